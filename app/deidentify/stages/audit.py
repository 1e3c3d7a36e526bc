"""The audit of a rendered segment: original and result are searched for faces, and compared where either has one.

It does not rely on what found the faces, see `search`, and looks at the original as well: a face that the first stage
missed is found there.  The result is searched where it differs from the original: the rest shows what was searched
already.  Every face that is said to be swapped is also compared with the original.  Searched are one frame in
`AuditLimits.interval_frames`, frames without a face shortly before or after one, and those about what was found; every
frame with ``--audit full``.  Some are searched as negatives, too, and all after a negative that has a face.  Where no
face is swapped, it is looked for what patterns may hide, see `doubt`.  Pixels as shown; boxes ``x0 y0 x1 y1`` of the 68
iBUG points; turns in radians, by which a face is rolled clockwise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.changes import Part, changed_parts
from guise.aam.landmarks import iou
from guise.aam.landmarks.rolls import RolledBoxes
from guise.app.deidentify.stages.doubt import Doubt
from guise.app.deidentify.stages.search import AuditSearch
from guise.app.media import Frame
from guise.app.people.looks import small_picture
from guise.app.swapping.policy import COVERED, LEFT, NOBODY, SWAPPED, FaceTreatment
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.closing import Closing


@dataclass(frozen=True)
class AuditLimits:
    """What is searched, and what is taken for unchanged."""

    interval_frames: int = 8  # from one searched frame to the next
    risky_interval_frames: int = 3  # the same where faces were lost
    risky_seconds: float = 1.0  # for which frames without a face count as such before and after one
    negative_interval: int = (
        4  # from one of the regularly searched frames to the next whose negative is searched
    )
    kept_pixels: int = 640  # longer side of the original as it is kept for comparison
    patch_pixels: int = 16  # side of what is compared of a face
    compared_share: float = 0.7  # of a box's width and height; the rest may lie beside the face
    min_unchanged_correlation: float = 0.95  # of two patches, from which they show the same
    max_same_spread: float = 0.1  # of a patch's pixels, by which the same pixel may differ,
    max_same_grey_levels: float = 2.0  # or this
    light_pixels: float = 3.0  # standard deviation of a patch's light
    max_unchanged_swapped: float = 0.6  # share of a patch; a hand in front of a swapped face is kept
    max_unchanged_covered: float = 0.4
    min_shown: int = 128  # of 255, of a pixel of a swapped face, from which it isn't an object's in front
    min_shown_share: float = 0.25  # of a patch; of less nothing is told, so that all of it counts
    min_thing_iou: float = 0.3  # of a find and of what is no face, as the user says, from which it is that
    max_upside_down_cosine: float = -0.7  # of the turn between a face and what its hair is taken for


LIMITS = AuditLimits()
THREADS = 2  # in which is searched while frames are drawn and read


@dataclass(frozen=True, eq=False)
class AuditDetection:
    """A face that the audit found."""

    frame: int
    box: F32
    score: float
    turn: float = 0.0
    negative: bool = False


@dataclass(frozen=True, eq=False)
class DrawnFace:
    """A face as it was drawn.

    track : number.   box : (4,) of all that was drawn.
    uncovered : (h, w) uint8, 255 where nothing hides the face, on a grid; None is everywhere.
    to_grid : (2, 3) affine map from pixels to the grid.
    """

    track: int
    box: F64
    uncovered: U8 | None = None
    to_grid: F64 | None = None

    def shown(self, box: NDArray[np.floating]) -> Bool | None:
        """(16, 16) which pixels of the patch of a box (4,) show what was drawn; None is all of them."""
        if self.uncovered is None or self.to_grid is None:
            return None
        x0, y0, x1, y1 = _middle(box)
        step = np.array([x1 - x0, y1 - y0]) / LIMITS.patch_pixels
        from_patch = np.column_stack([np.diag(step), [x0, y0] + step / 2 - 0.5])
        linear = self.to_grid[:, :2] @ from_patch[:, :2]
        shift = self.to_grid[:, :2] @ from_patch[:, 2] + self.to_grid[:, 2]
        share = cv2.warpAffine(
            self.uncovered, np.column_stack([linear, shift]), (LIMITS.patch_pixels,) * 2,
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return np.asarray(share > LIMITS.min_shown)


class Audit(Closing):
    """Looks at the original and at the result.

    Parameters
    ----------
    search : AuditSearch
    frames : (first, last), of the segment, which are [first, last).
    entries : what is done, by frame; frames without any near some with one are searched more often.
    rate : frames a second.
    every_frame : search all of them.
    """

    def __init__(
        self,
        search: AuditSearch,
        frames: tuple[int, int],
        entries: dict[int, list[FaceTreatment]],
        rate: float,
        *,
        every_frame: bool,
    ) -> None:
        self._search, self._frames, self._every_frame = search, frames, every_frame
        self._searched = set(range(*frames)) if every_frame else _sampled(frames, entries, rate)
        self._patches: dict[int, list[tuple[FaceTreatment, U8]]] = {}
        self._kept: dict[int, tuple[U8, float]] = {}  # small, and by how much
        self._original: dict[tuple[int, bool], RolledBoxes] = {}  # by frame, and whether as a negative
        self._doubts: dict[int, Doubt] = {}  # by frame
        self._is_negative = False  # as far as is known
        self._threads = ThreadPoolExecutor(THREADS, "audit")

    @property
    def searched(self) -> int:
        """How many frames are searched."""
        return len(self._searched)

    @property
    def unclear(self) -> list[int]:
        """The frames, about those searched, in which nobody can tell whether there is another face."""
        about = {
            at
            for index, doubt in self._doubts.items()
            if doubt.is_unclear
            for at in range(index - LIMITS.interval_frames + 1, index + LIMITS.interval_frames)
        }
        return sorted(about & set(range(*self._frames)))

    @property
    def unsearched(self) -> list[int]:
        """The frames that are still to be looked at."""
        return sorted(
            i for i in self._searched if any((i, way) not in self._original for way in self._ways(i))
        )

    def before(
        self, frames: Iterable[Frame], entries: dict[int, list[FaceTreatment]]
    ) -> list[AuditDetection]:
        """Look at frames of the original; the faces there with which nothing is done.

        entries : what will be done, by frame.
        """
        searched: deque[tuple[int, dict[bool, Future[RolledBoxes]]]] = deque()
        doubts: dict[int, Future[Doubt]] = {}
        missed: list[AuditDetection] = []

        def known() -> None:
            index, found = searched.popleft()
            for negative, boxes in found.items():
                self._original[index, negative] = boxes.result()
                missed.extend(self._missed(index, negative, entries.get(index, [])))
            if index in doubts:
                self._doubts[index] = doubts.pop(index).result()
                faces = self._doubts[index].faces
                for box, score, turn in zip(faces.boxes, faces.scores, faces.turns, strict=True):
                    missed.append(AuditDetection(index, box, float(score), float(turn)))

        for frame in frames:
            index = frame.index
            if index not in self._patches:
                swapped = (e for e in entries.get(index, []) if e.done == SWAPPED)
                pairs = ((entry, patch_of(frame.luma, entry.box)) for entry in swapped)
                self._patches[index] = [(entry, patch) for entry, patch in pairs if patch is not None]
            ways = [way for way in self._ways(index) if (index, way) not in self._original]
            if ways:
                self._kept[index] = _small(frame.luma)
                searched.append((index, self._searches(frame, ways)))
                if not any(entry.done == SWAPPED for entry in entries.get(index, [])):
                    places = [entry.region for entry in entries.get(index, [])]
                    doubts[index] = self._threads.submit(self._search.doubt, frame.quick_rgb(), places)
            if len(searched) > THREADS:
                known()
        while searched:
            known()
        return missed

    def _missed(
        self, index: int, negative: bool, entries: Sequence[FaceTreatment]
    ) -> Iterator[AuditDetection]:
        """What was found in a frame of the original where nothing is done; its negative shows known faces, too."""
        (luma, scale), found = self._kept[index], self._original[index, negative]
        places = [entry.box for entry in entries if entry.done == SWAPPED]
        covers = [entry.region for entry in entries if entry.done == COVERED]
        for box, score, turn in zip(found.boxes, found.scores, found.turns, strict=True):
            is_known = any(_inside(box, place) for place in places) or _is_left(box, entries)
            is_known = is_known or any(_is_hair(box, float(turn), entry) for entry in entries)
            if is_known or share_within(box, covers) > 1 - LIMITS.max_unchanged_covered:
                continue
            if self._is_in_original(luma, box * scale, float(turn), negative):
                yield AuditDetection(index, box, float(score), float(turn), negative)

    def after(
        self,
        frames: Iterable[Frame],
        entries: dict[int, list[FaceTreatment]],
        drawn: Mapping[int, Sequence[DrawnFace]],
    ) -> Iterator[AuditDetection]:
        """The faces in the result that were neither changed nor left on purpose.

        entries : what was done, by frame.   drawn : by frame, too.
        """
        searched: deque[tuple[Frame, dict[bool, Future[RolledBoxes]]]] = deque()

        def judged() -> Iterator[AuditDetection]:
            frame, found = searched.popleft()
            treatments, swapped = entries.get(frame.index, []), drawn.get(frame.index, [])
            for negative, boxes in found.items():
                yield from self._compared(frame, treatments, swapped, boxes.result(), negative)

        for frame in frames:
            shown = {face.track: face.shown for face in drawn.get(frame.index, [])}
            for entry, patch in self._patches.get(frame.index, []):
                where = shown[entry.who](entry.box) if entry.who in shown else None
                if _is_unchanged(patch, patch_of(frame.luma, entry.box), LIMITS.max_unchanged_swapped, where):
                    yield AuditDetection(frame.index, entry.box, 1.0, entry.turn)
            ways = [way for way in self._ways(frame.index) if (frame.index, way) in self._original]
            if ways:
                before, scale = self._kept[frame.index]
                parts = changed_parts(before, _small(frame.luma)[0], scale)
                searched.append((frame, self._searches(frame, ways, parts)))
            if len(searched) > THREADS:
                yield from judged()
        while searched:
            yield from judged()

    def close(self) -> None:
        """Stop searching."""
        self._threads.shutdown(cancel_futures=True)

    def look_closer(self, found: Iterable[AuditDetection]) -> None:
        """Search all frames about what was found from now on, and as negatives if it was found in one."""
        for one in found:
            if one.negative and not self._is_negative:
                self._is_negative = True
                self._original = {key: boxes for key, boxes in self._original.items() if not key[1]}
            reach = range(one.frame - LIMITS.interval_frames, one.frame + LIMITS.interval_frames + 1)
            self._searched |= set(reach) & set(range(*self._frames))

    def _ways(self, index: int) -> tuple[bool, ...]:
        """How a frame is searched: not at all, as it is, or also as a negative."""
        if index not in self._searched:
            return ()
        regular = index % (LIMITS.negative_interval * LIMITS.interval_frames) == 0
        return (False, True) if self._every_frame or self._is_negative or regular else (False,)

    def _searches(
        self, frame: Frame, ways: Iterable[bool], parts: Sequence[Part] | None = None
    ) -> dict[bool, Future[RolledBoxes]]:
        rgb = frame.quick_rgb()
        return {way: self._threads.submit(self._faces, rgb, frame.index, way, parts) for way in ways}

    def _faces(self, rgb: U8, index: int, negative: bool, parts: Sequence[Part] | None) -> RolledBoxes:
        size = None if self._every_frame else index // LIMITS.interval_frames
        if not negative:
            return self._search.faces(rgb, size, within=parts)
        return self._search.faces(255 - rgb, size, parts, is_doubtful=not self._is_negative)

    def _compared(
        self, frame: Frame, entries: Sequence[FaceTreatment], drawn: Sequence[DrawnFace], result: RolledBoxes,
        negative: bool,
    ) -> Iterator[AuditDetection]:  # fmt: skip
        """Faces that another way of searching finds in the original or in the result, where both are the same."""
        found = self._original[frame.index, negative].and_others(result).distinct()
        (before, scale), (after, _) = self._kept[frame.index], _small(frame.luma)
        covered = [e.region for e in entries if e.done == COVERED]
        for box, score, turn in zip(found.boxes, found.scores, found.turns, strict=True):
            if _is_left(box, entries):
                continue
            if any(_is_hair(box, float(turn), entry) for entry in entries):
                continue
            swapped = next((face for face in drawn if _inside(box, face.box)), None)
            patches = [patch_of(luma, box * scale) for luma in (before, after)]
            unknown = swapped is None and not any(_inside(box, place) for place in covered)
            if unknown and not self._is_in_original(before, box * scale, float(turn), negative):
                continue
            most = LIMITS.max_unchanged_covered if swapped is None else LIMITS.max_unchanged_swapped
            shown = None if swapped is None else swapped.shown(box)
            if unknown or _is_unchanged(patches[0], patches[1], most, shown):
                yield AuditDetection(frame.index, box, float(score), float(turn), negative)

    def _is_in_original(self, luma: U8, box: F32, turn: float, negative: bool) -> bool:
        """Whether a face is in the original as well: edges of covers make background look like faces."""
        return self._search.is_alike(255 - luma if negative else luma, box, turn)


def patch_of(luma: NDArray[Any], box: NDArray[np.floating]) -> U8 | None:
    """The middle of a box (4,) as a small picture; None when it is not in the picture (h, w)."""
    return small_picture(luma, _middle(box), LIMITS.patch_pixels)


def _middle(box: NDArray[np.floating]) -> F64:
    """What is compared of a box (4,)."""
    centre, half = (box[:2] + box[2:]) / 2, LIMITS.compared_share * (box[2:] - box[:2]) / 2
    return np.concatenate([centre - half, centre + half]).astype(np.float64)


def share_within(box: F32, places: Sequence[F64]) -> float:
    """Share of the middle of a box (4,) that lies in any of some places (4,)."""
    middle = _middle(box)
    at = np.linspace(middle[:2], middle[2:], LIMITS.patch_pixels)
    within = [
        np.logical_and.outer(*(((at > low) & (at < high)).T)) for low, high in np.reshape(places, (-1, 2, 2))
    ]
    return float(np.any(within, axis=0).mean()) if within else 0.0


def _is_left(box: F32, entries: Sequence[FaceTreatment]) -> bool:
    """Whether a find is left as the user wished: it is on a track's face, or just what is no face, and no other's."""
    on_faces = any(_inside(box, one.box) for one in entries if one.done == LEFT and one.who != NOBODY)
    things = [one.box for one in entries if one.done == LEFT and one.who == NOBODY]
    is_thing = any(iou(box, thing) >= LIMITS.min_thing_iou for thing in things)
    return on_faces or (is_thing and not any(_inside(box, e.box) for e in entries if e.done == SWAPPED))


def _is_hair(box: F32, turn: float, entry: FaceTreatment) -> bool:
    """Whether a find is the hair of a head whose face is swapped: upside down, grey hair looks like a chin.

    Somebody else's face that is upside down there would lie in part beyond that head, and the head's own, had it been
    followed the wrong way round, on what is swapped.
    """
    upside_down = float(np.cos(turn - entry.turn)) < LIMITS.max_upside_down_cosine
    above = upside_down and not _inside(box, entry.box)
    return entry.done == SWAPPED and above and share_within(box, [entry.region]) == 1


def _is_unchanged(one: U8 | None, other: U8 | None, most: float, where: Bool | None = None) -> bool:
    """Whether two patches show the same, or a larger share of them than `most` does; only there, if that is enough."""
    if one is None or other is None:
        return False
    if float(other.std()) < LIMITS.max_same_grey_levels:
        return False  # plain, as a cover before a wall of its colour is: nobody is seen there
    if where is None or where.mean() < LIMITS.min_shown_share:
        where = np.ones_like(one, bool)
    before, after = one[where].astype(np.float64), other[where].astype(np.float64)
    spread = float(before.std())
    same = np.abs(after - before) <= max(LIMITS.max_same_grey_levels, LIMITS.max_same_spread * spread)
    if float(same.mean()) > most:
        return True
    a, b = (_features(patch)[where] for patch in (one, other))
    return bool((a * b).sum() >= LIMITS.min_unchanged_correlation * np.sqrt((a**2).sum() * (b**2).sum()) + 1)


def _features(patch: U8) -> F64:
    """A patch without the light on it, which a swap keeps: what is left tells whose face it is."""
    grey = patch.astype(np.float64)
    return np.asarray(grey - cv2.GaussianBlur(grey, (0, 0), LIMITS.light_pixels), np.float64)


def _sampled(frames: tuple[int, int], entries: dict[int, list[FaceTreatment]], rate: float) -> set[int]:
    """The frames that are searched: some of all, and more where faces were lost."""
    first, last = frames
    chosen = set(range(first, last, LIMITS.interval_frames))
    known = np.array(sorted(frame for frame, these in entries.items() if these), np.int64)
    if len(known):
        for frame in range(first, last, LIMITS.risky_interval_frames):
            if 0 < np.abs(known - frame).min() <= LIMITS.risky_seconds * rate:
                chosen.add(frame)
    return chosen


def _small(luma: NDArray[Any]) -> tuple[U8, float]:
    return _scaled(luma, LIMITS.kept_pixels / max(luma.shape))


def _scaled(picture: NDArray[Any], factor: float) -> tuple[U8, float]:
    """A picture made smaller by a factor, if that is below 1, and by how much it is."""
    factor = min(1.0, factor)
    size = [max(1, round(side * factor)) for side in picture.shape[1::-1]]
    return np.array(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8), factor


def _inside(box: F32, place: NDArray[np.floating]) -> bool:
    """Whether a box is at a place: its centre lies in the place, or the centre of the place in the box."""
    centre, middle = (box[:2] + box[2:]) / 2, (place[:2] + place[2:]) / 2
    return bool(
        ((centre > place[:2]) & (centre < place[2:])).all() or ((middle > box[:2]) & (middle < box[2:])).all()
    )
