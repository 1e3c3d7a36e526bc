"""The 8-bit picture that stands for a deeper one while a face is drawn, and the way back.

Components are Y, U, V as stored, in units of 8 bits (0..255, the deeper ones with fractions).  A picture with the
transfer of SDR is shown as it is.  One of HDR (PQ or HLG, ITU-R BT.2100) is shown as SDR would show it: as far as
`_KNEE` by light, with a gamma of 2.2 below a white of `WHITE_NITS`, and above that ever flatter, so that no highlight
is cut off and every value has its way back; colours of BT.2020 are those of BT.709.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media.colour import ColourMatrix

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

PQ, HLG = 16, 18  # transfers that H.273 numbers
BT2020 = 9  # primaries
WHITE_NITS = 203.0  # diffuse white in HDR, ITU-R BT.2408
_PQ_NITS, _HLG_NITS = 10_000.0, 1000.0
_HLG_GAMMA = 1.2  # of a display of 1000 nits, ITU-R BT.2100
_GAMMA, _KNEE = 2.2, 0.75  # of SDR; the value above which it is ever flatter
_STEPS = 1 << 16  # of the tables
_TO_BT709 = np.array(  # linear light of BT.2020, ITU-R BT.2087 the other way
    [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
)


class Rendition:
    """Between stored components (n, m, 3) float32, in units of 8 bits, and those of the 8-bit picture: of SDR."""

    def shown(self, stored: F32) -> F32:
        """What the 8-bit picture has, before it is rounded."""
        return stored

    def stored(self, shown: F32) -> F32:
        """The way back."""
        return shown

    def quick(self, rgb: U8) -> U8:
        """The 8-bit picture (h, w, 3) from one of R'G'B' as stored, a few grey levels off."""
        return rgb


class HighDynamicRange(Rendition):
    """Of HDR.

    Parameters
    ----------
    matrix : of the components.
    transfer : PQ or HLG.
    wide : whether the primaries are BT.2020's.
    """

    def __init__(self, matrix: ColourMatrix, transfer: int, *, wide: bool) -> None:
        self._to_rgb = np.asarray(matrix.to_rgb / 255, np.float32)
        self._from_rgb = np.asarray(matrix.from_rgb * (255, 255, 255, 1), np.float32)
        self._to_light, self._from_light = _tables(transfer)
        self._to_tone, self._from_tone = _tone_tables()
        self._primaries = (_TO_BT709 if wide else np.eye(3)).astype(np.float32)
        self._back = np.linalg.inv(self._primaries)

    def shown(self, stored: F32) -> F32:
        light = _looked_up(self._to_light, _transformed(stored, self._to_rgb))
        tone = _looked_up(self._to_tone, _fourth_root(_transformed(light, self._primaries)))
        return _transformed(tone, self._from_rgb)

    def stored(self, shown: F32) -> F32:
        light = _looked_up(self._from_tone, _transformed(shown, self._to_rgb))
        code = _looked_up(self._from_light, _fourth_root(_transformed(light, self._back)))
        return _transformed(code, self._from_rgb)

    def quick(self, rgb: U8) -> U8:
        codes = np.linspace(0, 1, 256, dtype=np.float32)
        tone = _looked_up(self._to_tone, _fourth_root(_looked_up(self._to_light, codes)))
        toned = cv2.LUT(rgb, np.rint(tone * 255).astype(np.uint8))
        return np.asarray(cv2.transform(toned, self._primaries), np.uint8)


_SDR = Rendition()


def rendition_of(matrix: ColourMatrix, transfer: int, primaries: int) -> Rendition:
    """The rendition of pictures with these tags, as H.273 numbers them."""
    if not is_hdr(transfer):
        return _SDR
    return HighDynamicRange(matrix, transfer, wide=primaries == BT2020)


def is_hdr(transfer: int) -> bool:
    """Whether a transfer is one of HDR."""
    return transfer in (PQ, HLG)


# Light is in units of diffuse white; tables go from 0 to 1 in `_STEPS` steps, those from light by its fourth root.
_MOST_LIGHT = _PQ_NITS / WHITE_NITS


def _looked_up(table: F32, places: F32) -> F32:
    """A table's values at places, clipped to [0, 1]."""
    rows = np.clip(places * np.float32(_STEPS - 1) + np.float32(0.5), 0, _STEPS - 1).astype(np.uint16)
    return np.asarray(table[rows])


def _transformed(values: F32, matrix: F32) -> F32:
    return np.asarray(cv2.transform(np.ascontiguousarray(values), matrix), np.float32)


def _fourth_root(light: F32) -> F32:
    share = np.maximum(light, 0) / np.float32(_MOST_LIGHT)
    return np.asarray(np.sqrt(np.sqrt(share)), np.float32)


@cache
def _tables(transfer: int) -> tuple[F32, F32]:
    """From a component of R'G'B' (0..1) to its light, and from the fourth root of light to the component."""
    steps = np.linspace(0, 1, _STEPS)
    light = _MOST_LIGHT * steps**4
    if transfer == PQ:
        return _pq_light(steps).astype(np.float32), _pq_code(light).astype(np.float32)
    return _hlg_light(steps).astype(np.float32), _hlg_code(light).astype(np.float32)


@cache
def _tone_tables() -> tuple[F32, F32]:
    """From the fourth root of light to a component of SDR (0..1), and from the component to light."""
    steps = np.linspace(0, 1, _STEPS)
    knee = _KNEE**_GAMMA
    power = _KNEE / (_GAMMA * (1 - _KNEE))  # with which the slope at the knee is the same from both sides
    light = np.maximum(_MOST_LIGHT * steps**4, 1e-12)
    above = 1 - (1 - _KNEE) * (light / knee) ** -power
    top = above[-1]
    tone = np.where(light < knee, light ** (1 / _GAMMA), above)
    part = np.maximum((1 - np.minimum(steps, top)) / (1 - _KNEE), 1e-12)
    back = np.where(steps < _KNEE, steps**_GAMMA, knee * part ** (-1 / power))
    return tone.astype(np.float32), np.minimum(back, _MOST_LIGHT).astype(np.float32)


_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128  # ITU-R BT.2100, table 4
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32


def _pq_light(code: F64) -> F64:
    root = code ** (1 / _M2)
    return np.asarray(_MOST_LIGHT * (np.maximum(root - _C1, 0) / (_C2 - _C3 * root)) ** (1 / _M1))


def _pq_code(light: F64) -> F64:
    share = (light / _MOST_LIGHT) ** _M1
    return np.asarray(((_C1 + _C2 * share) / (1 + _C3 * share)) ** _M2)


_A = 0.17883277  # ITU-R BT.2100, table 5
_B, _C = 1 - 4 * _A, 0.5 - _A * np.log(4 * _A)


def _hlg_light(code: F64) -> F64:
    scene = np.where(code <= 0.5, code**2 / 3, (np.exp((code - _C) / _A) + _B) / 12)
    return np.asarray(_HLG_NITS / WHITE_NITS * scene**_HLG_GAMMA)


def _hlg_code(light: F64) -> F64:
    scene = np.minimum(light * WHITE_NITS / _HLG_NITS, 1) ** (1 / _HLG_GAMMA)
    high = _A * np.log(np.maximum(12 * scene - _B, 1e-12)) + _C
    return np.asarray(np.where(scene <= 1 / 12, np.sqrt(3 * scene), high))
