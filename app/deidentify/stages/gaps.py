"""The gaps that heads leave when they are taken away, by track and frame, as the fourth stage keeps them for the last.

With ``--region head``; two bits for each cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.app.swapping.head_matte import Gap

Gaps = dict[tuple[int, int], Gap]


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
