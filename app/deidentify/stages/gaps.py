"""The gaps that heads leave when they are taken away, by track and frame, as the fourth stage keeps them for the last.

With ``--region head``; steady in time, and kept as two bits for each cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.stages.head_matte import Gap
from guise.common.arrays import F64

Key = tuple[int, int]
Gaps = dict[Key, Gap]
NEAR_FRAMES = 3  # before and after one, whose gaps it shares,
MIN_SHARE = 0.4  # if so many of them have a cell
MARGIN_CELLS = 4  # by which a gap may grow


def steadied(gaps: Gaps, shapes: Mapping[Key, F64]) -> Gaps:
    """Gaps as most of the frames around have them, moved along with the face's shape (81, 2) in each."""
    places = {key: (shape.mean(0), float(np.ptp(shape[:, 0]))) for key, shape in shapes.items()}
    made: Gaps = {}
    for (track, frame), gap in gaps.items():
        size = np.add(gap.cells.shape, 2 * MARGIN_CELLS)
        corner = gap.corner - MARGIN_CELLS / gap.scale
        centre, width = places[track, frame]
        sums = []
        for key in ((track, k) for k in range(frame - NEAR_FRAMES, frame + NEAR_FRAMES + 1)):
            if key not in gaps:
                continue
            other, (their_centre, their_width) = gaps[key], places[key]
            # From my cells to theirs, by way of both pictures.
            scale = other.scale * their_width / width
            first = (corner + 0.5 / gap.scale - centre) * their_width / width + their_centre - other.corner
            to_theirs = np.column_stack([np.eye(2) * scale / gap.scale, first * other.scale - 0.5])
            parts = np.dstack([other.cells, other.body]).astype(np.float32)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            sums.append(cv2.warpAffine(parts, to_theirs, size[::-1].tolist(), flags=flags))
        share = np.mean(sums, axis=0)
        cells, body = share[..., 0] > MIN_SHARE, share[..., 1] > MIN_SHARE
        made[track, frame] = Gap(cells, body & ~cells, corner, gap.scale)
    return made


def packed(gaps: Gaps) -> dict[str, NDArray[Any]]:
    """As arrays: key (n, 2), corner (n, 2), scale (n,), size (n, 2) of the cells, the bits of all cells and bodies."""
    bits = [np.packbits([gap.cells, gap.body]) for gap in gaps.values()]
    return {
        "key": np.array(list(gaps), np.int32).reshape(-1, 2),
        "corner": np.array([gap.corner for gap in gaps.values()]).reshape(-1, 2),
        "scale": np.array([gap.scale for gap in gaps.values()], np.float64),
        "size": np.array([gap.cells.shape for gap in gaps.values()], np.int32).reshape(-1, 2),
        "bits": np.concatenate([*bits, np.zeros(0, np.uint8)]),
    }


def unpacked(arrays: dict[str, NDArray[Any]]) -> Gaps:
    """From what `packed` gave."""
    gaps: Gaps = {}
    lengths = -(-2 * arrays["size"].prod(1) // 8)
    each = np.split(arrays["bits"], np.cumsum(lengths)[:-1]) if len(lengths) else []
    for key, corner, scale, size, bits in zip(
        arrays["key"].tolist(), arrays["corner"], arrays["scale"], arrays["size"], each, strict=True
    ):
        cells, body = np.unpackbits(bits, count=2 * int(size.prod())).reshape(2, *size) > 0
        gaps[key[0], key[1]] = Gap(cells, body, corner, float(scale))
    return gaps
