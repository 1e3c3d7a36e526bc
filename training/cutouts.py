"""Backgrounds and occluders of training crops: procedural backgrounds, cut-outs of rendered hands."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from guise.common.arrays import F32
from training.augment import Props
from training.clutter import clutter
from training.data import HELD_OUT, Packed
from training.occluders import Cutout

BACKGROUNDS, BACKGROUND_SIZE = 1500, 192


def make_props(
    seed: int, hands: Path | None, *, held_out: bool = False, backgrounds: int = BACKGROUNDS
) -> Props:
    """Procedural backgrounds, and cut-outs of hands, of the people trained on or of those held out."""
    rng = np.random.default_rng(seed)
    behind = np.stack([clutter(rng, BACKGROUND_SIZE) for _ in range(backgrounds)])
    return Props(behind, load_hands(hands, held_out=held_out) if hands else ())


class Cutouts:
    """Cut-outs, decoded on access.

    scales : (n,) pixels per decimetre; knuckles : (n, 2) pixels
    """

    def __init__(self, colours: Packed, alphas: Packed, scales: F32, knuckles: F32) -> None:
        self._colours, self._alphas = colours, alphas
        self._scales, self._knuckles = scales, knuckles

    def __len__(self) -> int:
        """Return the number of cut-outs."""
        return len(self._colours)

    def __getitem__(self, index: int) -> Cutout:
        """Return one cut-out."""
        picture = np.dstack([self._colours[index], self._alphas[index]])
        return Cutout(picture, float(self._scales[index]), self._knuckles[index])


def load_hands(file: Path, *, held_out: bool) -> Cutouts:
    """The output of `render_hands.py`, of the people held out or of all others."""
    with np.load(file) as stored:
        wanted = np.flatnonzero((stored["person"] % HELD_OUT == 0) == held_out)

        def packed(name: str, colour: bool) -> Packed:
            ends, length = np.cumsum(stored[f"{name}_length"]), stored[f"{name}_length"]
            data = stored[name]
            return Packed([data[ends[i] - length[i] : ends[i]].copy() for i in wanted], colour)

        return Cutouts(
            packed("colour", True),
            packed("alpha", False),
            stored["scale"][wanted],
            stored["knuckles"][wanted],
        )
