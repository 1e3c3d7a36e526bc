"""How a person's model is trained, as a user says it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from guise.common.option import option

if TYPE_CHECKING:
    from guise.aam.training import TrainingOptions


@dataclass(frozen=True)
class TrainingChoices:
    """What of `TrainingOptions`, which takes long to import, a user may set; None stands for what is there."""

    frames: int | None = option(None, "Frames to train on; about 120 by default.", least=12)
    resolution: int | None = option(None, "Pixels across the face in the model.", least=32, most=512)
    retain: float | None = option(None, "Share of variance that the modes keep.", least=0.5, most=1.0)
    modes: int | None = option(None, "Number of modes to keep, instead of --retain.", least=1)

    def training(self) -> TrainingOptions:
        """For the training; `modes` goes before `retain`."""
        from guise.aam.training import TrainingOptions

        usual = TrainingOptions()
        return replace(
            usual,
            frames=self.frames or usual.frames,
            resolution=self.resolution or usual.resolution,
            retain=self.modes or self.retain or usual.retain,
            max_modes=max(usual.max_modes, self.modes or 0),
        )
