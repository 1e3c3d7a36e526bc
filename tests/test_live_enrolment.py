"""Enrolment in front of the camera: what is said, when the ring moves, what is kept, and how good the model is."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from made_up import SAMPLES
from models import SMALL

from guise.aam.landmarks import Landmarker, open_landmarker
from guise.aam.landmarks.schemes import (
    LEFT_EYE_OUTER,
    LOWER_INNER_LIP,
    LOWER_LIDS,
    LOWER_LIP_INNER,
    NOSE_TIP,
    RIGHT_EYE_OUTER,
    UPPER_LIDS,
    UPPER_LIP_INNER,
    interocular,
)
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.reference import ReferenceFrame
from guise.aam.tracker import Fit
from guise.app.enrolment.enrol import EnrolError, enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.live import enrolment
from guise.app.live.enrolment import DONE, LIMITS, PROMPTS, TURN_PROMPTS, EnrolmentStatus, OnScreenEnrolment
from guise.app.live.keyframes import LIMITS as KEYFRAME_LIMITS
from guise.app.live.keyframes import FrameFeatures, KeyframeAlbum
from guise.app.media import Frame, open_input
from guise.common.errors import Interrupted

Picture = np.ndarray
FPS = 30


@cache
def clip(person: str, count: int) -> list[Picture]:
    """The first pictures of a person's clip."""
    with open_input(SAMPLES / person / "talk.mp4") as source:
        pictures = [frame.rgb() for frame in source if frame.index < count]
    for picture in pictures:
        picture.setflags(write=False)
    return pictures


@pytest.fixture(scope="module")
def landmarker() -> Landmarker:
    return open_landmarker("builtin")


@pytest.fixture
def enrolling(landmarker: Landmarker) -> OnScreenEnrolment:
    return OnScreenEnrolment("Anna", 4.0, landmarker, SMALL)


def feed(
    enrolling: OnScreenEnrolment, pictures: list[Picture], *, start: int = 0, every: int = 1
) -> list[EnrolmentStatus]:
    """Frames at 30 a second, from a number on; what is said to each."""
    statuses = range(start, start + every * len(pictures), every)
    return [
        enrolling.observe(Frame.from_rgb(picture, at, Fraction(1, FPS), at))
        for picture, at in zip(pictures, statuses, strict=True)
    ]


Enrolled = tuple[list[EnrolmentStatus], Identity, list[tuple[str, float]]]


@pytest.fixture(scope="module")
def enrolled(landmarker: Landmarker) -> Enrolled:
    enrolling = OnScreenEnrolment("Anna", 8.0, landmarker, SMALL)
    statuses = feed(enrolling, clip("p01", 300))
    progress: list[tuple[str, float]] = []
    return statuses, enrolling.train(lambda stage, share: progress.append((stage, share))), progress


@pytest.mark.slow
def test_the_ring_fills_in_the_time_asked_for_and_says_what_to_do(
    enrolled: Enrolled,
) -> None:
    statuses = enrolled[0]
    rings = np.array([status.ring for status in statuses])
    assert rings[0] == 0
    assert rings[120] == pytest.approx(0.5)
    assert (np.diff(rings) >= 0).all()
    assert [status.done for status in statuses] == [at >= 240 for at in range(300)]
    said = list(dict.fromkeys(status.sentence for status in statuses))
    assert [sentence for sentence in said if sentence not in TURN_PROMPTS] == [
        *(text for _, text in PROMPTS),
        DONE,
    ]


@pytest.mark.parametrize(
    ("yaws", "sentence"),
    [((), TURN_PROMPTS[0]), ((-15,), TURN_PROMPTS[1]), ((15,), TURN_PROMPTS[0]), ((15, -15), PROMPTS[-1][1])],
)
def test_a_turn_is_asked_for_only_while_that_view_is_missing(
    enrolling: OnScreenEnrolment, yaws: tuple[float, ...], sentence: str
) -> None:
    assert enrolling._prompt(0.5) == PROMPTS[1][1]
    for yaw in yaws:
        enrolling._note_turn(yaw)
    assert enrolling._prompt(0.8) == sentence


@pytest.mark.slow
def test_the_face_is_where_it_is(enrolled: Enrolled) -> None:
    truth = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"]
    for status, points in zip(enrolled[0], truth[: len(enrolled[0])], strict=True):
        assert status.face is not None
        assert np.linalg.norm(status.face.points - points, axis=1).mean() < 6


