"""The landmarker's network: soft arg max of heat maps, refined by what lies there, beside a guess from the whole face.

A residual trunk (128 -> 8 pixels) and a feature pyramid back to 32 x 32. Every point has a heat map there; its soft
arg max (integral regression, Sun et al. 2018) is corrected by a linear map of the features pooled under that heat map,
which also gives the point's standard deviation (Gaussian likelihood as in Wood et al. 2022). A second guess from the
coarsest features knows the whole face, also where it is hidden or outside the crop; a learned gate mixes the two.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

SIZE = 128
CELL = 4  # pixels of the crop per cell of the heat maps
POINTS = 81


def _conv(inputs: int, outputs: int, stride: int = 1, kernel: int = 3) -> nn.Sequential:
    layers = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(layers, nn.BatchNorm2d(outputs), nn.ReLU())


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _conv(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.second(self.first(x)))


class LandmarkNet(nn.Module):
    """uint8 RGB crops (n, 128, 128, 3) -> points (n, 81, 2) and their sigma (n, 81) in its pixels, face logit (n,)."""

    def __init__(self, width: int = 16, blocks: tuple[int, int, int] = (1, 2, 2), head: int = 48) -> None:
        super().__init__()
        w = width
        self.fine = nn.Sequential(
            _conv(3, w, 2), _conv(w, 2 * w, 2), *(_Residual(2 * w) for _ in range(blocks[0]))
        )
        self.middle = nn.Sequential(_conv(2 * w, 4 * w, 2), *(_Residual(4 * w) for _ in range(blocks[1])))
        self.coarse = nn.Sequential(_conv(4 * w, 8 * w, 2), *(_Residual(8 * w) for _ in range(blocks[2])))
        self.from_coarse = nn.Conv2d(8 * w, 4 * w, 1)
        self.merge_middle = _conv(4 * w, head)
        self.from_fine = nn.Conv2d(2 * w, head, 1)
        self.merge_fine = _conv(head, head)
        self.heat = nn.Parameter(torch.randn(POINTS, head) * 0.1)
        self.squeeze = _conv(8 * w, 32, kernel=1)
        self.whole = nn.Sequential(nn.Linear(32 * 64, 192), nn.ReLU())
        self.guess = nn.Linear(192, 2 * POINTS)
        self.face = nn.Linear(192, 1)
        self.local = nn.Parameter(torch.randn(POINTS, head, 4) * 0.01)
        self.offset = nn.Parameter(torch.zeros(POINTS, 4))
        cells = SIZE // CELL
        centres = torch.arange(cells).float() * CELL + (CELL - 1) / 2
        ys, xs = torch.meshgrid(centres, centres, indexing="ij")
        self.register_buffer("places", torch.stack([xs.flatten(), ys.flatten()], -1))

    def features(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Stem (n, w, 64, 64), pyramid (n, head, 32, 32) and coarsest features (n, 8 w, 8, 8) of crops."""
        x = (images.permute(0, 3, 1, 2).float() - 127.5) / 64
        stem = self.fine[0](x)
        fine = self.fine[1:](stem)
        middle = self.middle(fine)
        coarse = self.coarse(middle)
        up = self.merge_middle(F.interpolate(self.from_coarse(coarse), scale_factor=2.0) + middle)
        return stem, self.merge_fine(F.interpolate(up, scale_factor=2.0) + self.from_fine(fine)), coarse

    def parts(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Mixed, local and whole-face points, log sigma, face logit."""
        _, pyramid, coarse = self.features(images)
        return self.points_of(pyramid, coarse)

    def points_of(self, pyramid: Tensor, coarse: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """What `parts` gives, from features."""
        under, centre = self._under_heat(self.heat, pyramid.flatten(2))
        local = torch.matmul(under.transpose(0, 1), self.local).transpose(0, 1) + self.offset
        points = centre + CELL * local[..., :2]
        whole = self.whole(self.squeeze(coarse).flatten(1))
        guess = (SIZE - 1) / 2 + 32 * self.guess(whole).float().view(-1, POINTS, 2)
        gate = torch.sigmoid(local[..., 3:] + 2)
        mixed = gate * points + (1 - gate) * guess
        return mixed, points, guess, local[..., 2].clamp(-3, 5), self.face(whole).float()[:, 0]

    def _under_heat(self, maps: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Mean features (n, k, c) and places (n, k, 2) under heat maps (k, c), from features (n, c, cells)."""
        with torch.autocast(features.device.type, enabled=False):
            features = features.float()
            weight = torch.softmax(torch.matmul(maps, features), -1)
            return torch.matmul(weight, features.transpose(1, 2)), torch.matmul(weight, self.places)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        mixed, _, _, log_sigma, face = self.parts(images)
        return mixed, torch.exp(log_sigma), face
