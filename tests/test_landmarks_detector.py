"""The built-in face detector: hits on the sample clips, sizes, several faces, pictures without a face."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import skimage.data
from clips import sampled
from skimage.util import img_as_ubyte

from guise.aam.landmarks import BoxDetector, LandmarkError, iou, open_detector
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector, _peaks
from guise.aam.onnx_model import DATA

SAMPLES = Path(__file__).parents[1] / "sample_videos"
CLIPS = sorted(f"{f.parent.name}/{f.stem}" for f in SAMPLES.glob("p*/*.npz"))
FACELESS = (
    "brick",
    "grass",
    "gravel",
    "coffee",
    "rocket",
    "moon",
    "page",
    "clock",
    "coins",
    "text",
    "colorwheel",
)


@pytest.fixture(scope="module")
def detector() -> FaceDetector:
    return FaceDetector()


def box_of(points: np.ndarray) -> np.ndarray:
    """Square about the tight box of points (68, 2), as `BoxFit()` makes it."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = (low + high) / 2, (high - low).max() / 2
    return np.concatenate([centre - half, centre + half])


def best(detector: FaceDetector, image: np.ndarray, points: np.ndarray) -> float:
    """Overlap of the face with the box nearest to it; 0 without a box."""
    boxes = [detector.fit.apply(box) for box in detector.detect(image)]
    return max((iou(box, box_of(points)) for box in boxes), default=0.0)


