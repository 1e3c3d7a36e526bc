"""The audit's detector: votes of cells for faces, at any roll, and the network that casts them."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from clips import sampled

from guise.aam.landmarks.schemes import IBUG68
from guise.aam.landmarks.voting import STRIDE, UNIT, Votes, VotingDetector, levels, whole_blocks
from guise.aam.onnx_model import DATA

CELLS = (30, 40)
HALF = np.array([8.0, 10.0])


def votes_for(centre: tuple[float, float], turn: float, sure: float = 3.0) -> np.ndarray:
    """What the network gives where all cells within 6 pixels of a face's middle vote for it."""
    rows, columns = np.mgrid[: CELLS[0], : CELLS[1]]
    off = np.stack([columns, rows]) * STRIDE + (STRIDE - 1) / 2 - np.reshape(centre, (2, 1, 1))
    size = np.broadcast_to(np.log(HALF / UNIT)[:, None, None], off.shape)
    up = np.broadcast_to(np.array([np.sin(turn), -np.cos(turn)])[:, None, None], off.shape)
    logit = np.where(np.hypot(*off) < 6, sure, -9.0)
    return np.concatenate([logit[None], -off / UNIT, size, up]).astype(np.float32)


@cache
def detector() -> VotingDetector:
    return VotingDetector()


@pytest.mark.parametrize("factor", [1.0, 3.0])
@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_votes_for_one_face_are_one_box(turn: float, factor: float) -> None:
    found = Votes.of([votes_for((70, 50), turn)], [factor]).boxes(0.5)
    middle = (np.array([70, 50]) + 0.5) * factor - 0.5
    np.testing.assert_allclose(
        found.boxes, [[*(middle - HALF * factor), *(middle + HALF * factor)]], rtol=1e-5
    )
    np.testing.assert_allclose(found.turns, [turn], rtol=1e-5)
    assert found.scores[0] > 0.9


def test_two_faces_have_two_boxes_and_one_vote_is_none() -> None:
    left, right = votes_for((40, 50), 0.0), votes_for((110, 50), 0.0, 2.0)
    assert len(Votes.of([np.where(left[0] > right[0], left, right)], [1.0]).boxes(0.5)) == 2
    lone = np.full((7, *CELLS), -9, np.float32)
    lone[:, 12, 17] = votes_for((70, 50), 0.0)[:, 12, 17]
    assert lone[0, 12, 17] > 0
    assert len(Votes.of([lone], [1.0]).boxes(0.5)) == 0
    assert len(Votes.of([lone - lone - 9], [1.0]).boxes(0.5)) == 0


def test_pictures_halve_until_they_are_small() -> None:
    made = levels(np.zeros((360, 640, 3), np.uint8), 24)
    shapes = [(180, 400), (90, 200), (45, 100), (22, 50), (11, 25)]
    assert [(one.image.shape[:2], one.factor, one.margin) for one in made] == [
        (shape, 2 << k, 40 / (1 << k)) for k, shape in enumerate(shapes)
    ]
    assert [whole_blocks(one.image).shape[:2] for one in made][-2:] == [(24, 56), (16, 32)]
    assert len(levels(np.zeros((3, 5, 3), np.uint8), 24)) == 1


def test_the_network_is_small() -> None:
    assert (DATA / "audit.onnx").stat().st_size < 1e6


@pytest.mark.parametrize("degrees", [0, 22.5, 70, 112.5, 150, 200, 230, 315])
def test_a_face_has_its_box_and_its_turn_at_any_roll(degrees: float) -> None:
    image, points = sampled("p02/talk", 60)[0]
    low, high = points[list(IBUG68)].min(0), points[list(IBUG68)].max(0)
    x, y = ((low + high) / 2).tolist()
    matrix = cv2.getRotationMatrix2D((x, y), -degrees, 1.0)
    turned = cv2.warpAffine(image, matrix, image.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    found = detector().search(turned, 30)
    best = int(np.argmax(found.scores))
    box, off = found.boxes[best], found.turns[best] - np.radians(degrees)
    side = float((high - low).max())
    assert np.hypot(*((box[:2] + box[2:]) / 2 - (x, y))) < 0.2 * side
    np.testing.assert_allclose((box[2:] - box[:2]).max(), side, rtol=0.3)
    assert abs(np.angle(np.exp(1j * off))) < np.radians(45)


@pytest.mark.parametrize("hidden", [0.0, 0.5, 0.6])
def test_a_face_that_a_side_cuts_is_found(hidden: float) -> None:
    image, points = sampled("p02/talk", 60)[0]
    low, high = points[list(IBUG68)].min(0), points[list(IBUG68)].max(0)
    cut = image[:, round(low[0] + hidden * (high[0] - low[0])) :]
    found = detector().search(np.ascontiguousarray(cut), 30)
    middle = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
    place = np.array([(0.5 - hidden) * (high[0] - low[0]), (low[1] + high[1]) / 2])
    near = np.hypot(*(middle - place).T) < 0.5 * (high - low).max()
    assert near[found.scores >= 0.7].any()


@pytest.mark.parametrize("shape", [(1, 1), (4, 60), (480, 640)])
def test_a_picture_of_nothing_has_no_face(shape: tuple[int, int]) -> None:
    assert len(detector().search(np.full((*shape, 3), 90, np.uint8), 30)) == 0
