"""The one loop body of all that swaps: a frame comes in, and goes out with faces drawn and covered, and a row for each.

Files, the API, live and de-identification drive it; what is done to whom is the policy's (`guise.app.swapping.policy`).
Pixels as shown, x right, y down.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal, Protocol, TypeVar

import numpy as np

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.glances import Glancer
from guise.aam.landmarks.rolls import RolledBoxes, ScoredDetector, detect_on_schedule
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.media import Frame, MediaInput, ProcessStats, Sink, process
from guise.app.media.time_range import TimeRange, within
from guise.app.swapping.cover import Covering, CoverStyle, cover
from guise.app.swapping.policy import COVERED, DONE, LIMITS, SWAPPED, FacePlace, FaceTreatment, FollowedFace
from guise.common.arrays import F64
from guise.common.closing import Closing

ABSENT = Failed("not in this frame")
ALONE = 1  # the number of the only one


@dataclass(frozen=True, eq=False)
class FaceRow:
    """What became of a face in a frame.

    Parameters
    ----------
    who : whose face it is; people are numbered from 1.
    outcome : "swapped"; "held", drawn where it was seen last; "covered"; "left" as the user wished; or "lost": neither
        drawn nor covered.
    mesh : (81, 2) pixels that was drawn, or None.   doubt : opacity in [0, 1] of the cover that came in over it.
    """

    who: int
    outcome: Literal["swapped", "held", "covered", "left", "lost"]
    mesh: F64 | None = None
    doubt: float = 0.0


class Swap(Protocol):
    """What became of a frame of one person, see `guise.app.drawing.engine.SwapResult`."""

    @property
    def outcome(self) -> Literal["swapped", "held", "lost"]: ...
    @property
    def mesh(self) -> F64 | None: ...
    @property
    def doubt(self) -> float: ...


class Drawer(Protocol):
    """Draws one face over one person: an `guise.app.drawing.engine.Engine`."""

    @property
    def renderer(self) -> str: ...
    def swap_tracked(self, frame: Frame, fit: Fit | Failed) -> Swap:
        """Draw where the person was tracked, in place."""

    def close(self) -> None:
        """Release it."""


class Follower(Drawer, Protocol):
    """Also finds the person itself: an engine or a puppet."""

    def track(self, frame: Frame) -> Fit | Failed:
        """Where the person is in the next frame; runs ahead of the drawing, in another thread."""


D = TypeVar("D", bound=Drawer)
F = TypeVar("F", bound=Follower)


class LostFaceSearch:
    """Searches frames for faces, at a glance as well where none is sure: they may be behind bars or letters."""

    def __init__(self, detector: ScoredDetector) -> None:
        self._detector, self._glancer, self._landmarker = detector, Glancer(), BuiltinLandmarker()

    def look(self, frame: Frame) -> RolledBoxes:
        """The faces in a frame, each once."""
        rgb = frame.quick_rgb()
        found = detect_on_schedule(self._detector, rgb, frame.index, LIMITS.sure_score)
        if not (found.scores >= LIMITS.sure_score).any():
            found = found.and_others(self._glancer.likely(self._landmarker, rgb, frame.index))
        return found.distinct()


class SwapSession(Closing, Generic[D]):
    """Draws faces on people's heads and covers others, in frames in the order of time; use it by `with`, in one thread.

    Parameters
    ----------
    open_engine : makes the engine of somebody, when they are first drawn; the session closes it.
    style : of covers; None covers nothing: a face that cannot be drawn stays as it is.
    detector : looks for a lost face; the built-in one, made when it is first needed.
    """

    def __init__(
        self,
        open_engine: Callable[[int], D],
        style: CoverStyle | Covering | None = None,
        detector: ScoredDetector | None = None,
    ) -> None:
        self._open_engine, self._style, self._detector = open_engine, style, detector
        self._lost: LostFaceSearch | None = None
        self._engines: dict[int, D] = {}
        self._followed: dict[int, FollowedFace] = {}
        self.renderer = ""  # of the faces that were drawn

    def engine(self, who: int) -> D:
        """Somebody's engine."""
        if who not in self._engines:
            self._engines[who] = self._open_engine(who)
            self.renderer = self._engines[who].renderer
        return self._engines[who]

    @property
    def engines(self) -> Mapping[int, D]:
        """The engines of all who were drawn and not released."""
        return self._engines

    def swap(self, frame: Frame, who: int, fit: Fit | Failed, *, fades: bool = True) -> FaceRow:
        """Draw somebody's face, in place, where it was tracked.

        fades : let a cover come in over a head that turns too far.
        """
        result = self.engine(who).swap_tracked(frame, fit)
        if result.mesh is not None and result.doubt > 0 and self._style is not None and fades:
            cover(frame, FacePlace.of(result.mesh).region(), self._style, result.doubt)
            return FaceRow(who, result.outcome, result.mesh, result.doubt)
        return FaceRow(who, result.outcome, result.mesh)

    def follow(self, frame: Frame, who: int, fit: Fit | Failed) -> FaceRow:
        """As `swap`, for somebody who is in every frame; where they are lost, their face is searched and covered."""
        row, now = self.swap(frame, who, fit), frame.seconds
        if self._style is None:
            return row
        face = self._followed.get(who)
        if face is None:
            face = self._followed[who] = FollowedFace()
        if row.mesh is not None:
            face.see(now, FacePlace.of(row.mesh))
            return row
        self._search(frame, face)
        rectangle = face.region(now)
        is_covered = rectangle is not None and cover(frame, rectangle, self._style) is not None
        return replace(row, outcome="covered") if is_covered else row

    def treat(
        self, frame: Frame, treatments: Sequence[FaceTreatment], fits: Mapping[int, Fit | Failed],
        after: Callable[[D, FaceRow], None] | None = None,
    ) -> list[FaceRow]:  # fmt: skip
        """Do what is planned, in place; a face that cannot be swapped is covered, or left if it may be.

        Smaller faces are drawn before larger ones, and covers lie over all of them.

        fits : by person, where the faces are that are swapped.   after : called after each swap.
        """
        rows, rest = [], [one for one in treatments if one.done != SWAPPED]
        swaps = sorted(
            (one for one in treatments if one.done == SWAPPED), key=lambda one: one.box[2] - one.box[0]
        )
        for who in self._engines.keys() - {one.who for one in swaps}:
            self._engines[who].swap_tracked(frame, ABSENT)
        for one in swaps:
            fit = fits.get(one.who, ABSENT)
            row = self.swap(frame, one.who, fit, fades=one.otherwise == COVERED)
            if row.mesh is None:
                rest.append(replace(one, done=one.otherwise))
                continue
            rows.append(row)
            if after is not None:
                after(self.engine(one.who), row)
        for one in rest:
            if one.done == COVERED:
                assert self._style is not None
                cover(frame, one.region, self._style)
            rows.append(FaceRow(one.who, DONE[one.done]))
        return rows

    def release(self, who: int) -> None:
        """Let go of somebody's engine, 40 MB or more: many come and go in a street."""
        if who in self._engines:
            self._engines.pop(who).close()

    def close(self) -> None:
        """Release all engines."""
        for who in list(self._engines):
            self.release(who)

    def _search(self, frame: Frame, face: FollowedFace) -> None:
        """Look for a lost face where it was, or for the largest clear one before it was seen at all."""
        if self._lost is None:
            self._lost = LostFaceSearch(self._detector or FaceDetector(min_score=LIMITS.min_box_score))
        found = self._lost.look(frame)
        if face.was_seen:
            face.look_for(frame.seconds, FacePlace.detected(found))
        else:
            clear = found[found.scores >= LIMITS.min_first_score]
            for place in FacePlace.detected(_largest(clear)):
                face.see(frame.seconds, place)


def follow_alone(
    session: SwapSession[F], media: MediaInput, sink: Sink, told: Callable[[str], None],
    progress: Callable[[int], None], part: TimeRange | None = None, outside: Callable[[Frame], None] | None = None,
) -> ProcessStats:  # fmt: skip
    """Pass all frames of a video of one person through a session.

    told : called with the outcome of each frame.   progress : see `process`.
    part : of the frames; the others are untouched, or what `outside` makes of them.
    """
    engine, is_within = session.engine(ALONE), within(part)
    fits: dict[int, Fit | Failed] = {}

    def track(frame: Frame) -> None:
        if is_within(frame):
            fits[frame.index] = engine.track(frame)

    def swap(frame: Frame) -> None:
        if frame.index in fits:
            told(session.follow(frame, ALONE, fits.pop(frame.index)).outcome)
            return
        if outside is not None:
            outside(frame)
        told("untouched")

    return process(media, sink, swap, ahead=track, progress=progress)


def _largest(found: RolledBoxes) -> RolledBoxes:
    sizes = np.prod(found.boxes[:, 2:] - found.boxes[:, :2], axis=1)
    return found[np.argsort(-sizes, kind="stable")[:1]]
