"""The network of the learned light: from what a face and a frame show to the affine map that lights the face.

It adds to the classical local light (`app/swapping/local_light.py`): from sums of texels on a coarse grid it forms the
ratio of local means of skin at two widths, and a small network with a view of the whole face says how much of each
counts, corrects the ratio smoothly. The output is an affine map of colours per
cell, so that nothing can be painted that the face does not have. RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from guise.aam.light import LUMA
from guise.app.swapping.coarse_grid import gaussian_kernel
from guise.app.swapping.learned_light import BLACK_GREY_LEVELS, CELL_FACE_WIDTHS, GRID

INPUTS, STATIC, OUTPUTS = 19, 4, 4
PARTS = 2  # eyes, inside of the mouth
FLOOR = 1e-3  # share of texels that are not skin in the means of skin
CONTRAST = 0.5, 1.5  # limits of the scale of details
SCALE = 3.0  # of log ratios, as the network sees them


@dataclass(frozen=True)
class Widths:
    """Standard deviations, face widths."""

    narrow: tuple[float, float] = (0.04, 0.08)  # of means of brightness, of colour
    wide: tuple[float, float] = (0.08, 0.15)
    own: float = 0.05  # of the face's own mean, about which contrast is scaled
    brightness: float = 0.05  # of the correction
    colour: float = 0.1


class LightNet(nn.Module):
    """Sums (n, 7, h, w) of skin and of other texels -> map (n, 6, h, w) and gains of the parts (n, 2, 3).

    Sums are those of the weighted colours of the face (3) and the frame (3), and of the weights. The map holds gain
    and offset of R, G, B; the parts are eyes and mouth.
    """

    def __init__(self, channels: int = 24, deep: int = 32, widths: Widths = Widths()) -> None:
        super().__init__()
        self.widths = widths
        self.static = nn.Parameter(torch.randn(1, STATIC, *GRID) * 0.1)
        self.stem = nn.Sequential(*_conv(INPUTS + STATIC, channels, 2), *_conv(channels, channels))
        self.down = nn.Sequential(*_conv(channels, deep, 2), *_conv(deep, deep))
        self.whole = nn.Linear(deep, deep)
        self.middle = nn.Sequential(*_conv(deep, deep), nn.Conv2d(deep, channels, 1))
        self.body = nn.Sequential(*_conv(channels, channels))
        self.out = nn.Conv2d(channels, 4 * OUTPUTS, 3, 1, 1)
        self.parts = nn.Linear(deep, 3 * PARTS)
        for layer in (self.out, self.parts):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        self.register_buffer("luma", torch.tensor(LUMA)[:, None, None])
        for width in sorted({*widths.narrow, *widths.wide, widths.own, widths.brightness, widths.colour}):
            for name, length in zip("hw", GRID, strict=True):
                kernel = torch.tensor(gaussian_kernel(length, width / CELL_FACE_WIDTHS))
                self.register_buffer(_name(name, width), kernel)
                self.register_buffer("mean_" + _name(name, width), kernel / kernel.sum(1, keepdim=True))

    def forward(self, skin: Tensor, other: Tensor) -> tuple[Tensor, Tensor]:
        """See the class."""
        every = skin + other
        skin = skin + FLOOR * every
        narrow, wide = (self._log_ratio(skin, *widths) for widths in (self.widths.narrow, self.widths.wide))
        local = self._means(every + FLOOR * skin, self.widths.own)
        total = skin.sum((2, 3), keepdim=True)
        own, seen = (
            (total[:, s] / total[:, 6:].clamp(min=1e-9) + BLACK_GREY_LEVELS).clamp(min=1).log()
            for s in (slice(3), slice(3, 6))
        )
        seen_share = every[:, 6:] > 0.05
        raw = torch.where(seen_share, every[:, :6] / every[:, 6:].clamp(min=0.05), local) + BLACK_GREY_LEVELS
        raw = raw.clamp(min=1).log() - torch.cat([own, seen], 1)
        level = seen - own
        flat = torch.cat([own, seen], 1) - 4.5
        inputs = torch.cat(
            [
                torch.cat([raw, narrow - level, wide - level], 1) * SCALE,
                every[:, 6:].clamp(max=1) * seen_share,
                flat.expand(-1, -1, *GRID),
                self.static.expand(len(skin), -1, -1, -1),
            ],
            1,
        )
        fields, part_changes = self._network(inputs)
        share = torch.sigmoid(fields[:, 3:4])
        ratio = share * narrow + (1 - share) * wide + self._mean(fields[:, :1], self.widths.brightness)
        tint = self._mean(fields[:, 1:3], self.widths.colour)
        ratio = (ratio + torch.cat([tint[:, :1], -0.25 * tint.sum(1, keepdim=True), tint[:, 1:]], 1)).exp()
        grey = self._grey(ratio)
        parts = (self._grey(wide.exp()).log().mean((2, 3)) + part_changes).view(-1, PARTS, 3).exp()
        gain = ratio * (grey.clamp(*CONTRAST) / grey)
        offset = local[:, :3] * (ratio - gain) + BLACK_GREY_LEVELS * (ratio - 1)
        return torch.cat([gain, offset], 1), parts

    def _network(self, inputs: Tensor) -> tuple[Tensor, Tensor]:
        near = self.stem(inputs)
        deep = self.down(near)
        whole = deep.mean((2, 3))
        deep = self.middle(deep + self.whole(whole)[:, :, None, None])
        deep = F.interpolate(deep, size=near.shape[2:], mode="bilinear", align_corners=False)
        fields = F.pixel_shuffle(self.out(self.body(near + deep)), 2)
        return fields[:, :, : GRID[0], : GRID[1]], self.parts(whole)

    def _log_ratio(self, skin: Tensor, brightness: float, colour: float) -> Tensor:
        """Log of the ratio (n, 3, h, w) of frame over face, brightness over less of the neighbourhood than colour."""
        near, far = (
            self._means(skin, width).clamp(min=0) + BLACK_GREY_LEVELS for width in (brightness, colour)
        )
        grey = (self._grey(near[:, 3:]) / self._grey(near[:, :3])).clamp(0.08, 8)
        tint = far[:, 3:] / far[:, :3] * (self._grey(far[:, :3]) / self._grey(far[:, 3:]))
        return (grey * tint.clamp(0.4, 2.5)).log()

    def _means(self, sums: Tensor, width: float) -> Tensor:
        smooth = getattr(self, _name("h", width)) @ sums @ getattr(self, _name("w", width))
        return smooth[:, :-1] / smooth[:, -1:].clamp(min=1e-9)

    def _mean(self, planes: Tensor, width: float) -> Tensor:
        rows, columns = (getattr(self, "mean_" + _name(name, width)) for name in "hw")
        return rows @ planes @ columns.T

    def _grey(self, rgb: Tensor) -> Tensor:
        return (rgb * self.luma).sum(1, keepdim=True)


def _conv(before: int, after: int, stride: int = 1) -> tuple[nn.Module, ...]:
    return nn.Conv2d(before, after, 3, stride, 1), nn.PReLU(after)


def _name(axis: str, width: float) -> str:
    return f"{axis}_{round(1000 * width)}"


def weights(net: nn.Module) -> int:
    """Number of trained weights."""
    return int(np.sum([p.numel() for p in net.parameters()]))
