"""Video and image files in and out: frames stay in YUV, time stamps and other streams are kept."""

from guise.app.media.encoder import EncodeOptions
from guise.app.media.errors import MediaError
from guise.app.media.frame import ColourMatrix, Frame
from guise.app.media.input import MediaInput
from guise.app.media.opening import frames_at, open_input
from guise.app.media.outputs import open_sink
from guise.app.media.process import ProcessStats, process
from guise.app.media.sink import NullSink, Sink

__all__ = [
    "ColourMatrix",
    "EncodeOptions",
    "Frame",
    "MediaError",
    "MediaInput",
    "NullSink",
    "ProcessStats",
    "Sink",
    "frames_at",
    "open_input",
    "open_sink",
    "process",
]
