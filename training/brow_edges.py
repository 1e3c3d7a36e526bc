"""Measure where the hair of brows begins, seen from their landmarks: `USUAL_EDGE` of `aam/brows.py`.

    python -m training.brow_edges CLIP [CLIP ...]

The clips show a person each, best rendered ones, as these have no brows that are always raised.  Landmarks are the
built-in landmarker's.  Prints the median over people and both brows, in thousandths of the face's width.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from guise.aam.brows import edges_of_hair
from guise.aam.landmarks import FaceTracker, open_landmarker
from guise.aam.parsing import FaceParser
from guise.app.media import open_input
from guise.common.arrays import F64


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clips", type=Path, nargs="+")
    people = np.array([edges_of(clip) for clip in parser.parse_args().clips])
    print(np.round(1000 * np.median(people, axis=0)).astype(int).tolist())


def edges_of(clip: Path) -> F64:
    """(12,) median of a person's edges, from the outer end to the inner one, face widths."""
    parser, tracker, found = FaceParser(), FaceTracker(open_landmarker("builtin")), []
    with open_input(clip) as source:
        for frame in source:
            rgb = frame.rgb()
            face = tracker.update(rgb)
            if face is None:
                continue
            points = face.points.astype(np.float64)
            (right, left), _ = edges_of_hair(parser.parse(rgb, points), points)
            found += [right, left[::-1]]
    return np.median(found, axis=0)


if __name__ == "__main__":
    main()
