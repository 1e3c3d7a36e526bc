"""Expression transfer against rendered truth: the target's face under exactly the driver's expressions.

data/synthetic/transfer/A_drives_B shows B with the curves of A's second clip.  A and B are enrolled on their first
clips, A is tracked through the second, and B's appearance is synthesised for every frame.

Landmark error: mean distance over the inner points (17-67), the synthesised shape brought to the truth by the weighted
similarity of the rigid landmarks, in % of the truth's inter-ocular distance.  Face-region error: mean absolute RGB
difference, on the reference grid inside the target's mask, between the synthesised texture and the true frame's
texture at the true landmarks, both in grey levels of the true frame; before it, mean and standard deviation of each
channel of the synthesised texture are matched to the true one's in each frame (light is the palette's business, not
the transfer's).

The targets' own clips are as expressive as what they must show.  So a second set of tables has targets enrolled on the
first quarter of their clips, where what alpha lets through is needed more.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aam.appearance import SHAPE, sample_texture
from aam.extrapolation import DEFAULT_ALPHA, GATE, Extrapolator
from aam.follow import PersonFollower
from aam.mask import expressive_mask
from aam.model import Identity
from aam.parameters import ParameterEstimator
from aam.reference import POINTS, RIGID_WEIGHTS, ReferenceFrame
from aam.similarity import Similarity, align
from benchmarks import common
from benchmarks.common import F32, F64, Clip, Criterion, Report, Table

INNER = slice(17, 68)
POOR = 0.25  # share of the clip that a target with few expressions is enrolled on
Results = dict[str, list["Errors"]]  # by setting, for each pair


@dataclass(frozen=True)
class Setting:
    """How the target's appearance is made; alpha None is its neutral face in every frame."""

    name: str
    alpha: float | None
    anchored: bool = True
    gate: float = GATE


SETTINGS = (
    Setting("neutral face, no transfer", None),
    *(Setting(f"alpha {alpha:g}", alpha) for alpha in (0.0, 0.3, 0.6, 0.8, 1.0)),
    Setting("alpha 0.6, not anchored", 0.6, anchored=False),
    *(Setting(f"alpha {alpha:g}, gate 1", alpha, gate=1.0) for alpha in (0.3, 0.6, 0.8, 1.0)),
    Setting("alpha 0.6, gate 1, not anchored (the paper's formula)", 0.6, anchored=False, gate=1.0),
)
CHOSEN = f"alpha {DEFAULT_ALPHA:g}"
RIVALS = ("alpha 0", "alpha 1", "alpha 0.6, not anchored")


@dataclass(frozen=True, eq=False)
class Truth:
    """What the target looks like: shapes (t, 81, 2) pixels and textures (t, n, 3)."""

    shapes: F64
    textures: F32


@dataclass(frozen=True)
class Errors:
    """Mean errors over a clip: landmarks in %, the whole face and eyes and mouth alone in grey levels."""

    landmarks: float
    face: float
    features: float


def driven(driver: Clip, source: Identity) -> dict[int, F32]:
    """The source's parameters (k,) in every frame of a clip in which it is tracked."""
    follower = PersonFollower(source.tracker, common.detector())
    estimator = ParameterEstimator(source.appearance)
    found = {}
    for frame in common.frames(driver):
        shape = common.shape_of(follower.step(frame.luma))
        if shape is not None:
            found[frame.index] = estimator(shape, frame.sample_rgb(estimator.sampler.positions(shape)))
    return found


def truth_of(clip: Clip, frame: ReferenceFrame) -> Truth:
    """The rendered answer."""
    textures = [sample_texture(f.rgb(), clip.points[f.index], frame) for f in common.frames(clip)]
    return Truth(clip.points, np.stack(textures))


def synthesised(setting: Setting, source: Identity, target: Identity, rho: F32) -> F32:
    """Target appearances (t, n) for source parameters (t, k)."""
    if setting.alpha is None:
        return np.repeat(target.appearance.neutral[None], len(rho), axis=0)
    extrapolator = Extrapolator(
        source.appearance, target.appearance, setting.alpha, anchored=setting.anchored, gate=setting.gate
    )
    return np.stack([extrapolator.apply(r) for r in rho])


def landmark_error(appearance: F32, truth: F64, frame: ReferenceFrame) -> float:
    """See the module."""
    shape = appearance[:SHAPE].reshape(POINTS, 2).astype(np.float64) / frame.shape_weight
    move = align(shape, truth, RIGID_WEIGHTS)
    assert isinstance(move, Similarity)
    miss = common.point_error(move.apply(shape)[INNER], truth[INNER])
    return 100 * miss / float(np.linalg.norm(truth[45] - truth[36]))


