"""The work of a swapped frame in memory, on one thread: processor time beside another revision, and instructions.

Both revisions swap the same frames of the same clip in turn, each in a process of its own with models of its own, on
the Python and the libraries of this environment.  Instructions are callgrind's, of `COUNTED` frames after a few others:
they repeat where other load makes times noisy.  Valgrind shows programs a processor without AVX-512, so what has code
for it runs its AVX2 code, and OpenCV is held to AVX, as valgrind lacks an instruction of the rest.
"""

from __future__ import annotations

import argparse
import contextlib
import platform
import re
import shutil
import statistics
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.children import AS_INSTALLED, CommandError, PeerProcess, ran
from benchmarks.common import say
from benchmarks.threads import VARIABLES

ROOT = Path(__file__).parents[1]
GIT = ("git", "-C", str(ROOT))
CHILD = Path(__file__).with_name("frame_child.py")
WARM, STRETCH, STRETCHES = 12, 20, 10  # frames before any that count, frames in turn, and turns of each
COUNTED = 24  # frames whose instructions are counted: some work is done every 2nd, 4th or 12th
SAME_EACH_RUN = {"PYTHONHASHSEED": "0"} | dict.fromkeys(VARIABLES, "1")
UNDER_VALGRIND = {"OPENCV_CPU_DISABLE": "AVX2"}
COLLECTED = re.compile(r"Collected : (\d+)")


@dataclass(frozen=True)
class Revision:
    """A state of the code: what its processes get in their environment, and its models of person and donor."""

    environment: dict[str, str]
    models: tuple[Path, Path]

    @classmethod
    def enrolled(cls, tree: Path, clips: tuple[Path, Path], folder: Path) -> Revision:
        """Of a tree of files, with models of the people of two clips, written to a folder."""
        environment = AS_INSTALLED | SAME_EACH_RUN | {"PYTHONPATH": str(packages(tree, folder / "packages"))}
        models = folder / "person.guise", folder / "donor.guise"
        enrol(clips, models, environment)
        return cls(environment, models)


def enrol(
    clips: tuple[Path, Path], models: tuple[Path, Path], environment: Mapping[str, str] | None = None
) -> None:
    """Enrol two people, in processes of their own: Linux counts what a parent holds to the peak of its children."""
    for clip, model in zip(clips, models, strict=True):
        ran((sys.executable, CHILD, clip, model), environment=environment)


def packages(tree: Path, folder: Path) -> Path:
    """A folder from which Python imports the packages of a tree, before those that are installed."""
    places = tomllib.loads((tree / "pyproject.toml").read_text())["tool"]["setuptools"]["package-dir"]
    for name, place in places.items():
        package = folder.joinpath(*name.split("."))
        package.mkdir(parents=True, exist_ok=True)
        for entry in (tree / place).iterdir():
            (package / entry.name).symlink_to(entry)
    return folder


def known(revision: str) -> str:
    """A revision of this repository, as an option gives it.  argparse.ArgumentTypeError when it is not there."""
    if subprocess.run(
        (*GIT, "rev-parse", "--verify", "--quiet", revision + "^{commit}"), capture_output=True
    ).returncode:
        raise argparse.ArgumentTypeError(f"there is no revision {revision} in this repository")
    return revision


@contextlib.contextmanager
def checked_out(revision: str, folder: Path) -> Iterator[Path]:
    """The files of a revision of this repository, below a folder, for a while."""
    tree = folder / "tree"
    subprocess.run((*GIT, "worktree", "add", "--quiet", "--detach", tree, revision), check=True)
    try:
        yield tree
    finally:
        subprocess.run((*GIT, "worktree", "remove", "--force", tree), check=True)


def ratios(here: Revision, other: Revision, clip: Path) -> list[float]:
    """Processor time of one over the other, of each stretch of frames that both swap, one right after the other."""
    with contextlib.ExitStack() as stack:
        engines = []
        for one in (here, other):
            given = (CHILD, clip, *one.models, WARM + STRETCH * STRETCHES)
            engine = PeerProcess(Path(sys.executable), *given, environment=one.environment)
            engines.append(stack.enter_context(engine))
        for engine in engines:
            _swapped(engine, WARM)
        times = [[_swapped(engine, STRETCH) for engine in engines] for _ in range(STRETCHES)]
    own, others = (1e3 * statistics.median(t) / STRETCH for t in zip(*times, strict=True))
    say(f"{own:.1f} ms a frame beside {others:.1f}")
    return [own / others for own, others in times]


def _swapped(engine: PeerProcess, frames: int) -> float:
    engine.send(f"{frames}\n".encode())
    return float(engine.line())


def instructions(revision: Revision, clip: Path) -> float:
    """Instructions of a swapped frame."""
    count = ("valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "--instr-atstart=no")
    done = subprocess.run(
        [*count, sys.executable, CHILD, clip, *revision.models, str(WARM + COUNTED)],
        input=f"{WARM}\n{COUNTED}\n", env=revision.environment | UNDER_VALGRIND, capture_output=True, text=True,
    )  # fmt: skip
    found = COLLECTED.search(done.stderr)
    if done.returncode or found is None:
        raise CommandError(f"callgrind failed ({done.returncode}): {done.stderr[-400:]}")
    return int(found[1]) / COUNTED


def figures(clips: tuple[Path, Path], beside: str | None, folder: Path) -> dict[str, float]:
    """What a frame of the first clip takes, by what is measured; beside a revision the shares of what it takes there.

    clips : of the person in the frames and of the donor.   folder : an empty one.
    """
    counts = platform.machine() == "x86_64" and shutil.which("valgrind") is not None
    here, found = Revision.enrolled(ROOT, clips, folder / "here"), {}
    if counts:
        found["instructions a frame, millions"] = instructions(here, clips[0]) / 1e6
    if beside is None:
        return found
    with checked_out(beside, folder) as tree:
        other = Revision.enrolled(tree, clips, folder / "other")
        found["processor of a frame over " + beside] = statistics.median(ratios(here, other, clips[0]))
        if counts:
            own = found["instructions a frame, millions"]
            found["instructions of a frame over " + beside] = 1e6 * own / instructions(other, clips[0])
    return found
