"""Train every network from scratch, in one run.

    python -m training.all --program DIR --data DATA --work WORK [--processes 2] [--only face,detector] [--ship]

DIR holds the renderer, DATA the folders `pairs/london` and `real`. WORK receives all output: rendered parts and hands,
and one run for each network with its report and model card. Tasks whose output exists are skipped and interrupted ones
resume, so the same command can be repeated until nothing is left to do. --ship copies the weights to aam/data at the
end.
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
PEOPLE, PICTURES_PER_PERSON, HAND_PEOPLE = 1200, 30, 120
RENDERED_ONLY_BATCHES, FACE_BATCHES, PARSING_BATCHES, DETECTOR_BATCHES = 6000, 40_000, 20_000, 6850
GROUPS = 60  # of people whose faces are swapped


@dataclass(frozen=True)
class Task:
    """Commands that run in parallel, and the file that exists once they are done.

    Parameters
    ----------
    name : str
    commands : each is a module of `training` and its options
    output : None if it is always run
    """

    name: str
    commands: Sequence[tuple[str, ...]]
    output: Path | None

    def done(self) -> bool:
        """Whether the output exists."""
        return self.output is not None and self.output.exists()


@dataclass(frozen=True)
class Plan:
    """Folders and the size of the training."""

    program: Path
    data: Path
    work: Path
    processes: int = 2
    people: int = PEOPLE
    steps: int = FACE_BATCHES
    device: str = "cpu"
    groups: int = GROUPS

    def tasks(self) -> Iterator[Task]:
        """All tasks in order."""
        parts, hands, alignment = self.work / "parts", self.work / "hands.npz", self.work / "alignment.json"
        alone, face, parsing, detector = (
            self.work / name for name in ("rendered", "face", "parsing", "detector")
        )
        real = ("--real", str(self.data))
        yield Task("people", self._rendering(parts), parts / "complete")
        yield Task(
            "hands",
            [self._run("render_hands", hands, "--program", self.program, "--people", HAND_PEOPLE)],
            hands,
        )
        train = ("--parts", str(parts), *real, "--hands", str(hands), "--resume", "--device", self.device)
        yield Task(
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
                    str(RENDERED_ONLY_BATCHES),
                )
            ],
            alone / "complete",
        )
        first = str(alone / "face.pt")
        yield Task(
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
        yield Task(
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
        yield Task("report", [("finish_face", *finish)], face / "face.md")
        parse = ("--goal", "parsing", "--first-weights", str(face / "face.pt"), "--output", str(parsing))
        yield Task(
            "parsing",
            [("train_face", *train, *given, *parse, "--steps", str(PARSING_BATCHES))],
            parsing / "complete",
        )
        finish = ("--run", str(parsing), *finish[2:])
        yield Task("parsing report", [("finish_parsing", *finish)], parsing / "face.md")
        solid = self.work / "solid_shape.npz"
        yield Task(
            "solid shape",
            [self._run("solid_shape", solid, "--parts", parts, "--program", self.program)],
            solid,
        )
        relief = self.work / "relief.npz"
        yield Task("relief", [("relief", "--program", str(self.program), "--out", str(relief))], relief)
        yield Task(
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
                    str(DETECTOR_BATCHES),
                )
            ],
            detector / "detector.onnx",
        )
        photographs, recognition = self.data / "pairs" / "london", self.work / "recognition.npz"
        yield Task(
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

        swaps, light = self.work / "swaps", self.work / "light"
        yield Task("swaps", self._swaps(swaps), swaps / "complete")
        yield Task("light", [self._light(swaps, light)], light / "light.md")
        places = self.work / "placement.npz"
        yield Task("placement", [("placement", "--swaps", str(swaps), "--out", str(places))], places)

    def _light(self, swaps: Path, output: Path) -> tuple[str, ...]:
        photographs = str(self.data / "pairs" / "london")
        return ("train_light", "--swaps", str(swaps), "--photographs", photographs, "--output", str(output))

    def _swaps(self, parts: Path) -> list[tuple[str, ...]]:
        """Commands that divide the groups of four people among the processes."""
        share = -(-self.groups // self.processes)
        return [
            self._run(
                "render_swaps", parts, "--program", self.program, "--first", first,
                "--groups", min(share, self.groups - first),
            )
            for first in range(0, self.groups, share)
        ]  # fmt: skip

    def _rendering(self, parts: Path) -> list[tuple[str, ...]]:
        """Commands that divide the people among the processes, in whole parts."""
        share = -(-self.people // (10 * self.processes)) * 10
        return [
            self._run(
                "render_people", parts, "--program", self.program, "--first", first,
                "--people", min(share, self.people - first), "--per-person", PICTURES_PER_PERSON,
            )
            for first in range(0, self.people, share)
        ]  # fmt: skip

    @staticmethod
    def _run(module: str, out: Path, *options: object) -> tuple[str, ...]:
        return (module, *map(str, options), "--out", str(out))

    def shipped(self) -> dict[Path, Path]:
        """Destination of each file that ships."""
        face, parsing = self.work / "face", self.work / "parsing"
        return {
            face / "landmarks.onnx": DATA / "landmarks.onnx",
            face / "landmarks.json": DATA / "landmarks.json",
            face / "face.md": DATA / "landmarks.md",
            parsing / "face.onnx": DATA / "face.onnx",
            parsing / "face.md": DATA / "face.md",
            self.work / "detector" / "detector.onnx": DATA / "detector.onnx",
            self.work / "recognition.npz": DATA / "recognition.npz",
            self.work / "light" / "light.onnx": DATA / "light.onnx",
            self.work / "light" / "light.md": DATA / "light.md",
            self.work / "placement.npz": DATA / "placement.npz",
            self.work / "solid_shape.npz": DATA / "solid_shape.npz",
            self.work / "relief.npz": DATA / "relief.npz",
            self.work / "alignment.json": Path(__file__).parent / "alignment.json",
        }


def perform(task: Task) -> None:
    """Run a task's commands in parallel, one core each; exit if one of them fails."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}
    running = [
        subprocess.Popen([sys.executable, "-m", f"training.{command[0]}", *command[1:]], env=environment)
        for command in task.commands
    ]
    codes = [process.wait() for process in running]
    if any(codes):
        raise SystemExit(
            f"{task.name} failed (exit codes {codes}); fix the cause and run the same command again"
        )
    if task.output is not None and task.output.name == "complete":
        task.output.touch()
    if task.output is not None and not task.output.exists():
        raise SystemExit(f"{task.name} finished without writing {task.output}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Train every network from scratch.")
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--data", type=Path, required=True, help="folder with pairs/london and real")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=2, help="renderers that run in parallel")
    parser.add_argument("--people", type=int, default=PEOPLE)
    parser.add_argument("--steps", type=int, default=FACE_BATCHES)
    parser.add_argument("--device", default="cpu", help="cpu or cuda, for the networks")
    parser.add_argument("--only", help="names of tasks, separated by commas")
    parser.add_argument(
        "--list", action="store_true", help="list the tasks and whether they are done, then exit"
    )
    parser.add_argument("--ship", action="store_true", help="copy the weights to aam/data")
    options = parser.parse_args()
    plan = Plan(
        options.program,
        options.data,
        options.work,
        options.processes,
        options.people,
        options.steps,
        options.device,
    )
    wanted = options.only.split(",") if options.only else [task.name for task in plan.tasks()]
    for task in plan.tasks():
        if task.name not in wanted or task.done() or options.list:
            print(f"{task.name}: {'done' if task.done() else 'to do'}", flush=True)
            continue
        start = time.time()
        perform(task)
        print(f"{task.name}: {time.time() - start:.0f} s", flush=True)
    if options.ship:
        for made, place in plan.shipped().items():
            shutil.copy(made, place)


if __name__ == "__main__":
    main()
