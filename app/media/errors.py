"""The exception of the media room."""

from guise.common.errors import GuiseError


class MediaError(GuiseError):
    """A user's mistake with a file or an encoder setting.

    `str(error)` is one sentence: what was expected, what was found, what to do.
    """


class UnreadableError(MediaError):
    """An input that cannot be read at all."""


def reason(error: Exception) -> str:
    """Why FFmpeg or the system has failed, in its own words."""
    return getattr(error, "strerror", None) or str(error)
