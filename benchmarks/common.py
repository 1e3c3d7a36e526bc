"""Shared by the benchmarks: data, people, the description of the machine, tables with targets.

Pixels, x right, y down, pixel centres at integers; RGB 0..255.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np

from guise.aam.landmarks import LbpDetector, interocular, load_annotations
from guise.aam.model import Identity
from guise.aam.tracker import Fit
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource, landmark_file
from guise.app.media import Frame, open_input
from guise.common.arrays import F64 as F64
from guise.common.arrays import U8

Picture = U8
Sense = Literal["<=", ">=", "<", ">"]

SHARED = Path(__file__).parents[2] / "shared"
RESULTS = Path(__file__).parent / "results"
LIBRARIES = ("numpy", "scipy", "opencv-contrib-python-headless", "av", "moderngl", "onnxruntime")


# -- data -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip and its landmarks: points (t, 81, 2) pixels, NaN where there is no face."""

    name: str
    video: Path
    points: F64

    @property
    def interocular(self) -> F64:
        """(t,) distance between the outer eye corners, pixels."""
        return np.asarray(interocular(self.points), np.float64)


def clip_at(video: Path, name: str | None = None) -> Clip:
    """A clip whose landmarks lie beside it."""
    file = landmark_file(video)
    if file is None:
        raise FileNotFoundError(f"{video.name} has no landmark file beside it")
    return Clip(name or video.stem, video, load_annotations(file).points.astype(np.float64))


def real_clip(shared: Path, name: str) -> Clip:
    """A clip of data/real."""
    return clip_at(shared / "data" / "real" / f"{name}.mp4")


def synthetic_clip(shared: Path, person: str, take: str = "talk") -> Clip:
    """A clip of data/synthetic/people."""
    return clip_at(shared / "data" / "synthetic" / "people" / person / f"{take}.mp4", f"{person}/{take}")


def synthetic_people(shared: Path) -> list[str]:
    """Names of the available synthetic people."""
    folder = shared / "data" / "synthetic" / "people"
    return sorted(p.parent.name for p in folder.glob("*/talk.mp4"))


def frames(clip: Clip) -> Iterator[Frame]:
    """The clip's frames, in order."""
    with open_input(clip.video) as media:
        yield from media


def enrolled(clip: Clip, share: float = 1.0) -> Identity:
    """A person enrolled on the first share of a clip with the landmarks beside it and default options."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "landmarks.npz"
        points = clip.points.astype(np.float32)
        points[round(share * len(points)) :] = np.nan
        np.savez(file, face81=points)
        return enrol([clip.video], LandmarkSource(files=[file]), name=clip.name)


def detector() -> LbpDetector:
    """The face detector that the commands use by default."""
    return LbpDetector()


def shape_of(fit: object) -> F64 | None:
    """The shape of a fit, or None for a failure."""
    return fit.shape if isinstance(fit, Fit) else None


def point_error(shape: F64, truth: F64) -> float:
    """Mean distance of two shapes (n, 2), pixels."""
    return float(np.linalg.norm(shape - truth, axis=1).mean())


# -- tables ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Criterion:
    """A measured value beside its target."""

    what: str
    measured: float
    sense: Sense
    target: float
    unit: str = ""

    @property
    def met(self) -> bool:
        """Whether the measured value satisfies the target; never with NaN.

        >>> Criterion("error", 1.9, "<=", 2.0, "%").met
        True
        """
        m, t = self.measured, self.target
        return bool({"<=": m <= t, ">=": m >= t, "<": m < t, ">": m > t}[self.sense])

    def cells(self, kept: float | None = None) -> tuple[str, ...]:
        """What, measured, what was kept of an earlier run, target, met or not."""
        before = "" if kept is None else shown(kept, self.unit)
        target = f"{self.sense} {shown(self.target, self.unit)}"
        return self.what, shown(self.measured, self.unit), before, target, "met" if self.met else "NOT MET"


@dataclass(frozen=True)
class Table:
    """Figures behind the criteria: a title, column names and rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[object]]


