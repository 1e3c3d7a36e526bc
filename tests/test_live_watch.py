"""The detector that looks at every frame: boxes lie where the faces are, whatever the frame is made of."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks import overlap
from guise.app.live.watch import HEIGHT, Watch, small
from guise.app.media import Frame, open_source

HAND = Path(__file__).parents[2] / "shared/data/synthetic/hard/occlusion_hand.mp4"


@pytest.fixture
def watch() -> Iterator[Watch]:
    with Watch() as watch:
        yield watch


@pytest.fixture(scope="module")
def talk() -> Frame:
    with open_source(SAMPLES / "p01" / "talk.mp4") as source:
        return next(iter(source)).copy()


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """Box (4,) of the 68 points in that frame."""
    inner = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0, :68]
    return np.concatenate([inner.min(0), inner.max(0)]).astype(np.float32)


def test_planes_and_rgb_give_the_true_box_and_points(watch: Watch, talk: Frame, truth: np.ndarray) -> None:
    for frame in (talk, Frame.from_rgb(talk.rgb())):
        watch.look(frame)
        boxes, scores = watch.boxes
        assert len(boxes) == 1
        assert scores[0] > 0.9
        assert overlap(boxes[0], truth) > 0.8
        (face,) = watch.detect(np.zeros((1, 1, 3), np.uint8))
        inner = face.points[:68]
        assert overlap(np.concatenate([inner.min(0), inner.max(0)]), truth) > 0.9


@pytest.mark.parametrize(
    ("factor", "size"), [(1.5, (1280, 720)), (0.75, (480, 853)), (0.5, (320, 240)), (0.4, (700, 192))]
)
def test_boxes_are_those_of_the_picture_whatever_its_size(
    watch: Watch, talk: Frame, truth: np.ndarray, factor: float, size: tuple[int, int]
) -> None:
    picture = np.full((*size[::-1], 3), 120, np.uint8)
    scaled = cv2.resize(talk.rgb(), None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    picture[: scaled.shape[0], : scaled.shape[1]] = scaled
    frame = Frame.from_rgb(picture)
    watch.look(frame)
    assert overlap(watch.boxes[0][0], ((truth + 0.5) * factor - 0.5).astype(np.float32)) > 0.8
    assert small(frame).shape[0] == min(HEIGHT, size[1])


def test_what_is_drawn_after_it_began_to_look_does_not_matter(watch: Watch, talk: Frame) -> None:
    found = []
    for drawn in (False, True):
        frame = talk.copy()
        watch.look(frame)
        if drawn:
            frame.write_roi(0, 0, np.zeros((frame.height, frame.width, 3), np.uint8))
        found.append(watch.boxes[0])
    np.testing.assert_array_equal(*found)


def test_before_the_first_frame_there_is_nobody(watch: Watch) -> None:
    assert len(watch.boxes[0]) == 0
    assert watch.detect(np.zeros((1, 1, 3), np.uint8)) == []


@pytest.mark.skipif(not HAND.is_file(), reason=f"{HAND.name} is not there")
def test_fingertips_are_no_faces(watch: Watch) -> None:
    with open_source(HAND) as source:
        for frame in source:
            if frame.index in (30, 55, 90):
                watch.look(frame)
                assert len(watch.boxes[0]) == 1
