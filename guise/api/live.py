"""Another face, live: from a camera, a file, a stream or a program, in a window, a call, a file or a program."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Unpack

from guise.api.options import AnyPath, DrawOptions, WriteOptions, encoding, taken
from guise.api.pictures import Person, as_array, as_names
from guise.api.vocabulary import call, watch_of
from guise.common.arrays import U8
from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say

if TYPE_CHECKING:
    from guise.api.pictures import Picture
    from guise.app.live.options import LiveOptions
    from guise.app.live.output import OutputFrame
    from guise.app.live.run import LiveReport

    Frames: TypeAlias = Iterable[Picture] | Callable[[], Picture | None]
    Sink: TypeAlias = AnyPath | Callable[["LiveFrame"], object]


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A finished frame.

    Parameters
    ----------
    picture : RGB uint8 (h, w, 3).   seconds : its time in the input.
    outcome : "swapped"; "covered", only faces; "lost", all of it is covered; "off", covered as wished; "shown",
        unchanged as wished; "enrolling", covered until there is a model.
    message : a sentence for the person, "" for none.   enrolled : share in [0, 1] of the enrollment, None without one.
    """

    picture: U8
    seconds: float
    outcome: str
    message: str
    enrolled: float | None


class LiveCallOptions(DrawOptions, WriteOptions, total=False):
    """How a session runs; see `guise live` for each.

    camera : its number; size and fps are requested of it.   loop : repeat the file.
    enroll : make a new model of the person in the picture.   unsure : what is done with a face that cannot be swapped.
    """

    camera: int
    size: tuple[int, int]
    fps: float
    loop: bool
    enroll: bool
    mode: Literal["swap", "puppet", "off"]
    side_by_side: bool
    readout: bool
    cover: Literal["solid", "mosaic", "blur"]
    unsure: Literal["cover", "leave"]
    mirror: bool | None
    overwrite: bool
    progress: Progress
    say: Say


class LiveSession:
    """Shows another face live.  Faces that cannot be swapped are covered, and all of the frame while nobody is known.

    Parameters
    ----------
    identity : the face that is shown, or several to choose from with the number keys; by default the fictional ones.
    source : model of the person in the picture; by default the one that is kept for this camera or file, or they are
        enrolled in front of it.
    map : instead of both, for up to four people the face of each, by their models; everybody else is covered.
    input : a file, a stream, or frames: an iterable of pictures, or a function that gives the next one, None at the
        end; by default the camera.
    output : "window", "virtualcam", a file, a function that is called with each `LiveFrame`, or several of them.
    paced : with frames of your own, whether they come in real time, so that those which come too fast are left out;
        otherwise each is waited for.
    options : `LiveCallOptions`.
    """

    @call
    def __init__(
        self,
        identity: Person | Sequence[Person] = (),
        *,
        source: Person | None = None,
        map: Mapping[str, Person] | None = None,
        input: AnyPath | Frames | None = None,
        output: Sink | Sequence[Sink] = "window",
        paced: bool = False,
        **options: Unpack[LiveCallOptions],
    ) -> None:
        several = isinstance(identity, Sequence) and not isinstance(identity, str)
        self._faces: list[Person] = list(identity) if several else [identity]  # type: ignore[arg-type,list-item]
        self._source, self._cast, self._input, self._paced = source, dict(map or {}), input, paced
        alone = isinstance(output, str | os.PathLike) or callable(output)
        self._outputs: list[Sink] = [output] if alone else list(output)  # type: ignore[arg-type,list-item]
        self._options: dict[str, Any] = {**options}
        self._stopped = threading.Event()
        if self._cast and (self._faces or source is not None):
            raise GuiseError("map says who gets which face: leave out identity and source")
        if not self._outputs:
            raise GuiseError('a session needs an output: "window", "virtualcam", a file or a function')

    @call
    def run(self) -> LiveReport:
        """Run until the input ends, the user quits or `stop` is called; what was done.

        A window needs the main thread; otherwise any thread will do.
        """
        from guise.app.live.feeds import FrameCall, FrameFeed, Program
        from guise.app.live.run import run_live

        left = dict(self._options)
        progress, say = watch_of(left)
        is_fed = self._input is not None and not isinstance(self._input, str | os.PathLike)
        feed = (
            FrameFeed(_arrays(self._input), fps=left.get("fps", 30.0), paced=self._paced) if is_fed else None
        )
        calls = [one for one in self._outputs if not isinstance(one, str | os.PathLike)]
        places = [os.fspath(one) for one in self._outputs if isinstance(one, str | os.PathLike)]
        every = feed is not None and not self._paced
        program = Program(
            feed, [FrameCall(partial(_call, one), lossless=every) for one in calls], self._stopped
        )
        given = {str(n): face for n, face in enumerate(self._faces)} | {
            f"={who}": f for who, f in self._cast.items()
        }
        if self._source is not None:
            given["source"] = self._source
        with as_names(given) as names:
            live = _options(left, names, None if is_fed else self._input, places)
            return run_live(live, progress=progress, say=say, program=program)

    def stop(self) -> None:
        """End soon; from any thread."""
        self._stopped.set()


def _options(
    left: dict[str, Any], names: Mapping[str, str], input: Any, places: Sequence[str]
) -> LiveOptions:
    """The options of a session.   names : of faces, by number; of those of a cast, by = and the person; source."""
    from guise.app.drawing.look import LIVE, LIVE_CHOICES, DrawingChoices
    from guise.app.live.options import LiveOptions, LiveSettings
    from guise.common.option import made

    choices = made(DrawingChoices, **asdict(LIVE_CHOICES) | taken(left, DrawOptions))
    mirror = left.pop("mirror", None)
    settings = LiveSettings(
        alpha=choices.alpha, mirror=input is None if mirror is None else mirror, style=left.pop("cover", "mosaic"),
        **{name: left.pop(name) for name in ("mode", "side_by_side", "readout", "unsure") if name in left},
    )  # fmt: skip
    encode = encoding(left, crf=20)
    return made(
        LiveOptions,
        input=None if input is None else os.fspath(input), outputs=tuple(places),
        identities=tuple(name for key, name in names.items() if key.isdigit()), source=names.get("source"),
        cast={key[1:]: name for key, name in names.items() if key.startswith("=")}, settings=settings,
        look=choices.of(LIVE), encode=encode, force=left.pop("overwrite", False),
        enrol=left.pop("enroll", False), **left,
    )  # fmt: skip


def _arrays(frames: Any) -> Iterator[U8]:
    """The frames of an iterable, or of a function until it gives none."""
    return (as_array(frame) for frame in (_until_none(frames) if callable(frames) else frames))


def _until_none(give: Callable[[], Picture | None]) -> Iterator[Picture]:
    while (frame := give()) is not None:
        yield frame


def _call(function: Callable[[LiveFrame], object], shown: OutputFrame) -> None:
    frame, result = shown.frame, shown.result
    function(LiveFrame(frame.rgb(), frame.seconds, result.outcome, shown.message, shown.ring))