@dataclass
class Report:
    """What a benchmark found."""

    name: str
    title: str
    criteria: list[Criterion] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def markdown(self) -> str:
        """The report as Markdown."""
        kept = kept_figures(self.name)
        rows = [c.cells(kept.get(c.what)) for c in self.criteria]
        parts = [f"## {self.title}", "", markdown_table(("what", "measured", "kept", "target", ""), rows)]
        for table in self.tables:
            parts += ["", f"**{table.title}**", "", markdown_table(table.columns, table.rows)]
        return "\n".join(parts + [f"\n{note}" for note in self.notes]) + "\n"

    def plain(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        criteria = [asdict(c) | {"met": c.met} for c in self.criteria]
        tables = [asdict(t) for t in self.tables]
        return {
            "name": self.name,
            "title": self.title,
            "criteria": criteria,
            "tables": tables,
            "notes": self.notes,
        }


def shown(value: object, unit: str = "") -> str:
    """A cell's text: four significant digits at most.

    >>> shown(0.123456), shown(34.0, "dB"), shown(120.0), shown("p01")
    ('0.1235', '34 dB', '120', 'p01')
    """
    if isinstance(value, float | np.floating):
        text = f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    else:
        text = str(value)
    return f"{text} {unit}".rstrip()


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table, padded so that it reads well as text too."""
    cells = [[str(c) for c in columns], *([shown(v) for v in row] for row in rows)]
    widths = [max(3, *(len(row[i]) for row in cells)) for i in range(len(columns))]
    lines = ["| " + " | ".join(v.ljust(w) for v, w in zip(row, widths, strict=True)) + " |" for row in cells]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


# -- the machine ----------------------------------------------------------------------------------------------


def machine() -> dict[str, Any]:
    """Processor, cores, load, Python, libraries and revision with which the figures were taken."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "load": round(os.getloadavg()[0], 2),
        "system": platform.platform(),
        "python": platform.python_version(),
        "libraries": {name: _version(name) for name in LIBRARIES},
        "ffmpeg": _first_line(["ffmpeg", "-version"]),
        "revision": _first_line(["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]),
    }


def _processor() -> str:
    names = [
        s.split(":", 1)[1].strip()
        for s in Path("/proc/cpuinfo").read_text().splitlines()
        if "model name" in s
    ]
    return names[0] if names else platform.processor()


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"


def _first_line(command: Sequence[str]) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0]
    except (OSError, subprocess.CalledProcessError, IndexError):
        return "unknown"


# -- what is kept ---------------------------------------------------------------------------------------------


def kept_figures(name: str) -> dict[str, float]:
    """What a benchmark measured when its figures were kept, by what was measured; empty when they never were."""
    file = RESULTS / f"{name}.json"
    return dict(json.loads(file.read_text())["figures"]) if file.is_file() else {}


def keep(report: Report) -> None:
    """Keep a report's figures with the day, the revision and the kind of machine, beside those of earlier releases.

    Figures of the same release that this run has not measured stay, with the day and the revision of theirs.
    """
    here, file = machine(), RESULTS / f"{report.name}.json"
    content = {
        "day": datetime.now(UTC).date().isoformat(),
        "release": _version("guise-video"),
        **{name: here[name] for name in ("revision", "processor", "cores")},
        "figures": {c.what: float(f"{c.measured:.4g}") for c in report.criteria},
    }
    before = json.loads(file.read_text()) if file.is_file() else {}
    earlier = before.pop("earlier", [])
    if before.get("release", content["release"]) != content["release"]:
        earlier = [before, *earlier]
    elif left := {what: v for what, v in before.get("figures", {}).items() if what not in content["figures"]}:
        of = before.get("not_of_this_run", {})
        content["not_of_this_run"] = {w: of.get(w, [before["day"], before["revision"]]) for w in left}
        content["figures"] |= left
    RESULTS.mkdir(exist_ok=True)
    file.write_text(json.dumps(content | ({"earlier": earlier} if earlier else {}), indent=1) + "\n")


# -- the command ----------------------------------------------------------------------------------------------

SHARED_OPTIONS = ("shared", "peers_python", "landmarker", "parts", "work", "minutes")


def arguments(description: str | None, **defaults: object) -> argparse.ArgumentParser:
    """The options that every benchmark takes, whether it has a use for them or not; defaults as `set_defaults`."""
    parser = argparse.ArgumentParser(description=(description or "").split("\n")[0])
    add = parser.add_argument
    add("--shared", type=Path, default=SHARED, help="folder that holds data/ and models/")
    add("--json", type=Path, help="also write the figures here")
    add(
        "--keep",
        action="store_true",
        help="keep the figures in benchmarks/results, beside which new ones are shown",
    )
    add("--quick", action="store_true", help="do only part of the work, to check the script")
    add("--peers-python", type=Path, help="Python of the peers' environment, see README.md")
    add("--landmarker", default="builtin", help="the landmarker under test (default: builtin)")
    add("--parts", type=Path, help="folder of training/render_people.py; held-out people are used")
    add("--work", type=Path, help="keep models, videos and pictures here, and use those that are there")
    add("--minutes", type=float, help="length of the long run")
    parser.set_defaults(**defaults)
    return parser


def run(measure: Callable[[argparse.Namespace], Report], parser: argparse.ArgumentParser) -> None:
    """Measure, print, and write or keep the figures if requested."""
    options = parser.parse_args()
    if options.keep and options.quick:
        parser.error("--keep needs the whole run, got --quick")
    report = measure(options)
    if options.quick:
        report.notes.append("Quick run: do not quote these figures.")
    print(report.markdown())
    if options.keep:
        keep(report)
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        content = {"machine": machine(), "report": report.plain()}
        options.json.write_text(json.dumps(content, indent=1, default=float) + "\n")


def say(text: str) -> None:
    """Print progress on stderr."""
    print(text, file=sys.stderr, flush=True)
