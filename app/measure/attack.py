"""An attack on a folder of de-identified people, from files to figures.

What is known of a person to the attacker, and what he attacks, are different pictures: files of one person, or the
halves of a single video.  Faces are located in the original, and again in the output where one is found there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from glob import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, iou, open_landmarker
from guise.app.measure.attackers import Attacker, By, Evidence, Guesses, attacks, guessed, luck
from guise.app.measure.faces import MIN_CONFIDENCE, MIN_MATCH_IOU, MeasureError, files_by_person
from guise.app.measure.figures import plain
from guise.app.measure.pair import VideoTiming, require_alike
from guise.app.measure.privacy import Scores, template
from guise.app.measure.views import Embedder, Region, embedders
from guise.app.media import frames_at
from guise.app.people.recogniser import Recogniser, five_points
from guise.common.arrays import F32, U8
from guise.common.progress import NoteLog, Progress, Say, mute, silent
from guise.common.threads import one_thread
from guise.common.version import VERSION

SAMPLED_FRAMES = 20  # of what is known, and of what is attacked, of each person
CONTROL_FRAMES = 4  # of each person, turned to the tilt of others
MIN_TILT_DEGREES = 15.0  # of a face's roll, from which it is compared with others that are turned alike
TILT_STEP_DEGREES = 30
OUTPUT_SUFFIX = "_deidentified"


@dataclass(frozen=True)
class AttackRequest:
    """What is attacked.

    originals : folder with a video, or a folder of videos and pictures, for each person.
    outputs : folders with the same files, de-identified; NAME may be NAME_deidentified there.
    recognisers : TOML cards, beside the built-in embedding.   landmarker : spec.
    """

    originals: Path
    outputs: Sequence[Path]
    recognisers: Sequence[Path] = ()
    landmarker: str | None = None


@dataclass(frozen=True)
class RankOne:
    """How often an attacker is right, and the 95 % confidence interval over people."""

    share: float
    interval: tuple[float, float]

    @classmethod
    def of(cls, guesses: Guesses) -> RankOne:
        """Of some guesses."""
        return cls(guesses.rank_one, guesses.interval())


@dataclass(frozen=True)
class Worst:
    """The attacker that is right most often: through which view, by single frames or clips, and its figures.

    luck, luck_95 : mean and 95th percentile of what the best of all attackers would reach by guessing.
    """

    view: str
    attacker: Attacker
    by: By
    rank_one: RankOne
    luck: float
    luck_95: float


@dataclass(frozen=True)
class ViewFigures:
    """What is told through a view.

    Parameters
    ----------
    unchanged : rank 1 of the naive attacker on the originals.   attackers : of each on the output.
    own, impostors : similarity of the output's faces to their own person and to others.
    tilted, tilted_impostors : the same of faces rolled by 15 degrees and more, the others turned alike; or None.
    """

    view: str
    region: Region
    unchanged: Mapping[By, RankOne]
    attackers: Mapping[Attacker, Mapping[By, RankOne]]
    own: Scores | None
    impostors: Scores | None
    tilted: Scores | None
    tilted_impostors: Scores | None


@dataclass(frozen=True)
class AttackedOutput:
    """An output: its name, its figures by view, and the worst attacker that sees the face, or hair and outline only."""

    name: str
    views: tuple[ViewFigures, ...]
    worst: Worst
    worst_outline: Worst


@dataclass(frozen=True)
class AttackResult:
    """All that the attackers reached.  chance : of a guess.   notes : sentences for the user."""

    people: int
    chance: float
    outputs: tuple[AttackedOutput, ...]
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """The result as docs/measure.md explains it."""
        facts = {"format": "guise-attack", "version": 1, "guise": VERSION} | asdict(self)
        return dict(plain(facts))


@dataclass(frozen=True, eq=False)
class _Clip:
    """A file of a person: its original, frames that are looked at, and the face in each."""

    path: Path
    frames: tuple[int, ...]
    faces: tuple[Face, ...]


@dataclass(frozen=True, eq=False)
class _Person:
    """A person's material: what the attacker knows, and what he attacks."""

    name: str
    known: tuple[_Clip, ...]
    published: tuple[_Clip, ...]


