"""How soon Guise answers, each time in a fresh process: `import guise`, `guise --version`, and a first face.

The first face is that of a 640 x 480 frame, from the first line of a new Python process on: import, opening the
landmarker and finding; the target holds for processor time on one thread, which other load hardly changes.  Beside it
the size of the weights in the package.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

import guise
from benchmarks import common
from benchmarks.children import ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.threads import VARIABLES

ROUNDS = 9
WEIGHTS = (".onnx", ".npz", ".safetensors", ".tflite")
ROOT = Path(__file__).parents[1]
IMPORT = "import time; start = time.perf_counter(); import guise; print(time.perf_counter() - start)"
FIRST_FACE = """
import sys, time
start = time.process_time()
import guise
faces = next(guise.landmarks(sys.argv[1]))
assert len(faces) == 1
print(time.process_time() - start)
"""


def said(code: str, *arguments: str) -> float:
    """The number that a new Python process prints."""
    command = [sys.executable, "-c", code, *arguments]
    one = os.environ | dict.fromkeys(VARIABLES, "1")
    return float(subprocess.run(command, capture_output=True, text=True, check=True, env=one).stdout)


def measure(options: argparse.Namespace) -> Report:
    """All three, in turn; the first round fills the caches and does not count."""
    clip = str(ROOT / "sample_videos" / "p01" / "talk.mp4")
    taken: dict[str, list[float]] = {"import guise, ms": [], "guise --version, s": [], "first face, s": []}
    for _ in range(1 + (3 if options.quick else ROUNDS)):
        version = ran([sys.executable, "-m", "guise", "--version"]).seconds
        for values, value in zip(
            taken.values(), (1000 * said(IMPORT), version, said(FIRST_FACE, clip)), strict=True
        ):
            values.append(value)
    found = [values[1:] for values in taken.values()]
    files = [
        file
        for file in sorted((Path(guise.__file__).parents[1] / "aam").rglob("*"))
        if file.suffix in WEIGHTS
    ]
    sizes = [(file.name, file.stat().st_size / 1e6) for file in files]
    middle = [statistics.median(values) for values in found]
    return Report(
        "startup", "Start of the package and of the command",
        [
            Criterion("import guise, median", middle[0], "<=", 60.0, "ms"),
            Criterion("guise --version, median", middle[1], "<=", 0.2, "s"),
            Criterion("import and first face, processor, median", middle[2], "<=", 1.0, "s"),
            Criterion("all weights in the package", sum(size for _, size in sizes), "<=", 8.0, "MB"),
        ],
        [
            Table("Range", ("what", "least", "most"),
                  [(name, min(v), max(v)) for name, v in zip(taken, found, strict=True)]),
            Table("Weights", ("file", "MB"), sizes),
        ],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