def texture_error(texture: F32, truth: F32, mask: F32, features: F32) -> tuple[float, float]:
    """See the module; textures (n, 3), weights (n,) of the face and of eyes and mouth."""
    inside = mask > 0
    made, true = texture[inside], truth[inside]
    matched = (made - made.mean(0)) * (true.std(0) / made.std(0)) + true.mean(0)
    miss = np.abs(matched - true).mean(1)
    weight = features[inside]
    return float(miss.mean()), float((miss * weight).sum() / weight.sum())


def errors(setting: Setting, source: Identity, target: Identity, rho: dict[int, F32], truth: Truth) -> Errors:
    """Mean errors of a setting over the frames in which the driver was tracked."""
    frame, index = target.frame, list(rho)
    mask = target.appearance.mask[frame.mask].astype(np.float32)
    features = expressive_mask(frame)[frame.mask] * mask
    made = synthesised(setting, source, target, np.stack([rho[i] for i in index]))
    rows = [
        (
            landmark_error(y, truth.shapes[i], frame),
            *texture_error(y[SHAPE:].reshape(-1, 3), truth.textures[i], mask, features),
        )
        for i, y in zip(index, made, strict=True)
    ]
    return Errors(*(float(v) for v in np.mean(rows, axis=0)))


def pairs(shared: Path) -> list[tuple[str, str]]:
    """(driver, target) of the transfer clips whose two people can be enrolled."""
    names = sorted(p.stem for p in (shared / "data" / "synthetic" / "transfer").glob("*_drives_*.mp4"))
    split = [(n.split("_drives_")[0], n.split("_drives_")[1]) for n in names]
    people = set(common.synthetic_people(shared))
    return [pair for pair in split if people.issuperset(pair)]


def measure(options: argparse.Namespace) -> Report:
    """All pairs, all settings, both kinds of targets."""
    chosen = pairs(options.shared)[: 1 if options.quick else None]
    names = sorted({name for pair in chosen for name in pair})
    clips = {name: common.synthetic_clip(options.shared, name) for name in names}
    people = {name: common.enrolled(clip) for name, clip in clips.items()}
    rich: Results = {s.name: [] for s in SETTINGS}
    poor: Results = {s.name: [] for s in SETTINGS}
    for a, b in chosen:
        common.say(f"{a} drives {b}")
        rho = driven(common.synthetic_clip(options.shared, a, "talk2"), people[a])
        answer = common.clip_at(options.shared / "data" / "synthetic" / "transfer" / f"{a}_drives_{b}.mp4")
        truth, less = truth_of(answer, people[b].frame), common.enrolled(clips[b], POOR)
        for setting in SETTINGS:
            rich[setting.name].append(errors(setting, people[a], people[b], rho, truth))
            poor[setting.name].append(errors(setting, people[a], less, rho, truth))
    return summary(chosen, rich, poor)


KINDS = {
    "landmarks": ("Landmark error, % of inter-ocular distance", "%"),
    "face": ("Face-region error, grey levels", ""),
    "features": ("Face-region error around eyes and mouth alone, grey levels", ""),
}


def means(results: Results, kind: str) -> dict[str, float]:
    """The mean over the pairs of one kind of error, by setting."""
    return {name: float(np.mean([getattr(e, kind) for e in some])) for name, some in results.items()}


def criteria(results: Results) -> list[Criterion]:
    """The default setting against its rivals."""
    made = []
    for kind in ("landmarks", "face"):
        mean = means(results, kind)
        for rival in RIVALS:
            what = f"{kind} error, {CHOSEN} against {rival}"
            made.append(Criterion(what, mean[CHOSEN], "<", mean[rival], KINDS[kind][1]))
    return made


def tables(chosen: list[tuple[str, str]], results: Results, whose: str) -> list[Table]:
    """A table for each kind of error."""
    columns = ["setting", *(f"{a} drives {b}" for a, b in chosen), "mean"]
    return [
        Table(
            f"{title}; {whose}",
            columns,
            [
                (name, *(getattr(e, kind) for e in results[name]), mean)
                for name, mean in means(results, kind).items()
            ],
        )
        for kind, (title, _) in KINDS.items()
    ]


def summary(chosen: list[tuple[str, str]], rich: Results, poor: Results) -> Report:
    """Criteria on targets enrolled on whole clips."""
    made = tables(chosen, rich, "whole clips") + tables(
        chosen, poor, "targets enrolled on a quarter of their clips"
    )
    return Report("transfer", "Expression transfer against rendered truth", criteria(rich), made)


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
