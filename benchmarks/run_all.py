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

NAMES = (
    "roundtrip",
    "tracker_synthetic",
    "tracker_real",
    "tracker_scenes",
    "unswapped",
    "tracker_speed",
    "transfer",
    "frame_time",
    "file_to_file",
    "speed",
    "identity",
    "enrolment",
    "structure",
    "startup",
    "fuzz",
    "self_calibration",
    "recognition",
    "memory",
)
LANDMARKS = (
    "landmarks.stills",
    "landmarks.real_clips",
    "landmarks.small_faces",
    "landmarks.rendered",
    "landmarks.rolls",
    "landmarks.head_pose",
    "landmarks.gaze",
    "landmarks.expressions",
    "landmarks.parsing",
    "landmarks.jitter",
    "landmarks.speed",
    "landmarks.footprint",
    "landmarks.false_faces",
    "landmarks.calibration",
)
DEIDENTIFY = (
    "deidentify.leaks",
    "deidentify.identity",
    "deidentify.attack",
    "deidentify.voice",
    "deidentify.expression",
    "deidentify.swapped",
    "deidentify.speed",
    "deidentify.memory",
    "deidentify.resumed",
    "deidentify.cluster",
    "deidentify.scaling",
)
LIVE = (
    "live.throughput",
    "live.latency",
    "live.start",
    "live.closed",
    "live.studio",
    "live.browser",
    "live.soak",
)
IMAGE = (
    "image.onto_itself",
    "image.across",
    "image.light",
    "image.crossings",
    "image.speed",
)
MESH = (
    "mesh.transfer",
    "mesh.people",
    "mesh.correspondence",
    "mesh.cylinder",
    "mesh.landmarks",
    "mesh.production",
    "mesh.large_rig",
    "mesh.speed",
)
PICTURE = (
    "picture.truth",
    "picture.turned",
    "picture.pairs",
    "picture.grade",
    "picture.ideal",
    "picture.exemplars",
)
PEOPLE = (
    "people.photo",
    "people.several",
    "people.studio",
)
ALL = (*NAMES, *LANDMARKS, *PICTURE, *PEOPLE, *DEIDENTIFY, *LIVE, *MESH, *IMAGE)
WITH_PEERS = (
    "tracker_speed", "file_to_file", "landmarks.stills", "landmarks.small_faces", "landmarks.speed",
    "deidentify.leaks", "deidentify.expression", "deidentify.speed", "picture.pairs",
    "picture.grade", "picture.ideal", "people.photo",
)  # fmt: skip
WITH_PARTS = ("landmarks.rendered", "landmarks.head_pose", "landmarks.parsing", "landmarks.calibration")


def arguments_of(name: str, options: argparse.Namespace, file: Path) -> list[str]:
    """What a benchmark is given."""
    given = ["--shared", str(options.shared), "--json", str(file)]
    if options.quick:
        given.append("--quick")
    if name in WITH_PEERS and options.peers_python:
        given += ["--peers-python", str(options.peers_python)]
    if name in LANDMARKS:
        given += ["--landmarker", options.landmarker]
    if name in PICTURE or name == "people.photo":
        given += ["--work", str(options.output / "picture")]
    if name in WITH_PARTS and options.parts:
        given += ["--parts", str(options.parts)]
    if name.endswith("memory"):
        given += ["--minutes", str(options.minutes)]
    if name == "live.soak":
        given += ["--minutes", str(options.soak_minutes)]
    if name == "identity":
        given += ["--sheets", str(options.output / "sheets")]
    return given


def result(name: str, options: argparse.Namespace) -> dict[str, Any] | None:
    """A benchmark's JSON, or None when it failed."""
    file = options.output / f"{name}.json"
    file.unlink(missing_ok=True)
    common.say(f"== {name}")
    command = [sys.executable, "-m", f"benchmarks.{name}", *arguments_of(name, options, file)]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], stdout=subprocess.DEVNULL, check=False)
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
    rows = [(r.title, *c.cells()) for r in reports for c in r.criteria]
    missed = sum(not c.met for r in reports for c in r.criteria)
    parts = [
        f"# Benchmarks, {day}, revision {machine['revision']}",
        "",
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load']} at the end; {machine['system']}; "
        f"Python {machine['python']}; {libraries}; {machine['ffmpeg']}.",
        "",
        f"{len(rows) - missed} of {len(rows)} targets met.",
        "",
        common.markdown_table(("benchmark", "what", "measured", "target", ""), rows),
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
    made = common.with_peers(common.arguments(__doc__))
    made.add_argument("--output", type=Path, default=Path("out/benchmarks"), help="folder for the figures")
    made.add_argument("--only", nargs="+", choices=ALL, help="some of the benchmarks")
    made.add_argument("--landmarker", default="builtin", help="the landmarker of the landmarks benchmarks")
    made.add_argument("--parts", type=Path, help="rendered parts for the landmarks benchmarks")
    made.add_argument("--minutes", type=float, default=10.0, help="length of the memory runs")
    made.add_argument("--soak-minutes", type=float, default=60.0, help="length of the long live run")
    return made


if __name__ == "__main__":
    raise SystemExit(1 if run_all(parser().parse_args()) else 0)
