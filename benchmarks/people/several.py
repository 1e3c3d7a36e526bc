"""Several people: who is who after they cross, a clip cut from two, and a second swap of the same video.

Rendered people are composed on plain ground: two cross in front of one another, or one follows the other by a cut.
Where each is found is compared with the truth, and the crossing is swapped both ways by the command.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from benchmarks import common
from benchmarks.children import GUISE, CommandError
from benchmarks.common import Criterion, Report, Table
from guise.aam.landmarks.schemes import FOREHEAD
from guise.app.media import open_input
from guise.app.people.finding import find_people
from guise.common.arrays import F64, U8

NAME, TITLE = "people.several", "People: crossings, cuts, second swaps"
PAIRS = (("p01", "p06"), ("p02", "p05"), ("p03", "p07"))
FRAMES, FPS, WIDTH, HEIGHT = 150, 30, 480, 240
CROSSED = 0.7  # of the time, from which the two have passed each other
CUT = 0.4  # of the time
GROUND = (90.0, 100.0, 110.0)
AWAY = -300.0  # pixels: beside the picture

Places = Callable[[float], tuple[float, float]]


def written(pictures: Iterable[U8], output: Path) -> Path:
    """Pictures (h, w, 3) RGB as a video."""
    with av.open(str(output), "w") as container:
        stream = None
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, "rgb24")
            if stream is None:
                stream = container.add_stream("libx264", FPS, {"crf": "14", "preset": "ultrafast"})
                stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p"
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
        assert stream is not None
        container.mux(stream.encode(None))
    return output


def crossing(at: float) -> tuple[float, float]:
    """Across the picture, the middles of two people who pass each other."""
    way = float(np.clip((at - 0.3) / (CROSSED - 0.3), 0, 1))
    return 120 + 240 * way, 360 - 240 * way


def following(at: float) -> tuple[float, float]:
    """The second person in the place of the first after a cut."""
    return (240.0, AWAY) if at < CUT else (AWAY, 240.0)


def composed(folder: Path, people: tuple[str, str], places: Places, output: Path) -> F64:
    """A clip of two people, the first one in front; returns the truth (2, FRAMES, 81, 2)."""
    heads = [_head(folder / name, FRAMES) for name in people]
    shifts = np.array([places(number / (FRAMES - 1)) for number in range(FRAMES)]).T  # (2, FRAMES)
    middles = np.stack([points.mean((0, 1)) for _, points, _ in heads])
    moves = np.stack(
        [shifts - middles[:, :1], np.broadcast_to(HEIGHT / 2 - middles[:, 1:], shifts.shape)], -1
    )
    written((_picture(heads, moves[:, number], number) for number in range(FRAMES)), output)
    return np.stack([head[1] for head in heads]) + moves[:, :, None]


def _picture(heads: list[Any], moves: F64, number: int) -> U8:
    canvas = np.full((HEIGHT, WIDTH, 3), GROUND, np.float32)
    for (pictures, _, share), (x, y) in reversed(list(zip(heads, moves, strict=True))):
        place = np.array([[1, 0, x], [0, 1, y]])
        shown, alpha = (cv2.warpAffine(one, place, (WIDTH, HEIGHT)) for one in (pictures[number], share))
        canvas += alpha[..., None] * (shown - canvas)
    return np.asarray(canvas.round(), np.uint8)


def _head(folder: Path, frames: int) -> tuple[list[Any], F64, Any]:
    """Frames at half size, landmarks (n, 81, 2), and the share (h, w) of the picture that is the head."""
    points = (np.load(folder / "talk.npz")["landmarks"][:frames] + 0.5) / 2 - 0.5
    with open_input(folder / "talk.mp4") as clip:
        pictures = [
            cv2.resize(one.rgb(), None, fx=0.5, fy=0.5).astype(np.float32) for one in islice(clip, frames)
        ]
    ys, xs = np.mgrid[: pictures[0].shape[0], : pictures[0].shape[1]]
    middle, size = points.mean((0, 1)), np.ptp(points.reshape(-1, 2), axis=0) * (0.78, 0.85)
    away = np.hypot((xs - middle[0]) / size[0], (ys - middle[1] + 0.1 * size[1]) / size[1])
    return pictures, points, np.clip((1.05 - away) * 10, 0, 1).astype(np.float32)


def owners(clip: Path, truth: F64) -> list[tuple[Any, Any]]:
    """For each person found, the frames and who of the truth is nearest in each."""
    with open_input(clip) as media:
        found = find_people(media)
    known = np.delete(truth, FOREHEAD, axis=2)
    pairs = []
    for person in found.people:
        middle = person.boxes.reshape(-1, 2, 2).mean(1)
        away = np.linalg.norm(known[:, person.frames].mean(2) - middle, axis=2)
        pairs.append((person.frames, away.argmin(0)))
    return pairs


def of_crossing(people: tuple[str, str], options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """In how many frames after the crossing each is right, and swapped both ways."""
    clip = folder / f"{'_'.join(people)}.mp4"
    truth = composed(options.shared / "data" / "synthetic" / "people", people, crossing, clip)
    found = owners(clip, truth)
    after, right = round(CROSSED * FRAMES), 0
    for frames, who in found:
        first = int(np.bincount(who[frames < 0.3 * FRAMES], minlength=2).argmax())
        right += int((who[frames >= after] == first).sum())
    _, report, _ = run(
        [
            "swap",
            clip,
            "--map",
            f"left={people[1]}",
            "--map",
            f"right={people[0]}",
            "-o",
            folder / "both.mp4",
            "--force",
        ],
        folder,
    )
    swapped = [one["swapped"] for one in report["people"]]
    return {
        "pair": " x ".join(people), "people found": len(found), "right after the crossing, %":
        100 * right / (2 * (FRAMES - after)), "swapped, % of frames": 100 * sum(swapped) / (2 * FRAMES),
    }  # fmt: skip


def of_cut(people: tuple[str, str], options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Whether a cut is told at enrolment, and how many frames of the other are among those of the one learned."""
    clip = folder / f"cut_{'_'.join(people)}.mp4"
    truth = composed(options.shared / "data" / "synthetic" / "people", people, following, clip)
    del truth
    with open_input(clip) as media:
        found = find_people(media)
    learned = max(found.people, key=lambda person: len(person.frames))
    later = learned.frames >= math.ceil(CUT * (FRAMES - 1))
    _, report, said = run(["enroll", clip, "-o", folder / "cut.guise", "--force"], folder)
    return {
        "pair": " | ".join(people), "told": "shows 2 people" in said,
        "frames of the other learned": int(min(later.sum(), (~later).sum())), "frames": report["frames"],
    }  # fmt: skip


