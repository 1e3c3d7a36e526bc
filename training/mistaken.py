"""What the shipped detector takes for faces and is none, for training what tells them apart (`face_head.py`).

    python -m training.mistaken --parts PARTS --real DATA --hands HANDS --output MISTAKEN.npz [--pictures 8000]

Pictures of hands in heaps, some of them moved or out of focus, of stones and bottles, of the detector's scenes and
backgrounds, and real frames that may be trained on.  MISTAKEN.npz holds `jpeg`, the bytes of crops as the landmarker
sees them, one after the other, their `length` (n,), and `logit` (n,), how much they looked like a face.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks.boxes import is_same
from guise.aam.landmarks.builtin import BuiltinLandmarker, crop_of_box
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.schemes import IBUG68
from guise.common.arrays import F64, U8
from training.backgrounds import CLIPS, faceless_photos, random_background
from training.camera import camera, lit
from training.cutouts import Cutouts, load_hands
from training.data import load_parts
from training.scenes import SIZE, Scenes, real_people

EVERY = 4  # frames of a clip
LEAST_SCORE, LEAST_LOGIT = 0.08, -8.0  # of what is kept
REAL_SHARE, BACKGROUNDS = 0.25, 400  # of the scenes
# Faces that no landmarks tell of: a person beside the signer.
NEIGHBOURS = {"gesture_bird": ((560.0, 120.0, 640.0, 300.0),)}

Rng = np.random.Generator
Picture = tuple[U8, F64]  # and boxes (n, 4) of faces, and of what may be one
NOBODY: F64 = np.zeros((0, 4))


class Pictures:
    """Makes pictures with things that may be mistaken for faces, and says where faces are."""

    def __init__(self, parts: Path, data: Path, hands: Cutouts, seed: int) -> None:
        self._photos, self._hands = faceless_photos(data / "real"), hands
        self._frames = list(real_frames(data / "real"))
        rendered = load_parts(parts, held_out=False)
        self._scenes = Scenes(rendered, real_people(data), self._photos, REAL_SHARE, seed, BACKGROUNDS)

    def make(self, rng: Rng) -> Picture:
        """One picture."""
        makers = (self._scene, self._background, self._heap, self._stones, self._real)
        image, faces = makers[int(rng.choice(len(makers), p=(0.2, 0.15, 0.25, 0.15, 0.25)))](rng)
        return (
            (np.ascontiguousarray(camera(rng, lit(rng, image))), faces)
            if rng.random() < 0.3
            else (image, faces)
        )

    def _scene(self, rng: Rng) -> Picture:
        made = self._scenes.make(rng)
        return made.image, np.concatenate([made.boxes, made.unsure])

    def _background(self, rng: Rng) -> Picture:
        return random_background(rng, SIZE, SIZE, self._photos, 0.4), NOBODY

    def _heap(self, rng: Rng) -> Picture:
        """Hands on and beside each other."""
        image, middle = self._background(rng)[0], rng.uniform(0.2, 0.8, 2) * SIZE
        for _ in range(int(rng.integers(1, 6))):
            hand, scale = (
                self._hands[int(rng.integers(len(self._hands)))],
                float(np.exp(rng.uniform(-1.4, 0.5))),
            )
            angle = rng.uniform(0, 2 * np.pi)
            turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            linear = turn @ np.diag([rng.choice([-1.0, 1.0]), 1.0])
            matrix = np.column_stack([linear, middle - linear @ hand.knuckles])
            warped = cv2.warpAffine(hand.picture, matrix, (SIZE, SIZE)).astype(np.float32)
            opacity, colour = warped[..., 3:] / 255, np.clip(warped[..., :3] * rng.uniform(0.6, 1.3), 0, 255)
            image = (image * (1 - opacity) + colour * opacity).astype(np.uint8)
            middle = middle + rng.normal(0, 60 * scale, 2)
        if rng.random() < 0.5:
            length = int(rng.integers(3, 25))
            image = np.asarray(cv2.blur(image, (length, 1) if rng.random() < 0.5 else (1, length)), np.uint8)
        return image, NOBODY

    def _stones(self, rng: Rng) -> Picture:
        """Round and square things with spots, in a light from one side."""
        image = self._background(rng)[0]
        y, x = np.mgrid[:SIZE, :SIZE]
        for _ in range(int(rng.integers(1, 9))):
            centre, axes = rng.uniform(0, SIZE, 2), np.exp(rng.uniform(np.log(10), np.log(90), 2))
            base = rng.uniform(60, 220) * np.array([1, rng.uniform(0.75, 1), rng.uniform(0.5, 1)])
            mask = np.zeros((SIZE, SIZE), np.uint8)
            place = (centre.tolist(), (2 * axes).tolist(), float(rng.uniform(0, 180)))
            if rng.random() < 0.6:
                cv2.ellipse(mask, place, 255, -1, cv2.LINE_AA)
            else:
                cv2.fillPoly(mask, [cv2.boxPoints(place).astype(np.int32)], 255, cv2.LINE_AA)
            slope = rng.uniform(-0.25, 0.25, 2) / axes
            grain = cv2.GaussianBlur(
                rng.standard_normal((SIZE, SIZE)).astype(np.float32), (0, 0), rng.uniform(1, 9)
            )
            grain *= rng.uniform(0.03, 0.3) / max(float(grain.std()), 1e-6)
            light = 1 + (x - centre[0]) * slope[0] + (y - centre[1]) * slope[1] + grain
            colour = np.clip(base * light[..., None], 0, 255)
            for _ in range(int(rng.integers(0, 5))):
                at, size = centre + rng.normal(0, 0.4, 2) * axes, 2 + 2 * axes * rng.uniform(0.05, 0.3, 2)
                spot = (at.tolist(), size.tolist(), float(rng.uniform(0, 180)))
                cv2.ellipse(colour, spot, tuple((base * rng.uniform(0.2, 1.4)).tolist()), -1, cv2.LINE_AA)
            opacity = cv2.GaussianBlur(mask, (0, 0), rng.uniform(0.5, 3))[..., None] / 255
            image = (image * (1 - opacity) + colour * opacity).astype(np.uint8)
        return image, NOBODY

    def _real(self, rng: Rng) -> Picture:
        """A frame of a clip, smaller or larger."""
        image, faces = self._frames[int(rng.integers(len(self._frames)))]
        scale = rng.uniform(0.6, 2.9) * SIZE / max(image.shape)
        resized = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        if rng.random() < 0.4:
            resized = cv2.GaussianBlur(resized, (0, 0), rng.uniform(0.5, 3))
        return np.asarray(resized, np.uint8), faces * scale


def real_frames(folder: Path) -> Iterator[Picture]:
    """Frames of the clips that may be trained on, where all their faces are known."""
    for file in sorted(f for name in CLIPS for f in folder.glob(f"{name}.m*")):
        points = np.load(file.with_suffix(".landmarks.npz"))["face81"][:, :, IBUG68]
        capture = cv2.VideoCapture(str(file))
        for index, shapes in enumerate(points):
            good, bgr = capture.read()
            if good and index % EVERY == 0 and np.isfinite(shapes).all():
                boxes = np.concatenate([shapes.min(1), shapes.max(1)], axis=1)
                others = np.reshape(NEIGHBOURS.get(file.stem, []), (-1, 4))
                yield np.ascontiguousarray(bgr[..., ::-1], np.uint8), np.concatenate([boxes, others])
        capture.release()


def mistaken(pictures: Pictures, count: int, seed: int) -> Iterator[tuple[U8, float]]:
    """Crops (128, 128, 3) of what the detector finds beside faces in so many pictures, and the landmarker's logits."""
    rng = np.random.default_rng(seed)
    cv2.setRNGSeed(seed)
    detector = FaceDetector(12, min_score=LEAST_SCORE)
    landmarker = BuiltinLandmarker(detector)
    for _ in range(count):
        image, faces = pictures.make(rng)
        for box in detector.detect_scored(image)[0]:
            if not any(_touches(box, face) for face in faces):
                logit = landmarker.likeness(image, box)
                if logit >= LEAST_LOGIT:
                    yield crop_of_box(image, box, 0.0)[0], logit


def _touches(box: F64, face: F64) -> bool:
    middle = (box[:2] + box[2:]) / 2
    return is_same(box, face) or bool(((middle > face[:2]) & (middle < face[2:])).all())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("parts", "real", "hands", "output"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--pictures", type=int, default=8000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    made = Pictures(options.parts, options.real, load_hands(options.hands, held_out=False), options.seed)
    crops, logits = zip(*mistaken(made, options.pictures, options.seed), strict=True)
    codes = [
        cv2.imencode(".jpg", crop[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].ravel() for crop in crops
    ]
    np.savez(
        options.output, jpeg=np.concatenate(codes), length=np.array([len(code) for code in codes]),
        logit=np.array(logits, np.float32),
    )  # fmt: skip
    print(f"{len(crops)} crops, {sum(logit > 0 for logit in logits)} of them like faces")


if __name__ == "__main__":
    main()
