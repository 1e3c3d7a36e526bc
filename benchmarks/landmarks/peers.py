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

MISSING = "{} was not measured: give --peers-python (README.md)."


class Peer(PeerProcess):
    """A process of the peers' environment that answers one picture after the other.

    kind : "image" or "video" (MediaPipe) or "centerface".   argument : the model's path, or the threshold.
    """

    def __init__(self, python: Path, kind: str, argument: Path | float) -> None:
        super().__init__(python, Path(__file__).with_name("peer.py"), kind, argument)

    def ask(self, rgb: Picture) -> tuple[list[Any], tuple[float, float]]:
        """The peer's faces, and the milliseconds that it took: on the clock, and of the processor."""
        self.send(b"%d %d\n" % rgb.shape[:2] + rgb.tobytes())
        answer = json.loads(self.line())
        return answer["faces"], (answer["ms"], answer["processor_ms"])

    def meshes(self, rgb: Picture) -> F64:
        """MediaPipe's faces (f, 478, 2)."""
        return np.array(self.ask(rgb)[0], np.float64).reshape(-1, 478, 2)

    def boxes(self, rgb: Picture) -> F64:
        """CenterFace's boxes and scores (f, 5)."""
        return np.array(self.ask(rgb)[0], np.float64).reshape(-1, 5)