def run(command: list[Any], folder: Path) -> tuple[float, dict[str, Any], str]:
    """Wall seconds of a command, its JSON, and what it said."""
    environment = os.environ | {"GUISE_PEOPLE": str(folder / "kept")}
    start = time.perf_counter()
    done = subprocess.run(
        [*map(str, (*GUISE, *command)), "--json"],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    if done.returncode:
        raise CommandError(done.stderr.strip()[-400:])
    return time.perf_counter() - start, json.loads(done.stdout), done.stderr


def of_second(options: argparse.Namespace, folder: Path) -> tuple[float, float]:
    """Seconds that a first and a second swap of a video take before they draw."""
    video = options.shared / "data" / "synthetic" / "people" / "p01" / "talk2.mp4"
    starts = []
    for number in range(2):
        wall, report, _ = run(["swap", video, "--identity", "p03", "-o", folder / f"{number}.mp4"], folder)
        starts.append(wall - report["seconds"])
    return starts[0], starts[1]


def measure(options: argparse.Namespace) -> Report:
    """All of it."""
    some = PAIRS[: 1 if options.quick else None]
    with tempfile.TemporaryDirectory(prefix="guise-") as name:
        folder = Path(name)
        crossings = [of_crossing(pair, options, folder) for pair in some]
        common.say(str(crossings))
        cuts = [of_cut(pair, options, folder) for pair in some]
        common.say(str(cuts))
        first, second = of_second(options, folder)
    right = min(row["right after the crossing, %"] for row in crossings)
    return Report(
        NAME,
        TITLE,
        [
            Criterion("each right after the crossing, worst pair", right, ">=", 100.0, "%"),
            Criterion("cuts told at enrolment", 100 * float(np.mean([row["told"] for row in cuts])), ">=", 100.0, "%"),
            Criterion(
                "frames of the other learned", float(max(row["frames of the other learned"] for row in cuts)),
                "<=", 0.0,
            ),
            Criterion("start of a second swap of a video", second, "<=", 1.0, "s"),
        ],
        [
            Table("Crossings", tuple(crossings[0]), [tuple(row.values()) for row in crossings]),
            Table("Cuts", tuple(cuts[0]), [tuple(row.values()) for row in cuts]),
            Table("Seconds before drawing", ("first swap", "second swap"), [(first, second)]),
        ],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
