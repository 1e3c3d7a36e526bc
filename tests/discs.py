"""A landmarker for tests, which takes bright discs for faces, and pictures of such discs."""

import cv2
import numpy as np

from guise.aam.landmarks import Face
from guise.aam.landmarks.schemes import mean_geometry

SIZE = 24.0  # inter-ocular distance of a disc of radius 30
Disc = tuple[float, float, float]  # x, y, radius


def face_at(x: float, y: float, size: float = SIZE, confidence: float = 0.9) -> Face:
    mean = mean_geometry().mean
    points = np.stack([mean.real, mean.imag], axis=-1) * size
    points += np.array([x, y]) - points.mean(axis=0)
    return Face.around(points, confidence, np.linspace(0, 1, 81, dtype=np.float32))


class Discs:
    """Takes bright discs for faces; their brightness is the confidence, and they move a little with each frame."""

    name = "discs"

    def __init__(self) -> None:
        self.detections = 0

    def detect(self, rgb: np.ndarray) -> list[Face]:
        self.detections += 1
        return sorted(self.all(rgb), key=lambda face: -face.area)

    def refine(self, rgb: np.ndarray, previous: Face) -> Face | None:
        near = [f for f in self.all(rgb) if np.abs(f.points - previous.points).max() < SIZE / 2]
        return near[0] if near else None

    def all(self, rgb: np.ndarray) -> list[Face]:
        grey = rgb[..., 1]
        count, _, stats, centres = cv2.connectedComponentsWithStats((grey > 100).astype(np.uint8))
        return [
            face_at(*centres[i], SIZE * np.sqrt(stats[i, cv2.CC_STAT_AREA] / np.pi) / 30, grey.max() / 255)
            for i in range(1, count)
            if stats[i, cv2.CC_STAT_AREA] > 200
        ]


def scene(discs: list[Disc], width: int = 320, height: int = 240) -> np.ndarray:
    rgb = np.full((height, width, 3), 20, np.uint8)
    for x, y, radius in discs:
        cv2.circle(rgb, (round(x), round(y)), round(radius), (230, 230, 230), -1)
    return rgb
