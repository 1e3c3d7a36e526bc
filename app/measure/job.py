"""A measurement from files to figures.

The faces are located in the original, and the same places are compared in the outputs, so that no privacy figure
depends on whether the output's faces can be found.  Where one is found, it is also compared by its own landmarks, as
an attacker would who has the output alone, and the higher score counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import open_landmarker
from guise.app.measure.curves import expression
from guise.app.measure.faces import (
    FaceLocator,
    FacesByFrame,
    FaceTrack,
    FaceTrackBuilder,
    MeasureError,
    faces_in,
    faces_of_file,
    matched,
)
from guise.app.measure.figures import (
    FileChecks,
    MeasureResult,
    OutputFigures,
    PlotCurves,
    Privacy,
    Reidentification,
    Utility,
    weighted_mean,
)
from guise.app.measure.options import MeasureOptions
from guise.app.measure.pair import (
    BackgroundDifference,
    VideoTiming,
    compare_sounds,
    require_alike,
    side_by_side,
)
from guise.app.measure.people import Gallery, Subject, embeddings_in, group_people, open_gallery
from guise.app.measure.privacy import Scores, accepted, equal_error_rate, rank, rank_one, template
from guise.app.measure.reported import ReportedFaces, read_report
from guise.app.media import open_input
from guise.app.people.recogniser import Recogniser
from guise.app.swapping.donors import open_face
from guise.common.arrays import F32, F64
from guise.common.progress import NoteLog, Progress, Say, mute, silent
from guise.common.threads import one_thread


def measure(
    original: Path, outputs: Sequence[Path], options: MeasureOptions, *, progress: Progress = silent, say: Say = mute
) -> MeasureResult:  # fmt: skip
    """Measure outputs against their original.

    original, outputs : videos, images or folders of images; the outputs show the same frames.

    Raises
    ------
    MeasureError, RecogniserError, LandmarkError, MediaError, ModelError
        For a user's mistake.
    """
    work = _Measurement(original, outputs, options, progress, say)
    with one_thread():
        return work.result()


def _reports(paths: Sequence[Path], outputs: Sequence[Path]) -> dict[Path, ReportedFaces]:
    """The report of each output that has one."""
    found: dict[Path, ReportedFaces] = {}
    for path in paths:
        report = read_report(path)
        own = [o for o in outputs if o.name == report.output] or list(outputs)
        if len(own) != 1:
            raise MeasureError(f"{path} is the report of {report.output}, which is not among the outputs")
        found[own[0]] = report
    return found


class _Measurement:
    """The work, whose inputs are checked at once."""

    def __init__(
        self, original: Path, outputs: Sequence[Path], options: MeasureOptions, progress: Progress, say: Say
    ) -> None:
        self._original, self._outputs, self._options = original, outputs, options
        self._progress, self._say = progress, NoteLog(say)
        if len(options.recognisers) > 1:
            raise MeasureError("several recognisers are compared with --attack only: give one --recogniser")
        self._recogniser = Recogniser(options.recognisers[0]) if options.recognisers else None
        if self._recogniser is None and (options.gallery or options.identities):
            raise MeasureError(
                "--distractors and --identity are compared by a face recogniser: give one with --recogniser"
            )
        self._landmarker = open_landmarker(options.landmarker)
        self._reports = _reports(options.reports, outputs)
        self._timing = VideoTiming.of(original)
        self._timings = [VideoTiming.of(output) for output in outputs]
        for one in self._timings:
            require_alike(self._timing, one)
        self._seconds = np.array([float(t - self._timing.times[0]) for t in self._timing.times])

    def result(self) -> MeasureResult:
        """All figures."""
        independent = self._landmarker.name.partition("@")[0] != "builtin"
        if not independent:
            self._say(
                "expression is measured by the built-in landmarker, from which Guise also makes its swaps: "
                "give another one with --landmarker"
            )
        faces = self._faces()
        matcher = None if self._recogniser is None else self._matcher(faces, self._recogniser)
        people = faces if matcher is None else matcher.faces
        if matcher is None:
            self._say("privacy is not measured without a face recogniser: give one with --recogniser")
        outputs = tuple(
            self._output(path, timing, people, matcher)
            for path, timing in zip(self._outputs, self._timings, strict=True)
        )
        return MeasureResult(
            original=self._timing.name,
            frames=len(self._timing.times),
            seconds=float(self._timing.times[-1] - self._timing.times[0] + self._timing.frame_interval),
            faces=tuple(len(face.frames) for face in people),
            landmarker=self._landmarker.name,
            independent=independent,
            recogniser=self._recogniser.name if self._recogniser else None,
            gallery=matcher.facts() if matcher else {},
            impostors=Scores.of(matcher.gallery.impostors) if matcher else None,
            outputs=outputs,
            notes=tuple(self._say.said),
        )

    def _faces(self) -> list[FaceTrack]:
        """The faces of the original."""
        total = len(self._timing.times)
        if self._options.landmarks is not None:
            return faces_of_file(self._options.landmarks, total)
        with open_input(self._original) as media:
            return faces_in(media, self._landmarker, lambda done: self._progress("faces", done / total))

    def _matcher(self, faces: list[FaceTrack], recogniser: Recogniser) -> FaceMatcher:
        """Enrol the people of the original and of the gallery."""
        folder = self._options.gallery
        known = open_gallery(folder, self._landmarker, recogniser, self._say) if folder else []
        gallery = Gallery.of(known)
        with open_input(self._original) as media:
            embeddings = embeddings_in(media, faces, recogniser)
        groups = group_people(faces, embeddings, gallery.usable_limit)
        own = [_joined_face(group, faces, embeddings) for group in groups]
        for _, rows in own:
            gallery = gallery.without(template(_finite(rows)), self._say)
        matcher = FaceMatcher(
            recogniser, gallery, own, _donors(self._options.identities, self._reports, recogniser, self._say)
        )
        if gallery.limit is None:
            self._say(
                "there is no false-accept rate without at least two other people: give them with --distractors"
            )
        elif not gallery.limit.enough:
            self._say(
                f"{gallery.limit.pairs} pairs of the gallery are too few for a false-accept rate of "
                f"{gallery.limit.rate:g}, which needs {round(1 / gallery.limit.rate)}: the "
                f"threshold is their largest score"
            )
        return matcher

    def _output(
        self, path: Path, timing: VideoTiming, faces: Sequence[FaceTrack], matcher: FaceMatcher | None
    ) -> OutputFigures:
        report = self._reports.get(path)
        pairs, untouched = self._compared(path, faces)
        utilities = [
            Utility.of(before, after.points, after.frames, len(face.frames))
            for face, (before, after) in zip(faces, pairs, strict=True)
        ]
        states = [report.states(face) for face in faces] if report else None
        scores = matcher.scores(path, [after for _, after in pairs]) if matcher else []
        curves = self._plot_curves(faces, pairs, scores, states)
        return OutputFigures(
            name=timing.name,
            privacy=matcher.privacy(scores, states) if matcher else None,
            utility=weighted_mean(utilities, [len(face.frames) for face in faces]),
            people=tuple(utilities),
            files=self._files(path, timing, untouched.psnr),
            plot_curves=curves,
        )

    def _compared(
        self, path: Path, faces: Sequence[FaceTrack]
    ) -> tuple[list[tuple[F32, FaceTrack]], BackgroundDifference]:
        """For each face the landmarks before and after, in the frames in which it is found in the output too."""
        at, untouched = FacesByFrame(faces), BackgroundDifference()
        before, after = FaceTrackBuilder(), FaceTrackBuilder()
        locate, total = FaceLocator(self._landmarker, video=self._timing.video), len(self._timing.times)
        for own, other in side_by_side(self._original, path):
            known = at[own.index]
            places = dict(known)
            for number, points in matched(known, locate(other)):
                before.add(number, own.index, places[number])
                after.add(number, own.index, points)
            untouched.add(own, other, list(places.values()))
            self._progress(path.name, (own.index + 1) / total)
        return [(before.track(i).points, after.track(i)) for i in range(len(faces))], untouched

    def _files(self, path: Path, timing: VideoTiming, psnr: float) -> FileChecks:
        own, other = self._timing.times, timing.times
        apart = max(abs((b - other[0]) - (a - own[0])) for a, b in zip(own, other, strict=True))
        return FileChecks(own == other, float(apart), compare_sounds(self._original, path), psnr)

    def _plot_curves(
        self, faces: Sequence[FaceTrack], pairs: list[tuple[F32, FaceTrack]], scores: list[MatchScores],
        states: list[NDArray[np.str_]] | None,
    ) -> PlotCurves:  # fmt: skip
        """The curves of the person seen in most frames."""
        most = int(np.argmax([len(face.frames) for face in faces]))
        before, after = pairs[most]
        return PlotCurves(
            self._seconds[after.frames], expression(before), expression(after.points),
            self._seconds[faces[most].frames],
            scores[most].own if scores else np.full(len(faces[most].frames), np.nan),
            states[most] if states else None,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class MatchScores:
    """A person's faces in an output: (n,) scores with the person, (n, people) with all, and embeddings (n, d)."""

    own: F64
    every: F64
    embeddings: F32


