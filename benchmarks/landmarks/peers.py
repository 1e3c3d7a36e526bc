"""Peers in a process of their own, and how MediaPipe's mesh becomes face81.

Pixels, x right, y down, pixel centres at integers; pictures RGB uint8 (h, w, 3).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.children import PeerProcess
from benchmarks.common import F64, Picture

# The vertices of MediaPipe's 478-point mesh that are the points of face81: each the one whose mean distance from the
# landmarks beside studio_d3, address_o2 and phone_d13 (MediaPipe's answers as face81) is smallest.
FACE81 = (
    127, 234, 93, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 323, 454, 356,  # jaw
    71, 63, 105, 66, 107, 336, 296, 334, 293, 301,  # brows
    168, 197, 5, 4, 75, 97, 2, 326, 305,  # nose
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,  # eyes
    61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181,  # outer lips
    78, 82, 13, 312, 308, 317, 14, 87,  # inner lips
    162, 21, 54, 103, 67, 109, 10, 338, 297, 332, 284, 251, 389,  # forehead
)  # fmt: skip
MISSING = "{} was not measured: give --peers-python (README.md)."


class Peer(PeerProcess):
    """A process of the peers' environment that answers one picture after the other.

    kind : "image" or "video" (MediaPipe) or "centerface".   argument : the model's path, or the threshold.
    """

    def __init__(self, python: Path, kind: str, argument: Path | float) -> None:
        super().__init__(python, Path(__file__).with_name("peer.py"), kind, argument)

    def ask(self, rgb: Picture) -> list[Any]:
        """The peer's faces."""
        self.send(b"%d %d\n" % rgb.shape[:2] + rgb.tobytes())
        return list(json.loads(self.line()))

    def meshes(self, rgb: Picture) -> F64:
        """MediaPipe's faces (f, 478, 2)."""
        return np.array(self.ask(rgb), np.float64).reshape(-1, 478, 2)

    def boxes(self, rgb: Picture) -> F64:
        """CenterFace's boxes and scores (f, 5)."""
        return np.array(self.ask(rgb), np.float64).reshape(-1, 5)


def face81(mesh: F64) -> F64:
    """Points (..., 81, 2) of meshes (..., 478, 2)."""
    return np.asarray(mesh[..., list(FACE81), :])
