"""Attackers that learn: who is who among de-identified people, with donors of their own and with a shared one.

Two takes of each person of data/real are cut from one clip, its beginning and its second half.  All are de-identified
by the command, with each of the settings that `--donors` gives, and attacked by `guise.app.measure.attack`: the first
take is what the attacker knows, the second what he attacks.  The takes share place and clothes, which makes the
attackers of the crop and of the outline stronger than they would be on other recordings.

With `--tilt` the second takes are rolled by that angle before they are de-identified.

`--work` keeps clips and outputs, and continues where an earlier run stopped.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Picture, Report, Table
from benchmarks.deidentify.guise import done, guise_command
from benchmarks.deidentify.identity import person_of, recogniser
from benchmarks.landmarks.clips import HARD, RealClip, real_clips
from benchmarks.rolled import rolled
from guise.app.deidentify.reach import REACHES
from guise.app.measure.attack import (
    AttackedOutput,
    AttackRequest,
    AttackResult,
    RankOne,
    ViewFigures,
    Worst,
    attack,
)
from guise.app.measure.attackers import By
from guise.app.measure.privacy import Scores
from guise.app.media import open_input

TAKE_FRAMES = 45
MAX_SHORT_SIDE_PIXELS = 480
SETTINGS = ("auto", "same", "average:3")
HARD_BUT_ENROLLED = ("studio_d3", "gesture_school", "gesture_sorry")  # people who are in no other clip


def people(shared: Path) -> dict[str, RealClip]:
    """One clip of each person."""
    found: dict[str, RealClip] = {}
    for clip in real_clips(shared):
        if clip.name not in HARD or clip.name in HARD_BUT_ENROLLED:
            found.setdefault(person_of(clip.video), clip)
    return found


def write_takes(clip: RealClip, folder: Path, name: str, tilt: float) -> None:
    """The two takes of a clip, no larger than needed, as NAME_1.mp4 and NAME_2.mp4."""
    folder.mkdir(parents=True, exist_ok=True)
    half = len(clip.points) // 2
    for number, first in enumerate((0, half), start=1):
        target = folder / f"{name}_{number}.mp4"
        if target.exists():
            continue
        write_take(clip.video, target, first, min(TAKE_FRAMES, half), tilt if number == 2 else 0.0)


def write_take(video: Path, target: Path, first: int, count: int, tilt: float) -> None:
    """Some frames of a video, rolled clockwise by an angle in degrees, almost losslessly."""
    with av.open(str(target), "w") as out:
        stream = out.add_stream("libx264", 30, {"crf": "10", "preset": "veryfast"})
        stream.pix_fmt = "yuv420p"
        for picture in pictures(video, first, count, tilt):
            if not stream.codec_context.is_open:
                stream.height, stream.width = picture.shape[:2]
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        out.mux(stream.encode(None))


def pictures(video: Path, first: int, count: int, tilt: float) -> Iterator[Picture]:
    """Frames of a video, of even size, rolled."""
    with open_input(video) as media:
        scale = min(1.0, MAX_SHORT_SIDE_PIXELS / min(media.width, media.height))
        size = [round(side * scale / 2) * 2 for side in (media.width, media.height)]
        for frame in media:
            if frame.index >= first + count:
                return
            if frame.index >= first:
                small = cv2.resize(frame.rgb(), size, interpolation=cv2.INTER_AREA)
                picture = rolled(np.asarray(small, np.uint8), tilt)[0]
                height, width = picture.shape[:2]
                yield np.ascontiguousarray(picture[: height // 2 * 2, : width // 2 * 2])


def attacked(options: argparse.Namespace, work: Path) -> AttackResult:
    """De-identify everybody with each setting, and attack."""
    originals = work / f"people{options.tilt:g}"
    known = people(options.shared)
    clips = [(name, known[name]) for name in options.only or known][:: 7 if options.quick else 1]
    for name, clip in clips:
        write_takes(clip, originals / name, name, options.tilt)
    outputs = []
    for setting in options.donors:
        outputs.append(
            work / f"{setting.replace(':', '')}{options.tilt:g}{options.region.replace('face', '')}"
        )
        more = ("--recursive", "--resume", "--identity", setting, "--region", options.region)
        more += ("--encoder-preset", "ultrafast", "--crf", "14")
        done(guise_command(originals, outputs[-1], *more))
        common.say(f"{setting}: de-identified")
    card = work / "recogniser.toml"
    card.write_text(card_text(options.shared))
    return attack(AttackRequest(originals, outputs, [card]), say=common.say)


def card_text(shared: Path) -> str:
    """The card of the recogniser of shared/models, as a user would write it."""
    known = recogniser(shared).card
    points = ", ".join(f"[{x}, {y}]" for x, y in known.template.tolist())
    return (
        f'name = "{known.name}"\nmodel = "{known.model.resolve()}"\n'
        f"[input]\nsize = [{known.size[0]}, {known.size[1]}]\nmean = {known.mean[0]}\nscale = {known.scale[0]}\n"
        f"[template]\npoints = [{points}]\n"
    )


def measure(options: argparse.Namespace) -> Report:
    """All settings."""
    if options.work is not None:
        options.work.mkdir(parents=True, exist_ok=True)
        return report(attacked(options, options.work.resolve()), options.donors, options.region)
    with tempfile.TemporaryDirectory() as folder:
        return report(attacked(options, Path(folder)), options.donors, options.region)


def as_told(output: AttackedOutput, setting: str, region: str) -> list[Criterion]:
    """Whether users are told no less than what attackers reach."""
    if setting != "auto":
        return []
    told, worst = REACHES[region], {"face": output.worst, "outline": output.worst_outline}
    return [
        Criterion(
            f"found by {what}, as users are told", one.rank_one.share, "<=", getattr(told, what) + 0.005
        )
        for what, one in worst.items()
    ]


def report(result: AttackResult, settings: list[str], region: str) -> Report:
    """The criteria of the first setting, and the figures of all."""
    named = list(zip(settings, result.outputs, strict=True))
    crop = next(view for view in result.outputs[0].views if view.view.endswith("crop"))
    chances = [one.worst.rank_one.share / result.chance for one in result.outputs]
    criteria = [
        Criterion("people", result.people, ">=", 20),
        *(
            Criterion(f"worst attacker of the face, --donors {setting}, in chances", times, "<=", 2)
            for setting, times in zip(settings, chances, strict=True)
        ),
        *as_told(result.outputs[0], settings[0], region),
        *similarity("", crop.own),
        *similarity("tilted, ", crop.tilted),
    ]
    return Report(
        "deidentify.attack",
        "De-identification: attackers that learn",
        criteria,
        [table(*one) for one in named],
        [*(worst(*one) for one in named), *result.notes],
    )


def similarity(what: str, scores: Scores | None) -> list[Criterion]:
    """The criteria of similarities to the source, if there are any."""
    if scores is None:
        return []
    target = 0.25 if what else 0.10
    return [
        Criterion(f"{what}similarity to the source, mean", scores.mean, "<=", target),
        Criterion(f"{what}similarity to the source, 99th percentile", scores.p99, "<=", 0.25),
    ]


def table(setting: str, output: AttackedOutput) -> Table:
    """Rank 1 by frame and by clip of each attacker, and similarities to the own person and to others."""
    rows = [
        (
            view.view,
            *(f"{by['frame'].share:.2f}, {by['clip'].share:.2f}" for by in attackers(view)),
            *map(scores_text, (view.own, view.impostors, view.tilted, view.tilted_impostors)),
        )
        for view in output.views
    ]
    columns = (
        "seen by", "unchanged", "naive", "reverse", "parrot", "own: mean, 99 %", "others", "own tilted",
        "others tilted alike",
    )  # fmt: skip
    return Table(f"--donors {setting}: rank 1 by frame, by clip; similarities", columns, rows)


def scores_text(scores: Scores | None) -> str:
    """Mean and 99th percentile."""
    return "-" if scores is None else f"{scores.mean:.2f}, {scores.p99:.2f}"


def worst(setting: str, output: AttackedOutput) -> str:
    """The worst attackers of a setting in words."""
    found = (("face", output.worst), ("hair and outline", output.worst_outline))
    return f"--donors {setting}, worst attackers: " + "; ".join(f"{what} {words(one)}" for what, one in found)


def attackers(view: ViewFigures) -> list[Mapping[By, RankOne]]:
    """What the naive attacker reaches on the originals, and each on the output."""
    return [view.unchanged, *view.attackers.values()]


def words(one: Worst) -> str:
    """An attacker with its interval."""
    low, high = one.rank_one.interval
    return (
        f"{one.rank_one.share:.2f} [{low:.2f}, {high:.2f}] ({one.attacker}, by {one.by}, {one.view}; "
        f"by luck {one.luck:.2f}, up to {one.luck_95:.2f})"
    )


def arguments() -> argparse.ArgumentParser:
    """The options of this benchmark."""
    parser = common.arguments(__doc__)
    parser.add_argument("--donors", nargs="+", default=list(SETTINGS), help="settings of guise deidentify")
    parser.add_argument(
        "--tilt", type=float, default=0.0, help="degrees, by which the second takes are rolled"
    )
    parser.add_argument("--region", default="face", choices=("face", "head"), help="what a swap replaces")
    parser.add_argument("--only", nargs="*", default=[], help="names of people; all by default")
    return parser


if __name__ == "__main__":
    common.run(measure, arguments())
