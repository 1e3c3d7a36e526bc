"""The multi-task face network: points, irises and parsing from one crop through one trunk.

It adds to the landmarker's trunk and point heads (`landmark_net.py`)

- for each iris a heat map like those of the points, whose pooled features give a correction of the centre, the radius
  and a standard deviation;
- a decoder from the 32 x 32 pyramid to 64 x 64, joined there by the stem's features, whose soft maps tell the classes
  of `parsing_labels.CLASSES` apart.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from guise.aam.landmarks import LEFT_EYE, RIGHT_EYE
from guise.aam.parsing import CELLS
from training.landmark_net import CELL, LandmarkNet, _conv
from training.parsing_labels import CLASSES

MAPS = CELLS  # the side of the parsing maps
TYPICAL_IRIS_RADIUS_PIXELS = 4.0  # of the crop


class FaceNet(LandmarkNet):
    """uint8 RGB crops (n, 128, 128, 3) -> points, sigma, face logit, irises (n, 2, 4), parsing (n, 10, 64, 64).

    The fourth number of an iris is its standard deviation in pixels; the parsing maps sum to 1 in each cell.
    """

    def __init__(
        self, width: int = 16, blocks: tuple[int, int, int] = (1, 2, 2), head: int = 48, decoder: int = 32
    ) -> None:
        super().__init__(width, blocks, head)
        self.iris_heat = nn.Parameter(torch.randn(2, head) * 0.1)
        self.iris_local = nn.Parameter(torch.randn(2, head, 4) * 0.01)
        self.iris_offset = nn.Parameter(torch.zeros(2, 4))
        self.context = nn.Sequential(_conv(head, head), _conv(head, decoder))
        self.from_stem = nn.Conv2d(width, decoder, 1)
        self.detail = _conv(decoder, 24)
        self.classes = nn.Conv2d(24, len(CLASSES), 1)

    @torch.no_grad()
    def start_irises(self) -> None:
        """Start the irises' heat maps from the means of those of the eyes' points, with large deviations."""
        for k, eye in enumerate((RIGHT_EYE, LEFT_EYE)):
            self.iris_heat[k] = self.heat[eye.tolist()].mean(0)
        self.iris_offset[:, 3] = 1.0

    def found_irises(self, pyramid: Tensor) -> tuple[Tensor, Tensor]:
        """Irises (n, 2, 3), centre and radius, and the logarithms of their deviations (n, 2), from features."""
        under, centre = self._under_heat(self.iris_heat, pyramid.flatten(2))
        rest = torch.matmul(under.transpose(0, 1), self.iris_local).transpose(0, 1) + self.iris_offset
        radius = TYPICAL_IRIS_RADIUS_PIXELS * torch.exp(rest[..., 2:3].clamp(-2, 2))
        return torch.cat([centre + CELL * rest[..., :2], radius], -1), rest[..., 3].clamp(-3, 5)

    def irises_of(self, pyramid: Tensor) -> Tensor:
        """Irises (n, 2, 4): centre, radius and standard deviation, from features."""
        iris, log_sigma = self.found_irises(pyramid)
        return torch.cat([iris, torch.exp(log_sigma)[..., None]], -1)

    def parsing_of(self, stem: Tensor, pyramid: Tensor) -> Tensor:
        """Logits (n, classes, 64, 64) of the parsing, from features."""
        wide = F.interpolate(self.context(pyramid), scale_factor=2.0) + self.from_stem(stem)
        logits: Tensor = self.classes(self.detail(wide))
        return logits

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        stem, pyramid, coarse = self.features(images)
        points, _, _, log_sigma, face = self.points_of(pyramid, coarse)
        chance = torch.softmax(self.parsing_of(stem, pyramid), 1)
        return points, torch.exp(log_sigma), face, self.irises_of(pyramid), chance
