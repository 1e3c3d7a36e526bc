"""Pictures that aren't plain portraits: cut off, mirrored, negative, grey, 16 bits; found where they are, or not."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import INNER51, MIRROR
from guise.app.cli.main import main
from guise.app.media import open_input
from guise.common.arrays import F64

MAX_ERROR, MAX_ERROR_CUT = 0.04, 0.06  # inter-ocular distances


@pytest.fixture(scope="module")
def portrait() -> tuple[np.ndarray, F64]:
    """A frame of a sample person, and the true landmarks."""
    with open_input(SAMPLES / "p02" / "talk2.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    return rgb, np.load(SAMPLES / "p02" / "talk2.npz")["landmarks"][0].astype(np.float64)


def faces_in(folder: Path, picture: np.ndarray) -> list[dict]:
    """What `guise landmarks` finds in a picture (h, w) or (h, w, 3), 8 or 16 bits."""
    assert cv2.imwrite(str(folder / "in.png"), picture[..., ::-1] if picture.ndim == 3 else picture)
    assert main(["landmarks", str(folder / "in.png"), "-o", str(folder / "out.json"), "-q"]) == 0
    return json.loads((folder / "out.json").read_text())["frames"][0]["faces"]


def error(faces: list[dict], truth: F64) -> float:
    """Mean distance of the one face's inner points from the true ones, inter-ocular distances."""
    (face,) = faces
    away = np.linalg.norm(np.array(face["points"]) - truth, axis=1)[INNER51]
    return float(away.mean() / interocular(truth))


@pytest.mark.parametrize("side", ["left", "right", "upper", "lower"])
def test_half_a_face_is_found_where_it_is(
    tmp_path: Path, portrait: tuple[np.ndarray, F64], side: str
) -> None:
    rgb, truth = portrait
    x, y = truth.mean(0).round().astype(int)
    rows, columns = {
        "left": np.s_[:, :x], "right": np.s_[:, x:], "upper": np.s_[:y, :], "lower": np.s_[y:, :]
    }[side]  # fmt: skip
    faces = faces_in(tmp_path, np.ascontiguousarray(rgb[rows, columns]))
    corner = columns.start or 0, rows.start or 0
    assert error(faces, truth - corner) < MAX_ERROR_CUT


def test_a_mirrored_face_has_mirrored_points(tmp_path: Path, portrait: tuple[np.ndarray, F64]) -> None:
    rgb, truth = portrait
    mirrored = (truth * (-1, 1) + (rgb.shape[1] - 1, 0))[list(MIRROR)]
    assert error(faces_in(tmp_path, rgb[:, ::-1]), mirrored) < MAX_ERROR


def test_a_negative_is_a_face_in_its_place_or_none(tmp_path: Path, portrait: tuple[np.ndarray, F64]) -> None:
    rgb, truth = portrait
    faces = faces_in(tmp_path, 255 - rgb)
    assert not faces or error(faces, truth) < MAX_ERROR_CUT


@pytest.mark.parametrize("deep", [False, True], ids=["8 bits", "16 bits"])
@pytest.mark.parametrize("grey", [False, True], ids=["colour", "grey"])
def test_grey_and_deep_pictures_show_the_same_face(
    tmp_path: Path, portrait: tuple[np.ndarray, F64], grey: bool, deep: bool
) -> None:
    rgb, truth = portrait
    picture = rgb.mean(2).astype(np.uint8) if grey else rgb
    faces = faces_in(tmp_path, picture.astype(np.uint16) * 257 if deep else picture)
    assert error(faces, truth) < MAX_ERROR
