"""How long work tells how far it is, and what the user should know."""

from collections.abc import Callable

Progress = Callable[[str, float], None]  # stage, share of it that is done
Say = Callable[[str], None]


def silent(stage: str, share: float) -> None:
    """Ignore progress."""


def mute(text: str) -> None:
    """Ignore notes."""
