"""What is shown, kept: recordings with their true times, and snapshots.  All say in their tags that they are synthetic.

Only the result is written, never the camera's own picture beside it.
"""

from __future__ import annotations

import shutil
from fractions import Fraction
from itertools import count
from pathlib import Path

from guise.app.live.capture import Say
from guise.app.live.letterbox import letterboxed
from guise.app.live.output import Output, Shown
from guise.app.media import EncodeOptions, Frame, MediaError, Source
from guise.app.media.beside import Beside
from guise.app.media.encoding import encoding_for
from guise.app.media.images import encode_image
from guise.app.media.sink import VideoOutput, as_media_error
from guise.app.media.source import VideoSource
from guise.app.media.synthetic import synthetic_tags
from guise.common.errors import OutputError
from guise.common.files import require_free, write_whole

TICK = Fraction(1, 90_000)  # seconds, unit of the times in a recording
RESERVE = 64_000_000  # bytes that a live recording leaves free: completing a file takes some
STEM = "guise"  # of the names of recordings and snapshots
_DEFAULTS = EncodeOptions()


class Recorder(Output):
    """Writes what is shown to a video file, which is NAME.part until it is closed.

    Parameters
    ----------
    path : of the file.
    source : the file that is shown, from its beginning and once; its times, sound and other streams are kept, and no
        picture is lost on the way.
        None for a camera, a stream or a loop: the times are those of arrival, and there is no sound.
    encode : how.   force : replace what is there.
    whole : keep the file only if all of the source was shown.
    say : called with a sentence when the recording must end before the show; without it, that is raised.

    Raises
    ------
    OutputError
        When the file cannot be written.  `open` raises MediaError for what only the encoder knows.
    """

    def __init__(
        self, path: Path, *, source: Source | None = None, encode: EncodeOptions = _DEFAULTS,
        force: bool = False, whole: bool = False, say: Say | None = None,
    ) -> None:  # fmt: skip
        if source is not None and path.exists() and path.samefile(source.path):
            raise OutputError(f"{path} is the input itself: choose another name for the output")
        require_free(path, force=force)
        self.path, self.lossless = path, source is not None
        self._source, self._encode, self._force = source, encode, force
        self._whole, self._say = whole, say
        self._file: _File | None = None
        self._begun = self._checked = 0.0
        self._last = -1

    def open(self, width: int, height: int, fps: float) -> None:
        """Begin the file; without a source, pictures of another size are shown whole in it."""
        source = self._source or _Endless(self.path, width, height, fps)
        self._file = _File(self.path, source, self._encode, force=self._force)

    def show(self, shown: Shown) -> None:
        """Write a picture, unless the recording has ended."""
        if self._file is None:
            return
        try:
            frame = self._timed(shown, self._file)
            if frame is not None:
                self._file.write(frame)
        except MediaError as error:
            self.abort()
            self._tell(str(error))
            return
        if self._say is not None and shown.arrived >= self._checked + 1:
            self._checked = shown.arrived
            self._keep_reserve()

    def close(self) -> None:
        """Complete the file; there is none when nothing was shown."""
        file, self._file = self._file, None
        if file is None:
            return
        try:
            if not file.frames or (file.copy_rest() and self._whole):
                file.abort()
                return
            with file:
                pass
        except MediaError as error:
            file.abort()
            self._tell(str(error))

    def abort(self) -> None:
        """Remove what was written; nothing more will be."""
        file, self._file = self._file, None
        if file is not None:
            file.abort()

    def _timed(self, shown: Shown, file: _File) -> Frame | None:
        """The picture with its time in the file; None when it came with the one before."""
        if self._source is not None:
            return shown.frame
        if not file.frames:
            self._begun = shown.arrived
        pts = round((shown.arrived - self._begun) / TICK)
        if pts <= self._last:
            return None
        self._last = pts
        frame = Frame.from_rgb(letterboxed(shown.frame.rgb(), *file.size), pts, TICK)
        frame.duration = file.usual_duration
        return frame

    def _keep_reserve(self) -> None:
        """Complete the recording while there is room for that."""
        if shutil.disk_usage(self.path.parent).free < RESERVE:
            self.close()
            self._tell(f"The disk is nearly full: {self.path.name} ends here, and what was recorded is kept.")

    def _tell(self, sentence: str) -> None:
        if self._say is None:
            raise MediaError(sentence)
        self._say(sentence)


