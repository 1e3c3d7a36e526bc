"""Makes every weight that ships from nothing, in one go.

    python -m training.all --program DIR --data DATA --work WORK [--processes 2] [--only face,detector] [--ship]

DIR holds the renderer, DATA the folder with `pairs/london` and `real`, WORK gets everything that is made: rendered
parts and hands, a run for each network with its report and card. A step whose output is there is skipped and a broken
one goes on where it stopped, so the same command is run again until nothing is left to do. --ship copies the weights to
aam/data at the end.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

DATA = Path(__file__).parents[1] / "aam" / "data"
PEOPLE, PER_PERSON, HANDS = 1200, 30, 120
ALONE, STEPS, DETECTOR = 6000, 40_000, 6850  # batches: rendered people alone, everything, the detector


@dataclass(frozen=True)
class Step:
    """One command, and what is there when it is done.

    Parameters
    ----------
    name : str
    commands : run side by side; each is a module of `training` and its options
    output : None if it is always run
    """

    name: str
    commands: Sequence[tuple[str, ...]]
    output: Path | None

    def done(self) -> bool:
        """Whether there is nothing to do."""
        return self.output is not None and self.output.exists()


@dataclass(frozen=True)
class Plan:
    """Where things are and how large the training is."""

    program: Path
    data: Path
    work: Path
    processes: int = 2
    people: int = PEOPLE
    steps: int = STEPS
    device: str = "cpu"

    def steps_of(self) -> Iterator[Step]:
        """All steps in order."""
        parts, hands, alignment = self.work / "parts", self.work / "hands.npz", self.work / "alignment.json"
        alone, face, detector = (self.work / name for name in ("rendered", "face", "detector"))
        real = ("--real", str(self.data))
        yield Step("people", self._rendering(parts), parts / "complete")
        yield Step(
            "hands", [self._run("render_hands", hands, "--program", self.program, "--people", HANDS)], hands
        )
        train = ("--parts", str(parts), *real, "--hands", str(hands), "--resume", "--device", self.device)
        yield Step(
            "alone",
            [
                (
                    "train_face",
                    *train,
                    "--output",
                    str(alone),
                    "--scratch",
                    "--as-given",
                    "--steps",
                    str(ALONE),
                )
            ],
            alone / "complete",
        )
        first = str(alone / "face.pt")
        yield Step(
            "alignment",
            [
                (
                    "align_definitions",
                    "--weights",
                    first,
                    "--parts",
                    str(parts),
                    *real,
                    "--output",
                    str(alignment),
                )
            ],
            alignment,
        )
        given = ("--alignment", str(alignment))
        yield Step(
            "face",
            [
                (
                    "train_face",
                    *train,
                    *given,
                    "--output",
                    str(face),
                    "--first-weights",
                    first,
                    "--steps",
                    str(self.steps),
                )
            ],
            face / "complete",
        )
        finish = ("--run", str(face), "--parts", str(parts), *real, "--hands", str(hands), *given)
        yield Step("report", [("finish_face", *finish)], face / "face.md")
        yield Step(
            "detector",
            [
                (
                    "train_detector",
                    "--parts",
                    str(parts),
                    *real,
                    "--output",
                    str(detector),
                    "--steps",
                    str(DETECTOR),
                )
            ],
            detector / "detector.onnx",
        )
        photographs, recognition = self.data / "pairs" / "london", self.work / "recognition.npz"
        yield Step(
            "recognition",
            [
                (
                    "train_recognition",
                    "--parts",
                    str(parts),
                    "--photographs",
                    str(photographs),
                    "--output",
                    str(recognition),
                )
            ],
            recognition,
        )

    def _rendering(self, parts: Path) -> list[tuple[str, ...]]:
        """People shared out among the processes, whole parts each."""
        share = -(-self.people // (10 * self.processes)) * 10
        return [
            self._run(
                "render_people", parts, "--program", self.program, "--first", first,
                "--people", min(share, self.people - first), "--per-person", PER_PERSON,
            )
            for first in range(0, self.people, share)
        ]  # fmt: skip

    @staticmethod
    def _run(module: str, out: Path, *options: object) -> tuple[str, ...]:
        return (module, *map(str, options), "--out", str(out))

    def shipped(self) -> dict[Path, Path]:
        """Where each file goes when it ships."""
        face = self.work / "face"
        return {
            face / "landmarks.onnx": DATA / "landmarks.onnx",
            face / "landmarks.json": DATA / "landmarks.json",
            face / "face.md": DATA / "landmarks.md",
            self.work / "detector" / "detector.onnx": DATA / "detector.onnx",
            self.work / "recognition.npz": DATA / "recognition.npz",
            self.work / "alignment.json": Path(__file__).parent / "alignment.json",
        }


def perform(step: Step) -> None:
    """Run a step's commands side by side, one core each; a failure ends everything."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}
    running = [
        subprocess.Popen([sys.executable, "-m", f"training.{command[0]}", *command[1:]], env=environment)
        for command in step.commands
    ]
    codes = [process.wait() for process in running]
    if any(codes):
        raise SystemExit(f"{step.name} failed ({codes}); run the same command again when it is mended")
    if step.output is not None and step.output.name == "complete":
        step.output.touch()
    if step.output is not None and not step.output.exists():
        raise SystemExit(f"{step.name} ended without {step.output}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Make every weight that ships from nothing.")
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--data", type=Path, required=True, help="folder with pairs/london and real")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=2, help="that render side by side")
    parser.add_argument("--people", type=int, default=PEOPLE)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--device", default="cpu", help="cpu or cuda, for the networks")
    parser.add_argument("--only", help="names of steps, separated by commas")
    parser.add_argument(
        "--list", action="store_true", help="say what is done and what is left, and do nothing"
    )
    parser.add_argument("--ship", action="store_true", help="copy the weights to aam/data")
    options = parser.parse_args()
    plan = Plan(options.program, options.data, options.work, options.processes, options.people, options.steps)
    wanted = options.only.split(",") if options.only else [step.name for step in plan.steps_of()]
    for step in plan.steps_of():
        if step.name not in wanted or step.done() or options.list:
            print(f"{step.name}: {'done' if step.done() else 'to do'}", flush=True)
            continue
        start = time.time()
        perform(step)
        print(f"{step.name}: {time.time() - start:.0f} s", flush=True)
    if options.ship:
        for made, place in plan.shipped().items():
            shutil.copy(made, place)


if __name__ == "__main__":
    main()
