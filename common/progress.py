"""How long-running work reports progress and notes."""

from collections.abc import Callable, Iterable

Progress = Callable[[str, float], None]  # stage, finished share of it
Say = Callable[[str], None]


def silent(stage: str, share: float) -> None:
    """Ignore progress."""


def mute(text: str) -> None:
    """Ignore notes."""


class NoteLog:
    """Passes notes on to the user, and keeps them for the report.   said : those so far."""

    def __init__(self, say: Say) -> None:
        self._say = say
        self.said: list[str] = []

    def __call__(self, text: str) -> None:
        self.said.append(text)
        self._say(text)

    def extend(self, texts: Iterable[str]) -> None:
        """Pass on several notes."""
        for text in texts:
            self(text)