class FaceMatcher:
    """Compares faces with the people of the original, of the gallery, and with donors.

    own : for each person of the original the face and its embeddings (n, d).
    """

    def __init__(
        self,
        recogniser: Recogniser,
        gallery: Gallery,
        own: list[tuple[FaceTrack, F32]],
        donors: list[Subject],
    ) -> None:
        self._recogniser, self.gallery, self._donors = recogniser, gallery, donors
        self.faces = [face for face, _ in own]
        self._original = [rows for _, rows in own]
        # Every second frame makes the template; those between are the reference of what the same person scores.
        self._own = [template(_finite(rows[::2])) for rows in self._original]
        self._templates = np.stack([*self._own, *(one.template for one in gallery.people)])

    def facts(self) -> dict[str, Any]:
        """About the gallery."""
        limit = self.gallery.limit
        return {
            "people": len(self._templates),
            "pictures": sum(len(one.embeddings) for one in self.gallery.people),
            "impostor_pairs": len(self.gallery.impostors),
            "false_accept_rate": limit and limit.rate,
            "threshold": limit and limit.score,
            "enough_pairs": limit is not None and limit.enough,
        }

    def scores(self, path: Path, again: Sequence[FaceTrack]) -> list[MatchScores]:
        """Each person's scores in a video: at the places of the original or, if higher, where the face is found.

        again : for each person the face as it is found in the video, in some of the original's frames.
        """
        with open_input(path) as media:
            at_place = embeddings_in(media, self.faces, self._recogniser)
        with open_input(path) as media:
            as_found = embeddings_in(media, again, self._recogniser)
        return [self._worse(i, at_place[i], again[i].frames, as_found[i]) for i in range(len(self.faces))]

    def _worse(self, number: int, rows: F32, frames: NDArray[np.int32], found: F32) -> MatchScores:
        """The scores of a person's faces (n, d), or of the one `found` in the same frame where it scores higher."""
        first, second = self._compared(number, rows), self._compared(number, found)
        index = np.searchsorted(self.faces[number].frames, frames)
        higher = (second.own > first.own[index]) | np.isnan(first.own[index])
        for old, new in (
            (first.own, second.own),
            (first.every, second.every),
            (first.embeddings, second.embeddings),
        ):
            old[index[higher]] = new[higher]
        return first

    def _compared(self, number: int, rows: F32) -> MatchScores:
        every = rows.astype(np.float64) @ self._templates.T
        return MatchScores(every[:, number], every, rows)

    def privacy(self, scores: list[MatchScores], states: list[NDArray[np.str_]] | None) -> Privacy:
        """The figures of an output."""
        before = [self._compared(number, rows[1::2]) for number, rows in enumerate(self._original)]
        changed, unchanged = _pooled(scores), _pooled(before)
        nearest = [self._nearest(one) for one in scores]
        return Privacy(
            to_source=Scores.of(changed),
            unswapped=Scores.of(unchanged),
            to_donor=self._to_donors(scores, nearest),
            unswapped_to_donor=self._to_donors(before, nearest),
            rank_one=_rank_one(scores),
            unswapped_rank_one=_rank_one(before),
            chance=1 / len(self._templates),
            verification=self._accepted(changed),
            unswapped_verification=self._accepted(unchanged),
            equal_error_rate=equal_error_rate(changed, self.gallery.impostors),
            unswapped_equal_error_rate=equal_error_rate(unchanged, self.gallery.impostors),
            by_state=_by_state(scores, states),
            people=tuple(
                self._found(i, one, near) for i, (one, near) in enumerate(zip(scores, nearest, strict=True))
            ),
        )

    def _accepted(self, scores: F64) -> float:
        return float("nan") if self.gallery.limit is None else accepted(scores, self.gallery.limit)

    def _nearest(self, one: MatchScores) -> Subject | None:
        """The donor that a person's changed face is most like."""
        mean = template(_finite(one.embeddings)) if np.isfinite(one.own).any() else None
        if mean is None:
            return None
        return max(self._donors, key=lambda donor: float(donor.template @ mean), default=None)

    def _to_donors(self, scores: list[MatchScores], donors: list[Subject | None]) -> Scores | None:
        parts = [
            _finite(one.embeddings) @ donor.template
            for one, donor in zip(scores, donors, strict=True)
            if donor is not None
        ]
        return Scores.of(np.concatenate(parts)) if parts else None

    def _found(self, number: int, one: MatchScores, donor: Subject | None) -> Reidentification:
        rows = _finite(one.embeddings)
        every = self._templates @ template(rows) if len(rows) else np.full(len(self._templates), -1.0)
        return Reidentification(
            number + 1, len(rows), float(every[number]), rank(every, number), len(every), donor.name if donor else ""
        )  # fmt: skip


