"""NAME.report.json: what was done with each face in every frame (see docs/deidentify-report.md)."""

from __future__ import annotations


def clock(seconds: float) -> str:
    """A time in a video, for people.

    >>> clock(62.34), clock(3661.0)
    ('1:02.3', '1:01:01.0')
    """
    minutes, tenths = divmod(round(10 * seconds), 600)
    hours, minutes = divmod(minutes, 60)
    rest = f"{tenths // 10:02}.{tenths % 10}"
    return f"{hours}:{minutes:02}:{rest}" if hours else f"{minutes}:{rest}"
