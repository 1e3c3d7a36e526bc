"""Measure how rendered points and real labels differ, using a network trained on rendered people alone.

    python -m training.align_definitions --weights RUN/face.pt --parts PARTS --real DATA --output alignment.json

`definitions.py` says how the result is used.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from guise.aam.landmarks.schemes import JAW
from training.crops import plain_crops
from training.data import Pictures, by_hands, load_parts, load_real
from training.definitions import Alignment, definition_moves, difference, even_spacing
from training.measure import Answer
from training.report import answer_of

MAX_FRONTAL_YAW_DEGREES = 12.0


def align(answer: Answer, rendered: Pictures, real: Pictures) -> Alignment:
    """The alignment that brings both kinds of labels to one definition."""
    crops, labels = plain_crops(real, len(real))
    rendered_moves, real_moves = definition_moves(difference(answer(crops).points, labels))
    assert rendered.pose is not None
    frontal = plain_crops(rendered.only(np.abs(rendered.pose[:, 0]) < MAX_FRONTAL_YAW_DEGREES), 500)[1]
    return Alignment(even_spacing(frontal[:, JAW]), rendered_moves, even_spacing(labels[:, JAW]), real_moves)


def main() -> None:
    parser = argparse.ArgumentParser(description="Align the definitions of rendered and real points.")
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--real", type=Path, required=True)
    parser.add_argument("--output", type=Path, required=True)
    options = parser.parse_args()
    rendered, _ = by_hands(load_parts(options.parts, held_out=False))
    align(answer_of(options.weights), rendered, load_real(options.real, held_out=False)).write(options.output)


if __name__ == "__main__":
    main()
