"""Enrols the donors that ship with Guise (app/gallery) from clips of rendered, fictional people.

    python -m training.make_gallery --people DIR

DIR holds a folder p01, p02 .. for each, with talk.mp4 and talk2.mp4 (CC0, made by the same program as sample_videos).
Landmarks come from the built-in landmarker, like those of the people in videos, so that both mean the same places of a
face.  A model keeps few modes: a swap needs the donor's own motion only as far as it differs from everybody's.

The renderer's faces frown at rest, and the whites of dark faces' eyes are brighter than real ones: compared with real
people the brows lie lower (inner ends 0.145 of the inter-ocular distance above the eyes, real ones 0.19), and the
whites are 70 grey levels brighter than the skin (real ones 10 to 20).  Both are corrected in the neutral face.
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
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.common.arrays import F32, F64, U8
from guise.common.version import version

ROOT = Path(__file__).parents[1]
GALLERY, PICTURE = ROOT / "app" / "gallery", ROOT / "docs" / "images" / "gallery.jpg"
PORTRAIT_PIXELS = 160  # side
OPTIONS = TrainingOptions(max_modes=10)
TAKES = ("talk.mp4", "talk2.mp4")
BROW_LIFT_INTEROCULAR = (0.007, 0.016, 0.024, 0.028, 0.032)  # of the brow's points, from the outer end
MAX_WHITE_GREY_LEVELS = 0.0  # above the skin, from which eyes are darkened ..
WHITE_SLOPE = 0.3  # .. and the slope from there


def donor(folder: Path) -> Identity:
    """The model of a rendered person."""
    landmarks = LandmarkSource(landmarker=open_landmarker("builtin"))
    person = enrol([folder / take for take in TAKES], landmarks, name=folder.name, options=OPTIONS)
    model = person.appearance
    neutral = model.neutral.copy()
    neutral[:SHAPE_ENTRIES] = (with_lifted_brows(model.neutral_shape) * model.reference.shape_weight).ravel()
    neutral[SHAPE_ENTRIES:] = with_darkened_eyes(model.neutral_texture, model.reference).ravel()
    facts = {**person.facts, "guise": version(), "licence": "CC0-1.0"}
    return replace(person, appearance=replace(model, neutral=neutral), facts=facts)


def with_lifted_brows(shape: F64) -> F64:
    """A shape (81, 2) whose brows are lifted to where they are at rest."""
    lift = np.zeros((POINTS, 2))
    lift[RIGHT_BROW, 1] = BROW_LIFT_INTEROCULAR
    lift[LEFT_BROW, 1] = BROW_LIFT_INTEROCULAR[::-1]
    return shape - lift * np.linalg.norm(shape[LEFT_EYE_OUTER] - shape[RIGHT_EYE_OUTER])


def with_darkened_eyes(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (n, 3) whose whites of the eyes are no brighter than real ones."""
    luma = texture @ LUMA
    eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.02)[reference.mask]
    most = float(luma[skin_mask(reference)[reference.mask]].mean()) + MAX_WHITE_GREY_LEVELS
    wanted = np.minimum(luma, most + WHITE_SLOPE * (luma - most))
    ratio = 1 + eyes * (wanted / np.maximum(luma, 1) - 1)
    return np.asarray(texture * ratio[:, None], np.float32)


def portrait(person: Identity) -> U8:
    """The rest frame (PORTRAIT_PIXELS, PORTRAIT_PIXELS, 3), cropped around the face."""
    picture, shape = person.rest_frame.picture, person.rest_frame.shape
    centre, reach = shape.mean(0), 0.75 * np.ptp(shape[:, 1])
    x0, y0 = np.maximum(np.floor(centre - reach).astype(int), 0)
    x1, y1 = np.ceil(centre + reach).astype(int)
    return np.asarray(
        cv2.resize(picture[y0:y1, x0:x1], (PORTRAIT_PIXELS, PORTRAIT_PIXELS), interpolation=cv2.INTER_AREA),
        np.uint8,
    )


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
