"""Whether frames of the donor's own clip would show eyes, mouth and fine skin better than the donor's model does.

In every rendered scene each part is read on the reference grid: of the ideal swap at its true points, and of the frames
of the donor's clip of speech at the landmarker's, as enrolment reads them.  The figures are correlations with the ideal
swap, which no light changes: of the frame of the clip whose lids or lips are open most alike, as exemplars would be
chosen, kept while another is hardly nearer; of the best frame of the whole clip, chosen by the answer; of the texture
that the model makes; of the person's own, which a swap shows in eyes and mouth unless it is told otherwise; and of the
swap as drawn, which alone pays for misplaced features.  Fine skin is brightness less its mean over 2 % of the face's
width; its exemplar is the mean of the three frames nearest in lips and lids.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks.setting import skipped
from benchmarks.picture.program import arguments
from benchmarks.picture.truth import missing, model, pair_of, scenes
from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.landmarks import FaceTracker, open_landmarker
from guise.aam.landmarks.schemes import (
    INNER_LIPS,
    LEFT_EYE,
    LEFT_EYE_CORNERS,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_LIP_INNER,
    OUTER_EYE_CORNERS,
    RIGHT_EYE,
    RIGHT_EYE_CORNERS,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    UPPER_LIP_INNER,
)
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.model import Identity
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.solid_shape import SolidFit
from guise.aam.tracker import Fit
from guise.app.media import Frame, open_input
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.common.arrays import F32, Bool

NAME, TITLE = "picture.exemplars", "Picture: frames of the donor's clip beside what is drawn"
PARTS = {"mouth": (INNER_LIPS,), "eyes": (RIGHT_EYE, LEFT_EYE)}
SKIN = "fine skin"
FINE_FACE_WIDTHS = 0.02
EVERY_FRAME, EVERY_EXEMPLAR = 3, 2
NEAREST = 3
KEPT = 0.01  # by which another exemplar has to be nearer
HEIGHTS = {  # pairs of points of lids or lips, and of what their distance is compared with
    "mouth": (
        ((UPPER_LIP_INNER, LOWER_LIP_INNER), OUTER_EYE_CORNERS),
        ((INNER_LIPS[0], INNER_LIPS[4]), OUTER_EYE_CORNERS),
    ),
    "eyes": (
        ((RIGHT_UPPER_LID[0], RIGHT_LOWER_LID[0]), RIGHT_EYE_CORNERS),
        ((LEFT_UPPER_LID[0], LEFT_LOWER_LID[0]), LEFT_EYE_CORNERS),
    ),
}
FRAME = ReferenceFrame.canonical(160)
SAMPLER = MeshSampler.build(
    FRAME, np.column_stack(np.divmod(FRAME.pixels, FRAME.size[1])[::-1]).astype(np.float64)
)


@dataclass(frozen=True)
class Read:
    """Frames of a video on the grid: RGB (t, n, 3), and points (t, 81, 2)."""

    textures: F32
    points: F64


def read(video: Path, points: F64, every: int) -> Read:
    """One frame in so many of a video with points (t, 81, 2)."""
    textures = []
    with open_input(video) as media:
        for frame in islice(media, len(points)):
            if frame.index % every == 0:
                textures.append(_read(frame, points[frame.index]))
    return Read(np.array(textures), points[::every])


def _read(frame: Frame, points: F64) -> F32:
    return np.asarray(frame.sample_rgb(SAMPLER.positions(points.astype(np.float64))), np.float32)


def landmarks(video: Path) -> F64:
    """(t, 81, 2) of the built-in landmarker, from frame to frame."""
    tracker, found = FaceTracker(open_landmarker("builtin")), []
    with open_input(video) as media:
        for frame in media:
            face = tracker.update(frame.rgb())
            found.append(found[-1] if face is None else face.points.astype(np.float64))
    return np.array(found)


class _Observed(Engine):
    """Keeps the texture that it drew last."""

    def synthesise(self, parameters: F32, shape: F64, solid: SolidFit) -> F32:
        appearance = super().synthesise(parameters, shape, solid)
        self.texture = appearance[SHAPE_ENTRIES:].reshape(-1, 3).copy()
        return appearance


def swap(video: Path, source: Identity, target: Identity, points: F64) -> dict[str, F32]:
    """Textures (t, n, 3) of every third frame: made by the model, the person's own, and drawn at true points."""
    seen: dict[str, list[F32]] = {"model": [], "own": [], "drawn": []}
    finder, options = open_landmarker("builtin"), EngineOptions(renderer="cpu")
    with open_input(video) as media, _Observed(source, target, finder, options) as engine:
        for frame in islice(media, len(points)):
            fit = engine.track(frame)
            if not isinstance(fit, Fit):
                raise SystemExit(f"frame {frame.index} of {video} was lost: {fit}")
            own = _read(frame, fit.shape)
            engine.swap_tracked(frame, fit)
            if frame.index % EVERY_FRAME == 0:
                for name, texture in (
                    ("model", engine.texture), ("own", own), ("drawn", _read(frame, points[frame.index])),
                ):  # fmt: skip
                    seen[name].append(texture)
    return {name: np.array(textures) for name, textures in seen.items()}


