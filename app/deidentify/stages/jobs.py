"""The jobs of a de-identification: each reads the manifest and earlier results, and writes its own result whole.

Any process may do a job, at any time after the stage before; a job whose result exists does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.heads import region
from guise.aam.model import Identity
from guise.aam.parsing import HeadParser
from guise.app.deidentify.covers import rows_from
from guise.app.deidentify.stages.alike import LIMITS as ALIKE
from guise.app.deidentify.stages.alike import Signatures
from guise.app.deidentify.stages.audit import Audit, AuditDetection
from guise.app.deidentify.stages.case import KEPT, Case, LinkedTrack
from guise.app.deidentify.stages.fit import Fits
from guise.app.deidentify.stages.gaps import Gaps, packed, steadied
from guise.app.deidentify.stages.head import knows_head
from guise.app.deidentify.stages.head_matte import find_head
from guise.app.deidentify.stages.loose import gap_of
from guise.app.deidentify.stages.people import enrol
from guise.app.deidentify.stages.pieces import open_piece, read_piece
from guise.app.deidentify.stages.render import (
    LIMITS,
    JudgedPlaces,
    SegmentRenderer,
    entries_of,
    numbers_of,
    with_detections,
)
from guise.app.deidentify.stages.search import AuditSearch
from guise.app.deidentify.stages.things import Sights, find_doubtful, find_things, known_things
from guise.app.deidentify.stages.work import WorkFolder
from guise.app.media import Frame, MediaInput, Sink, process
from guise.app.media.input import VideoInput
from guise.app.media.problems import ProblemLog
from guise.app.people.faces import detect_faces
from guise.app.swapping.policy import SWAPPED, FaceTreatment
from guise.app.swapping.trust import LocatedFace, TrustJudge
from guise.common.files import write_whole
from guise.common.memory import given_back
from guise.common.threads import one_thread

PICTURE_PIXELS = 160  # side of a track's pictures
MAX_REPORT_PICTURES = 4  # of each track


@dataclass(frozen=True)
class Job:
    """A piece of work that any process may do: the `index`-th of a stage, for a work folder."""

    stage: str
    work: str
    index: int


def perform(job: Job) -> None:
    """Do a job, unless its result exists."""
    work = WorkFolder(Path(job.work))
    if not work.has(result_of(job.stage, job.index)):
        with one_thread(), given_back():
            _STAGES[job.stage](Case(work), job.index)


def result_of(stage: str, index: int) -> str:
    """The name of the result that is written last."""
    return f"{stage}.{index}.{'npz' if stage in ('detect', 'fit') else 'json'}"


def detect(case: Case, segment: int) -> None:
    """Find all faces of a segment."""
    piece, problems = case.scan.segments[segment], ProblemLog()
    found = detect_faces(case.frames(piece.first, piece.end, problems))
    case.work.save_json(f"problems.{segment}.json", {"all": problems, "damage": problems.damage})
    case.work.save_arrays(f"detect.{segment}.npz", **found.arrays())


def person(case: Case, index: int) -> None:
    """Enrol the person of a track."""
    track = case.linked[index]
    model = enrol(case, track)
    if isinstance(model, Identity):
        write_whole(case.work.path(f"person.{track.number}.guise"), model.save)
    case.work.save_json(f"person.{index}.json", model if isinstance(model, str) else "")


def fit(case: Case, segment: int) -> None:
    """Fit each person in a segment, and take pictures of the tracks."""
    found, judge = case.found(segment), TrustJudge()
    parser = HeadParser() if case.options.region == "head" else None
    gaps: Gaps = {}
    wanted: dict[int, list[tuple[LinkedTrack, int]]] = {}
    for track in case.linked:
        for number in (n for s, n in track.pieces if s == segment):
            for at in np.flatnonzero(found.tracklet == number).tolist():
                wanted.setdefault(int(found.frame[at]), []).append((track, at))
    rows: list[tuple[int, int, LocatedFace]] = []
    pictures: dict[str, NDArray[np.uint8]] = {}
    if wanted:
        for frame in case.frames(min(wanted), max(wanted) + 1):
            for track, row in wanted.get(frame.index, []):
                points = found.points[row].astype(np.float64)
                if case.has_model(track.number) and np.isfinite(points).all():
                    placed = judge.locate(
                        case.tracker_of(track.number), frame, points, float(found.confidence[row])
                    )
                    if parser is not None and placed.confidence:
                        head = find_head(parser, frame, placed.shape)
                        if knows_head(head, placed.shape):
                            gaps[track.number, frame.index] = gap_of(frame, placed.shape, head)
                        else:
                            placed = LocatedFace(placed.shape, 0.0)
                    rows.append((track.number, frame.index, placed))
                if frame.index in track.shown:
                    pictures[f"{track.number}.{frame.index}"] = picture(
                        frame, found.box[row], found.turn[row]
                    )
    case.work.save_arrays(f"pictures.{segment}.npz", **pictures)
    if parser is not None:
        shapes = {(track, frame): placed.shape for track, frame, placed in rows}
        case.work.save_arrays(f"gaps.{segment}.npz", **packed(steadied(gaps, shapes)))
    case.work.save_arrays(f"fit.{segment}.npz", **vars(Fits.of(rows)))


def picture(frame: Frame, box: NDArray[np.floating], turn: float) -> NDArray[np.uint8]:
    """A square picture, PICTURE_PIXELS wide, of a face and its surroundings; black beyond the frame."""
    x0, y0, x1, y1 = region(box, turn=turn)
    half = max(x1 - x0, y1 - y0) / 2 + 1
    low = [int(np.floor((x0 + x1) / 2 - half)), int(np.floor((y0 + y1) / 2 - half))]
    side = int(2 * half) + 1
    canvas = np.zeros((side, side, 3), np.uint8)
    left, top, w, h = frame.align_roi(low[0], low[1], low[0] + side, low[1] + side)
    if w and h:
        rgb = frame.rgb_roi(left, top, w, h)[max(0, low[1] - top) :, max(0, low[0] - left) :]
        y, x = max(0, top - low[1]), max(0, left - low[0])
        rgb = rgb[: side - y, : side - x]
        canvas[y : y + rgb.shape[0], x : x + rgb.shape[1]] = rgb
    return np.asarray(
        cv2.resize(canvas, (PICTURE_PIXELS, PICTURE_PIXELS), interpolation=cv2.INTER_AREA), np.uint8
    )


def trial(case: Case, segment: int) -> None:
    """Draw each person in a few frames, to know whether they are recognised before all is rendered."""
    first, last = case.span(segment)
    planned = entries_of(case.plan, first, last)
    frames = _sample(case.work, segment, tried_frames(planned))
    with SegmentRenderer(case, segment, {frame.index: planned[frame.index] for frame in frames}) as drawing:
        drawing.signatures = Signatures(1)
        for frame in frames:
            drawing.draw(frame.copy())
        case.work.save_json(f"trial.{segment}.json", {"signatures": drawing.signatures.as_json()})


def tried_frames(planned: Mapping[int, Sequence[FaceTreatment]]) -> tuple[int, ...]:
    """Of frames with what is done in them, some that show each person who is drawn."""
    shown: dict[int, list[int]] = {}
    for frame, entries in sorted(planned.items()):
        for who in {one.who for one in entries if one.done == SWAPPED}:
            shown.setdefault(who, []).append(frame)
    most = ALIKE.tried_frames
    chosen = {f[k] for f in shown.values() for k in np.linspace(0, len(f) - 1, most).astype(int).tolist()}
    return tuple(sorted(chosen))


@lru_cache(maxsize=1)
def _sample(work: WorkFolder, segment: int, wanted: tuple[int, ...]) -> list[Frame]:
    """Some frames of a segment, kept for the next trial."""
    first, last = (wanted[0], wanted[-1] + 1) if wanted else (0, 0)
    return [frame for frame in Case(work).frames(first, last) if frame.index in wanted]


def render(case: Case, segment: int) -> None:
    """Swap and cover, encode, audit; and pictures of the result."""
    _sample.cache_clear()
    first, last = case.span(segment)
    planned = entries_of(case.plan, case.scan.segments[segment].first, last)
    covered: list[AuditDetection] = []
    judged = JudgedPlaces()
    pictures: dict[str, NDArray[np.uint8]] = {}

    def entries() -> dict[int, list[FaceTreatment]]:
        found = with_detections(planned, covered, first, last, case.rate, judged)
        return {f: these if case.worked_on[f] else planned.get(f, []) for f, these in found.items()}

    with ExitStack() as stack:
        media = stack.enter_context(case.open_input())
        every_frame = case.options.audit == "full" or not isinstance(media, VideoInput)
        audit = stack.enter_context(
            Audit(
                AuditSearch(case.options.detector), (first, last), planned, case.rate, every_frame=every_frame
            )
        )
        segment_renderer = stack.enter_context(SegmentRenderer(case, segment, planned))
        _look(case, audit, range(first, last), entries(), covered)
        for attempt in range(1 + LIMITS.max_repeats):
            for _ in range(LIMITS.max_repeats):
                if wanted := audit.unsearched:
                    _look(case, audit, wanted, entries(), covered)
            judged = judged_places(case, covered, last - first)
            segment_renderer.entries = entries()
            segment_renderer.things = [*known_things(case), *judged.things]
            segment_renderer.signatures = Signatures()
            _encode(case, media, segment, segment_renderer)
            result, drawn = _pictured(case, segment, segment_renderer, pictures), segment_renderer.drawn
            detections = _worked_on(case, audit.after(result, segment_renderer.treated, drawn))
            if not detections or attempt == LIMITS.max_repeats:
                break
            audit.look_closer(detections)
            covered += detections
        unclear = [at for at in audit.unclear if case.worked_on[at]]
        renderer, problems = segment_renderer.renderer, list(media.problems)
    KEPT.clear()  # this was the last stage
    case.work.save_arrays(f"output.{segment}.npz", **pictures)
    inside = {frame: these for frame, these in segment_renderer.done.items() if frame >= first}
    case.work.save_arrays(f"drawn.{segment}.npz", **rows_from(inside))
    hidden = [one for one in covered if not any(thing.is_at(one.box) for thing in judged.things)]
    findings = [_finding(one, True) for one in hidden] + [_finding(one, False) for one in detections]
    case.work.save_json(
        f"render.{segment}.json",
        {
            "audit": findings,
            "unclear": unclear,
            "signatures": segment_renderer.signatures.as_json(),
            "searched": audit.searched,
            "renderer": renderer,
            "problems": problems,
        },
    )


def judged_places(case: Case, detections: Sequence[AuditDetection], reach: int) -> JudgedPlaces:
    """What is known of the places at which the audit found something.   reach : frames of the segment."""
    numbers, places = np.array(numbers_of(detections, reach), np.int32), []
    for number in np.unique(numbers).tolist():
        here = sorted(
            (detections[k] for k in np.flatnonzero(numbers == number).tolist()), key=lambda one: one.frame
        )
        places.append(
            Sights(
                np.array([one.frame for one in here], np.int32), np.array([one.box for one in here], np.float32),
                np.array([one.turn for one in here], np.float32), np.array([one.score for one in here], np.float32),
            )
        )  # fmt: skip
    return JudgedPlaces(find_things(case, places), find_doubtful(case, places))


def _look(
    case: Case, audit: Audit, frames: Sequence[int], entries: dict[int, list[FaceTreatment]],
    missed: list[AuditDetection],
) -> None:  # fmt: skip
    """Show the audit the original between some frames; what was missed there is added, and looked at closer."""
    found = _worked_on(case, audit.before(case.frames(frames[0], frames[-1] + 1), entries))
    audit.look_closer(found)
    missed += found


def _worked_on(case: Case, detections: Iterable[AuditDetection]) -> list[AuditDetection]:
    """Those in frames in which faces are hidden."""
    return [one for one in detections if case.worked_on[one.frame]]


@given_back()
def _encode(case: Case, media: MediaInput, segment: int, segment_renderer: SegmentRenderer) -> None:
    """Write a segment as it is drawn; the encoder, which is large, is released with this."""
    first, last = case.span(segment)
    frames = _FrameRange(case, case.scan.segments[segment].first, last)
    with open_piece(case, media, segment) as sink:
        process(frames, _SinkFromFrame(sink, first), segment_renderer.draw)


def _finding(one: AuditDetection, covered: bool) -> dict[str, Any]:
    box = [round(float(v)) for v in one.box]
    return {"frame": one.frame, "box": box, "score": round(one.score, 3), "covered": covered}


def _pictured(
    case: Case, segment: int, segment_renderer: SegmentRenderer, pictures: dict[str, NDArray[np.uint8]]
) -> Iterator[Frame]:
    """The frames that were written; pictures of the tracks in them are added."""
    wanted = {frame: track.number for track in case.linked for frame in track.shown[:MAX_REPORT_PICTURES]}
    origins = {track.number: track.origin for track in case.tracks}
    for frame in read_piece(case, segment):
        for entry in segment_renderer.entries.get(frame.index, []) if frame.index in wanted else ():
            if entry.who in origins and wanted[frame.index] == origins[entry.who]:
                pictures[f"{entry.who}.{frame.index}"] = picture(frame, entry.box, entry.turn)
        yield frame


class _FrameRange:
    """The frames [first, last) of a case as an input."""

    def __init__(self, case: Case, first: int, last: int) -> None:
        self._case, self._first, self._last = case, first, last
        self.problems = ProblemLog()

    def __iter__(self) -> Iterator[Frame]:
        return self._case.frames(self._first, self._last, self.problems)


class _SinkFromFrame:
    """A sink that takes the frames from `first` on: those before only warm up the renderer."""

    def __init__(self, sink: Sink, first: int) -> None:
        self._sink, self._first = sink, first

    def write(self, frame: Frame) -> None:
        """Write the frame unless it comes before the first one."""
        if frame.index >= self._first:
            self._sink.write(frame)


_STAGES: dict[str, Callable[[Case, int], None]] = {
    "detect": detect,
    "person": person,
    "fit": fit,
    "trial": trial,
    "render": render,
}
