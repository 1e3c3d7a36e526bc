"""How long-running work reports progress and notes."""

from collections.abc import Callable

Progress = Callable[[str, float], None]  # stage, finished share of it
Say = Callable[[str], None]


def silent(stage: str, share: float) -> None:
    """Ignore progress."""


def mute(text: str) -> None:
    """Ignore notes."""
