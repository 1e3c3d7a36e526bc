"""What is inside a model file, as a table; `guise.app.people.montage` shows it as a picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from guise.aam.model import VERSION, Identity
from guise.aam.views import Views

# The file's tensors, by purpose.
_PARTS = {
    "appearance": ("appearance.", "neutral", "mask"),
    "tracker": ("tracker.",),
    "detail": ("detail",),
    "still": ("still.",),
}


@dataclass(frozen=True)
class ModelInfo:
    """Facts about a model file; sizes in bytes, errors in per cent of the inter-ocular distance."""

    path: str
    name: str
    format_version: int
    reference: str
    resolution: int
    clips: tuple[str, ...]
    frames: int
    modes: int
    variance_kept: float
    tracker_modes: int
    tracker_stages: int
    held_out_error: float
    lost_threshold: float
    still: tuple[int, int]
    sizes: dict[str, int]
    file_size: int
    facts: dict[str, Any]

    def as_rows(self) -> dict[str, str]:
        """The facts for the user, row by row."""
        parts = ", ".join(f"{part} {size / 1e6:.2f}" for part, size in self.sizes.items())
        return {
            "name": self.name,
            "format": f"version {self.format_version}",
            "reference frame": f"{self.reference}, {self.resolution} pixels across the face",
            "clips": ", ".join(self.clips),
            "training frames": str(self.frames),
            "appearance modes": f"{self.modes}, {100 * self.variance_kept:.1f} % of the variance",
            "tracker": f"{self.tracker_modes} shape modes, {self.tracker_stages} stages",
            "held-out error": f"{self.held_out_error:.2f} % of the inter-ocular distance",
            "lost above": f"residual {self.lost_threshold:.3f}",
            "still": f"{self.still[0]} x {self.still[1]}",
            "parts": f"{parts} MB",
            "file": f"{self.file_size / 1e6:.2f} MB",
            **{key.replace("_", " "): _shown(key, value) for key, value in self.facts.items()},
        }


def _shown(key: str, value: Any) -> str:
    if isinstance(value, list):
        return "; ".join(map(str, value)) or "none"
    return str(Views(**value)) if key == "views" else str(value)


def describe(path: Path) -> tuple[Identity, ModelInfo]:
    """A model and the facts about its file.

    Raises ModelError when it can't be used.
    """
    identity = Identity.load(path)
    components, tracker, facts = identity.appearance.components, identity.tracker, dict(identity.facts)
    height, width = identity.rest_frame.picture.shape[:2]
    facts.pop("held_out_error", None)
    info = ModelInfo(
        path=str(path),
        name=identity.name,
        format_version=VERSION,
        reference=identity.reference.id,
        resolution=identity.reference.resolution,
        clips=tuple(map(str, facts.pop("clips", ()))),
        frames=int(facts.pop("frames", 0)),
        modes=components.modes,
        variance_kept=round(components.retained, 4),
        tracker_modes=tracker.shapes.modes,
        tracker_stages=len(tracker.stages),
        held_out_error=round(100 * tracker.quality.error, 3),
        lost_threshold=round(tracker.quality.threshold, 4),
        still=(width, height),
        sizes=_sizes(path),
        file_size=path.stat().st_size,
        facts=facts,
    )
    return identity, info


def _sizes(path: Path) -> dict[str, int]:
    """Bytes of each part, from the header of the file (safetensors: its length, then JSON)."""
    with path.open("rb") as file:
        header = json.loads(file.read(int.from_bytes(file.read(8), "little")))
    header.pop("__metadata__", None)
    spans = {key: entry["data_offsets"][1] - entry["data_offsets"][0] for key, entry in header.items()}
    return {part: sum(n for key, n in spans.items() if key.startswith(keys)) for part, keys in _PARTS.items()}
