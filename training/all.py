"""Train every network from scratch, in one run.

    python -m training.all --program DIR --data DATA --work WORK [--processes 2] [--only face,detector] [--ship]

DIR holds the renderer, DATA the folders `pairs/london` and `real`. WORK receives all output: rendered parts and hands,
and one run for each network with its report and model card. Tasks whose output exists are skipped and interrupted ones
resume, so the same command can be repeated until nothing is left to do. --ship copies the weights to aam/data at the
end. --scale 0.01 goes through all of it with so small a share of the pictures and batches, to see that it runs.
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
SAMPLES = Path(__file__).parents[1] / "sample_videos"
PEOPLE, PICTURES_PER_PERSON, HAND_PEOPLE = 1200, 30, 120
RENDERED_ONLY_BATCHES, FACE_BATCHES, PARSING_BATCHES, DETECTOR_BATCHES = 6000, 40_000, 20_000, 6850
LANDMARK_BATCHES, LANDMARK_BATCH = 7000, 128
REFINEMENT_BATCHES, REFINEMENT_RATE = 2200, 5e-4  # of 32
HEAD_PEOPLE, FIRST_HEAD, PICTURES_PER_HEAD = 560, 30_000, 12
HEAD_COURSES = (6500, 6e-4), (5000, 4e-4)  # batches of 32, rate
AUDIT_PEOPLE, FIRST_AUDIT, PICTURES_PER_AUDIT, AUDIT_BATCHES = 150, 40_000, 12, 5000  # people of its own
MISTAKEN, FACE_SHARDS, FACE_SECONDS = 8000, 60, 2400  # pictures, of each process, of training
GROUPS = 60  # of people whose faces are swapped
TURNING_PEOPLE = 600
PLACEMENT_BATCHES = 4000
SOLID_PEOPLE, RELIEF_PEOPLE = 500, 60


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


def command(module: str, *flags: str, **values: object) -> tuple[str, ...]:
    """A module of `training` with its options."""
    return (module, *flags, *options(**values))


def options(**values: object) -> tuple[str, ...]:
    """As words of a command line: "--first-weights", "face.pt" for first_weights="face.pt"."""
    return tuple(
        word
        for name, value in values.items()
        for word in (f"--{name.replace('_', '-')}", *map(str, value if isinstance(value, list) else [value]))
    )


@dataclass(frozen=True)
class Plan:
    """Folders and the size of the training.

    scale : share in (0, 1] of every number of pictures and of batches.
    """

    program: Path
    data: Path
    work: Path
    processes: int = 2
    people: int = PEOPLE
    steps: int = FACE_BATCHES
    device: str = "cpu"
    groups: int = GROUPS
    scale: float = 1.0

    def tasks(self) -> Iterator[Task]:
        """All tasks in order."""
        yield from self._pictures()
        yield from self._landmark_training()
        yield from self._parsing_training()
        yield from self._head_training()
        yield from self._other_models()
        yield from self._placement_training()
        yield from self._view_training()

    @property
    def _parts(self) -> Path:
        return self.work / "parts"

    @property
    def _photographs(self) -> Path:
        return self.data / "pairs" / "london"

    def _seen(self) -> dict[str, object]:
        """What the networks of the face are trained on and measured with."""
        return {"parts": self._parts, "real": self.data, "hands": self.work / "hands.npz"}

    def _sized(self, number: int, least: int = 10) -> int:
        """That share of a number that is asked for, and not less than some."""
        return min(number, max(least, round(self.scale * number)))

    def _pictures(self) -> Iterator[Task]:
        people = self._sized(self.people, 40)
        render = self._rendering(self._parts, 0, people, per_person=PICTURES_PER_PERSON)
        yield Task("people", render, self._parts / "complete")
        hands = self.work / "hands.npz"
        render = command("render_hands", program=self.program, people=self._sized(HAND_PEOPLE), out=hands)
        yield Task("hands", [render], hands)

    def _landmark_training(self) -> Iterator[Task]:
        """On rendered faces alone, which tells how real annotations differ, then on both, then for points alone."""
        alone, face, alignment = self.work / "rendered", self.work / "face", self.work / "alignment.json"
        train = command("train_face", "--resume", device=self.device, **self._seen())
        first = options(output=alone, steps=self._sized(RENDERED_ONLY_BATCHES))
        yield Task("alone", [(*train, "--scratch", "--as-given", *first)], alone / "complete")
        weights = alone / "face.pt"
        align = command(
            "align_definitions", weights=weights, parts=self._parts, real=self.data, output=alignment
        )
        yield Task("alignment", [align], alignment)
        both = options(alignment=alignment, output=face, first_weights=weights, steps=self._sized(self.steps))
        yield Task("face", [(*train, *both)], face / "complete")
        landmarks, weights = self.work / "landmarks", face / "face.pt"
        points = options(
            goal="landmarks", alignment=alignment, output=landmarks, first_weights=weights,
            steps=self._sized(LANDMARK_BATCHES), batch=LANDMARK_BATCH,
        )  # fmt: skip
        yield Task("landmarks", [(*train, *points)], landmarks / "complete")
        told = self.work / "told"
        fit = command(
            "face_logit", run=landmarks, parts=self._parts, hands=self.work / "hands.npz", output=told
        )
        yield Task("logit", [fit], told / "face.pt")
        finish = command("finish_face", run=told, alignment=alignment, **self._seen())
        yield Task("report", [finish], told / "face.md")
        yield from self._face_head_training(told / "landmarks.onnx", self.work / "face head")

    def _face_head_training(self, network: Path, output: Path) -> Iterator[Task]:
        """What tells faces from other things, also behind patterns."""
        mistaken, shards, held = (self.work / name for name in ("mistaken.npz", "shards", "held shards"))
        find = command("mistaken", output=mistaken, pictures=self._sized(MISTAKEN), **self._seen())
        yield Task("mistaken", [find], mistaken)
        make = ("face_head", "make", *options(network=network, **self._seen()))
        count = self._sized(FACE_SHARDS, 1)
        seen = (*make, *options(output=shards, shards=count, mistaken=mistaken))
        yield Task("shards", [(*seen, *options(seed=k)) for k in range(self.processes)], shards / "complete")
        yield Task("held shards", [(*make, "--held-out", *options(output=held, shards=2))], held / "complete")
        learn = options(
            network=network, shards=shards, held_out=held, output=output, seconds=self._sized(FACE_SECONDS)
        )
        yield Task("face head", [("face_head", "train", *learn)], output / "landmarks.onnx")

    def _parsing_training(self) -> Iterator[Task]:
        """For everything first, then with the outlines of hands weighted and without points."""
        face, parsing, refined = self.work / "face", self.work / "parsing", self.work / "refined"
        given = {"alignment": self.work / "alignment.json", **self._seen()}
        train = command(
            "train_face", "--resume", goal="parsing", device=self.device, first_weights=face / "face.pt",
            output=parsing, steps=self._sized(PARSING_BATCHES), **given,
        )  # fmt: skip
        yield Task("parsing", [train], parsing / "complete")
        refine = command(
            "train_face", "--resume", goal="refinement", device=self.device, first_weights=parsing / "face.pt",
            output=refined, steps=self._sized(REFINEMENT_BATCHES), rate=REFINEMENT_RATE, batch=32, **given,
        )  # fmt: skip
        yield Task("refinement", [refine], refined / "complete")
        yield Task("parsing report", [command("finish_parsing", run=refined, **given)], refined / "face.md")

    def _head_training(self) -> Iterator[Task]:
        """The parsing of whole heads, from that of faces, in two courses."""
        parts, first, head = self.work / "head parts", self.work / "first head", self.work / "head"
        render = self._rendering(
            parts,
            FIRST_HEAD,
            self._sized(HEAD_PEOPLE, 40),
            per_person=PICTURES_PER_HEAD,
            size=208,
            hands=0.12,
        )
        share = ("--face-share", "0.25", "0.31")
        yield Task("heads", [(*one, *share) for one in render], parts / "complete")
        given = {"parts": parts, "real": self.data, "alignment": self.work / "alignment.json"}
        weights = self.work / "refined" / "face.onnx"
        for run, (steps, rate) in zip((first, head), HEAD_COURSES, strict=True):
            train = command(
                "train_face", "--resume", goal="head", device=self.device, output=run, steps=self._sized(steps),
                rate=rate, batch=32, seed=1 + (run == head), first_weights=weights, **given,
            )  # fmt: skip
            yield Task(run.name, [train], run / "complete")
            weights = run / "face.pt"
        yield Task("head report", [command("finish_head", run=head, **given)], head / "head.md")

    def _other_models(self) -> Iterator[Task]:
        solid, relief = self.work / "solid_shape.npz", self.work / "relief.npz"
        yield Task(
            "solid shape",
            [
                command(
                    "solid_shape", parts=self._parts, program=self.program, people=self._sized(SOLID_PEOPLE),
                    out=solid,
                )
            ],
            solid,
        )  # fmt: skip
        known = command("relief", program=self.program, people=self._sized(RELIEF_PEOPLE), out=relief)
        yield Task("relief", [known], relief)
        shading = self.work / "shading.npz"
        yield Task("shading", [command("shading", real=self.data, out=shading)], shading)
        detector, recognition = self.work / "detector", self.work / "recognition.npz"
        train = command(
            "train_detector",
            parts=self._parts,
            real=self.data,
            output=detector,
            steps=self._sized(DETECTOR_BATCHES),
        )
        yield Task("detector", [train], detector / "detector.onnx")
        rounded = self.work / "detector.onnx"
        clips = [*(self.data / "real").glob("g*_*.m*"), *SAMPLES.glob("*/talk2.mp4")]
        made = command("round_detector", network=detector / "detector.onnx", clips=clips, out=rounded)
        yield Task("rounded detector", [made], rounded)
        parts, audit = self.work / "audit parts", self.work / "audit"
        people = self._sized(AUDIT_PEOPLE, 40)
        render = self._rendering(parts, FIRST_AUDIT, people, per_person=PICTURES_PER_AUDIT)
        yield Task("audit people", render, parts / "complete")
        train = command(
            "train_audit",
            "--resume",
            parts=parts,
            real=self.data,
            output=audit,
            steps=self._sized(AUDIT_BATCHES),
        )
        yield Task("audit", [train], audit / "audit.onnx")
        rounded = self.work / "audit.onnx"
        made = command("round_audit", network=audit / "audit.onnx", clips=clips, out=rounded)
        yield Task("rounded audit", [made], rounded)
        train = command(
            "train_recognition", parts=self._parts, photographs=self._photographs, output=recognition
        )
        yield Task("recognition", [train], recognition)

    def _placement_training(self) -> Iterator[Task]:
        swaps, places = self.work / "swaps", self.work / "placement.npz"
        yield Task("swaps", self._swaps(swaps), swaps / "complete")
        place = command("placement", swaps=swaps, steps=self._sized(PLACEMENT_BATCHES), out=places)
        yield Task("placement", [place], places)

    def _view_training(self) -> Iterator[Task]:
        turns, views = self.work / "turns", self.work / "views.npz"
        render = command(
            "render_turns", program=self.program, out=turns, count=self._sized(TURNING_PEOPLE, 20)
        )
        yield Task("turns", [render], turns / "complete")
        yield Task("views", [command("views", turns=turns, out=views)], views)
        points = self.work / "point_correction.npz"
        correct = command("point_correction", swaps=self.work / "swaps", turns=turns, out=points)
        yield Task("points", [correct], points)

    def _swaps(self, parts: Path) -> list[tuple[str, ...]]:
        """Commands that divide the groups of four people among the processes."""
        groups = self._sized(self.groups)
        share = -(-groups // self.processes)
        return [
            command(
                "render_swaps", program=self.program, first=first, count=min(share, groups - first),
                out=parts,
            )
            for first in range(0, groups, share)
        ]  # fmt: skip

    def _rendering(self, parts: Path, first: int, people: int, **given: object) -> list[tuple[str, ...]]:
        """Commands that divide people, from that number on, among the processes, in whole parts."""
        share = -(-people // (10 * self.processes)) * 10
        render = command("render_people", program=self.program, out=parts, **given)
        return [
            (*render, *options(first=first + k, people=min(share, people - k)))
            for k in range(0, people, share)
        ]

    def shipped(self) -> dict[Path, Path]:
        """Destination of each file that ships."""
        told, refined = self.work / "told", self.work / "refined"
        return {
            self.work / "face head" / "landmarks.onnx": DATA / "landmarks.onnx",
            told / "landmarks.json": DATA / "landmarks.json",
            told / "face.md": DATA / "landmarks.md",
            refined / "face.onnx": DATA / "face.onnx",
            refined / "face.md": DATA / "face.md",
            self.work / "head" / "head.onnx": DATA / "head.onnx",
            self.work / "head" / "head.md": DATA / "head.md",
            self.work / "detector.onnx": DATA / "detector.onnx",
            self.work / "audit.onnx": DATA / "audit.onnx",
            self.work / "recognition.npz": DATA / "recognition.npz",
            self.work / "placement.npz": DATA / "placement.npz",
            self.work / "views.npz": DATA / "views.npz",
            self.work / "point_correction.npz": DATA / "point_correction.npz",
            self.work / "solid_shape.npz": DATA / "solid_shape.npz",
            self.work / "relief.npz": DATA / "relief.npz",
            self.work / "shading.npz": DATA / "shading.npz",
            self.work / "shading.md": DATA / "shading.md",
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
    parser.add_argument(
        "--scale", type=float, default=1.0, help="share of all pictures and batches, to try the whole run"
    )
    parser.add_argument("--device", default="cpu", help="cpu or cuda, for the networks")
    parser.add_argument("--only", help="names of tasks, separated by commas")
    parser.add_argument(
        "--list", action="store_true", help="list the tasks and whether they are done, then exit"
    )
    parser.add_argument("--ship", action="store_true", help="copy the weights to aam/data")
    given = parser.parse_args()
    plan = Plan(
        given.program, given.data, given.work, given.processes, given.people, given.steps, given.device,
        scale=given.scale,
    )  # fmt: skip
    wanted = given.only.split(",") if given.only else [task.name for task in plan.tasks()]
    for task in plan.tasks():
        if task.name not in wanted or task.done() or given.list:
            print(f"{task.name}: {'done' if task.done() else 'to do'}", flush=True)
            continue
        start = time.time()
        perform(task)
        print(f"{task.name}: {time.time() - start:.0f} s", flush=True)
    if given.ship:
        for made, place in plan.shipped().items():
            shutil.copy(made, place)


if __name__ == "__main__":
    main()
