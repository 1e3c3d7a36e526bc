"""The network of the learned light: from what a face and a frame show to the affine map that lights the face.

From sums of texels on a coarse grid it forms ratios of local means of skin: of the frame over the face, at two widths;
finer than some width, of the frame over the person's own face as enrolled, which is the scene's light without that
person's form (the quotient image of Shashua and Riklin-Raviv 2001); and two that hold no local mean of the face, so
that the smooth pattern of its skin stays.  A small network with a view of the whole face says how much of each counts,
for brightness and colour apart, and corrects their mean smoothly.  The output is an affine map of colours per cell, so
that nothing can be painted that the face does not have.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from guise.aam.coarse_grid import gaussian_kernel
from guise.aam.light import LUMA
from guise.app.drawing.face import BLACK_GREY_LEVELS
from guise.app.drawing.passes.light import CELL_FACE_WIDTHS, GRID

RATIOS = 7  # of which the light is a mean
SEEN_RATIOS = 4  # by the network
INPUTS, STATIC, OUTPUTS = 37, 4, 3 + 2 * RATIOS
PARTS = 2  # eyes, inside of the mouth
FLOOR = 1e-3  # share of texels that are not skin in the means of skin
CONTRAST = 0.5, 1.5  # limits of the scale of details
SCALE = 3.0  # of log ratios, as the network sees them
MAX_LOG = 2.0  # of what the network adds
USUAL_LEVEL = 4.5  # log of a face's mean colour


@dataclass(frozen=True)
class Widths:
    """Standard deviations, face widths."""

    narrow: tuple[float, float] = (0.04, 0.08)  # of means of brightness, of colour
    wide: tuple[float, float] = (0.08, 0.15)
    sharp: tuple[float, float] = (0.02, 0.04)  # of the person's own ratio, so that shadows keep their edges
    split: tuple[float, float] = (
        0.1,
        0.2,
    )  # beyond which the light is taken from the ratio of the two people
    own: float = 0.05  # of the face's own mean, about which contrast is scaled
    brightness: float = 0.03  # of the correction
    colour: float = 0.05


class LightNet(nn.Module):
    """What a face and a frame show -> map (n, 6, h, w) and gains of the parts (n, 2, 3).

    Inputs are sums (n, 7, h, w) of skin and of other texels: of the weighted colours of the face (3) and the frame (3),
    and of the weights; and means (n, 2, 3, h, w) of skin and of other texels of the frame's person, `own`, and of the
    face, `rest`, both at rest as enrolled. The map holds gain and offset of R, G, B; the parts are eyes and mouth.
    """

    def __init__(self, channels: tuple[int, int, int] = (48, 96, 128), widths: Widths = Widths()) -> None:
        super().__init__()
        self.widths = widths
        self.static = nn.Parameter(torch.randn(1, STATIC, *GRID) * 0.1)
        near, middle, far = channels
        self.near = nn.Sequential(*_conv(INPUTS + STATIC, near, 2), Residual(near))
        self.middle = nn.Sequential(*_conv(near, middle, 2), Residual(middle))
        self.far = nn.Sequential(*_conv(middle, far, 2), Residual(far))
        self.whole = nn.Linear(far, far)
        self.to_middle = nn.Sequential(Residual(far), nn.Conv2d(far, middle, 1))
        self.to_near = nn.Sequential(Residual(middle), nn.Conv2d(middle, near, 1))
        self.body = nn.Sequential(Residual(near), nn.PReLU(near))
        self.out = nn.Conv2d(near, 4 * OUTPUTS, 3, 1, 1)
        self.parts = nn.Linear(far, 3 * PARTS)
        for layer in (self.out, self.parts):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        self.register_buffer("luma", torch.tensor(LUMA)[:, None, None])
        for width in sorted(
            {
                *widths.narrow,
                *widths.wide,
                *widths.sharp,
                *widths.split,
                widths.own,
                widths.brightness,
                widths.colour,
            }
        ):
            for name, length in zip("hw", GRID, strict=True):
                kernel = torch.tensor(gaussian_kernel(length, width / CELL_FACE_WIDTHS))
                self.register_buffer(_name(name, width), kernel)
                self.register_buffer("mean_" + _name(name, width), kernel / kernel.sum(1, keepdim=True))

    def forward(self, skin: Tensor, other: Tensor, own: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
        """See the class."""
        known, every = torch.cat([own, rest], 2), skin + other
        known_every = torch.cat([known[:, 0] * skin[:, 6:] + known[:, 1] * other[:, 6:], every[:, 6:]], 1)
        known_skin = torch.cat([known[:, 0] * skin[:, 6:], skin[:, 6:]], 1) + FLOOR * known_every
        skin = skin + FLOOR * every
        levels = [self._level(sums) for sums in (skin, known_skin)]
        ratios = self._ratios(skin, known_skin, *levels)
        local, known_local = (
            self._means(all_ + FLOOR * some, self.widths.own)
            for all_, some in ((every, skin), (known_every, known_skin))
        )
        shown = every[:, 6:] > 0.05
        raw = [
            torch.where(shown, sums[:, :6] / sums[:, 6:].clamp(min=0.05), means) + BLACK_GREY_LEVELS
            for sums, means in ((every, local), (known_every, known_local))
        ]
        flat, change = torch.cat(levels, 1), levels[0][:, 3:] - levels[0][:, :3]
        inputs = torch.cat(
            [
                torch.cat(
                    [
                        torch.cat(raw, 1).clamp(min=1).log() - flat,
                        *(r - change for r in ratios[:SEEN_RATIOS]),
                    ],
                    1,
                )
                * SCALE,
                every[:, 6:].clamp(max=1) * shown,
                (flat - USUAL_LEVEL).expand(-1, -1, *GRID),
                self.static.expand(len(skin), -1, -1, -1),
            ],
            1,
        )
        fields, part_changes = (MAX_LOG * torch.tanh(x / MAX_LOG) for x in self._network(inputs))
        ratio = self._corrected(ratios, fields)
        grey = self._grey(ratio)
        parts = (self._grey(ratios[1].exp()).log().mean((2, 3)) + part_changes).view(-1, PARTS, 3).exp()
        gain = ratio * (grey.clamp(*CONTRAST) / grey)
        offset = local[:, :3] * (ratio - gain) + BLACK_GREY_LEVELS * (ratio - 1)
        return torch.cat([gain, offset], 1), parts

    def _ratios(self, skin: Tensor, known: Tensor, level: Tensor, known_level: Tensor) -> list[Tensor]:
        """Logs (n, 3, h, w) of the ratios of which the light is a mean; the second is the widest.

        Levels are logs (n, 6, 1, 1) of the mean colours.
        """
        w = self.widths
        # Sums of two colours each, of which the second is divided by the first.
        person = torch.cat([known[:, :3], skin[:, 3:]], 1)
        moved = torch.cat([skin[:, :3], known[:, 3:]], 1)
        narrow, wide = (self._log_ratio(skin, *widths) for widths in (w.narrow, w.wide))
        light = self._log_ratio(person, *w.sharp)
        near, far = (
            light + self._log_ratio(skin, width, width) - self._log_ratio(person, width, width)
            for width in w.split
        )
        still = self._log_ratio(moved, *w.sharp) - self._log_ratio(moved, w.split[0], w.split[0])
        even = (level[:, 3:] - level[:, :3]).expand_as(light)
        whole = light + known_level[:, :3] - level[:, :3]
        return [narrow, wide, near, far, near + still, whole, even]

    def _corrected(self, ratios: list[Tensor], fields: Tensor) -> Tensor:
        """The ratio (n, 3, h, w) of which the network's fields tell shares and corrections."""
        bright, coloured = (
            sum(shares[:, i : i + 1] * one for i, one in enumerate(ratios))
            for shares in (torch.softmax(some, 1) for some in fields[:, 3:].split(RATIOS, 1))
        )
        grey = self._grey(coloured.exp()).log()
        mean = self._grey(bright.exp()).log() + coloured - grey
        brightness, tint = (
            self._mean(fields[:, :1], self.widths.brightness),
            self._mean(fields[:, 1:3], self.widths.colour),
        )
        colour = torch.cat([tint[:, :1], -0.25 * tint.sum(1, keepdim=True), tint[:, 1:]], 1)
        return (mean + brightness + colour).exp()

    def _level(self, sums: Tensor) -> Tensor:
        """Log (n, 6, 1, 1) of the mean colours of all cells."""
        total = sums.sum((2, 3), keepdim=True)
        return (total[:, :6] / total[:, 6:].clamp(min=1e-9) + BLACK_GREY_LEVELS).clamp(min=1).log()

    def _network(self, inputs: Tensor) -> tuple[Tensor, Tensor]:
        near = self.near(inputs)
        middle = self.middle(near)
        far = self.far(middle)
        whole = far.mean((2, 3))
        middle = middle + _as_large(self.to_middle(far + self.whole(whole)[:, :, None, None]), middle)
        fields = F.pixel_shuffle(self.out(self.body(near + _as_large(self.to_near(middle), near))), 2)
        return fields[:, :, : GRID[0], : GRID[1]], self.parts(whole)

    def _log_ratio(self, skin: Tensor, brightness: float, colour: float) -> Tensor:
        """Log of the ratio (n, 3, h, w) of second over first, brightness over less of the neighbourhood than colour."""
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


class Residual(nn.Module):
    """Two convolutions that are added to what goes in."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.change = nn.Sequential(*_conv(channels, channels), nn.Conv2d(channels, channels, 3, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        """(n, c, h, w)."""
        return x + self.change(x)


def _conv(before: int, after: int, stride: int = 1) -> tuple[nn.Module, ...]:
    return nn.Conv2d(before, after, 3, stride, 1), nn.PReLU(after)


def _as_large(planes: Tensor, others: Tensor) -> Tensor:
    return F.interpolate(planes, size=others.shape[2:], mode="bilinear", align_corners=False)


def _name(axis: str, width: float) -> str:
    return f"{axis}_{round(1000 * width)}"


def weights(net: nn.Module) -> int:
    """Number of trained weights."""
    return int(np.sum([p.numel() for p in net.parameters()]))
