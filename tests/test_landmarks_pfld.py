"""The PFLD network as an ONNX landmarker on the sample clips, where its file is there."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from guise.aam.landmarks import (
    Face,
    OnnxLandmarker,
    YunetDetector,
    interocular,
    load_annotations,
    mirror,
    open_landmarker,
)
from guise.aam.landmarks.schemes import INNER51

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_videos"
MODELS = ROOT.parent / "shared" / "models"

needs_pfld = pytest.mark.skipif(not (MODELS / "pfld.onnx").is_file(), reason="the PFLD model is not there")
needs_yunet = pytest.mark.skipif(
    not (MODELS / "yunet_2026may.onnx").is_file(), reason="the YuNet model is not there"
)

PFLD = """
name = "pfld"
model = "{model}"
scheme = "ibug68"
[input]
size = [112, 112]
[crop]
enlarge = 1.1
"""


def pfld_card(folder: Path) -> Path:
    (folder / "pfld.toml").write_text(PFLD.format(model=MODELS / "pfld.onnx"))
    return folder / "pfld.toml"


def frames_of(clip: str, indices: list[int]) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(SAMPLES / f"{clip}.mp4"))
    read = [capture.read()[1] for _ in range(max(indices) + 1)]
    capture.release()
    return [cv2.cvtColor(read[i], cv2.COLOR_BGR2RGB) for i in indices]


def inner_error(points: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(points - truth, axis=-1)[INNER51].mean() / interocular(truth) * 100)


@needs_pfld
@pytest.mark.parametrize("person", ["p01", "p02", "p06"])
@pytest.mark.parametrize("detector", ["lbp", pytest.param("yunet", marks=needs_yunet)])
@pytest.mark.slow
def test_pfld_on_the_sample_clips(tmp_path: Path, person: str, detector: str) -> None:
    indices = [0, 40, 80, 120]
    truth = load_annotations(SAMPLES / person / "talk.npz").points
    box = YunetDetector(MODELS / "yunet_2026may.onnx") if detector == "yunet" else None
    landmarker = OnnxLandmarker(pfld_card(tmp_path), box)
    for index, image in zip(indices, frames_of(f"{person}/talk", indices), strict=True):
        (face,) = landmarker.detect(image)
        assert inner_error(face.points, truth[index]) < 6.0
        assert face.confidence > 0.6
        again = landmarker.refine(image, face)
        assert again is not None
        assert np.abs(again.points - face.points).mean() < 0.02 * interocular(face.points)


@needs_pfld
def test_pfld_finds_the_mirrored_points_in_the_mirrored_picture(tmp_path: Path) -> None:
    (image,) = frames_of("p06/talk", [30])
    landmarker = open_landmarker(str(pfld_card(tmp_path)))
    (face,) = landmarker.detect(image)
    (flipped,) = landmarker.detect(np.ascontiguousarray(image[:, ::-1]))
    assert inner_error(mirror(flipped.points, image.shape[1]), face.points) < 4.0


@needs_pfld
def test_pfld_away_from_a_face_is_lost(tmp_path: Path) -> None:
    (image,) = frames_of("p01/talk", [0])
    landmarker = open_landmarker(str(pfld_card(tmp_path)))
    (face,) = landmarker.detect(image)
    elsewhere = Face.around(face.points * 0.5 + (20, 250), 1.0)
    found = landmarker.refine(image, elsewhere)
    assert found is None or found.confidence < 0.5
    flat = np.full_like(image, 90)
    assert landmarker.detect(flat) == []
    found = landmarker.refine(flat, face)
    assert found is None or found.confidence < 0.5
