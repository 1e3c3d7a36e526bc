"""`guise rig from-video`: the curves of the person in a clip."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from guise.aam.rig.calibration import load
from guise.aam.rig.coefficients import RigCalibration
from guise.app.media import MediaInput, open_input
from guise.app.media.time_range import TimeRange
from guise.app.rig.curves import CurveRecorder, RigCurves
from guise.app.rig.following import RigFollower, calibration_of
from guise.app.rig.formats import shows_head, write_curves
from guise.app.rig.head import RigHead, open_head
from guise.app.rig.options import RigClipOptions, RigOptions
from guise.common.arrays import F32
from guise.common.errors import GuiseError
from guise.common.files import require_outputs
from guise.common.progress import NoteLog, Progress, Say, mute, silent
from guise.common.report import Report
from guise.common.text import counted
from guise.common.threads import one_thread


@dataclass(frozen=True)
class RigReport(Report):
    """What was written.

    Parameters
    ----------
    frames : written; `held` of them show no face and hold the one before.   longest_gap : seconds without a face.
    shapes : of ARKit's 52 that the head of a .glb has; None for other files.   nodes : that turn in it.
    milliseconds : of coefficients, a frame.   seconds : wall time.
    """

    output: str
    frames: int
    held: int
    longest_gap: float
    calibrated: bool
    shapes: int | None
    nodes: tuple[str, ...]
    milliseconds: float
    seconds: float
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """For a person to read."""
        gap = (
            f", {self.held} without a face hold the one before ({self.longest_gap:.1f} s at most)"
            if self.held
            else ""
        )
        head = ""
        if self.shapes is not None:
            turned = (
                f" and turns {', '.join(self.nodes)}" if self.nodes else "; it has no node for head or eyes"
            )
            head = f"; the head has {self.shapes} of 52 shapes{turned}"
        calibrated = "calibrated" if self.calibrated else "not calibrated"
        return (
            f"{self.output}: {counted(self.frames, 'frame')}{gap}; {calibrated}{head}; "
            f"{self.milliseconds:.1f} ms a frame beyond landmarks"
        )


def rig_clip(
    clip: Path, output: Path, options: RigClipOptions, part: TimeRange | None = None,
    *, progress: Progress = silent, say: Say = mute,
) -> RigReport:  # fmt: skip
    """Write the curves of the person in a clip; nothing is written when nobody's face is found.

    Raises
    ------
    GuiseError
        For a user's mistake.
    """
    start, notes = time.perf_counter(), NoteLog(say)
    if options.calibration is not None and options.calibrate is not None:
        raise GuiseError("give either --calibration or --calibrate")
    check_rig_output(output, [clip], options.head, force=options.force)
    head = open_shown_head(output, options, progress, notes)
    with one_thread():
        if options.calibrate is not None:
            calibration: RigCalibration | None = calibration_of(
                options.calibrate, lambda share: progress("calibration", share)
            )
        else:
            calibration = None if options.calibration is None else load(options.calibration)
        with open_input(clip, part=part) as media:
            follower = RigFollower(calibration, smooth=False, say=notes)
            recorder = _follow(media, follower, options.person, progress)
            smooth = options.smooth and media.kind == "video"
        notes.extend(media.problems)
    if not recorder.with_face:
        raise GuiseError(
            f"no face was found in {clip}, and nothing was written: give a clip of one person's face"
        )
    curves = recorder.curves(smooth=smooth)
    return write_rig_file(output, curves, head, calibration, follower, start, tuple(notes.said))


def check_rig_output(output: Path, inputs: list[Path], head: Path | None, *, force: bool) -> None:
    """Raise GuiseError, before any work, if an output cannot be written."""
    if head is not None and not shows_head(output):
        raise GuiseError(f"--head is for a .glb or .vrm, which shows it: leave it out for {output}")
    require_outputs([output], [*inputs, *([head] if head else [])], force=force)


def open_shown_head(output: Path, options: RigOptions, progress: Progress, say: Say) -> RigHead | None:
    """The head that an output shows, if it shows one."""
    if not shows_head(output):
        return None
    head = open_head(options.head, options.unit, progress, say)
    if output.suffix.lower() == ".vrm" and head.vrm is None:
        raise GuiseError(f"{output} needs an avatar that is a VRM: give it with --head, or write a .glb")
    return head


def write_rig_file(
    output: Path, curves: RigCurves, head: RigHead | None, calibration: RigCalibration | None,
    follower: RigFollower, start: float, notes: tuple[str, ...],
) -> RigReport:  # fmt: skip
    """Write what was told since `start`, and report it."""
    write_curves(output, curves, head)
    return RigReport(
        str(output), len(curves.seconds), int((~curves.seen).sum()), round(curves.longest_gap, 3),
        calibration is not None, None if head is None else head.shapes, () if head is None else tuple(head.nodes),
        follower.per_frame, round(time.perf_counter() - start, 3), notes,
    )  # fmt: skip


def _follow(
    media: MediaInput, follower: RigFollower, person: int | None, progress: Progress
) -> CurveRecorder:
    recorder, total = CurveRecorder(), media.frame_count or 0
    points = None if person is None else _points_of(media, person, progress)
    for frame in media:
        rgb, seconds = frame.rgb(), float(frame.seconds)
        if points is None:
            found = follower(rgb, seconds)
        else:
            own = points.get(frame.index)
            found = None if own is None else follower.estimate(rgb, own, seconds)
        recorder.add(seconds, found)
        progress("coefficients", min(1.0, len(recorder.rows) / total) if total else 0.0)
    return recorder


def _points_of(media: MediaInput, number: int, progress: Progress) -> dict[int, F32]:
    """The points of a person by frame."""
    from guise.app.people.finding import find_people

    people = {one.number: one for one in find_people(media, lambda share: progress("people", share)).people}
    if number not in people:
        raise GuiseError(
            f"there is no person {number}: the clip shows {len(people)}; see `guise people find {media.path}`"
        )
    one = people[number]
    rows = zip(one.frames.tolist(), one.points, strict=True)
    return {frame: points for frame, points in rows if np.isfinite(points).all()}