def scaled(image: np.ndarray, points: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """The picture scaled so that the face's box has that side, and the points in it."""
    factor = side / float(np.ptp(points, axis=0).max())
    flags = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    return cv2.resize(image, None, fx=factor, fy=factor, interpolation=flags), (points + 0.5) * factor - 0.5


def turned(image: np.ndarray, points: np.ndarray, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """The picture turned about the face."""
    centre = points.mean(axis=0)
    matrix = cv2.getRotationMatrix2D((float(centre[0]), float(centre[1])), degrees, 1.0)
    out = cv2.warpAffine(image, matrix, image.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    return out, points @ matrix[:, :2].T + matrix[:, 2]


def test_it_is_known_by_its_name() -> None:
    detector = open_detector("builtin")
    assert isinstance(detector, BoxDetector)
    assert detector.name == "builtin"
    with pytest.raises(LandmarkError, match="builtin takes no argument, got 'x'"):
        open_detector("builtin:x")


def test_the_model_is_small() -> None:
    assert (DATA / "detector.onnx").stat().st_size < 0.6e6


@pytest.mark.parametrize("clip", CLIPS)
@pytest.mark.slow
def test_the_faces_of_the_sample_clips_are_found_and_nothing_else(detector: FaceDetector, clip: str) -> None:
    frames = sampled(clip, 25)
    overlaps = [best(detector, *frame) for frame in frames]
    assert min(overlaps) > 0.5
    assert np.mean(overlaps) > 0.7
    assert [len(detector.detect(image)) for image, _ in frames] == [1] * len(frames)


@pytest.mark.parametrize("side", [24, 40, 80, 200, 500, 1000])
@pytest.mark.slow
def test_faces_of_all_sizes(detector: FaceDetector, side: float) -> None:
    image, points = scaled(*sampled("p02/talk", 100)[1], side)
    assert best(detector, image, points) > 0.6


@pytest.mark.parametrize("degrees", [-30, -15, 15, 30])
@pytest.mark.parametrize("clip", ["p01/talk", "p06/talk"])
@pytest.mark.slow
def test_turned_heads(detector: FaceDetector, clip: str, degrees: float) -> None:
    image, points = turned(*sampled(clip, 100)[0], degrees)
    assert best(detector, image, points) > 0.5


def test_a_face_cut_by_the_edge_has_its_whole_box(detector: FaceDetector) -> None:
    image, points = sampled("p01/talk", 100)[0]
    low, high = points.min(axis=0), points.max(axis=0)
    cut = int(0.75 * low[0] + 0.25 * high[0])
    assert best(detector, np.ascontiguousarray(image[:, cut:]), points - (cut, 0)) > 0.5


@pytest.mark.parametrize("share", [0.15, 0.3])
@pytest.mark.slow
def test_dark_pictures(detector: FaceDetector, share: float) -> None:
    image, points = sampled("p06/talk", 100)[0]
    assert best(detector, (image * share).astype(np.uint8), points) > 0.5


def test_grey_pictures_give_nearly_the_same_boxes(detector: FaceDetector) -> None:
    image, points = sampled("p02/talk", 100)[0]
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    assert best(detector, grey, points) > 0.6
    same = np.repeat(grey[..., None], 3, axis=2)
    np.testing.assert_array_equal(detector.detect(grey), detector.detect(same))


@pytest.mark.slow
def test_many_faces_come_largest_first_with_scores(detector: FaceDetector) -> None:
    canvas = np.full((720, 1280, 3), 96, np.uint8)
    truths, x = [], 20
    for index, side in enumerate((30, 60, 45, 120, 90, 150)):
        clip = CLIPS[index % len(CLIPS)]
        image, points = scaled(*sampled(clip, 200)[0], side)
        low, high = points.min(axis=0).astype(int), points.max(axis=0).astype(int) + 1
        low, high = np.maximum(low - side // 2, 0), high + side // 4
        part = image[low[1] : high[1], low[0] : high[0]]
        canvas[200 : 200 + part.shape[0], x : x + part.shape[1]] = part
        truths.append(box_of(points - low + (x, 200)))
        x += part.shape[1] + 30
    boxes, scores = detector.detect_scored(canvas)
    assert boxes.shape == (6, 4)
    assert boxes.dtype == scores.dtype == np.float32
    assert ((scores >= 0.5) & (scores <= 1)).all()
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    assert (np.diff(areas) <= 0).all()
    for truth in truths:
        assert max(iou(detector.fit.apply(box), truth) for box in boxes) > 0.5


@pytest.mark.parametrize("picture", FACELESS)
@pytest.mark.parametrize(
    "change", [np.asarray, np.flipud, np.transpose], ids=["as it is", "flipped", "turned"]
)
@pytest.mark.slow
def test_a_box_where_there_is_no_face_does_not_become_one(
    detector: FaceDetector, picture: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    image = img_as_ubyte(getattr(skimage.data, picture)())
    image = image[..., :3] if image.ndim == 3 else image
    if change is np.transpose:
        image = image.swapaxes(0, 1)
    elif change is np.flipud:
        image = image[::-1]
    rgb = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    faces = BuiltinLandmarker(detector).detect(np.ascontiguousarray(rgb))
    assert not [face for face in faces if face.confidence >= 0.5]


@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 1, 3), (3, 500, 3), (700, 2, 3), (31, 33, 3), (240, 320), (2160, 3840, 3)]
)
@pytest.mark.parametrize("level", [0, 127, 255])
def test_empty_pictures_of_any_size(detector: FaceDetector, shape: tuple[int, ...], level: int) -> None:
    boxes, scores = detector.detect_scored(np.full(shape, level, np.uint8))
    assert boxes.shape == (0, 4)
    assert scores.shape == (0,)
    assert boxes.dtype == scores.dtype == np.float32


def test_smallest_and_longest_bound_what_the_network_sees() -> None:
    image = np.zeros((720, 1280, 3), np.uint8)
    assert FaceDetector(smallest=24)._scaled(image).shape == (360, 640, 3)
    assert FaceDetector(smallest=0.1)._scaled(image).shape == (120, 213, 3)
    assert FaceDetector(smallest=1.5)._scaled(image).shape == image.shape
    assert FaceDetector(longest=320)._scaled(image).shape == (180, 320, 3)
    with pytest.raises(LandmarkError, match="share of the height or pixels above 0, got 0"):
        FaceDetector(smallest=0)


def test_peaks_decode_cells_into_pixels() -> None:
    maps = np.zeros((5, 4, 6), np.float32)
    maps[0] = -9
    maps[0, 1, 2], maps[0, 1, 3] = 2, 1  # a neighbour that is lower does not count
    maps[1:, 1, 2] = 1, 2, 3, 4
    boxes, scores = _peaks(maps, 8, 0.5)
    x, y = 2 * 8 + 3.5, 8 + 3.5
    np.testing.assert_allclose(boxes, [[x - 16, y - 32, x + 48, y + 64]])
    np.testing.assert_allclose(scores, [1 / (1 + np.exp(-2))])
