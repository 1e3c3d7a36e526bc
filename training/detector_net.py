"""The face detector's network: heat maps of face centres with boxes at strides 8, 16 and 32.

Anchor-free in the manner of CenterNet (Zhou et al. 2019) with a feature pyramid: a few dense 3 x 3 convolutions, which
run fastest on a CPU, and depthwise ones where the maps are large. Input uint8 RGB (n, h, w, 3) of any size; each level
gives (n, 5, h / stride, w / stride): the logit of a face's centre there, and left, top, right, bottom of the box as
distances from the cell's centre in units of 2 strides.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

STRIDES = (8, 16, 32)
UNIT = 2  # strides, the unit of the distances
PRIOR = -4.0  # first logit of a centre: faces are rare


def _conv(inputs: int, outputs: int, stride: int = 1, kernel: int = 3, groups: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    )


def _light(channels: int, outputs: int) -> nn.Sequential:
    """Depthwise 3 x 3, then 1 x 1."""
    return nn.Sequential(_conv(channels, channels, groups=channels), _conv(channels, outputs, kernel=1))


class _Residual(nn.Module):
    def __init__(self, channels: int, light: bool = False) -> None:
        super().__init__()
        self.inner = _light(channels, channels) if light else _conv(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.inner(x)


class DetectorNet(nn.Module):
    """Three levels of (n, 5, h, w), see the module."""

    def __init__(self, widths: tuple[int, ...] = (16, 32, 64, 80, 96), head: int = 64) -> None:
        super().__init__()
        a, b, c, d, e = widths
        self.stem = nn.Sequential(_conv(3, a, 2), _conv(a, b, 2), _Residual(b, light=True))
        self.near = nn.Sequential(_conv(b, c, 2), _Residual(c), _Residual(c, light=True))
        self.middle = nn.Sequential(_conv(c, d, 2), _Residual(d), _Residual(d, light=True))
        self.far = nn.Sequential(_conv(d, e, 2), *(_Residual(e, light=True) for _ in range(3)))
        self.lateral = nn.ModuleList([nn.Conv2d(n, head, 1) for n in (c, d, e)])
        self.merge = nn.ModuleList([_light(head, head), _light(head, head)])
        self.heads = nn.ModuleList(
            [nn.Sequential(_light(head, head), nn.Conv2d(head, 5, 1)) for _ in STRIDES]
        )
        for module in self.heads:
            torch.nn.init.constant_(module[-1].bias[0], PRIOR)
            torch.nn.init.constant_(module[-1].bias[1:], 1.0)

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        x = (images.permute(0, 3, 1, 2).float() - 127.5) / 64
        near = self.near(self.stem(x))
        middle = self.middle(near)
        far = self.lateral[2](self.far(middle))
        middle = self.lateral[1](middle)
        middle = self.merge[1](middle + F.interpolate(far, size=middle.shape[-2:]))
        near = self.lateral[0](near)
        near = self.merge[0](near + F.interpolate(middle, size=near.shape[-2:]))
        return tuple(head(level) for head, level in zip(self.heads, (near, middle, far), strict=True))