def error(person: Identity, talk2: tuple[list[Picture], Picture]) -> float:
    """Mean landmark error on the other clip, inter-ocular distances; no frame may be lost."""
    person_tracker, missed = PersonTracker(person.tracker, open_landmarker("builtin")), []
    for luma, truth in zip(*talk2, strict=True):
        fit = person_tracker.update(luma)
        assert isinstance(fit, Fit)
        missed.append(np.linalg.norm(fit.shape - truth, axis=1).mean() / interocular(truth))
    return float(np.mean(missed))


@pytest.mark.slow
def test_the_model_tracks_another_clip_as_one_enrolled_from_the_file_does(
    enrolled: Enrolled, talk2: tuple[list[Picture], Picture], tmp_path: Path
) -> None:
    statuses, person, _ = enrolled
    np.savez(tmp_path / "found.npz", landmarks=[status.face.points for status in statuses if status.face])
    source = LandmarkSource([tmp_path / "found.npz"])
    whole = enrol([SAMPLES / "p01" / "talk.mp4"], source, name="p01", options=SMALL)
    assert (person.name, person.reference.resolution) == ("Anna", SMALL.resolution)
    assert error(person, talk2) < 1.1 * error(whole, talk2)
    assert person.facts["held_out_error"] < 1.3 * whole.facts["held_out_error"]


@pytest.mark.slow
def test_progress_is_reported_to_the_end(enrolled: Enrolled) -> None:
    stages, shares = zip(*enrolled[2], strict=True)
    assert set(stages) == {"training"}
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert list(shares) == sorted(shares)


@pytest.mark.slow
def test_the_model_can_be_saved_and_its_neutral_mouth_is_shut(
    enrolled: Enrolled, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("model") / "anna.guise"
    enrolled[1].save(path)
    person = Identity.load(path)
    shape = person.rest_frame.shape
    assert person.rest_frame.picture.shape == (480, 640, 3)
    assert np.linalg.norm(shape[UPPER_LIP_INNER] - shape[LOWER_LIP_INNER]) < 0.06 * np.linalg.norm(
        shape[LEFT_EYE_OUTER] - shape[RIGHT_EYE_OUTER]
    )


@pytest.mark.slow
def test_time_is_that_of_the_frames(landmarker: Landmarker) -> None:
    slow = OnScreenEnrolment("Anna", 4.0, landmarker, SMALL)
    assert feed(slow, clip("p01", 60)[::2], every=2)[-1].ring == pytest.approx(58 / FPS / 4)


@pytest.mark.slow
def test_lost_frames_do_not_fill_the_ring(enrolling: OnScreenEnrolment) -> None:
    before = feed(enrolling, clip("p01", 10))[-1].ring
    after = feed(enrolling, clip("p01", 11)[-1:], start=10 + 10 * FPS)[-1].ring
    assert 0 < after - before <= LIMITS.max_frame_seconds / 4 + 1e-9


def test_frames_are_left_as_they_are(enrolling: OnScreenEnrolment) -> None:
    picture = clip("p01", 1)[0]
    frame = Frame.from_rgb(picture)
    enrolling.observe(frame)
    assert (frame.rgb() == picture).all()


def far(picture: Picture) -> Picture:
    out = np.full_like(picture, 120)
    out[:160, :213] = picture[1::3, 1::3]
    return out


def beside(picture: Picture) -> Picture:
    other = clip("p02", 1)[0]
    return np.hstack([picture[:, 120:520], other[:, 120:520]])


def half_hidden(picture: Picture) -> Picture:
    out = picture.copy()
    nose = int(np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0][NOSE_TIP, 0])
    out[:, nose : nose + 140] = (60, 70, 160)
    return out


LOOK_FRAMES = 10  # within which the detector looks for others
WRONG: list[tuple[str, Callable[[Picture], Picture]]] = [
    ("Come into view", lambda picture: np.full_like(picture, 90)),
    ("Come closer", far),
    ("Only one person, please", beside),
    ("More light, please", lambda picture: (picture * 0.2).astype(np.uint8)),
    ("Move to the middle", lambda picture: np.ascontiguousarray(picture[:, 270:])),
    ("Move back a little", lambda picture: np.ascontiguousarray(picture[140:370, 200:440])),
    ("Show your whole face", half_hidden),
]


