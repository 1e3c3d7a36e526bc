"""Recordings with true time stamps, and snapshots, of what is shown.  Their metadata says that they are synthetic.

Only the result is written, never the camera's original picture.
"""

from __future__ import annotations

import shutil
import time
from fractions import Fraction
from itertools import count
from pathlib import Path

from guise.app.live.microphone import Microphone
from guise.app.live.output import Output, OutputFrame
from guise.app.media import EncodeOptions, Frame, MediaError, MediaInput
from guise.app.media.audio_reader import Samples
from guise.app.media.encoding import encoding_for
from guise.app.media.image_writing import encode_image
from guise.app.media.input import VideoInput
from guise.app.media.other_streams import OtherStreams
from guise.app.media.pictures import letterboxed
from guise.app.media.sink import VideoOutput, as_media_error
from guise.app.media.sound_track import SoundTrack
from guise.app.media.synthetic import synthetic_tags
from guise.common.errors import OutputError
from guise.common.files import require_free, write_whole
from guise.common.progress import Say

TIME_BASE = Fraction(1, 90_000)  # seconds, of a recording
RESERVE_BYTES = 64_000_000  # of disk space that a live recording leaves free, for completing the file
STEM = "guise"  # of the names of recordings and snapshots
_DEFAULTS = EncodeOptions(crf=20)


class VideoRecorder(Output):
    """Writes what is shown to a video file, which is called NAME.part until it is closed.

    Parameters
    ----------
    path : of the file.
    media : the input file, when it is shown once from its beginning; its time stamps, sound and other streams are kept
        and no frame is dropped.
        None for a camera, a stream or a loop: times are those of arrival.
    microphone : the sound of such a recording, if it gives any by then, or None.
    encode : encoder settings.   force : replace an existing file.
    whole : keep the recording only if all of the input was shown.
    say : called with a sentence when the recording must end early; without it, MediaError is raised.

    Attributes
    ----------
    is_written : the file is complete.

    Raises
    ------
    OutputError
        When the file cannot be written.  `open` raises MediaError when the encoder refuses the settings.
    """

    def __init__(
        self, path: Path, *, media: MediaInput | None = None, encode: EncodeOptions = _DEFAULTS,
        force: bool = False, whole: bool = False, say: Say | None = None, microphone: Microphone | None = None,
    ) -> None:  # fmt: skip
        if media is not None and path.exists() and path.samefile(media.path):
            raise OutputError(f"{path} is the input itself: choose another name for the output")
        require_free(path, force=force)
        self.path, self.lossless = path, media is not None
        self._media, self._encode, self._force = media, encode, force
        self._whole, self._say, self._microphone = whole, say, microphone
        self._file: _RecordingFile | None = None
        self.is_written = False
        self._begun = self._checked = 0.0
        self._last = -1

    def open(self, width: int, height: int, fps: float) -> None:
        """Begin the file; when recording a camera, frames of another size are letterboxed."""
        media = self._media or _LiveInput(self.path, width, height, fps)
        with_sound = self._microphone is not None and self._microphone.is_on
        self._file = _RecordingFile(self.path, media, self._encode, force=self._force, with_sound=with_sound)

    def show(self, shown: OutputFrame) -> None:
        """Write a frame, unless the recording has ended."""
        if self._file is None:
            return
        try:
            frame = self._timed(shown, self._file)
            if frame is not None:
                self._file.write(frame)
                self._write_sound(self._file)
        except MediaError as error:
            self.abort()
            self._report(str(error))
            return
        if self._say is not None and shown.arrived >= self._checked + 1:
            self._checked = shown.arrived
            self._keep_reserve()

    def close(self) -> None:
        """Complete the file; nothing is left behind when no frame was shown."""
        file, self._file = self._file, None
        if file is None:
            return
        try:
            if not file.frames or (file.copy_rest() and self._whole):
                file.abort()
                return
            with file:
                pass
            self.is_written = True
        except MediaError as error:
            file.abort()
            self._report(str(error))

    def abort(self) -> None:
        """Delete what was written and stop recording."""
        file, self._file = self._file, None
        if file is not None:
            file.abort()

    def _timed(self, shown: OutputFrame, file: _RecordingFile) -> Frame | None:
        """The frame with its time in the recording; None when that is not later than the previous one's."""
        if self._media is not None:
            return shown.frame
        if not file.frames:
            self._begun = shown.arrived
        pts = round((shown.arrived - self._begun) / TIME_BASE)
        if pts <= self._last:
            return None
        self._last = pts
        frame = Frame.from_rgb(letterboxed(shown.frame.rgb(), *file.size), pts, TIME_BASE)
        frame.duration = file.usual_duration
        return frame

    def _write_sound(self, file: _RecordingFile) -> None:
        if self._microphone is not None and file.with_sound:
            for at, samples in self._microphone.take():
                file.write_sound(samples, at - self._begun)

    def _keep_reserve(self) -> None:
        """Complete the recording while there is still disk space to do so."""
        if shutil.disk_usage(self.path.parent).free < RESERVE_BYTES:
            self.close()
            self._report(
                f"The disk is nearly full: {self.path.name} ends here, and what was recorded is kept."
            )

    def _report(self, sentence: str) -> None:
        if self._say is None:
            raise MediaError(sentence)
        self._say(sentence)


