"""Run every benchmark, one after the other, and write the figures as Markdown and JSON into a folder.

Each runs in its own process, with its own threads and memory.  One that fails is reported, and the rest continue.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.common import Criterion, Report, Table

HERE = Path(__file__).parent
ALL = tuple(
    sorted(
        ".".join(path.relative_to(HERE).with_suffix("").parts)
        for path in HERE.rglob("*.py")
        if "common.run(measure" in path.read_text() and path != Path(__file__)
    )
)


def arguments_of(options: argparse.Namespace, file: Path) -> list[str]:
    """What each benchmark is given."""
    told = {name: getattr(options, name) for name in common.SHARED_OPTIONS}
    given = [f"--{name.replace('_', '-')}={value}" for name, value in told.items() if value is not None]
    switches = [f"--{name}" for name in ("quick", "keep") if getattr(options, name)]
    return [*given, *switches, "--json", str(file)]


def result(name: str, options: argparse.Namespace) -> dict[str, Any] | None:
    """A benchmark's JSON, or None when it failed."""
    file = options.output / f"{name}.json"
    file.unlink(missing_ok=True)
    common.say(f"== {name}")
    command = [sys.executable, "-m", f"benchmarks.{name}", *arguments_of(options, file)]
    done = subprocess.run(command, cwd=HERE.parent, stdout=subprocess.DEVNULL, check=False)
    return json.loads(file.read_text()) if done.returncode == 0 and file.is_file() else None


def report_of(content: dict[str, Any]) -> Report:
    """A report from its JSON."""
    plain = content["report"]
    criteria = [Criterion(**{k: v for k, v in c.items() if k != "met"}) for c in plain["criteria"]]
    return Report(
        plain["name"], plain["title"], criteria, [Table(**t) for t in plain["tables"]], plain["notes"]
    )


def markdown(reports: Sequence[Report], failed: Sequence[str], machine: dict[str, Any], day: str) -> str:
    """One page: the machine, all targets, then every benchmark."""
    libraries = ", ".join(f"{k} {v}" for k, v in machine["libraries"].items())
    rows = [(r.title, *c.cells(common.kept_figures(r.name).get(c.what))) for r in reports for c in r.criteria]
    missed = sum(not c.met for r in reports for c in r.criteria)
    parts = [
        f"# Benchmarks, {day}, revision {machine['revision']}",
        "",
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load']} at the end; {machine['system']}; "
        f"Python {machine['python']}; {libraries}; {machine['ffmpeg']}.",
        "",
        f"{len(rows) - missed} of {len(rows)} targets met.",
        "",
        common.markdown_table(("benchmark", "what", "measured", "kept", "target", ""), rows),
        "",
        *(f"**{name} failed**: no figures.\n" for name in failed),
        *(r.markdown() for r in reports),
    ]
    return "\n".join(parts)


def run_all(options: argparse.Namespace) -> int:
    """Run, write RESULTS.md and results.json, and return the number of benchmarks that failed."""
    options.output.mkdir(parents=True, exist_ok=True)
    contents = {name: result(name, options) for name in options.only or ALL}
    reports = [report_of(c) for c in contents.values() if c is not None]
    failed = [name for name, c in contents.items() if c is None]
    machine, day = common.machine(), datetime.now(UTC).date().isoformat()
    text = markdown(reports, failed, machine, day)
    (options.output / "RESULTS.md").write_text(text)
    plain = {"day": day, "machine": machine, "failed": failed, "reports": [r.plain() for r in reports]}
    (options.output / "results.json").write_text(json.dumps(plain, indent=1, default=float) + "\n")
    print(text)
    return len(failed)


def parser() -> argparse.ArgumentParser:
    """Options of all benchmarks together."""
    made = common.arguments(__doc__)
    made.add_argument("--output", type=Path, default=Path("out/benchmarks"), help="folder for the figures")
    made.add_argument("--only", nargs="+", choices=ALL, help="some of the benchmarks")
    return made


if __name__ == "__main__":
    raise SystemExit(1 if run_all(parser().parse_args()) else 0)