@pytest.mark.parametrize(("sentence", "change"), WRONG, ids=[sentence for sentence, _ in WRONG])
@pytest.mark.slow
def test_what_is_wrong_is_said_and_the_ring_waits(
    enrolling: OnScreenEnrolment, sentence: str, change: Callable[[Picture], Picture]
) -> None:
    good = feed(enrolling, clip("p01", 20))[-1]
    wrong = feed(enrolling, [change(picture) for picture in clip("p01", 20)], start=20)
    assert good.sentence == PROMPTS[0][1]
    assert wrong[-1].sentence == sentence
    assert wrong[-1].ring == wrong[10].ring <= good.ring + LOOK_FRAMES / FPS / 4
    assert not wrong[-1].done


def test_a_small_face_in_the_background_does_not_matter(enrolling: OnScreenEnrolment) -> None:
    pictures = [picture.copy() for picture in clip("p01", 20)]
    for picture in pictures:
        picture[-120:, :160] = clip("p02", 1)[0][1::4, 1::4]
    assert len(enrolling._landmarker.detect(pictures[0])) == 2
    statuses = feed(enrolling, pictures)
    assert {status.sentence for status in statuses} == {PROMPTS[0][1]}
    assert statuses[-1].ring == pytest.approx(19 / FPS / 4)


def test_a_fast_head_is_a_complaint(enrolling: OnScreenEnrolment) -> None:
    still = clip("p01", 1)[0]
    statuses = feed(enrolling, [np.roll(still, 12 * at, axis=1) for at in range(12)])
    assert statuses[-1].sentence == "Move more slowly"
    assert statuses[-1].ring == statuses[2].ring


def test_a_head_turned_too_far_is_a_complaint() -> None:
    grid = ReferenceFrame.canonical(160)
    turned = {degrees: grid.points + degrees * grid.yaw_mode for degrees in (-45, -20, 0, 20, 45)}
    said = {degrees: enrolment._fault_of_pose(shape, None, 0.03) for degrees, shape in turned.items()}
    assert said == {-45: "Turn back a little", -20: "", 0: "", 20: "", 45: "Turn back a little"}


@pytest.mark.slow
def test_a_complaint_stays_to_be_read_and_goes(enrolling: OnScreenEnrolment) -> None:
    empty = np.full_like(clip("p01", 1)[0], 90)
    statuses = feed(enrolling, [empty, *clip("p01", 30)])
    complains = [status.sentence == "Come into view" for status in statuses]
    assert complains == [at < LIMITS.complaint_seconds * FPS for at in range(31)]


@pytest.mark.slow
def test_somebody_else_may_come_after_a_long_absence(enrolling: OnScreenEnrolment) -> None:
    feed(enrolling, clip("p01", 30))
    empty = [np.full_like(clip("p01", 1)[0], 90)]
    short = feed(enrolling, empty * int((LIMITS.max_absence_seconds - 0.5) * FPS), start=30)[-1].ring
    assert short == feed(enrolling, empty, start=30 + 4 * FPS)[-1].ring > 0
    assert feed(enrolling, empty * FPS, start=30 + 5 * FPS)[-1].ring == 0
    with pytest.raises(EnrolError):
        enrolling.train()


@pytest.mark.slow
def test_what_is_done_stays_done(landmarker: Landmarker) -> None:
    enrolling = OnScreenEnrolment("Anna", 0.5, landmarker, SMALL)
    assert feed(enrolling, clip("p01", 20))[-1].done
    kept = enrolling._album.frames()
    empty = [np.full_like(clip("p01", 1)[0], 90)] * int((LIMITS.max_absence_seconds + 1) * FPS)
    statuses = feed(enrolling, [*empty, *clip("p01", 3)], start=20)
    assert all(status.done and status.sentence == DONE for status in statuses)
    assert [frame is before for frame, before in zip(enrolling._album.frames(), kept, strict=True)] == [
        True
    ] * len(kept)


def test_too_few_frames(enrolling: OnScreenEnrolment) -> None:
    feed(enrolling, clip("p01", 6))
    with pytest.raises(EnrolError) as caught:
        enrolling.train()
    assert str(caught.value) == (
        "a model needs at least 12 good frames of the face, got 6; stay in front of the camera until the ring is full"
    )