@dataclass(frozen=True, eq=False)
class _Seen:
    """Embeddings of some faces by view, (n, d) each, NaN where there is none, and their roll (n,) degrees clockwise."""

    by_view: dict[str, F32]
    roll: NDArray[np.float64]

    def known(self, view: str) -> F32:
        """The embeddings that there are."""
        rows = self.by_view[view]
        return np.asarray(rows[np.isfinite(rows).all(1)], np.float32)


def attack(request: AttackRequest, *, progress: Progress = silent, say: Say = mute) -> AttackResult:
    """Attack outputs with all attackers and views.

    Raises
    ------
    MeasureError, RecogniserError, LandmarkError, MediaError
        For a user's mistake.
    """
    work = _Attack(request, progress, say)
    with one_thread():
        return work.result()


def _people(folder: Path) -> dict[str, list[Path]]:
    """Each person's name and files."""
    if not folder.is_dir():
        raise MeasureError(
            f"--attack needs a folder with a video, or a folder of videos, for each person, got {folder}"
        )
    return files_by_person(folder)


def _files(request: AttackRequest, files: list[Path]) -> list[tuple[Path, list[Path]]]:
    """Each original with its file in every output."""
    return [(file, [_counterpart(request.originals, out, file) for out in request.outputs]) for file in files]


def _counterpart(originals: Path, output: Path, file: Path) -> Path:
    """The de-identified file of an original."""
    folder = output / file.parent.relative_to(originals)
    for stem in (file.stem, file.stem + OUTPUT_SUFFIX):
        for candidate in sorted(folder.glob(f"{escape(stem)}.*")):
            if not candidate.name.endswith((".json", ".html")):
                return candidate
    raise MeasureError(
        f"{output} must hold {file.relative_to(originals)} de-identified, got no such file: write it with "
        f"guise deidentify {originals} --recursive -o {output}"
    )


