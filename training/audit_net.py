"""The audit's network: cells of 4 pixels vote for the face that they lie in, at any roll.

Dense voting in the manner of FCOS (Tian et al. 2019), one scale for a pyramid of pictures: local contrast is evened out
first, then come residual 3 x 3 convolutions at strides 4 and 8.  Input uint8 RGB (n, h, w, 3), both sides multiples of
8; output (n, 7, h / 4, w / 4): the logit of being within a face of `SIDES`, the face's centre from the cell's and
the logarithms of its half width and half height, all in units of `UNIT` pixels, and its upward direction.  Width and
height are those of the tight box of the 68 iBUG points of the face turned upright.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

STRIDE = 4
UNIT = 8.0  # pixels
SIDES = (12.0, 26.0)  # pixels, of the longer side of faces
PRIOR = -4.0  # first logit: faces are rare
STEP, WINDOW = 8, 5  # pixels of a block, and blocks, within which contrast is evened out
LEAST_CONTRAST = 6.0  # grey levels, of nothing but noise


def _conv(inputs: int, outputs: int, kernel: int = 1, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False), nn.BatchNorm2d(outputs)
    )


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = _conv(channels, channels, 3)

    def forward(self, x: Tensor) -> Tensor:
        return x + F.relu(self.inner(x))


def even_contrast(x: Tensor) -> Tensor:
    """Pictures (n, 3, h, w) less the mean about each pixel, over the spread there."""
    mean, square = (_around(F.avg_pool2d(one, STEP)) for one in (x, x * x))
    spread = (square - mean * mean).mean(1, keepdim=True).clamp(min=0).sqrt()
    size = x.shape[-2:]
    mean = F.interpolate(mean, size=size, mode="bilinear", align_corners=True)
    share = F.interpolate(1 / (spread + LEAST_CONTRAST), size=size, mode="bilinear", align_corners=True)
    return (x - mean) * share


def _around(x: Tensor) -> Tensor:
    return F.avg_pool2d(x, WINDOW, 1, WINDOW // 2, count_include_pad=False)


class AuditNet(nn.Module):
    """(n, 7, h / 4, w / 4), see the module."""

    def __init__(
        self, widths: tuple[int, int, int, int] = (16, 32, 64, 32), near: int = 2, far: int = 6
    ) -> None:
        super().__init__()
        first, fine, coarse, last = widths
        self.stem = nn.Sequential(_conv(3, first, 3, 2), nn.ReLU(), _conv(first, fine, 3, 2), nn.ReLU())
        self.near = nn.Sequential(*(_Residual(fine) for _ in range(near)))
        self.far = nn.Sequential(
            _conv(fine, coarse, 3, 2), nn.ReLU(), *(_Residual(coarse) for _ in range(far))
        )
        self.lateral, self.back = _conv(fine, last), _conv(coarse, last)
        self.head = nn.Sequential(nn.ReLU(), _conv(last, last, 3), nn.ReLU(), nn.Conv2d(last, 7, 1))
        torch.nn.init.zeros_(self.head[-1].bias)
        torch.nn.init.constant_(self.head[-1].bias[0], PRIOR)

    def forward(self, images: Tensor) -> Tensor:
        near = self.near(self.stem(even_contrast(images.permute(0, 3, 1, 2).float())))
        far = F.interpolate(self.back(self.far(near)), scale_factor=2)
        return self.head(self.lateral(near) + far)
