"""Expression transfer against rendered truth: the target's face under exactly the driver's expressions.

data/synthetic/transfer/A_drives_B shows B with the curves of A's second clip.  A and B are enrolled on their first
clips, A is tracked through the second, and B's appearance is synthesised for every frame.

Landmark error: mean distance over the inner points (17-67), the synthesised shape brought to the truth by the weighted
similarity of the rigid landmarks, in % of the truth's inter-ocular distance.

Face-region error: mean absolute RGB difference, on the reference grid inside the target's mask, between the synthesised
texture and the true frame's at the true landmarks, in grey levels; also with the weights of eyes and mouth.  The true
frames are in the driver's light and the target's model is in its own, so both are taken relative to the target's true
face at rest in the same light (the still neutral.jpg; and the mean of the true frames with the least expression), and
the synthesised one is scaled per channel by the ratio of the standard deviations of these two.  A wrong rest, such as
the mean of a talking face, counts in full.

The targets' own clips are as expressive as what they must show.  So a second set of tables has targets enrolled on the
first quarter of their clips, where what alpha lets through is needed more.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Report, Table
from guise.aam.appearance import SHAPE_ENTRIES, sample_texture
from guise.aam.extrapolation import DEFAULT_ALPHA, DEFAULT_GATE, Extrapolator
from guise.aam.landmarks.schemes import INNER51, LEFT_EYE_OUTER, RIGHT_EYE_OUTER, RIGID_WEIGHTS
from guise.aam.mask import expressive_mask
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.aam.person_tracker import PersonTracker
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import Similarity, align
from guise.app.media import open_input
from guise.common.arrays import F32

REST_FRAMES = 8
WEIGHT_UNITS = np.array([1.0] * 34 + [30.0] * 2)  # expression units, then gaze in degrees
FEW_EXPRESSIONS_SHARE = 0.25  # share of the clip that a target with few expressions is enrolled on
Results = dict[str, list["Errors"]]  # by setting, for each pair


@dataclass(frozen=True)
class Setting:
    """How the target's appearance is made; alpha None is its neutral face in every frame."""

    name: str
    alpha: float | None
    anchored: bool = True
    gate: float = DEFAULT_GATE


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
    """What the target looks like: shapes (t, 81, 2) pixels, textures (t, n, 3), and at rest (n, 3).

    rest is in the truth's light, own_rest in that of the target's own clips.
    """

    shapes: F64
    textures: F32
    rest: F32
    own_rest: F32


@dataclass(frozen=True)
class Errors:
    """Mean errors over a clip: landmarks in %; face region, and eyes and mouth, in grey levels."""

    landmarks: float
    face: float
    features: float


def driven(driver: Clip, source: Identity) -> dict[int, F32]:
    """The source's parameters (k,) in every frame of a clip in which it is tracked."""
    person_tracker = PersonTracker(source.tracker, common.detector())
    estimator = ParameterEstimator(source.appearance)
    found = {}
    for frame in common.frames(driver):
        shape = common.shape_of(person_tracker.update(frame.luma))
        if shape is not None:
            found[frame.index] = estimator(shape, frame.sample_rgb(estimator.sampler.positions(shape)))
    return found


def truth_of(shared: Path, driver: str, target: str, frame: ReferenceFrame) -> Truth:
    """The rendered answer."""
    clip = common.clip_at(shared / "data" / "synthetic" / "transfer" / f"{driver}_drives_{target}.mp4")
    textures = np.stack([sample_texture(f.rgb(), clip.points[f.index], frame) for f in common.frames(clip)])
    weights = np.abs(np.load(clip.video.with_suffix(".npz"))["weights"]) / WEIGHT_UNITS
    rest = np.argsort(weights.sum(1))[:REST_FRAMES]
    return Truth(clip.points, textures, textures[rest].mean(0), own_rest(shared, target, frame))


