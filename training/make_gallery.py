"""Enrols the donors that ship with Guise (app/gallery) from clips of rendered, fictional people.

    python -m training.make_gallery --people DIR

DIR holds a folder p01, p02 .. for each, with talk.mp4, made by `python -m training.render_gallery`, and traced.png,
made by `python -m training.trace_gallery`: the clip shows how a face moves, the still what it looks like at rest.
Landmarks come from the built-in landmarker, like those of the people in videos, so that both mean the same places of a
face.  A model keeps few modes: a swap needs the donor's own motion only as far as it differs from everybody's.

The whites of dark faces' eyes are 70 grey levels brighter than the skin, those of real people 10 to 20: they are
darkened in the neutral face.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES, sample_texture
from guise.aam.detail import FineGrid, with_detail
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import (
    LEFT_EYE,
    RIGHT_EYE,
)
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.training import TrainingOptions
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.common.arrays import F32
from guise.common.version import VERSION

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "app" / "gallery"
OPTIONS = TrainingOptions(max_modes=7)
TAKE, TRACED = "talk.mp4", "traced.png"
MAX_WHITE_GREY_LEVELS = 0.0  # above the skin, from which eyes are darkened ..
WHITE_SLOPE = 0.3  # .. and the slope from there


def donor(folder: Path) -> Identity:
    """The model of a rendered person."""
    landmarks = LandmarkSource(landmarker=open_landmarker("builtin"))
    person = enrol([folder / TAKE], landmarks, name=folder.name, options=OPTIONS)
    person = with_traced_skin(person, folder / TRACED)
    facts = {**person.facts, "guise": VERSION, "licence": "CC0-1.0"}
    return replace(person, facts=facts)


def with_traced_skin(person: Identity, path: Path) -> Identity:
    """The same person with the neutral face of a path-traced still, in the clip's colours and without bright eyes."""
    picture, model = np.ascontiguousarray(cv2.imread(str(path))[..., ::-1]), person.appearance
    found = open_landmarker("builtin").detect(picture)
    if len(found) != 1:
        raise SystemExit(f"{path} should show one face, {len(found)} are found")
    shape, reference = found[0].points, model.reference
    texture = sample_texture(picture, shape, reference)
    texture, detail = with_detail(texture, [FineGrid(reference)(picture, shape)], model.mask, reference)
    skin = (skin_mask(reference) & model.mask)[reference.mask]
    gain = model.neutral_texture[skin].mean(0) / texture[skin].mean(
        0
    )  # to the colours that the modes belong to
    texture = np.clip(texture * gain, 0, 255).astype(np.float32)
    neutral = model.neutral.copy()
    neutral[SHAPE_ENTRIES:] = with_darkened_eyes(texture, reference).ravel()
    detail = np.asarray(detail * (gain @ LUMA), np.float32)
    return replace(person, appearance=replace(model, neutral=neutral), detail=detail)


def with_darkened_eyes(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (n, 3) whose whites of the eyes are no brighter than real ones."""
    luma = texture @ LUMA
    eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.02)[reference.mask]
    most = float(luma[skin_mask(reference)[reference.mask]].mean()) + MAX_WHITE_GREY_LEVELS
    wanted = np.minimum(luma, most + WHITE_SLOPE * (luma - most))
    ratio = 1 + eyes * (wanted / np.maximum(luma, 1) - 1)
    return np.asarray(texture * ratio[:, None], np.float32)


def main() -> None:
    """Write the gallery."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--people", type=Path, required=True, help="folder of the people's clips")
    parser.add_argument("--out", type=Path, default=GALLERY)
    options = parser.parse_args()
    options.out.mkdir(exist_ok=True)
    for folder in sorted(options.people.glob("p*")):
        person = donor(folder)
        print(
            person.name,
            f"{person.for_display().save(options.out / f'{person.name}.guise', compact=True) / 1e6:.2f} MB",
        )


if __name__ == "__main__":
    main()