class Recordings(Output):
    """Recordings that begin and end when the user says so, each in a file of its own.

    Parameters
    ----------
    folder : in which guise-001.mp4 and so on are written.   encode : how.
    say : called with what happened, one sentence.
    """

    def __init__(self, folder: Path, encode: EncodeOptions = _DEFAULTS, say: Say = print) -> None:
        self.recording = False
        self._folder, self._encode, self._say = folder, encode, say
        self._now: Recorder | None = None
        self._fps = 30.0

    def toggle(self) -> None:
        """Begin with the next picture, or end with it; from any thread."""
        self.recording = not self.recording

    def open(self, width: int, height: int, fps: float) -> None:
        self._fps = fps

    def show(self, shown: Shown) -> None:
        """Write a picture while it is recorded; what goes wrong ends the recording and is said."""
        if self.recording and self._now is None:
            self._begin(shown.frame)
        elif not self.recording and self._now is not None:
            self.close()
        if self._now is not None:
            self._now.show(shown)

    def close(self) -> None:
        """Complete the recording that is under way."""
        if (recorder := self._now) is not None:
            self._now = None
            recorder.close()
            if recorder.path.exists():
                self._say(f"Recorded {recorder.path}.")

    def _begin(self, frame: Frame) -> None:
        try:
            path = numbered(self._folder, ".mp4")
            recorder = Recorder(path, encode=self._encode, say=self._stop)
            recorder.open(frame.width, frame.height, self._fps)
        except (OutputError, MediaError) as error:
            self._stop(str(error))
            return
        self._now = recorder
        self._say(f"Recording to {path}.")

    def _stop(self, sentence: str) -> None:
        self.recording, self._now = False, None
        self._say(sentence)


class _Endless(Source):
    """What stands for a camera, a stream or a loop to the encoder."""

    kind = "video"

    def __init__(self, path: Path, width: int, height: int, fps: float) -> None:
        super().__init__(path)
        self.width, self.height = width, height
        self.frame_rate = Fraction(fps).limit_denominator(1001)
        self.time_base = TICK


class _File(VideoOutput):
    """The file: pictures encoded, the source's other streams copied as far as the pictures come.

    size : (width, height), pixels.   usual_duration : of a picture, in units of the source's time base.
    """

    def __init__(self, path: Path, source: Source, encode: EncodeOptions, *, force: bool) -> None:
        encoding = encoding_for(source, encode)
        super().__init__(
            path, source, encoding, force=force, tags=synthetic_tags(), private=False, audio="keep"
        )
        self._source, self.size = source, (source.width, source.height)
        self.usual_duration = round(1 / (source.frame_rate * source.time_base))
        self._beside = Beside(source) if isinstance(source, VideoSource) else None
        self._last = 0

    def write(self, frame: Frame) -> None:
        # A capture counts from 0, the other streams from where the file begins.
        self._last = frame.pts + (self._beside.first if self._beside else 0)
        for packet in self._beside.until(self._last) if self._beside else ():
            self._copy(packet)
        with as_media_error(self.path):
            picture = self._encoding.picture(frame)
            picture.pts = self._last
            self._mux(self._stream.encode(picture))
        self.frames += 1

    def copy_rest(self) -> bool:
        """Copy what is left beside the pictures; whether the source has more pictures."""
        if self._beside is None:
            return self.frames < (self._source.frame_count or 0)
        for packet in self._beside.rest(self._last, self._last + self.usual_duration):
            self._copy(packet)
        return self._beside.cut

    def _finish(self) -> None:
        self._mux(self._stream.encode(None))
        super()._finish()


def snapshot(frame: Frame, folder: Path) -> Path:
    """Write a picture to guise-001.png, or the next free number, in a folder; OutputError when it cannot be."""
    path = numbered(folder, ".png")
    require_free(path, force=False)
    data = encode_image(frame.rgb(), None, path.suffix, synthetic_tags())
    write_whole(path, lambda part: part.write_bytes(data))
    return path


def numbered(folder: Path, suffix: str) -> Path:
    """The first name of guise-001, guise-002 ... with a suffix that is not taken, also not by one being written."""
    names = (f"{STEM}-{number:03d}{suffix}" for number in count(1))
    return next(folder / n for n in names if not any((folder / m).exists() for m in (n, f"{n}.part")))
