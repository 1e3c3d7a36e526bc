"""The eyeballs of a disguise, painted anew: they look where the source looks, and show nothing of the source's eyes.

The identity's own, as its texture has them, look where they did when it was enrolled, and are squeezed when lids close.
White, iris and pupil are the identity's (`iris.py`), with the shade of the upper lid and a reflection.
Places in an eye are in its widths, see `in_eye`.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import Group
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.model import Identity
from guise.app.swapping.iris import EYES, IrisChange, in_eye, white, whole_width
from guise.app.swapping.painted_part import PaintedPart
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class EyeballLimits:
    """Eye widths, or radii of the iris where they say so."""

    edge: float = 0.04  # over which an eyeball ends at the lids
    lashes: tuple[float, float] = (0.6, 0.25)  # their darkness at the upper and the lower lid,
    lashes_reach: float = 0.05  # and how far out
    border: tuple[float, float] = (1.1, 0.94)  # radii, at which there is no iris, and all of it
    lid_shade: float = 0.4  # just below the upper lid,
    lid_shade_reach: float = 0.06  # and how far down
    corner_shade: float = 0.15
    reflection: tuple[float, float, float] = (-0.35, -0.4, 0.13)  # radii: place, and standard deviation
    reflected: float = 1.3  # of the white


LIMITS = EyeballLimits()


class Eyeballs:
    """Paints both eyes of an identity into its texture.

    source, target : Identity of whose gaze is followed, and of whose eyes are painted; both share a reference frame.
    """

    def __init__(self, source: Identity, target: Identity) -> None:
        change = IrisChange.of(source, target)
        self._gaze, self._irises = change.gaze, change.target
        self._source_at_rest, self._at_rest = change.at_rest, target.appearance.neutral_shape
        self._parts = [PaintedPart.of(target.reference, group) for group in EYES]
        self._whites = [_white(target, group) for group in EYES]

    def look(self, irises: F64, head: F64) -> None:
        """Follow irises (2, 2), pixels, that the parsing of a frame finds in the source's head (81, 2)."""
        self._gaze.see(irises, head, self._source_at_rest)

    def reset(self) -> None:
        """Look as at rest."""
        self._gaze.reset()

    def paint(self, texture: F32, mesh: F64) -> None:
        """Paint them into a texture (n, 3) that will be drawn on a mesh (81, 2)."""
        for group, part, bright, iris in zip(EYES, self._parts, self._whites, self._gaze.parsed, strict=True):
            outline = mesh[group]
            whole = whole_width(group, mesh, self._at_rest)
            places, lids = (in_eye(points, outline, whole) for points in (part.places(mesh), outline))
            colours = self._seen(places - iris.astype(np.float32)) * np.float32(bright)
            colours *= _shade(places, lids)[:, None]
            inside = _inside(places, lids)
            dark = np.where(places[:, 1] < 0, *LIMITS.lashes) * np.exp(
                inside.clip(max=0) / LIMITS.lashes_reach
            )
            skin = texture[part.beside] * (1 - dark)[:, None]
            shown = np.clip(inside / LIMITS.edge + 0.5, 0, 1)[:, None]
            part.paint(texture, skin + shown * (colours - skin))

    def _seen(self, from_middle: F32) -> F32:
        """(n, 3) shares of the white at places (n, 2) from the middle of the iris."""
        x, y = from_middle.T / np.float32(self._irises.radius)
        away = np.hypot(x, y)
        outer, inner = LIMITS.border
        share = np.clip((outer - away) / np.float32(outer - inner), 0, 1)
        seen = 1 + share * (self._irises.at(np.minimum(away, 1)) - 1)
        left, up, width = LIMITS.reflection
        gleam = np.exp(-((x - left) ** 2 + (y - up) ** 2) / (2 * width**2))
        return np.asarray((seen + gleam * (LIMITS.reflected - seen)).T, np.float32)


def _white(person: Identity, eye: Group) -> float:
    """Brightness of an eye's white in the person's texture."""
    inside = soft_parts(person.reference, (eye,), 0.0)[person.reference.mask] > 0.5
    return float(white(person.appearance.neutral_texture[inside]) @ LUMA)


def _inside(places: F32, lids: F32) -> F32:
    """(n,) how far places (n, 2) lie within lids (6, 2), of which the outline is convex; negative outside."""
    x, y = (np.roll(lids, -1, axis=0) - lids).T[..., None] + np.float32(1e-6)
    from_x, from_y = places.T[:, None] - lids.T[..., None]
    return np.asarray(((x * from_y - y * from_x) / np.hypot(x, y)).min(0), np.float32)


def _shade(places: F32, outline: F32) -> F32:
    """(n,) how bright an eyeball with an outline (6, 2) is at places (n, 2)."""
    x, y = places.T
    lid = outline[:, 1].min() * np.clip(1 - 4 * x * x, 0, 1)
    below = np.exp(-np.maximum(y - lid, 0) / LIMITS.lid_shade_reach)
    return np.asarray((1 - LIMITS.lid_shade * below) * (1 - LIMITS.corner_shade * np.minimum(4 * x * x, 1)))