def _finite(rows: NDArray[Any]) -> F32:
    """The rows (n, d) without those that are NaN."""
    return np.asarray(rows[np.isfinite(rows).all(1)], np.float32)


def _pooled(scores: list[MatchScores]) -> F64:
    """All scores with the own person that there are."""
    values = np.concatenate([one.own for one in scores])
    return np.asarray(values[np.isfinite(values)], np.float64)


def _rank_one(scores: list[MatchScores]) -> float:
    known = [np.isfinite(one.own) for one in scores]
    own = np.concatenate([np.full(int(k.sum()), i) for i, k in enumerate(known)])
    return rank_one(np.concatenate([one.every[k] for one, k in zip(scores, known, strict=True)]), own)


def _by_state(scores: list[MatchScores], states: list[NDArray[np.str_]] | None) -> dict[str, Scores]:
    if states is None:
        return {}
    reported, values = np.concatenate(states), np.concatenate([one.own for one in scores])
    parts = {str(s): Scores.of(values[(reported == s) & np.isfinite(values)]) for s in np.unique(reported)}
    return {state: part for state, part in parts.items() if part is not None}


def _joined_face(group: list[int], faces: list[FaceTrack], embeddings: list[F32]) -> tuple[FaceTrack, F32]:
    """Several tracks of one person as one face, in the order of time."""
    frames = np.concatenate([faces[k].frames for k in group])
    order = np.argsort(frames, kind="stable")
    points = np.concatenate([faces[k].points for k in group])[order]
    return FaceTrack(frames[order], points), np.concatenate([embeddings[k] for k in group])[order]


def _donors(
    faces: Sequence[str], reports: dict[Path, ReportedFaces], recogniser: Recogniser, say: Say
) -> list[Subject]:
    """The donors that were named, and those of the reports."""
    specs = dict.fromkeys([*faces, *(d for report in reports.values() for d in report.donors)])
    known = []
    for spec in specs:
        still = open_face(spec).rest_frame
        vector = recogniser(still.picture, still.shape)
        if vector is None:
            say(f"the recogniser gives no embedding of the donor {spec}")
        else:
            known.append(Subject(spec, vector[None]))
    return known
