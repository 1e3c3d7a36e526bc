"""Errors of occluder parsing on real crops whose occluders were outlined by hand.

A folder holds crops NAME.png of 128 x 128 pixels as the landmarker makes them, and labels.json: for each NAME lists of
polygons, [[[x, y], ...], ...] in pixels of the crop, `occluder` for what is in front of the face, `ignore` where
it cannot be decided.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.aam.parsing import CELLS
from guise.common.arrays import U8, Bool
from training.measure import Answer
from training.parsing_labels import OCCLUDER


def load_outlined(folder: Path) -> tuple[U8, Bool, Bool]:
    """Crops (n, 128, 128, 3), cells (n, 64, 64) that show an occluder, and cells to leave out."""
    labels = json.loads((folder / "labels.json").read_text())
    crops = [cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_COLOR_RGB) for name in labels]
    shown, left_out = (
        np.stack([_filled(one[kind]) for one in labels.values()]) for kind in ("occluder", "ignore")
    )
    return np.stack(crops).astype(np.uint8), shown, left_out & ~shown


def _filled(polygons: list[Any]) -> Bool:
    area = np.zeros((CELLS, CELLS), np.uint8)
    for polygon in polygons:
        corners = np.round(((np.array(polygon) + 0.5) / 2 - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(area, [corners], 1, shift=4)
    return area > 0


def outlined_figures(answer: Answer, folder: Path) -> dict[str, float]:
    """IoU of the occluders over all crops, and the percentage of the remaining face hulls classified as occluder."""
    crops, shown, left_out = load_outlined(folder)
    found = answer(crops)
    if found.parsing is None:
        return {}
    called = found.parsing.argmax(1) == OCCLUDER
    hulls = np.stack([_filled([cv2.convexHull(p)[:, 0]]) for p in found.points.astype(np.float32)])
    counted = ~left_out
    both, either = (called & shown & counted).sum(), ((called | shown) & counted).sum()
    clear = hulls & counted & ~shown
    return {
        "crops": len(crops), "occluder_iou": float(both / max(either, 1)),
        "false_occluder": float(100 * called[clear].mean()),
    }  # fmt: skip
