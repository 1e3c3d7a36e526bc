"""Faces that a side of the picture cuts at their middle or beyond, which no centre of a face tells."""

from __future__ import annotations

from functools import cache
from itertools import islice

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.landmarks.sides import detect_at_sides
from guise.app.deidentify.stages.audit import Audit
from guise.app.deidentify.stages.search import AuditSearch
from guise.app.media import Frame, open_input
from guise.app.people.faces import LIMITS, detect_faces

FRAMES = 12
HIDDEN_SHARES = (0.5, 0.6, 0.7)  # of a face's width, outside the picture


@cache
def cut(person: str, is_left: bool, hidden: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Frames of whose face a share lies outside, and the points (t, 68, 2), which reach beyond the picture."""
    with open_input(SAMPLES / person / "talk.mp4") as media:
        frames = [frame.rgb() for frame in islice(media, FRAMES)]
    points = np.load(SAMPLES / person / "talk.npz")["landmarks"][:FRAMES, IBUG68].astype(np.float64)
    low, high = points[0, :, 0].min(), points[0, :, 0].max()
    x = round(low + hidden * (high - low)) if is_left else round(high - hidden * (high - low))
    kept = slice(x // 2 * 2, None) if is_left else slice(0, x // 2 * 2)
    points[..., 0] -= kept.start or 0
    return [np.ascontiguousarray(rgb[:, kept]) for rgb in frames], points


def holds_what_is_seen(boxes: np.ndarray, points: np.ndarray, width: int) -> bool:
    """Whether the cover of a box holds all points (68, 2) that are in a picture of that width."""
    seen = points[(points[:, 0] >= 0) & (points[:, 0] < width)]
    return any(((seen >= r[:2]) & (seen <= r[2:])).all() for r in (region(box) for box in boxes))


@pytest.mark.parametrize("hidden", HIDDEN_SHARES)
@pytest.mark.parametrize("is_left", [True, False])
@pytest.mark.parametrize("person", ["p01", "p02"])
@pytest.mark.slow
def test_a_cut_face_is_found_beside_its_mirror_image(person: str, is_left: bool, hidden: float) -> None:
    frames, points = cut(person, is_left, hidden)
    found = detect_at_sides(FaceDetector(), frames[0])
    assert holds_what_is_seen(found.boxes, points[0], frames[0].shape[1])


def test_a_whole_face_is_not_cut() -> None:
    rgb = cut("p01", True, 0.0)[0][0]
    apart = cv2.copyMakeBorder(rgb, 0, 0, 60, 60, cv2.BORDER_REPLICATE)
    assert len(detect_at_sides(FaceDetector(), apart)) == 0


@pytest.mark.parametrize("shape", [(480, 640), (60, 4), (4, 60), (1, 1)])
def test_a_picture_of_nothing_has_none(shape: tuple[int, int]) -> None:
    assert len(detect_at_sides(FaceDetector(), np.full((*shape, 3), 90, np.uint8))) == 0


@pytest.mark.parametrize("is_left", [True, False])
@pytest.mark.slow
def test_a_cut_face_of_a_segment_is_held_in_every_frame(is_left: bool) -> None:
    frames, points = cut("p01", is_left, 0.7)
    found = detect_faces([Frame.from_rgb(rgb, index=i) for i, rgb in enumerate(frames)])
    all_frames = np.concatenate([found.frame, found.bystander_frame])
    boxes = np.concatenate([found.box, found.bystander_box])
    for index in range(0, FRAMES, LIMITS.side_interval_frames):
        assert holds_what_is_seen(boxes[all_frames == index], points[index], frames[0].shape[1])


@pytest.mark.parametrize("is_left", [True, False])
def test_the_audit_finds_a_cut_face_that_nothing_was_done_to(is_left: bool) -> None:
    frames, points = cut("p02", is_left, 0.7)
    audit = Audit(AuditSearch(None), (0, 1), {}, 30.0, every_frame=True)
    audit.before([Frame.from_rgb(frames[0])], {})
    found = np.array([one.box for one in audit.after([Frame.from_rgb(frames[0])], {}, {})])
    assert holds_what_is_seen(found, points[0], frames[0].shape[1])
