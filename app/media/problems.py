"""What went wrong without ending the work."""

from __future__ import annotations

from collections.abc import Iterable

MAX_PROBLEMS = 200  # that are listed one by one


class ProblemLog(list[str]):
    """What went wrong without ending the work: each sentence once, and a count beyond the limit.

    damage : those sentences that tell of parts of the input that could not be read.
    """

    unlisted = 0

    def __init__(self) -> None:
        super().__init__()
        self.damage: list[str] = []

    def note_damage(self, sentence: str) -> None:
        """Add a sentence about a part of the input that could not be read."""
        if sentence not in self:
            self.damage.append(sentence)
        self.note(sentence)

    def note(self, sentence: str) -> None:
        """Add a sentence unless it is there already."""
        if sentence in self:
            return
        if len(self) < MAX_PROBLEMS:
            self.append(sentence)
            return
        self.unlisted += 1
        self[MAX_PROBLEMS - 1 :] = [f"And {self.unlisted + 1} more."]

    def add(self, sentences: Iterable[str]) -> None:
        """Note each of several sentences."""
        damage = sentences.damage if isinstance(sentences, ProblemLog) else []
        for sentence in sentences:
            (self.note_damage if sentence in damage else self.note)(sentence)