class Recordings(Output):
    """Recordings that the user starts and stops, each in its own file.

    Parameters
    ----------
    folder : for guise-001.mp4 and so on.   encode : encoder settings.   microphone : of which there is sound, or None.
    say : called with one sentence about each event.
    """

    def __init__(
        self,
        folder: Path,
        encode: EncodeOptions = _DEFAULTS,
        say: Say = print,
        microphone: Microphone | None = None,
    ) -> None:
        self.recording = False
        self._since = 0.0
        self._folder, self._encode, self._say, self._microphone = folder, encode, say, microphone
        self._recorder: VideoRecorder | None = None
        self._fps = 30.0

    def toggle(self) -> None:
        """Start or stop recording with the next frame; from any thread."""
        self._since = time.monotonic()
        self.recording = not self.recording

    @property
    def seconds(self) -> float | None:
        """For how long the user has been recording; None while they are not."""
        return time.monotonic() - self._since if self.recording else None

    def open(self, width: int, height: int, fps: float) -> None:
        self._fps = fps

    def show(self, shown: OutputFrame) -> None:
        """Write a frame while recording; an error ends the recording and is reported."""
        if self.recording and self._recorder is None:
            self._begin(shown.frame)
        elif not self.recording and self._recorder is not None:
            self.close()
        if self._recorder is not None:
            self._recorder.show(shown)

    def close(self) -> None:
        """Complete the current recording."""
        if (recorder := self._recorder) is not None:
            self._recorder = None
            recorder.close()
            if recorder.path.exists():
                self._say(f"Recorded {recorder.path}.")

    def _begin(self, frame: Frame) -> None:
        try:
            path = numbered(self._folder, ".mp4")
            recorder = VideoRecorder(path, encode=self._encode, say=self._stop, microphone=self._microphone)
            recorder.open(frame.width, frame.height, self._fps)
        except (OutputError, MediaError) as error:
            self._stop(str(error))
            return
        self._recorder = recorder
        self._say(f"Recording to {path}.")

    def _stop(self, sentence: str) -> None:
        self.recording, self._recorder = False, None
        self._say(sentence)


class _LiveInput(MediaInput):
    """Stands in for a camera, a stream or a loop when the encoder asks for properties of its input."""

    kind = "video"

    def __init__(self, path: Path, width: int, height: int, fps: float) -> None:
        super().__init__(path)
        self.width, self.height = width, height
        self.frame_rate = Fraction(fps).limit_denominator(1001)
        self.time_base = TIME_BASE


class _RecordingFile(VideoOutput):
    """The file: frames are encoded, and the input's other streams copied up to the time of the last frame.

    size : (width, height), pixels.   usual_duration : of a frame, in units of the input's time base.
    with_sound : there is a stream for `write_sound`.
    """

    def __init__(
        self, path: Path, media: MediaInput, encode: EncodeOptions, *, force: bool, with_sound: bool
    ) -> None:
        encoding = encoding_for(media, encode, path)
        self.with_sound = with_sound
        super().__init__(
            path, media, encoding, force=force, tags=synthetic_tags(), private=False, audio="keep"
        )
        self._media, self.size = media, (media.width, media.height)
        self.usual_duration = round(1 / (media.frame_rate * media.time_base))
        self._others = OtherStreams(media) if isinstance(media, VideoInput) else None
        self._last = 0

    def _start(self) -> None:
        if self.with_sound:
            self._sound = SoundTrack(self._output)
        super()._start()

    def write_sound(self, samples: Samples, at: float) -> None:
        """Write a block (n, 2) that is heard `at` seconds after the first picture."""
        with as_media_error(self.path):
            self._mux(self._sound.encode(samples, at))

    def write(self, frame: Frame) -> None:
        # A capture's times start at 0, those of the other streams at the start of the file.
        self._last = frame.pts + (self._others.first if self._others else 0)
        for packet in self._others.until(self._last) if self._others else ():
            self._copy(packet)
        with as_media_error(self.path):
            picture = self._encoding.picture(frame)
            picture.pts = self._last
            self._mux(self._stream.encode(picture))
        self.frames += 1

    def copy_rest(self) -> bool:
        """Copy the rest of the other streams; whether the input has more frames than were written."""
        if self._others is None:
            return self.frames < (self._media.frame_count or 0)
        for packet in self._others.rest(self._last, self._last + self.usual_duration):
            self._copy(packet)
        return self._others.cut

    def _finish(self) -> None:
        self._mux(self._stream.encode(None))
        if self.with_sound:
            self._mux(self._sound.finish())
        super()._finish()


def snapshot(frame: Frame, folder: Path) -> Path:
    """Write a frame to guise-001.png, or the next free number, in a folder; OutputError when that fails."""
    path = numbered(folder, ".png")
    require_free(path, force=False)
    data = encode_image(frame.rgb(), None, path.suffix, synthetic_tags())
    write_whole(path, data)
    return path


def numbered(folder: Path, suffix: str) -> Path:
    """The first free name among guise-001, guise-002 ... with a suffix; names of unfinished files count as taken."""
    names = (f"{STEM}-{number:03d}{suffix}" for number in count(1))
    return next(folder / n for n in names if not any((folder / m).exists() for m in (n, f"{n}.part")))
