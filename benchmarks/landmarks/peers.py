"""Peers in a process of their own, and how MediaPipe's mesh becomes face81.

Pixels, x right, y down, pixel centres at integers; pictures RGB uint8 (h, w, 3).
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from benchmarks.common import F64, Picture
from benchmarks.tracker_speed import QUIET

MISSING = "{} was not measured: give --peers-python (README.md)."


class Peer:
    """A process of the peers' environment that answers one picture after the other.

    kind : "image" or "video" (MediaPipe) or "centerface".   argument : the model's path, or the threshold.
    """

    def __init__(self, python: Path, kind: str, argument: Path | float) -> None:
        script = Path(__file__).with_name("peer.py")
        self._process = subprocess.Popen(
            [str(python), str(script), kind, str(argument)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=QUIET,
        )  # fmt: skip
        self._line()

    def _line(self) -> bytes:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("a peer stopped; is the peers' environment complete?")
        return line

    def ask(self, rgb: Picture) -> tuple[list[Any], tuple[float, float]]:
        """The peer's faces, and the milliseconds that it took: on the clock, and of the processor."""
        assert self._process.stdin is not None
        self._process.stdin.write(b"%d %d\n" % rgb.shape[:2] + rgb.tobytes())
        self._process.stdin.flush()
        answer = json.loads(self._line())
        return answer["faces"], (answer["ms"], answer["processor_ms"])

    def meshes(self, rgb: Picture) -> F64:
        """MediaPipe's faces (f, 478, 2)."""
        return np.array(self.ask(rgb)[0], np.float64).reshape(-1, 478, 2)

    def boxes(self, rgb: Picture) -> F64:
        """CenterFace's boxes and scores (f, 5)."""
        return np.array(self.ask(rgb)[0], np.float64).reshape(-1, 5)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait(timeout=30)
