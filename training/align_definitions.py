"""Measures how rendered points and real labels differ, with a network that was trained on rendered people alone.

    python -m training.align_definitions --weights RUN/face.pt --parts PARTS --real DATA --output alignment.json

See `definitions.py` for what is done with it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from training.crops import plain_crops
from training.data import Pictures, load_parts, load_real
from training.definitions import Alignment, difference, evenly, moves
from training.measure import Answer
from training.report import answer_of

FRONTAL = 12.0  # degrees of yaw


def align(answer: Answer, rendered: Pictures, real: Pictures) -> Alignment:
    """What brings both kinds of labels to one definition."""
    crops, labels = plain_crops(real, len(real))
    rendered_moves, real_moves = moves(difference(answer(crops).points, labels))
    assert rendered.pose is not None
    frontal = plain_crops(rendered.only(np.abs(rendered.pose[:, 0]) < FRONTAL), 500)[1]
    return Alignment(evenly(frontal[:, :17]), rendered_moves, evenly(labels[:, :17]), real_moves)


def main() -> None:
    parser = argparse.ArgumentParser(description="Align the definitions of rendered and real points.")
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--real", type=Path, required=True)
    parser.add_argument("--output", type=Path, required=True)
    options = parser.parse_args()
    rendered = load_parts(options.parts, held_out=False)
    align(answer_of(options.weights), rendered, load_real(options.real, held_out=False)).write(options.output)


if __name__ == "__main__":
    main()
