"""What a command reports when it is done."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Report:
    """The base of reports: dataclasses of what JSON can hold."""

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return asdict(self)