class _Attack:
    """The work of a request, whose files are checked at once."""

    def __init__(self, request: AttackRequest, progress: Progress, say: Say) -> None:
        self._request, self._progress, self._say = request, progress, NoteLog(say)
        self._views = embedders([Recogniser(card) for card in request.recognisers])
        self._landmarker = open_landmarker(request.landmarker)
        self._pairs = {name: _files(request, files) for name, files in _people(request.originals).items()}
        self._outputs = {original: outputs for files in self._pairs.values() for original, outputs in files}
        for original, outputs in self._outputs.items():
            timing = VideoTiming.of(original)
            for output in outputs:
                require_alike(timing, VideoTiming.of(output))

    def result(self) -> AttackResult:
        """All figures."""
        people = [one for one in map(self._person, self._pairs) if one is not None]
        if len(people) < 2:
            raise MeasureError(
                f"an attack needs two people at least with a face to be found, got {len(people)}"
            )
        if len(people) < 20:
            self._say(f"{len(people)} people are few: with under 20 the intervals say little")
        before = [(self._embedded(p.known, None), self._embedded(p.published, None)) for p in people]
        outputs = []
        for number, folder in enumerate(self._request.outputs):
            after = []
            for done, person in enumerate(people):
                after.append((self._embedded(person.known, number), self._embedded(person.published, number)))
                self._progress(folder.name, (done + 1) / len(people))
            outputs.append(self._output(folder.name, people, before, after))
        return AttackResult(len(people), 1 / len(people), tuple(outputs), tuple(self._say.said))

    def _person(self, name: str) -> _Person | None:
        """A person's faces; None, and a note, where too few are found."""
        files = [original for original, _ in self._pairs[name]]
        half = len(files) // 2
        if half:
            known = [self._clip(file, (0.0, 1.0), half) for file in files[:half]]
            published = [self._clip(file, (0.0, 1.0), len(files) - half) for file in files[half:]]
        else:
            known, published = [self._clip(files[0], (0.0, 0.5), 1)], [self._clip(files[0], (0.5, 1.0), 1)]
        self._progress("faces", (list(self._pairs).index(name) + 1) / len(self._pairs))
        sides = [tuple(clip for clip in side if clip.faces) for side in (known, published)]
        if all(sides):
            return _Person(name, *sides)
        self._say(f"{name} is left out: no face found in one half of the pictures")
        return None

    def _clip(self, path: Path, part: tuple[float, float], among: int) -> _Clip:
        """The faces of a file, in frames evenly spread over a part of it."""
        total = len(VideoTiming.of(path).times)
        first, last = math.ceil(part[0] * total), math.ceil(part[1] * total) - 1
        wanted = set(
            np.linspace(first, max(first, last), max(2, SAMPLED_FRAMES // among)).astype(int).tolist()
        )
        frames, faces = [], []
        for frame in frames_at(path, wanted if last >= first else ()):
            index, rgb = frame.index, frame.rgb()
            found = [face for face in self._landmarker.detect(rgb) if face.confidence >= MIN_CONFIDENCE]
            if found:
                frames.append(index)
                faces.append(found[0])
        return _Clip(path, tuple(frames), tuple(faces))

    def _embedded(self, clips: Sequence[_Clip], output: int | None) -> _Seen:
        """The faces of some clips, in the original or in an output."""
        rows: list[list[F32 | None]] = []
        rolls = []
        for clip in clips:
            path = clip.path if output is None else self._outputs[clip.path][output]
            known = dict(zip(clip.frames, clip.faces, strict=True))
            for frame in frames_at(path, known):
                index, rgb = frame.index, frame.rgb()
                points = known[index].points if output is None else self._found(rgb, known[index])
                rows.append(self._looked(rgb, points))
                rolls.append(roll_degrees(points))
        return _Seen(self._stacked(rows), np.array(rolls))

    def _found(self, rgb: U8, face: Face) -> F32:
        """The landmarks (81, 2) of a face in the output: its own where one is found there, else the original's."""
        found = self._landmarker.refine(rgb, face)
        return face.points if found is None or iou(found.box, face.box) < MIN_MATCH_IOU else found.points

    def _looked(self, rgb: U8, points: F32) -> list[F32 | None]:
        return [view.embed(rgb, points) for view in self._views]

    def _stacked(self, rows: list[list[F32 | None]]) -> dict[str, F32]:
        """By view (n, d), NaN where there is no embedding."""
        found = {}
        for column, view in enumerate(self._views):
            vectors = [row[column] for row in rows]
            size = next((len(v) for v in vectors if v is not None), 1)
            found[view.name] = np.array(
                [np.full(size, np.nan) if v is None else v for v in vectors], np.float32
            ).reshape(-1, size)
        return found

    def _output(
        self, name: str, people: Sequence[_Person], before: list[tuple[_Seen, _Seen]],
        after: list[tuple[_Seen, _Seen]],
    ) -> AttackedOutput:  # fmt: skip
        """All views of an output."""
        controls = self._controls(people, after)
        figures, every = [], {}
        for view in self._views:
            evidence = [
                Evidence(*(seen.known(view.name) for seen in (b[0], a[0], a[1], b[1])))
                for b, a in zip(before, after, strict=True)
            ]
            if not all(len(r) for e in evidence for r in (e.known, e.imitated, e.published, e.hidden)):
                self._say(f"{view.name} is left out: it gives no embedding of some people")
                continue
            guesses = attacks(evidence)
            every[view] = guesses
            figures.append(_figures(view, evidence, guesses, after, controls))
        worst = [
            _worst({v: g for v, g in every.items() if v.region == region}) for region in ("face", "outline")
        ]
        return AttackedOutput(name, tuple(figures), *worst)

    def _controls(
        self, people: Sequence[_Person], after: list[tuple[_Seen, _Seen]]
    ) -> dict[int, list[_Seen]]:
        """By tilt that occurs among the attacked faces, all people's known faces turned to it."""
        rolls = np.concatenate([published.roll for _, published in after])
        tilts = {_step(roll) for roll in rolls[np.abs(rolls) >= MIN_TILT_DEGREES].tolist()}
        return {tilt: [self._turned(person.known, tilt) for person in people] for tilt in sorted(tilts)}

    def _turned(self, clips: Sequence[_Clip], degrees: int) -> _Seen:
        """Some known faces turned so that they are rolled by an angle, and located there."""
        rows, rolls = [], []
        clip = clips[0]
        known = dict(zip(clip.frames, clip.faces, strict=True))
        some = clip.frames[:: max(1, len(clip.frames) // CONTROL_FRAMES)]
        for frame in frames_at(clip.path, some):
            index, rgb = frame.index, frame.rgb()
            turned, points = turned_face(
                rgb, known[index].points, degrees - roll_degrees(known[index].points)
            )
            points = self._found(turned, Face.around(points, 1.0))
            rows.append(self._looked(turned, points))
            rolls.append(roll_degrees(points))
        return _Seen(self._stacked(rows), np.array(rolls))


def _figures(
    view: Embedder, evidence: Sequence[Evidence], guesses: Mapping[tuple[Attacker, By], Guesses],
    after: list[tuple[_Seen, _Seen]], controls: Mapping[int, list[_Seen]],
) -> ViewFigures:  # fmt: skip
    templates = np.stack([template(one.known) for one in evidence])
    scores = [one.published @ templates.T for one in evidence]
    own = [rows[:, i] for i, rows in enumerate(scores)]
    others = [np.delete(rows, i, axis=1).ravel() for i, rows in enumerate(scores)]
    tilted, alike = _tilted(view, templates, after, controls)
    known, hidden = [one.known for one in evidence], [one.hidden for one in evidence]
    by: tuple[By, By] = ("frame", "clip")
    return ViewFigures(
        view=view.name,
        region=view.region,
        unchanged={b: RankOne.of(guessed(known, hidden, b)) for b in by},
        attackers={
            name: {b: RankOne.of(guesses[name, b]) for b in by}
            for name in dict.fromkeys(name for name, _ in guesses)
        },
        own=Scores.of(np.concatenate(own)),
        impostors=Scores.of(np.concatenate(others)),
        tilted=Scores.of(tilted),
        tilted_impostors=Scores.of(alike),
    )


def _tilted(
    view: Embedder,
    templates: NDArray[Any],
    after: list[tuple[_Seen, _Seen]],
    controls: Mapping[int, list[_Seen]],
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Scores of tilted faces with their own person, and with all others turned alike."""
    own, others = [np.zeros(0)], [np.zeros(0)]
    for number, (_, published) in enumerate(after):
        rows = published.by_view[view.name]
        for row, roll in zip(rows, published.roll.tolist(), strict=True):
            if abs(roll) < MIN_TILT_DEGREES or not np.isfinite(row).all():
                continue
            own.append(templates[number : number + 1] @ row)
            turned = [seen.known(view.name) for i, seen in enumerate(controls[_step(roll)]) if i != number]
            others.append(np.array([template(one) @ row for one in turned if len(one)]))
    return np.concatenate(own), np.concatenate(others)


def _worst(every: Mapping[Embedder, Mapping[tuple[Attacker, By], Guesses]]) -> Worst:
    """The most successful attacker of some views."""
    flat = {(view, *key): one for view, guesses in every.items() for key, one in guesses.items()}
    view, attacker, by = max(flat, key=lambda key: flat[key].rank_one)
    return Worst(view.name, attacker, by, RankOne.of(flat[view, attacker, by]), *luck(list(flat.values())))


def roll_degrees(points: NDArray[Any]) -> float:
    """By how much a face (81, 2) is rolled clockwise, -180..180: the line through the eyes."""
    right, left = five_points(points)[:2]
    return float(np.degrees(np.arctan2(*(left - right)[::-1])))


def _step(roll: float) -> int:
    """The tilt of the controls that is nearest to a roll, degrees."""
    return round(roll / TILT_STEP_DEGREES) * TILT_STEP_DEGREES or round(
        math.copysign(TILT_STEP_DEGREES, roll)
    )


def turned_face(rgb: U8, points: NDArray[Any], degrees: float) -> tuple[U8, F32]:
    """A picture turned clockwise about its face, the same size, and the landmarks (81, 2) in it."""
    middle = points.mean(0, dtype=np.float64)
    matrix = cv2.getRotationMatrix2D(tuple(map(float, middle)), -degrees, 1.0)
    size = (rgb.shape[1], rgb.shape[0])
    turned = cv2.warpAffine(rgb, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    moved = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(turned, np.uint8), np.asarray(moved, np.float32)
