"""Enrols the donors that ship with Guise (app/gallery) from the clips of rendered people who do not exist.

    python -m training.make_gallery --people DIR

DIR holds a folder p01, p02 .. for each, with talk.mp4 and talk2.mp4 (CC0, made by the same program as sample_videos).
The landmarks are found by the built-in landmarker, as those of the people in videos are, so that both mean the same
places of a face.  A model keeps few modes: a swap needs the donor's own ways to move only as far as they differ from
everybody's.

The renderer's faces at rest frown, and the whites of dark faces' eyes are brighter than real ones: next to real people
the brows of these lie lower (inner ends 0.145 of the inter-ocular distance above the eyes, real ones 0.19), and whites
shine by 70 grey levels above the skin (real ones by 10 to 20).  Both are put right in the neutral face.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import (
    LEFT_BROW,
    LEFT_EYE,
    LEFT_EYE_OUTER,
    RIGHT_BROW,
    RIGHT_EYE,
    RIGHT_EYE_OUTER,
)
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.model import Identity
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.training import TrainingOptions
from guise.app.enrolment.enrol import LandmarkSource, enrol
from guise.common.arrays import F32, F64, U8
from guise.common.version import version

ROOT = Path(__file__).parents[1]
GALLERY, PICTURE = ROOT / "app" / "gallery", ROOT / "docs" / "images" / "gallery.jpg"
SIDE = 160  # pixels of a portrait
OPTIONS = TrainingOptions(max_modes=10)
TAKES = ("talk.mp4", "talk2.mp4")
LIFT = (0.007, 0.016, 0.024, 0.028, 0.032)  # of the brow's points, from the outer end, inter-ocular distances
WHITE, KNEE = 0.0, 0.3  # grey levels above the skin from which eyes are darkened, and the slope there


def donor(folder: Path) -> Identity:
    """The model of a rendered person."""
    landmarks = LandmarkSource(landmarker=open_landmarker("builtin"))
    person = enrol([folder / take for take in TAKES], landmarks, name=folder.name, options=OPTIONS)
    look = person.appearance
    neutral = look.neutral.copy()
    neutral[:SHAPE_ENTRIES] = (at_ease(look.neutral_shape) * look.reference.shape_weight).ravel()
    neutral[SHAPE_ENTRIES:] = calm_eyes(look.neutral_texture, look.reference).ravel()
    facts = {**person.facts, "guise": version(), "licence": "CC0-1.0"}
    return replace(person, appearance=replace(look, neutral=neutral), facts=facts)


def at_ease(shape: F64) -> F64:
    """A shape (81, 2) with its brows lifted."""
    lift = np.zeros((POINTS, 2))
    lift[RIGHT_BROW, 1] = LIFT
    lift[LEFT_BROW, 1] = LIFT[::-1]
    return shape - lift * np.linalg.norm(shape[LEFT_EYE_OUTER] - shape[RIGHT_EYE_OUTER])


def calm_eyes(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (n, 3) whose whites of the eyes shine no more than real ones."""
    luma = texture @ LUMA
    eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.02)[reference.mask]
    most = float(luma[skin_mask(reference)[reference.mask]].mean()) + WHITE
    wanted = np.minimum(luma, most + KNEE * (luma - most))
    ratio = 1 + eyes * (wanted / np.maximum(luma, 1) - 1)
    return np.asarray(texture * ratio[:, None], np.float32)


def portrait(person: Identity) -> U8:
    """The still (SIDE, SIDE, 3), cut around the face."""
    picture, shape = person.rest_frame.picture, person.rest_frame.shape
    centre, reach = shape.mean(0), 0.75 * np.ptp(shape[:, 1])
    x0, y0 = np.maximum(np.floor(centre - reach).astype(int), 0)
    x1, y1 = np.ceil(centre + reach).astype(int)
    return np.asarray(cv2.resize(picture[y0:y1, x0:x1], (SIDE, SIDE), interpolation=cv2.INTER_AREA), np.uint8)


def main() -> None:
    """Write the gallery and its picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--people", type=Path, required=True, help="folder of the people's clips")
    GALLERY.mkdir(exist_ok=True)
    portraits = []
    for folder in sorted(parser.parse_args().people.glob("p0*")):
        person = donor(folder)
        portraits.append(portrait(person))
        print(
            person.name,
            f"{person.for_display().save(GALLERY / f'{person.name}.guise', compact=True) / 1e6:.2f} MB",
        )
    cv2.imwrite(str(PICTURE), np.hstack(portraits)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()
