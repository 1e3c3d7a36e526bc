"""Things that are taken for faces are left only where everything says so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
import skimage.data
from made_up import SAMPLES

from guise.aam.landmarks.schemes import IBUG68
from guise.app.deidentify.stages.audit import AuditDetection
from guise.app.deidentify.stages.render import JudgedPlaces, with_detections
from guise.app.deidentify.stages.things import Sights, Thing, find_doubtful, find_things, save_things
from guise.app.media import Frame, open_input
from guise.app.swapping.policy import LIMITS, frames_within

RATE, COUNT = 25.0, 75
BOX = np.array([60, 50, 120, 110], np.float32)
SIGHTS = Sights(
    np.arange(0, COUNT, 5, dtype=np.int32), np.tile(BOX, (15, 1)), np.zeros(15, np.float32),
    np.full(15, 0.55, np.float32),
)  # fmt: skip


def a_cup() -> np.ndarray:
    """A part of a real picture of a cup of coffee."""
    return np.ascontiguousarray(skimage.data.coffee()[:180, :320])


def a_person() -> np.ndarray:
    """A real picture whose face fills BOX."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as media:
        rgb = next(iter(media)).rgb()
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0][IBUG68]
    scale = float((BOX[2] - BOX[0]) / np.ptp(points[:, 0]))
    shift = (BOX[:2] + BOX[2:]) / 2 - scale * (points.min(0) + points.max(0)) / 2
    return np.asarray(cv2.warpAffine(rgb, np.column_stack([scale * np.eye(2), shift]), (320, 180)), np.uint8)


class Clip:
    """As a case: the same picture, with a ball that moves."""

    rate = RATE

    def __init__(self, rgb: np.ndarray, *, moves: bool = True, changes: bool = False) -> None:
        self.rgb, self.moves, self.changes = rgb, moves, changes

    def frames(self, first: int, last: int) -> Iterator[Frame]:
        for index in range(first, last):
            rgb = self.rgb.copy()
            if self.moves:
                cv2.circle(rgb, (200 + index, 140), 20, (250, 250, 250), -1)
            if self.changes:
                cv2.circle(rgb, (90, 96), 4 + index % 10, (10, 10, 10), -1)
            yield Frame.from_rgb(rgb, index=index)


def found(clip: Clip, sights: Sights = SIGHTS) -> list[Thing]:
    case: Any = clip
    return find_things(case, [sights])


def test_what_rests_and_has_nothing_of_a_face_is_a_thing() -> None:
    (thing,) = found(Clip(a_cup()))
    assert thing.is_at(BOX + 3)
    assert not thing.is_at(BOX + 50)
    assert set(save_things([thing])[0]) == {"number", "box", "patch"}


@pytest.mark.parametrize(
    ("clip", "sights"),
    [
        (Clip(a_cup(), moves=False), SIGHTS),
        (Clip(a_cup(), changes=True), SIGHTS),
        (Clip(a_cup()), replace(SIGHTS, scores=SIGHTS.scores + 0.3)),
        (Clip(a_cup()), replace(SIGHTS, frames=SIGHTS.frames // 5)),
        (Clip(a_cup()), replace(SIGHTS, boxes=SIGHTS.boxes + SIGHTS.frames[:, None])),
        (Clip(np.full((180, 320, 3), 90, np.uint8)), SIGHTS),
        (Clip(a_person()), SIGHTS),
    ],
    ids=[
        "nothing moves", "it changes", "a high score", "a moment", "it moves", "too dull", "a still of a face",
    ],
)  # fmt: skip
def test_in_doubt_it_is_none(clip: Clip, sights: Sights) -> None:
    assert found(clip, sights) == []


def test_somebody_before_a_thing_is_seen() -> None:
    (thing,) = found(Clip(a_cup()))
    rgb = a_cup()
    assert thing.is_bare(Frame.from_rgb(rgb).luma)
    cv2.ellipse(rgb, (70, 80), (20, 30), 0, 0, 360, (200, 160, 140), -1)
    assert not thing.is_bare(Frame.from_rgb(rgb).luma)


def test_doubtful_finds_are_covered_from_one_to_the_next_only() -> None:
    case: Any = Clip(a_cup())
    person: Any = Clip(a_person())
    assert [box.tolist() for box in find_doubtful(case, [SIGHTS])] == [BOX.tolist()]
    assert find_doubtful(person, [SIGHTS]) == []
    near, far = frames_within(LIMITS.near_seconds, RATE), 200
    finds = [AuditDetection(frame, BOX, 0.55) for frame in (50, 70, far)]
    more = with_detections({}, finds, 0, 300, RATE, JudgedPlaces(doubtful=[BOX]))
    assert sorted(more) == [*range(50 - near, 70 + near + 1), *range(far - near, far + near + 1)]
    assert len(with_detections({}, finds, 0, 300, RATE)) == 300
