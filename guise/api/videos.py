"""Faces swapped: frame by frame, and in whole files."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeVar, Unpack, overload

from guise.aam.landmarks import open_landmarker
from guise.aam.model import Identity
from guise.api.options import AnyPath, DrawOptions, PuppetOptions, SwapFileOptions, encoding, taken
from guise.api.pictures import Person, as_array, identity_of, path_of
from guise.api.vocabulary import call, speaking, watch_of
from guise.app.media import Frame
from guise.app.swapping.session import ALONE, SwapSession
from guise.common.arrays import U8
from guise.common.closing import Closing
from guise.common.errors import GuiseError
from guise.common.threads import one_thread

if TYPE_CHECKING:
    from guise.api.pictures import Picture
    from guise.app.drawing.engine import Engine
    from guise.app.drawing.look import Look
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.photos.swap import SwappedPhoto
    from guise.app.swapping.report import SeveralReport, SwapReport, SwapSettings

P = ParamSpec("P")
R = TypeVar("R")
MICROSECOND = Fraction(1, 1_000_000)


class Swapper(Closing):
    """Puts one person's face on another's head, frame by frame, in the order of time.

    A frame goes in and a new one comes out; the array that was given is never changed.  It may be called from any
    thread: calls are done one after the other.  Close it, or use `with`.

    Parameters
    ----------
    identity : the face that is shown: a model, its file or its name, see `load`.
    source : the person in the frames: likewise, or a clip to enroll them from.
    unsure : what is done where the person's face is lost but a face is seen: "cover" it, "hold" the last face for a
        second, or "leave" the frame as it is.  Other people's faces are never swapped, and else left alone.
    fps : frames a second, from which the time of each is counted unless it is given.
    drawing : `DrawOptions`, such as alpha and renderer.

    Attributes
    ----------
    outcome : what happened to the last frame: "swapped"; "held", lost for a moment: the last face stays where it was;
        "covered"; or "lost": no face was found, or it may be left, and the frame came back as it was.

    Examples
    --------
    >>> import guise
    >>> with guise.Swapper("p06.guise", source="p02.guise") as swapper:  # doctest: +SKIP
    ...     picture = swapper(frame)
    """

    @call
    def __init__(
        self,
        identity: Person,
        source: Person,
        *,
        unsure: Literal["cover", "hold", "leave"] = "cover",
        fps: float = 30.0,
        **drawing: Unpack[DrawOptions],
    ) -> None:
        from guise.app.people.recognised import RecognisedPerson

        shown = identity_of(identity)
        person, self._fps = _source(source, shown), _positive("fps", fps)
        look = _settings(drawing, unsure=unsure).drawn_look()
        self._lock, self._closed = threading.Lock(), False
        # An OpenGL context belongs to one thread.
        has_context = look.renderer != "cpu"
        self._thread = ThreadPoolExecutor(1, "guise-swapper") if has_context else None
        self._is_person = RecognisedPerson(person)
        self._frames, self._seconds, self._next = 0, -math.inf, 0.0
        self.outcome: Literal["swapped", "held", "covered", "lost"] = "lost"
        try:
            self._session = self._done(_open_session, person, shown, look, unsure)
            self._engine = self._session.engine(ALONE)
        except BaseException:
            self._closed = True
            if self._thread is not None:
                self._thread.shutdown()
            raise

    def __call__(self, frame: Picture, seconds: float | None = None) -> U8:
        """The frame with the other face, as a new array (h, w, 3) RGB uint8.

        frame : such an array, or a `PIL.Image`.   seconds : its time, later than that of the frame before.
        """
        with speaking, self._lock:
            if self._closed:
                raise GuiseError("this Swapper is closed: make another one")
            if self._thread is None:
                return self._swap(as_array(frame), seconds)
            return self._thread.submit(self._swap, as_array(frame), seconds).result()

    def _done(self, do: Callable[P, R], *given: P.args, **options: P.kwargs) -> R:
        """What a function gives, in the thread of the context if there is one."""
        if self._thread is None:
            return do(*given, **options)
        return self._thread.submit(do, *given, **options).result()

    def _swap(self, rgb: U8, seconds: float | None) -> U8:
        now = self._next if seconds is None else seconds
        if now <= self._seconds:
            raise GuiseError(
                f"seconds must be later than that of the frame before, {self._seconds:g}, got {now:g}"
            )
        picture = Frame.from_rgb(rgb, round(now * MICROSECOND.denominator), MICROSECOND, self._frames)
        with one_thread():
            fit = self._is_person(picture, self._engine.track(picture))
            outcome = self._session.follow(picture, ALONE, fit).outcome
        assert outcome != "left"
        self.outcome, self._seconds, self._frames = outcome, now, self._frames + 1
        self._next = now + 1 / self._fps
        return picture.rgb()

    def close(self) -> None:
        """Release the renderer; a closed swapper takes no more frames."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._done(self._session.close)
            if self._thread is not None:
                self._thread.shutdown()


