"""Errors of occluder parsing on frames of real videos whose occluders were outlined by hand.

`real_occluders.json` lists crops of 128 x 128 pixels as the landmarker makes them: clip and frame, `crop` (centre x and
y, side in pixels and turn in radians), and polygons in pixels of the crop: `hull` about the face's points, `occluder`
around objects in front of the face, `ignore` where it can't be decided. Hair and glasses aren't occluders.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.builtin import cut
from guise.aam.parsing import CELLS, FaceClass
from guise.common.arrays import F32, U8, Bool

FILE = Path(__file__).with_suffix(".json")


@dataclass(frozen=True, eq=False)
class Outlined:
    """Crops (n, 128, 128, 3), and cells (n, 64, 64) of the face's hull, of occluders, and to be left out."""

    crops: U8
    hull: Bool
    occluder: Bool
    ignore: Bool


def load_outlined(clips: Path, file: Path = FILE) -> Outlined:
    """Crops of the clips in a folder, as far as they are there, and what was outlined in them."""
    rows = json.loads(file.read_text())
    found = [(row, crop) for row in rows if (crop := _crop(clips, row)) is not None]
    if not found:
        raise FileNotFoundError(f"none of the clips that {file.name} names is in {clips}")
    cells = {kind: np.stack([_filled(row[kind]) for row, _ in found]) for kind in ("occluder", "ignore")}
    hull = np.stack([_filled([row["hull"]]) for row, _ in found])
    crops = np.stack([crop for _, crop in found])
    return Outlined(crops, hull, cells["occluder"], cells["ignore"] & ~cells["occluder"])


def _crop(clips: Path, row: dict[str, Any]) -> U8 | None:
    for path in clips.glob(f"{row['clip']}.*"):
        capture = cv2.VideoCapture(str(path)) if path.suffix != ".npz" else None
        if capture is None:
            continue
        for _ in range(row["frame"] + 1):
            good, image = capture.read()
        if good:
            x, y, side, turn = row["crop"]
            return cut(np.ascontiguousarray(image[..., ::-1]), np.array([x, y]), side, turn)[0]
    return None


def _filled(polygons: list[Any]) -> Bool:
    area = np.zeros((CELLS, CELLS), np.uint8)
    for polygon in polygons:
        corners = np.round(((np.array(polygon) + 0.5) / 2 - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(area, [corners], 1, shift=4)
    return area > 0


def outlined_figures(parsing: F32, given: Outlined) -> dict[str, float]:
    """Of parsing (n, 10, 64, 64): IoU of occluders in the hulls, and the percentage of their other cells called so."""
    called = parsing.argmax(1) == FaceClass.OCCLUDER
    counted = given.hull & ~given.ignore
    both, either = (
        (called & given.occluder & counted).sum(),
        ((called | given.occluder) & counted).sum(),
    )
    return {
        "crops": len(called), "occluder_iou": float(both / max(int(either), 1)),
        "false_occluder": float(100 * called[counted & ~given.occluder].mean()),
    }  # fmt: skip
