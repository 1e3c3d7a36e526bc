"""Stills with annotated faces, as iBUG-68 points: lfpw, imm_frontal, dlib and menpo below data/annotated.

lfpw and menpo have .pts files (68 points, pixels counted from 1), dlib an XML file per set (68 points, pixels; by
its own words from dlib's predictor and not by hand), imm_frontal .asf files of 73 points as shares of the picture's
size.  Of those 73 only the points that the iBUG-68 scheme has too are used, IBUG_OF_IMM below: the ends and the
upper edge of the brows, the eyes' corners, the nose's tip, base and wings, the mouth's corners, the middles and peaks
of the lips, the chin.  Its lids have three points each where iBUG has two, its jaw 11 where iBUG has 17.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import F64, Picture
from benchmarks.landmarks.setting import boxes_of, picture
from guise.aam.landmarks import load_annotations
from guise.aam.landmarks.schemes import IBUG68

IBUG_OF_IMM = {
    0: 17, 1: 18, 2: 19, 3: 20, 4: 21, 12: 22, 13: 23, 14: 24, 15: 25, 8: 26,  # brows
    16: 36, 20: 39, 28: 42, 24: 45,  # eyes
    45: 30, 41: 31, 39: 33, 37: 35,  # nose
    46: 48, 47: 49, 48: 50, 49: 51, 50: 52, 51: 53, 52: 54, 54: 57, 57: 62, 60: 66,  # mouth
    67: 8,  # chin
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Still:
    """A picture and its faces: points (f, 68, 2) pixels, NaN where the scheme has no such point; boxes (f, 4)."""

    path: Path
    points: F64
    boxes: F64

    def rgb(self) -> Picture:
        """The picture."""
        return picture(self.path)


def pts_stills(folder: Path) -> Iterator[Still]:
    """Pictures with a .pts file each."""
    for file in sorted(folder.glob("*.pts")):
        pictures = [p for p in sorted(folder.glob(f"{file.stem}.*")) if p.suffix != ".pts"]
        points = load_annotations(file).points[:, IBUG68].astype(np.float64)
        yield Still(pictures[0], points, boxes_of(points))


def dlib_stills(folder: Path) -> Iterator[Still]:
    """Group photographs, in the order of the XML files."""
    for name in ("training", "testing"):
        for image in ET.parse(folder / f"{name}_with_face_landmarks.xml").iter("image"):
            faces = [
                [(part.get("x"), part.get("y")) for part in box.iter("part")] for box in image.iter("box")
            ]
            points = np.array(faces, np.float64).reshape(-1, 68, 2)
            yield Still(folder / str(image.get("file")), points, boxes_of(points))


def imm_stills(folder: Path) -> Iterator[Still]:
    """Frontal portraits; the boxes are those of all 73 points."""
    for file in sorted(folder.glob("*.asf")):
        path = file.with_suffix(".jpg")
        every = asf_shares(file.read_text()) * picture(path).shape[1::-1]
        points = np.full((1, 68, 2), np.nan)
        points[0, list(IBUG_OF_IMM.values())] = every[list(IBUG_OF_IMM)]
        yield Still(path, points, boxes_of(every[None]))


def asf_shares(text: str) -> F64:
    """Points (n, 2) of an .asf file, as shares of the picture's width and height."""
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    count = int(lines[0][0])
    return np.array([line[2:4] for line in lines[1 : 1 + count]], np.float64)


SETS: dict[str, Callable[[Path], Iterator[Still]]] = {
    "lfpw": pts_stills,
    "imm_frontal": imm_stills,
    "dlib": dlib_stills,
    "menpo": pts_stills,
}


def stills(shared: Path, name: str) -> list[Still]:
    """A data set; empty when it is not there."""
    folder = shared / "data" / "annotated" / name
    return list(SETS[name](folder)) if folder.is_dir() else []
