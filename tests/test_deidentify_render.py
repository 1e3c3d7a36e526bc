"""What is done in a segment, covers of what the audit finds, and pictures of tracks."""

import numpy as np

from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.stages.audit import AuditDetection
from guise.app.deidentify.stages.jobs import PICTURE_PIXELS, picture
from guise.app.deidentify.stages.render import entries_of, with_detections
from guise.app.media import EncodeOptions, Frame
from guise.app.swapping.policy import COVERED, LIMITS, SWAPPED, FaceTreatment, frames_within

RATE = 30.0
AUDIT_FRAMES = frames_within(LIMITS.near_seconds, RATE)
BOX = np.array([10, 20, 50, 70], np.float32)


def plan(**columns: list[float]) -> dict[str, np.ndarray]:
    count = len(columns["frame"])
    return {
        "frame": np.array(columns["frame"]), "track": np.array(columns["track"]),
        "done": np.array(columns["done"]), "box": np.repeat(BOX[None], count, axis=0),
        "growth": np.ones(count, np.float32), "turn": np.zeros(count, np.float32), "confidence": np.ones(count),
        "reason": np.zeros(count, np.uint8), "cover": np.zeros(count, np.int32),
    }  # fmt: skip


def test_a_segment_gets_the_entries_of_its_frames_only() -> None:
    made = entries_of(
        plan(frame=[1, 5, 5, 9], track=[1, 1, 2, 1], done=[SWAPPED, COVERED, COVERED, SWAPPED]), 2, 9
    )
    assert sorted(made) == [5]
    assert [e.who for e in made[5]] == [1, 2]


def test_a_find_is_covered_in_the_frames_about_it_and_changes_nothing_else() -> None:
    entries = {3: [FaceTreatment(1, SWAPPED, BOX, 1.0)]}
    more = with_detections(entries, [AuditDetection(4, BOX + 100, 0.9)], 2, 6, RATE)
    assert sorted(more) == [2, 3, 4, 5]
    assert [e.done for e in more[3]] == [SWAPPED, COVERED]
    assert len(entries[3]) == 1
    assert len(with_detections({}, [AuditDetection(50, BOX, 0.9)], 0, 100, RATE)) == 2 * AUDIT_FRAMES + 1


def test_what_is_found_again_at_the_same_place_is_covered_in_all_frames() -> None:
    finds = [AuditDetection(10, BOX, 0.9), AuditDetection(60, BOX + 2, 0.9)]
    assert sorted(with_detections({}, finds, 0, 100, RATE)) == list(range(100))
    elsewhere = [finds[0], AuditDetection(60, BOX + 100, 0.9)]
    assert len(with_detections({}, elsewhere, 0, 100, RATE)) == 2 * (2 * AUDIT_FRAMES + 1)


def test_a_place_has_one_cover_in_a_frame_that_holds_what_was_found_there() -> None:
    """A find that was not hidden yet is found again, a little beside: the cover grows, and none is added."""
    finds = [AuditDetection(k, BOX + shift, 0.9) for k in range(40, 60) for shift in (0, 3)]
    finds += [AuditDetection(90, BOX + 2, 0.8), AuditDetection(50, BOX + 200, 0.8)]
    more = with_detections({}, finds, 0, 100, RATE)
    for frame, these in more.items():
        assert len(these) == 1 + (abs(frame - 50) <= AUDIT_FRAMES)
        assert np.abs(these[0].box - BOX).max() <= 3
    np.testing.assert_array_equal(more[45][0].box, np.concatenate([BOX[:2], BOX[2:] + 3]))


def test_a_place_found_another_way_up_has_a_cover_for_each() -> None:
    finds = [AuditDetection(4, BOX, 0.9), AuditDetection(4, BOX, 0.8, turn=np.pi)]
    assert [one.turn for one in with_detections({}, finds, 4, 5, RATE)[4]] == [0.0, np.pi]


def test_a_face_that_is_followed_is_covered_where_it_is_found_only() -> None:
    finds = [AuditDetection(10, BOX, 0.9), AuditDetection(60, BOX + 2, 0.9)]
    entries = {k: [FaceTreatment(1, SWAPPED, BOX, 1.0)] for k in range(100)}
    more = with_detections(entries, finds, 0, 100, RATE)
    covered = [k for k, these in more.items() if len(these) > 1]
    assert len(covered) == 2 * (2 * AUDIT_FRAMES + 1)


def test_the_picture_of_a_face_at_the_edge_is_whole() -> None:
    rgb = np.full((100, 120, 3), 200, np.uint8)
    made = picture(Frame.from_rgb(rgb), np.array([-30, -10, 20, 40], np.float32), 0.0)
    assert made.shape == (PICTURE_PIXELS, PICTURE_PIXELS, 3)
    assert made[0, 0].max() == 0
    assert made[-1, -1].min() == 200


def test_options_survive_the_manifest() -> None:
    from pathlib import Path

    options = DeidentifyOptions(
        donor="mean:2", gallery=(Path("a.guise"), Path("b.guise")), cover="blur", seed=3, keyfile=Path("k"),
        audio="drop", encode=EncodeOptions(crf=30), audit="full", detector="yunet:m.onnx", region="head",
    )  # fmt: skip
    assert DeidentifyOptions.from_json(options.as_json()) == options
