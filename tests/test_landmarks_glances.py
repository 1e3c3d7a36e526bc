"""Faces in plain sight behind bars, wires or letters, which the search finds without ever seeing them sharp."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import empty_scene
from made_up import SAMPLES

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.face import iou
from guise.aam.landmarks.glances import CYCLE, Glancer, is_face, likeness_through
from guise.aam.landmarks.rolls import RolledBoxes
from guise.aam.landmarks.schemes import IBUG68
from guise.app.deidentify.stages.audit import Audit
from guise.app.deidentify.stages.doubt import DoubtSearch
from guise.app.deidentify.stages.search import AuditSearch
from guise.app.media import Frame, open_input
from guise.app.people import faces
from guise.app.people.faces import detect_faces
from guise.app.swapping.policy import COVERED, NOBODY, FaceTreatment

FRAMES = 2 * CYCLE


def clip(pattern: str, person: str = "p01") -> tuple[list[np.ndarray], np.ndarray]:
    """Frames behind a pattern, and the boxes (t, 4) of the face."""
    points = np.load(SAMPLES / person / "talk.npz")["landmarks"][:FRAMES, IBUG68].astype(np.float32)
    with open_input(SAMPLES / person / "talk.mp4") as media:
        frames = [np.array(frame.rgb()) for frame in islice(media, FRAMES)]
    pitch = int(np.ptp(points[0, :, 0]) / 5)
    for rgb in frames:
        if pattern == "slats":
            for row in range(pitch // 3):
                rgb[row::pitch] = 200
        elif pattern == "wires":
            for at in range(-rgb.shape[0], rgb.shape[1] + rgb.shape[0], pitch):
                for end in (at + rgb.shape[0], at - rgb.shape[0]):
                    cv2.line(rgb, (at, 0), (end, rgb.shape[0]), (60, 60, 60), max(pitch // 6, 1))
    return frames, np.concatenate([points.min(1), points.max(1)], axis=1)


@pytest.mark.parametrize("pattern", ["slats", "wires"])
@pytest.mark.slow
def test_a_face_behind_a_pattern_is_held_in_every_frame_by_glances_alone(
    pattern: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(faces, "detect_on_schedule", lambda *given, **more: RolledBoxes.none())
    frames, boxes = clip(pattern)
    found = detect_faces([Frame.from_rgb(rgb, index=i) for i, rgb in enumerate(frames)])
    seen = np.concatenate([found.frame, found.bystander_frame])
    places = np.concatenate([found.box, found.bystander_box])
    sights = [index for index, box in zip(seen, places, strict=True) if iou(box, boxes[index]) > 0.4]
    assert np.diff([-1, *sorted(set(sights)), FRAMES]).max() <= CYCLE


def test_a_face_looks_like_one_through_slats_and_nothing_else_does() -> None:
    landmarker, (frames, boxes) = BuiltinLandmarker(), clip("slats")
    apart = np.array([0, 0, 40, 40], np.float32)
    assert likeness_through(landmarker, frames[0], boxes[0], 0.0) > 3
    assert not is_face(0.6, likeness_through(landmarker, frames[0], apart, 0.0))


def test_what_spans_a_face_that_is_certain_is_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Live, a head with its hair, seen small, was covered over the face that was drawn."""
    boxes = np.array([[20, 20, 60, 60], [0, 0, 100, 100], [70, 20, 110, 60]], np.float32)
    seen = RolledBoxes(boxes, np.full(3, 0.8, np.float32), np.zeros(3, np.float32))
    monkeypatch.setattr(Glancer, "faces", lambda self, image, number: seen)
    found = Glancer().likely(BuiltinLandmarker(), np.zeros((120, 120, 3), np.uint8), 0, seen[:1])
    assert found.boxes.tolist() == boxes[2:].tolist()


@pytest.mark.parametrize("shape", [(240, 320), (60, 4), (1, 1)])
def test_a_picture_of_nothing_has_no_face(shape: tuple[int, int]) -> None:
    glancer, plain = Glancer(), np.full((*shape, 3), 90, np.uint8)
    assert [len(glancer.faces(plain, number)) for number in range(CYCLE)] == [0] * CYCLE


@pytest.mark.parametrize("pattern", ["slats", "wires"])
def test_the_audit_finds_a_face_behind_a_pattern_or_says_that_nobody_can_tell(pattern: str) -> None:
    frame = Frame.from_rgb(clip(pattern)[0][0], index=0)
    audit = Audit(AuditSearch(None), (0, 1), {}, 30.0, every_frame=False)
    found = audit.before([frame], {})
    assert bool(found) != bool(audit.unclear)
    covers = {0: [FaceTreatment(NOBODY, COVERED, one.box, 1.0, one.turn) for one in found]}
    audit = Audit(AuditSearch(None), (0, 1), covers, 30.0, every_frame=False)
    assert not audit.before([frame], covers)


@pytest.mark.parametrize(("score", "glances", "found"), [(0.75, 2, 1), (0.75, 1, 0), (0.65, 3, 0)])
def test_what_two_glances_show_is_a_face_whatever_the_landmarker_says(
    score: float, glances: int, found: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a shot of a few frames there are no other sights of it."""
    box = RolledBoxes(
        np.array([[8, 8, 40, 40]], np.float32), np.array([score], np.float32), np.zeros(1, np.float32)
    )
    seen = dict.fromkeys(range(glances), box)
    monkeypatch.setattr(Glancer, "faces", lambda _, image, number: seen.get(number, RolledBoxes.none()))
    doubt = DoubtSearch(BuiltinLandmarker()).look(np.full((60, 80, 3), 90, np.uint8), [])
    assert len(doubt.faces) == found
    assert doubt.is_unclear == (score >= 0.7 and not found)


def test_there_is_no_doubt_about_an_empty_scene(tmp_path: Path) -> None:
    with open_input(empty_scene(tmp_path / "empty.mp4")) as media:
        frame = next(iter(media))
    audit = Audit(AuditSearch(None), (0, 1), {}, 30.0, every_frame=False)
    assert (audit.before([frame], {}), audit.unclear) == ([], [])
