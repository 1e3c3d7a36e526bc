"""Face-box detectors: hits on the sample clips, options, bad models."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import sampled

from guise.aam.landmarks import (
    BoxDetector,
    BoxFit,
    LandmarkError,
    LbpDetector,
    YunetDetector,
    iou,
    open_detector,
)
from guise.aam.landmarks.boxes import strongest

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_videos"
CLIPS = [f"{person}/{clip}" for person in ("p01", "p02", "p06") for clip in ("talk", "talk2")]
YUNET = ROOT.parent / "shared" / "models" / "yunet_2026may.onnx"

needs_yunet = pytest.mark.skipif(not YUNET.is_file(), reason="the YuNet model is not there")


def hits(detector: BoxDetector, image: np.ndarray, points: np.ndarray) -> bool:
    """Whether the largest box, made a landmark box, covers the face."""
    boxes = detector.detect(image)
    truth = np.concatenate([points.min(axis=0), points.max(axis=0)])
    return bool(len(boxes)) and iou(detector.fit.apply(boxes[0]), truth) > 0.6


@pytest.mark.parametrize("clip", CLIPS)
@pytest.mark.slow
def test_lbp_finds_the_faces_of_the_sample_clips(clip: str) -> None:
    detector = LbpDetector()
    assert np.mean([hits(detector, *frame) for frame in sampled(clip, 20)]) >= 0.95


@needs_yunet
@pytest.mark.parametrize("clip", CLIPS[::2])
@pytest.mark.slow
def test_yunet_finds_the_faces_of_the_sample_clips(clip: str) -> None:
    detector = YunetDetector(YUNET)
    assert np.mean([hits(detector, *frame) for frame in sampled(clip, 40)]) >= 0.95


def test_lbp_finds_a_face_of_40_pixels_when_asked() -> None:
    image, points = sampled("p02/talk", 100)[1]
    factor = 40 / float(np.ptp(points, axis=0).max())
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    canvas = np.full((900, 1600, 3), 96, np.uint8)
    canvas[500 : 500 + small.shape[0], 700 : 700 + small.shape[1]] = small
    placed = points * factor + (700, 500)
    assert hits(LbpDetector(smallest=36), canvas, placed)
    assert len(LbpDetector(smallest=200).detect(canvas)) == 0


@pytest.mark.parametrize("spec", ["lbp", pytest.param(f"yunet:{YUNET}", marks=needs_yunet)])
@pytest.mark.slow
def test_boxes_do_not_depend_on_the_size_of_the_picture(spec: str) -> None:
    detector = open_detector(spec)
    image, points = sampled("p01/talk", 100)[0]
    twice = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    half = (detector.detect(twice)[0] - 0.5) / 2
    assert iou(half, detector.detect(image)[0]) > 0.8
    assert hits(detector, twice, points * 2)


@pytest.mark.parametrize("spec", ["lbp", pytest.param(f"yunet:{YUNET}", marks=needs_yunet)])
@pytest.mark.slow
def test_two_faces_come_largest_first_with_scores(spec: str) -> None:
    detector = open_detector(spec)
    image, _ = sampled("p01/talk", 100)[0]
    other = cv2.resize(sampled("p06/talk", 100)[0][0], (384, 288))
    canvas = np.full((480, 1024, 3), 96, np.uint8)
    canvas[96 : 96 + 288, :384] = other
    canvas[:, 384:] = image
    boxes, scores = detector.detect_scored(canvas)
    assert boxes.shape == (2, 4)
    assert boxes.dtype == scores.dtype == np.float32
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    assert areas[0] > areas[1]
    assert boxes[0, 0] > 384 > boxes[1, 2]
    assert ((scores > 0) & (scores <= 1)).all()


@pytest.mark.parametrize("spec", ["lbp", pytest.param(f"yunet:{YUNET}", marks=needs_yunet)])
@pytest.mark.parametrize("shape", [(1, 1), (1, 1, 3), (3, 500, 3), (240, 320), (240, 320, 3)])
def test_no_face_no_box(spec: str, shape: tuple[int, ...]) -> None:
    boxes, scores = open_detector(spec).detect_scored(np.full(shape, 127, np.uint8))
    assert boxes.shape == (0, 4)
    assert scores.shape == (0,)


@pytest.mark.parametrize("spec", ["lbp", pytest.param(f"yunet:{YUNET}", marks=needs_yunet)])
def test_grey_pictures_work(spec: str) -> None:
    image, points = sampled("p02/talk", 100)[0]
    assert hits(open_detector(spec), cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), points)


def test_nested_boxes_are_merged() -> None:
    boxes = np.array([[0, 0, 100, 100], [30, 30, 70, 70], [200, 0, 260, 60], [10, 0, 110, 100]], float)
    kept, scores = strongest(boxes, np.array([0.9, 0.8, 0.5, 0.7]), 0.4)
    np.testing.assert_array_equal(kept, boxes[[0, 2]])
    np.testing.assert_allclose(scores, [0.9, 0.5])
    assert len(strongest(boxes, np.array([0.9, 0.8, 0.5, 0.7]), 0.6)[0]) == 1


def test_box_fit_moves_and_scales() -> None:
    np.testing.assert_allclose(BoxFit().apply(np.array([0, 0, 4, 8])), [-2, 0, 6, 8])
    np.testing.assert_allclose(BoxFit(0.5, (0.25, 0)).apply(np.array([0, 0, 8, 8])), [4, 2, 8, 6])


def test_bad_detectors(tmp_path: Path) -> None:
    with pytest.raises(LandmarkError, match="share of the height or pixels above 0, got -1"):
        LbpDetector(smallest=-1)
    with pytest.raises(LandmarkError, match=r"expected at .*none.onnx, got no such file"):
        YunetDetector(tmp_path / "none.onnx")
    (tmp_path / "bad.onnx").write_bytes(b"garbage")
    with pytest.raises(LandmarkError, match="face_detection_yunet, got another file"):
        YunetDetector(tmp_path / "bad.onnx")


@needs_yunet
def test_another_network_is_not_yunet() -> None:
    other = YUNET.with_name("mobilefacenet.onnx")
    if not other.is_file():
        pytest.skip("no other model is there")
    with pytest.raises(LandmarkError, match="face_detection_yunet, got another file"):
        YunetDetector(other)
