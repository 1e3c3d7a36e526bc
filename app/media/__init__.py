"""Video and image files in and out: frames stay in YUV, time stamps and other streams survive."""

from app.media.encoder import EncodeOptions
from app.media.errors import MediaError
from app.media.frame import ColourMatrix, Frame
from app.media.process import ProcessStats, process
from app.media.sink import Sink, open_sink
from app.media.source import Source, open_source

__all__ = [
    "ColourMatrix",
    "EncodeOptions",
    "Frame",
    "MediaError",
    "ProcessStats",
    "Sink",
    "Source",
    "open_sink",
    "open_source",
    "process",
]
