"""Contact sheets of labelled crops for visual inspection: picture beside parsing colours, points, irises.

python -m training.overlay PART.npz SHEET.png [--first 0] [--count 16]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from guise.common.arrays import F32, U8
from training.parsing_labels import decode

# background, skin, brows, eyes, lips, inner mouth, hair, facial hair, glasses, occluder
COLOURS = np.array(
    [
        (40, 40, 40), (230, 180, 140), (150, 80, 30), (60, 120, 255), (230, 40, 90), (120, 0, 60), (110, 200, 60),
        (20, 130, 90), (0, 230, 230), (250, 230, 40),
    ],
    np.float32,
)  # fmt: skip


def overlay(
    image: U8, maps: F32, points: F32 | None = None,
    iris: F32 | None = None, zoom: int = 3,
) -> U8:  # fmt: skip
    """The picture (h, w, 3) with its points, beside its parsing maps (10, k, k) in colour: (zoom h, 2 zoom w, 3)."""
    h, w = image.shape[:2]
    size = (zoom * w, zoom * h)
    left = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
    colour = np.einsum("chw,cd->hwd", maps, COLOURS)
    right = cv2.resize(np.clip(colour, 0, 255).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    right = cv2.addWeighted(
        right, 0.75, cv2.cvtColor(cv2.cvtColor(left, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB), 0.25, 0
    )
    left = left.copy()
    for x, y in [] if points is None else (np.asarray(points) + 0.5) * zoom:
        cv2.circle(left, (round(float(x)), round(float(y))), 2, (0, 255, 0), -1, cv2.LINE_AA)
    for x, y, r in [] if iris is None else np.asarray(iris, np.float64):
        centre = (round((x + 0.5) * zoom), round((y + 0.5) * zoom))
        cv2.circle(left, centre, max(1, round(r * zoom)), (255, 0, 255), 1, cv2.LINE_AA)
    return np.asarray(np.concatenate([left, right], axis=1), np.uint8)


def sheet(tiles: list[U8], columns: int) -> U8:
    """Tiles of one size in rows."""
    blank = [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    rows = [np.concatenate(row, axis=1) for row in zip(*[iter(tiles + blank)] * columns, strict=True)]
    return np.concatenate(rows)


def save(path: Path, image: U8) -> None:
    """RGB picture to a file."""
    cv2.imwrite(str(path), np.ascontiguousarray(image[..., ::-1]))


def main() -> None:
    parser = argparse.ArgumentParser(description="Contact sheet of a rendered part.")
    parser.add_argument("part", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=16)
    parser.add_argument("--zoom", type=int, default=2)
    options = parser.parse_args()
    tiles = []
    with np.load(options.part) as part:
        ends, label_ends = np.cumsum(part["length"]), np.cumsum(part["labels_length"])
        for k in range(options.first, min(options.first + options.count, len(ends))):
            code = part["jpeg"][ends[k] - part["length"][k] : ends[k]]
            image = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR)[..., ::-1], np.uint8)
            labels = decode(part["labels"][label_ends[k] - part["labels_length"][k] : label_ends[k]])
            maps = (labels == np.arange(len(COLOURS))[:, None, None]).astype(np.float32)
            tiles.append(overlay(image, maps, part["face81"][k], part["iris"][k], options.zoom))
    save(options.sheet, sheet(tiles, 3))


if __name__ == "__main__":
    main()