def apertures(part: str, points: F64) -> F64:
    """(t, k) openings of eyes or mouth of points (t, 81, 2)."""
    return np.stack([_length(points, *pair) / _length(points, *unit) for pair, unit in HEIGHTS[part]], 1)


def _length(points: F64, one: int, other: int) -> F64:
    return np.asarray(np.linalg.norm(points[:, one] - points[:, other], axis=1))


def correlation(one: F32, other: F32) -> float:
    """Of the values of two textures (n, c), each less the mean of its channel."""
    a, b = (values - values.mean(0) for values in (one, other))
    return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum() + 1e-9))


def chosen(wanted: F64, given: F64) -> list[int]:
    """Which of the given openings (m, k) is nearest to each wanted one (t, k), with some hysteresis."""
    last, all_ = -1, []
    for one in wanted:
        away = np.linalg.norm(given - one, axis=1)
        nearest = int(away.argmin())
        last = last if last >= 0 and away[last] < away[nearest] + KEPT else nearest
        all_.append(last)
    return all_


def looks(part: str, textures: F32) -> F32:
    """(t, k, c) of textures (t, n, 3) that a part is compared by."""
    if part != SKIN:
        return textures[:, soft_parts(FRAME, PARTS[part], 0.0)[FRAME.mask] > 0.5]
    return np.array([_fine(texture, skin_mask(FRAME)) for texture in textures])


def _fine(texture: F32, skin: Bool) -> F32:
    luma = FRAME.scatter((texture @ LUMA).astype(np.float32))
    weight, sigma = FRAME.mask.astype(np.float32), FINE_FACE_WIDTHS * FRAME.resolution
    smooth, known = (cv2.GaussianBlur(plane, (0, 0), sigma) for plane in (luma * weight, weight))
    return np.asarray((luma - smooth / np.maximum(known, 1e-3))[skin][:, None], np.float32)


def of_part(part: str, truth: Read, donor: Read, swapped: dict[str, F32]) -> list[float]:
    """Mean correlations with the ideal swap: of exemplars, of the best ones, and of a swap's textures."""
    parts = tuple(PARTS) if part == SKIN else (part,)
    wanted, given = (np.concatenate([apertures(p, one.points) for p in parts], 1) for one in (truth, donor))
    ideal, own = looks(part, truth.textures), looks(part, donor.textures)
    if part == SKIN:
        exemplars = [own[np.linalg.norm(given - one, axis=1).argsort()[:NEAREST]].mean(0) for one in wanted]
    else:
        exemplars = [own[k] for k in chosen(wanted, given)]
    best = [max(correlation(one, t) for one in own) for t in ideal]
    others = [looks(part, textures) for textures in swapped.values()]
    found = [
        [correlation(a, t) for a, t in zip(textures, ideal, strict=True)] for textures in (exemplars, *others)
    ]
    return [float(np.mean(values)) for values in (found[0], best, *found[1:])]


def measure(options: argparse.Namespace) -> Report:
    """All scenes."""
    reason = missing(options.shared)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    rows = []
    for scene in scenes(options.shared)[:: 9 if options.quick else 1]:
        person, donor = pair_of(scene.name)
        source, identity = (Identity.load(model(options, name)) for name in (person, donor))
        points = np.load(scene / "truth.npz")["landmarks"].astype(np.float64)
        truth = read(scene / "truth.mp4", points, EVERY_FRAME)
        clip = common.synthetic_clip(options.shared, donor).video
        frames = read(clip, landmarks(clip), EVERY_EXEMPLAR)
        swapped = swap(scene / "source.mp4", source, identity, points)
        for part in (*PARTS, SKIN):
            rows.append((scene.name, part, *of_part(part, truth, frames, swapped)))
            common.say(str(rows[-1]))
    means = {
        part: [
            float(np.mean(values))
            for values in zip(*(row[2:] for row in rows if row[1] == part), strict=True)
        ]
        for part in (*PARTS, SKIN)
    }
    criteria = [
        Criterion(f"{part}: the model's texture, over exemplars", found[2] - found[0], ">=", 0.0)
        for part, found in means.items()
    ]
    columns = ("scene", "part", "exemplars", "best of the clip", "model", "own", "drawn")
    table = [*rows, *(("mean", part, *found) for part, found in means.items())]
    return Report(NAME, TITLE, criteria, [Table("Correlation with the ideal swap", columns, table)])


if __name__ == "__main__":
    common.run(measure, arguments(__doc__))