def _open_session(person: Identity, shown: Identity, look: Look, unsure: str) -> SwapSession[Engine]:
    """The session with its engine, made in the thread that will use them."""
    from guise.app.drawing.donor import Donor
    from guise.app.drawing.engine import Engine

    session = SwapSession(
        lambda _: Engine(person, Donor.of(shown), open_landmarker("builtin"), look),
        "mosaic" if unsure == "cover" else None,
    )
    session.engine(ALONE)
    return session


@overload
def swap_file(
    video: AnyPath,
    identity: Person,
    output: AnyPath,
    *,
    source: Person | None = None,
    **options: Unpack[SwapFileOptions],
) -> SwapReport: ...
@overload
def swap_file(
    video: AnyPath,
    identity: None,
    output: AnyPath,
    *,
    map: Mapping[str, Person],
    others: Literal["leave", "cover", "fictional"] = "leave",
    **options: Unpack[SwapFileOptions],
) -> SeveralReport: ...
@call
def swap_file(
    video: AnyPath,
    identity: Person | None,
    output: AnyPath,
    *,
    source: Person | None = None,
    map: Mapping[str, Person] | None = None,
    others: Literal["leave", "cover", "fictional"] = "leave",
    **options: Unpack[SwapFileOptions],
) -> SwapReport:
    """Swap the face of the person in a video, or of several; sound, time stamps, rotation and colour tags survive.

    Parameters
    ----------
    video : a video, an image or a folder of images.
    identity : the face that is shown: a model, its file or its name, see `load`; None with `map`.
    output : its suffix decides what is written.
    source : the person in the video: likewise; by default they are enrolled from the video itself.
    map : instead of both, for each of several people the face that they get: by "left", "right", "largest", a number
        of `find_people` as text, a file NAME.guise, or the name of somebody who is kept.
    others : with `map`, what becomes of everybody else: "leave", "cover", or a "fictional" face for each.
    options : `SwapFileOptions`.

    Returns
    -------
    SwapReport : frames, and how many of them are swapped, held, covered and lost; with `map` also what was done to
        each of the `people`.
    """
    from guise.app.photos.swap import swap_any

    if (identity is None) == (map is None):
        raise GuiseError("give the face as identity, or map={SOURCE: FACE} for each of several people")
    if map is not None:
        return _swap_people(video, map, output, others, source, options)
    assert identity is not None
    if others != "leave":
        raise GuiseError("others goes with map: name the people who get a face")
    shown = identity_of(identity)
    person = _person(source, shown, options)
    return swap_any(Path(video), shown, Path(output), source=person, settings=_settings(options))


def _swap_people(
    video: AnyPath, faces: Mapping[str, Person], output: AnyPath, others: Literal["leave", "cover", "fictional"],
    source: Person | None, options: SwapFileOptions,
) -> SwapReport:  # fmt: skip
    from guise.app.swapping.several import Casting, swap_people

    alone = [name for name in ("landmarks", "landmarker", "rest") if options.get(name)]
    if source is not None or alone or options.get("unsure") == "hold":
        raise GuiseError(
            'source, landmarks, landmarker, rest and unsure="hold" are for one person: leave them out'
        )
    return swap_people(Path(video), Casting(_named(faces), others), Path(output), settings=_settings(options))


class SwapPhotoOptions(DrawOptions, total=False):
    """How a photo is swapped.   unsure : as for `swap_file`."""

    unsure: Literal["cover", "leave"]


