"""Renders scenes for `benchmarks.picture.turned`: heads that turn to 60 degrees, and their ideal swap.

    python -m benchmarks.picture.sweeps --shared ../shared --out DIR

In `sweep` scenes a person speaks without sound; in `still` scenes the face doesn't move at all.  The renderer is
`make_swap_truth.py` of the shared folder; scenes lie in DIR as it names them, and finished ones are kept.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any

import av
import numpy as np

# kind, head, face shown, seed; the heads' own clips show the faces turned, so donors can be enrolled from them.
SCENES = (
    ("sweep", "p01", "p04", 701),
    ("sweep", "p04", "p07", 702),
    ("sweep", "p07", "p01", 703),
    ("still", "p04", "p02", 704),
)
FRAMES = 60
TURN_DEGREES = 58.0
GAZE_SHARE, MAX_GAZE_DEGREES = 0.4, 18.0  # by which eyes stay behind
CRF = "16"


class Writer:
    """An H.264 file of RGB frames; the renderer's own needs the program ffmpeg."""

    def __init__(self, path: Path, wav: None = None, crf: int = 0) -> None:
        self._file = av.open(str(path), "w")
        self._stream: Any = None

    def add(self, picture: np.ndarray) -> None:
        """Write a picture (h, w, 3) uint8."""
        if self._stream is None:
            self._stream = self._file.add_stream("libx264", 30, options={"crf": CRF, "preset": "fast"})
            self._stream.height, self._stream.width = picture.shape[:2]
            self._stream.pix_fmt = "yuv420p"
        self._file.mux(self._stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))

    def close(self) -> None:
        """Finish the file."""
        self._file.mux(self._stream.encode())
        self._file.close()


def load(shared: Path) -> Any:
    """The renderer's module, without speech and with the scenes of this file."""
    sys.path.insert(0, str(shared / "people"))
    program: Any = importlib.import_module("make_swap_truth")
    corpus = importlib.import_module("make_corpus")
    corpus.Writer = Writer  # type: ignore[attr-defined]
    corpus.TALK = {name: ("", *rest) for name, (_, *rest) in corpus.TALK.items()}
    usual = program.scene

    def scene(studio: Any, kind: str, actor: Any, seed: int, frames: int) -> tuple[Any, ...]:
        performance, *others = usual(studio, "yaw", actor, seed, frames)
        turn = TURN_DEGREES * np.sin(2 * np.pi * np.arange(frames) / frames)
        weights = performance["weights"]
        if kind == "still":
            for name in ("pitch", "roll", "sway", "weights"):
                performance[name][:] = 0
        performance["yaw"] = turn
        weights[:, -2] = np.clip(-GAZE_SHARE * turn, -MAX_GAZE_DEGREES, MAX_GAZE_DEGREES)
        return (performance, *others)

    program.scene = scene
    program.SAY |= {
        "sweep": "slow turn of the head, 58 degrees to each side",
        "still": "the same, the face at rest",
    }
    return program


def main() -> None:
    """Render what is missing."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shared", type=Path, default=Path(__file__).parents[3] / "shared")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    program = load(options.shared)
    for kind, head, face, seed in SCENES:
        program.make(options.out, kind, head, face, seed, FRAMES, False)


if __name__ == "__main__":
    main()
