"""De-identification: faces in plain sight behind a pattern, such as leaves, dots or bars that move.

A pattern is laid over the first frames of real clips, and the result is de-identified.  What lies between the bars is
compared within the points of brows, eyes, nose and mouth that the clean clip has: a frame leaks when more than half of
that skin is as it was.  The patterns here are drawn for this benchmark alone; `--tool` takes those of another program,
a Python file with ``over(name, frame, index, pitch, width, at)``.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.deidentify.forms import write
from benchmarks.deidentify.guise import LOSSLESS_OPTIONS, deidentified
from benchmarks.landmarks.clips import RealClip, real_clips
from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.app.media import open_input
from guise.common.arrays import F32, Bool

Over = Callable[[str, Picture, int, int, int, float], Picture]  # name, frame, index, pitch, width, at

CLIPS = (
    "studio_d3", "studio_d5", "studio_d6", "studio_d7", "studio_d18", "webcam_a1", "grid_lwbsza", "talk_r1",
    "phone_d13", "room_s18", "address_o1", "franck",
)  # fmt: skip
INNER = slice(17, 60)  # points of brows, eyes, nose and mouth
MIN_CLEAR = 0.97  # share of a pixel's light that comes from behind, from which it lies between the bars
MAX_SAME_LEVELS = 4  # of 255, below which a pixel is as it was
MIN_PIXELS = 30  # of skin, below which there is no face to see
ALL_HIDDEN = 0  # outcome
QUICK_CLIPS = 1


def checks(shape: tuple[int, int], index: int, pitch: int, width: int) -> F32:
    """Opaque squares of a chequer, smaller than its light ones."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.asarray(
        (y % pitch < pitch - width) & (x % pitch < pitch - width) & ((y // pitch + x // pitch) % 2 == 0)
    )


def dots(shape: tuple[int, int], index: int, pitch: int, width: int) -> F32:
    """Dots of a halftone, in rows that are set off."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    x += (y // pitch) % 2 * pitch / 2
    return np.asarray(np.hypot(x % pitch - pitch / 2, y % pitch - pitch / 2) < 0.8 * width)


def leaves(shape: tuple[int, int], index: int, pitch: int, width: int) -> F32:
    """Pointed leaves that sway, one for each square of the pitch and a half."""
    rng, mask = np.random.default_rng(3), np.zeros(shape, np.uint8)
    for y in range(0, shape[0] + pitch, 3 * pitch // 2):
        for x in range(0, shape[1] + pitch, 3 * pitch // 2):
            place, turn = np.array([x, y]) + rng.uniform(0, pitch, 2), rng.uniform(0, 2 * np.pi)
            turn += 0.2 * np.sin(index / 5 + turn)
            along = np.linspace(0, np.pi, 9)
            half = np.column_stack([1.2 * width * np.cos(along), 0.5 * width * np.sin(along)])
            leaf = np.concatenate([half, -half]) @ [
                [np.cos(turn), np.sin(turn)],
                [-np.sin(turn), np.cos(turn)],
            ]
            cv2.fillPoly(mask, [np.round(place + leaf).astype(np.int32)], 1)
    return np.asarray(mask, np.float32)


def drops(shape: tuple[int, int], index: int, pitch: int, width: int) -> F32:
    """Milky drops that run down a pane, and their trails."""
    rng, mask = np.random.default_rng(5), np.zeros(shape, np.float32)
    for x in range(0, shape[1] + pitch, pitch):
        for y in range(0, 2 * shape[0], 2 * pitch):
            at = (x + int(rng.integers(pitch)), (y + int(rng.integers(pitch)) + 2 * index) % (2 * shape[0]))
            cv2.line(mask, at, (at[0], at[1] - pitch), 0.6, max(width // 3, 1), cv2.LINE_AA)
            cv2.circle(mask, at, max(width // 2, 1), 0.85, -1, cv2.LINE_AA)
    return mask


def slanted(shape: tuple[int, int], index: int, pitch: int, width: int) -> F32:
    """Slanted bars that move."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.asarray((2 * x + y + 3 * index) % (2 * pitch) < 2 * width)


def waves(shape: tuple[int, int], index: int, pitch: int, width: int) -> F32:
    """Wavy stripes, as of a curtain of cords."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.asarray((x + 0.3 * pitch * np.sin(2 * np.pi * y / (3 * pitch))) % pitch < width)


Maker = Callable[[tuple[int, int], int, int, int], F32]
OWN: dict[str, tuple[Maker, tuple[int, int, int]]] = {
    "checks": (checks, (30, 30, 34)), "dots": (dots, (245, 245, 240)), "leaves": (leaves, (50, 95, 40)),
    "drops": (drops, (225, 230, 235)), "slanted": (slanted, (96, 88, 80)), "waves": (waves, (120, 84, 52)),
}  # fmt: skip
TOOL = ("blinds", "railing", "fence", "mesh", "checker", "dapple", "watermark", "wall", "bars")


def own(name: str, frame: Picture, index: int, pitch: int, width: int, at: float) -> Picture:
    """A frame behind one of OWN.   pitch, width : pixels, of the pattern and of what of it hides."""
    maker, colour = OWN[name]
    share = maker((frame.shape[0], frame.shape[1]), index, pitch, width).astype(np.float32)[..., None]
    return np.asarray(frame * (1 - share) + np.array(colour, np.float32) * share + 0.5, np.uint8)


def of_tool(path: Path) -> Over:
    """What another program lays over frames, which it takes as BGR."""
    spec = importlib.util.spec_from_file_location("tool", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{path.name} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def over(name: str, frame: Picture, index: int, pitch: int, width: int, at: float) -> Picture:
        bgr = module.over(name, np.ascontiguousarray(frame[..., ::-1]), index, pitch, width, at)
        return np.ascontiguousarray(bgr[..., ::-1])

    return over


@dataclass(frozen=True, eq=False)
class Pattern:
    """A pattern before a clip: who draws it, its name, pitch and width in pixels, and where a wall begins."""

    over: Over
    name: str
    pitch: int
    width: int
    at: float

    def before(self, frame: Picture, index: int) -> Picture:
        """A frame behind it."""
        return self.over(self.name, frame, index, self.pitch, self.width, self.at)

    def clear(self, shape: tuple[int, ...], index: int) -> Bool:
        """(h, w) the pixels that lie between its bars."""
        dark, light = (self.before(np.full(shape, v, np.uint8), index).astype(np.int16) for v in (0, 255))
        return np.asarray((light - dark).min(2) >= MIN_CLEAR * 255)


def pattern(over: Over, name: str, pitch: int, clip: RealClip) -> Pattern:
    """A pattern of which a third of the pitch hides; a wall lies just below the eyes."""
    lids = clip.points[:, [*RIGHT_EYE, *LEFT_EYE], 1].max(1)
    first = next(iter(clip.frames(1)))
    at = (float(np.nanmedian(lids[:60])) + 2) / first.shape[0]
    return Pattern(over, name, pitch, max(1, pitch // 3), at)


def leaked(laid: Pattern, clip: RealClip, video: Path, output: Path) -> Iterator[tuple[int, float]]:
    """The frames with a face to see, and the share of its skin between the bars that is as it was."""
    with open_input(video) as before, open_input(output) as after:
        for index, (old, new) in enumerate(zip(before, after, strict=True)):
            points = clip.points[index, INNER]
            if not np.isfinite(points).all():
                continue
            skin = inside(points, (old.height, old.width))
            skin &= laid.clear((*skin.shape, 3), index)
            if skin.sum() >= MIN_PIXELS:
                change = cv2.absdiff(old.rgb(), new.rgb()).max(2)
                yield index, float((change[skin] < MAX_SAME_LEVELS).mean())


def inside(points: F64, shape: tuple[int, int]) -> Bool:
    """(h, w) the pixels within points (n, 2)."""
    mask = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.round(points).astype(np.int32)), 1)
    return np.asarray(mask.astype(bool))


@dataclass
class Found:
    """What was found so far."""

    rows: list[tuple[object, ...]] = field(default_factory=list)
    frames: int = 0
    leaked: int = 0
    false_claims: int = 0


def measured(found: Found, laid: Pattern, clip: RealClip, options: argparse.Namespace) -> None:
    """De-identify a clip behind a pattern, and add what is found."""
    with tempfile.TemporaryDirectory() as folder:
        video, output, index = Path(folder) / "in.mkv", Path(folder) / "out.mkv", count()
        write(clip.video, video, lambda rgb: (laid.before(rgb, next(index)), np.eye(2, 3)), options.frames)
        report = deidentified(video, output, *LOSSLESS_OPTIONS, *options.more)
        shares = list(leaked(laid, clip, video, output))
    bad = [frame for frame, share in shares if share > 0.5]
    done = list(report["counts"].values())
    found.rows.append((clip.name, laid.name, laid.pitch, len(shares), len(bad), *done, report["outcome"]))
    found.frames += len(shares)
    found.leaked += len(bad)
    found.false_claims += bool(bad) and report["outcome"] == ALL_HIDDEN
    common.say(f"{found.rows[-1]} {bad}")


def measure(options: argparse.Namespace) -> Report:
    """All clips behind all patterns."""
    over, found, quick = (of_tool(options.tool) if options.tool else own), Found(), options.quick
    clips = [clip for name in options.clips for clip in real_clips(options.shared, name)]
    for clip in clips[: QUICK_CLIPS if quick else None]:
        for name in options.patterns or (TOOL if options.tool else tuple(OWN)):
            for pitch in options.pitches[: 1 if quick else None]:
                measured(found, pattern(over, name, pitch, clip), clip, options)
    return summary(found)


def summary(found: Found) -> Report:
    """Criteria and a row for each clip, pattern and pitch."""
    columns: Sequence[str] = (
        "clip", "pattern", "pitch", "faces", "leaked", "without face", "swapped", "covered", "left", "outcome",
    )  # fmt: skip
    return Report(
        "deidentify.patterns", "De-identification: faces in plain sight behind a pattern",
        [
            Criterion("leaked frames", float(found.leaked), "<=", 0.0),
            Criterion("clips of outcome 0 with a leak", float(found.false_claims), "<=", 0.0),
        ],
        [Table("Frames whose face was left as it was", columns, found.rows)],
        [f"Of {found.frames} frames with a face to see."],
    )  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--tool", type=Path, help="a program with patterns of its own, instead of these")
    made.add_argument("--patterns", nargs="+", help=f"of {', '.join(OWN)}; of the tool: {', '.join(TOOL)}")
    made.add_argument("--clips", nargs="+", default=CLIPS, help="of data/real, by how their names begin")
    made.add_argument(
        "--pitches", nargs="+", type=int, default=(24, 40, 64), help="pixels (default: 24 40 64)"
    )
    made.add_argument("--frames", type=int, default=60, help="of each clip (default: 60)")
    made.add_argument("--more", nargs="+", default=(), help="other options of guise deidentify")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