@call
def swap_photo(
    photo: Picture,
    identity: Person | None = None,
    *,
    map: Mapping[str, Person] | None = None,
    others: Literal["leave", "cover", "fictional"] = "leave",
    **options: Unpack[SwapPhotoOptions],
) -> SwappedPhoto:
    """Swap the largest face of a photo, or several by `map`; nothing is needed of the people in it.

    Parameters
    ----------
    photo : RGB uint8 (h, w, 3) or `PIL.Image`; files are for `swap_file`.
    identity, map, others : as for `swap_file`; numbers count from 1, larger faces first.
    options : `SwapPhotoOptions`.

    Returns
    -------
    SwappedPhoto : picture (h, w, 3); people, what was done with each; found, where they are.
    """
    from guise.app.photos.swap import swap_photo as swap
    from guise.app.swapping.several import Casting

    if (identity is None) == (map is None):
        raise GuiseError("give the face as identity, or map={SOURCE: FACE} for each of several people")
    faces = {"largest": identity} if map is None else map
    casting = Casting(_named(faces), others)  # type: ignore[arg-type]
    return swap(as_array(photo), casting, settings=_settings(options))


def _named(faces: Mapping[str, Person]) -> dict[str, str | Identity]:
    """By person, faces as the engine takes them."""
    return {who: face if isinstance(face, Identity) else os.fspath(face) for who, face in faces.items()}


@call
def puppet_file(
    video: AnyPath,
    identity: Person,
    output: AnyPath,
    *,
    source: Person | None = None,
    **options: Unpack[PuppetOptions],
) -> SwapReport:
    """Animate a still of the identity with the expressions of the person in a video; parameters as for `swap_file`."""
    from guise.app.swapping.puppet import puppet_file as puppet

    shown = identity_of(identity)
    person = _person(source, shown, options)
    return puppet(Path(video), shown, Path(output), source=person, settings=_settings(options))


def _settings(options: Any, **more: Any) -> SwapSettings:
    """The settings of a swap for a call's options."""
    from guise.app.drawing.look import SWAP, DrawingChoices
    from guise.app.media.time_range import TimeRange
    from guise.app.swapping.report import SwapSettings
    from guise.common.option import made

    left: dict[str, Any] = {**options, **more}
    progress, say = watch_of(left)
    look = made(DrawingChoices, **taken(left, DrawOptions)).of(SWAP)
    encode = encoding(left)
    times = [None if (at := left.pop(name, None)) is None else str(at) for name in ("start", "end")]
    part = TimeRange.between(times[0], times[1], left.pop("outside", "keep"))
    return SwapSettings(
        look, encode, part=part, keep_people=left.pop("keep", False), rest_seconds=left.pop("rest", None),
        force=left.pop("overwrite", False), progress=progress, say=say, **left,
    )  # fmt: skip


def _person(source: Person | None, shown: Identity, options: Any) -> Identity | LandmarkSource:
    """The person in a video, or where their landmarks come from, which is taken out of the options."""
    from guise.app.enrolment.landmark_source import LandmarkSource

    file, landmarker = path_of(options.pop("landmarks", None)), options.pop("landmarker", None)
    if source is not None:
        if file or landmarker:
            raise GuiseError(
                "landmarks and landmarker are for enrollment, which source replaces: leave them out"
            )
        return _source(source, shown)
    own = None if landmarker in (None, "builtin") else open_landmarker(landmarker)
    return LandmarkSource([file] if file else [], own)


def _source(person: Person, shown: Identity) -> Identity:
    """The model of the person in the video; a clip is enrolled at the resolution of the face that is shown."""
    if isinstance(person, Identity) or _is_face(Path(person)):
        return identity_of(person)
    from guise.api.faces import enroll

    return enroll(person, resolution=shown.reference.resolution)


def _is_face(path: Path) -> bool:
    """Whether a path is a model's or the name of a face, not that of a clip."""
    return path.suffix == ".guise" or (not path.suffix and not path.exists())


def _positive(name: str, value: float) -> float:
    if not value > 0:
        raise GuiseError(f"{name} must be above 0, got {value}")
    return value