def own_rest(shared: Path, person: str, frame: ReferenceFrame) -> F32:
    """The texture (n, 3) of the person's still at rest."""
    folder = shared / "data" / "synthetic" / "people" / person
    stills = np.load(folder / "stills.npz")
    shape = stills["landmarks"][list(stills["names"]).index("neutral")].astype(np.float64)
    with open_input(folder / "neutral.jpg") as source:
        return sample_texture(next(iter(source)).rgb(), shape, frame)


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
    shape = appearance[:SHAPE_ENTRIES].reshape(POINTS, 2).astype(np.float64) / frame.shape_weight
    move = align(shape, truth, RIGID_WEIGHTS)
    assert isinstance(move, Similarity)
    miss = common.point_error(move.apply(shape)[INNER51], truth[INNER51])
    return 100 * miss / float(np.linalg.norm(truth[LEFT_EYE_OUTER] - truth[RIGHT_EYE_OUTER]))


def errors(setting: Setting, source: Identity, target: Identity, rho: dict[int, F32], truth: Truth) -> Errors:
    """Mean errors of a setting over the frames in which the driver was tracked."""
    frame, index = target.reference, list(rho)
    inside = target.appearance.mask[frame.mask]
    features = expressive_mask(frame)[frame.mask][inside]
    made = synthesised(setting, source, target, np.stack([rho[i] for i in index]))
    rows = []
    for i, y in zip(index, made, strict=True):
        made_texture = y[SHAPE_ENTRIES:].reshape(-1, 3)[inside]
        away = change_error(
            made_texture, truth.textures[i][inside], truth.own_rest[inside], truth.rest[inside]
        )
        whole, part = (float(np.average(away, weights=weights)) for weights in (None, features))
        rows.append((landmark_error(y, truth.shapes[i], frame), whole, part))
    return Errors(*(float(v) for v in np.mean(rows, axis=0)))


def change_error(made: F32, true: F32, own_rest: F32, rest: F32) -> F32:
    """(m,) grey levels by which the change from rest is wrong; textures (m, 3)."""
    gain = rest.std(0) / own_rest.std(0)
    return np.asarray(np.abs((made - own_rest) * gain - (true - rest)).mean(1), np.float32)


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
        truth = truth_of(options.shared, a, b, people[b].reference)
        less = common.enrolled(clips[b], FEW_EXPRESSIONS_SHARE)
        for setting in SETTINGS:
            rich[setting.name].append(errors(setting, people[a], people[b], rho, truth))
            poor[setting.name].append(errors(setting, people[a], less, rho, truth))
    return summary(chosen, rich, poor)


KINDS = {
    "landmarks": ("Landmarks, % of inter-ocular distance", "%"),
    "face": ("Face region, change from rest, grey levels", ""),
    "features": ("Around eyes and mouth, change from rest, grey levels", ""),
}


def means(results: Results, kind: str) -> dict[str, float]:
    """The mean over the pairs of one kind of error, by setting."""
    return {name: float(np.mean([getattr(e, kind) for e in some])) for name, some in results.items()}


def summary(chosen: list[tuple[str, str]], rich: Results, poor: Results) -> Report:
    """The default setting against its rivals on targets enrolled on whole clips, and a table for each kind."""
    report = Report("transfer", "Expression transfer against rendered truth")
    columns = ["setting", *(f"{a} drives {b}" for a, b in chosen), "mean"]
    for kind, (title, unit) in KINDS.items():
        mean = means(rich, kind)
        report.criteria += [
            Criterion(f"{kind}, {CHOSEN} against {rival}", mean[CHOSEN], "<", mean[rival], unit)
            for rival in (RIVALS if kind != "features" else ())
        ]
        for whose, results in (("whole clips", rich), ("a quarter of their clips", poor)):
            rows = [
                (name, *(getattr(e, kind) for e in results[name]), mean)
                for name, mean in means(results, kind).items()
            ]
            report.tables.append(Table(f"{title}; targets enrolled on {whose}", columns, rows))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
