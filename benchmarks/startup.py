"""How soon the package and the command answer, each in a fresh process: `import guise` and `guise --version`."""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys

from benchmarks import common
from benchmarks.children import ran
from benchmarks.common import Criterion, Report, Table

ROUNDS = 9
IMPORT = "import time; start = time.perf_counter(); import guise; print(time.perf_counter() - start)"


def measure(options: argparse.Namespace) -> Report:
    """Both, in turn; the first round fills the caches and does not count."""
    imports, versions = [], []
    for _ in range(1 + (3 if options.quick else ROUNDS)):
        done = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True)
        imports.append(1000 * float(done.stdout))
        versions.append(ran([sys.executable, "-m", "guise", "--version"]).seconds)
    imports, versions = imports[1:], versions[1:]
    return Report(
        "startup",
        "Start of the package and of the command",
        [
            Criterion("import guise, median", statistics.median(imports), "<=", 60.0, "ms"),
            Criterion("guise --version, median", statistics.median(versions), "<=", 0.2, "s"),
        ],
        [
            Table(
                "Range",
                ("what", "least", "most"),
                [
                    ("import guise, ms", min(imports), max(imports)),
                    ("guise --version, s", min(versions), max(versions)),
                ],
            )
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