@pytest.mark.slow
def test_training_is_cancelled_at_once(enrolling: OnScreenEnrolment) -> None:
    feed(enrolling, clip("p01", 60))
    shares: list[float] = []

    def stop_soon(stage: str, share: float) -> None:
        shares.append(share)
        if share > 0.3:
            enrolling.cancel()

    with pytest.raises(Interrupted, match="no model was made"):
        enrolling.train(stop_soon)
    assert 0.3 < shares[-1] < 0.9
    with pytest.raises(Interrupted):
        enrolling.train()


@pytest.fixture
def features() -> FrameFeatures:
    picture = clip("p01", 1)[0]
    truth = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float)
    found = FrameFeatures.of(np.ascontiguousarray(picture[..., 1]), truth)
    assert isinstance(found, FrameFeatures)
    return found


@pytest.mark.slow
def test_the_album_stays_small_and_keeps_what_differs(features: FrameFeatures) -> None:
    """Most frames alike, a few that differ, early and late: each of these is kept."""
    rng = np.random.default_rng(0)
    picture, album = clip("p01", 1)[0], KeyframeAlbum(ReferenceFrame.canonical(64))
    far = {at: features.descriptor + rng.normal(size=features.descriptor.shape) for at in (30, 200, 700, 999)}
    for at in range(1000):
        descriptor = far.get(at, features.descriptor + 0.001 * rng.normal(size=features.descriptor.shape))
        album.offer(
            picture, replace(features, descriptor=descriptor, expression=float(rng.random())), at / 1000
        )
    kept = {k.number for k in album._diverse.kept}
    assert {at + 1 for at in far} <= kept
    assert len(album.frames()) <= KEYFRAME_LIMITS.keyframes
    assert sum(frame.picture is not None for frame in album.frames()) == KEYFRAME_LIMITS.resting_frames


def test_the_album_prefers_what_is_sharp(features: FrameFeatures) -> None:
    picture, album = clip("p01", 1)[0], KeyframeAlbum(ReferenceFrame.canonical(64))
    for at in range(320):
        album.offer(picture, replace(features, sharpness=20.0 if at % 10 == 4 else 10.0), at / 320)
    assert [k.number % 10 for k in album._sharpest.values()] == [5] * KEYFRAME_LIMITS.intervals
    before = len(album.frames())
    album.offer(
        picture, replace(features, sharpness=2.0, descriptor=features.descriptor + 9, expression=-9.0), 0.5
    )
    assert len(album.frames()) == before
    assert max(abs(k.features.descriptor - features.descriptor).max() for k in album._diverse.kept) == 0


def test_the_album_keeps_the_frames_at_rest_whole(features: FrameFeatures) -> None:
    picture, album = clip("p01", 1)[0], KeyframeAlbum(ReferenceFrame.canonical(64))
    for at in range(60):
        album.offer(picture, replace(features, expression=float((at * 37) % 60)), at / 60)
    assert sorted(k.features.expression for k in album._resting) == list(
        range(KEYFRAME_LIMITS.resting_frames)
    )
    whole = [frame for frame in album.frames() if frame.picture is not None]
    assert len(whole) == KEYFRAME_LIMITS.resting_frames
    assert all((frame.picture == picture).all() for frame in whole)


def test_an_open_mouth_or_shut_lids_or_a_turned_head_is_not_at_rest() -> None:
    picture = np.ascontiguousarray(clip("p01", 1)[0][..., 1])
    base = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float)
    grid = ReferenceFrame.canonical(48)
    straight = base - grid.yaw(grid.align(base)) * grid.yaw_mode * np.ptp(base[:, 0]) / 48
    mouth, lids = straight.copy(), straight.copy()
    mouth[LOWER_INNER_LIP, 1] += 20
    lids[UPPER_LIDS] = lids[LOWER_LIDS]
    turned = straight + 25 * grid.yaw_mode * np.ptp(base[:, 0]) / 48
    rest, *others = (FrameFeatures.of(picture, shape) for shape in (straight, mouth, lids, turned))
    assert isinstance(rest, FrameFeatures)
    assert all(isinstance(other, FrameFeatures) and other.expression > rest.expression for other in others)
