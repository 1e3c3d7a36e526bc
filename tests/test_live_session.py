"""A session from the first picture of a stranger to their swapped face, and what the command line makes of it."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from clips import cut, empty_scene, pictures
from made_up import SAMPLES
from models import SMALL
from numpy.typing import NDArray
from recordings import with_streams

from guise.aam.model import Identity
from guise.aam.training import TrainingOptions
from guise.app.cli.main import main
from guise.app.live import session
from guise.app.live.capture import FileCapture
from guise.app.live.controls import Controls
from guise.app.live.enrolment import OnScreenEnrolment
from guise.app.live.output import OutputFrame
from guise.app.live.session import LiveProcessor, SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.people import kept
from guise.app.swapping.donors import open_donor
from guise.common.threads import one_thread

pytestmark = pytest.mark.slow

CLIP = SAMPLES / "p01" / "talk.mp4"


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GUISE_PEOPLE", str(tmp_path / "people"))


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Enrolments take six seconds instead of sixteen, and train a small tracker."""

    def started(name: str, options: TrainingOptions) -> OnScreenEnrolment:
        return OnScreenEnrolment(name, 6.0, options=replace(SMALL, resolution=options.resolution))

    monkeypatch.setattr(session, "OnScreenEnrolment", started)


@pytest.fixture(scope="module")
def face() -> Identity:
    return open_donor("p03")


def run(
    config: SessionConfig, clip: Path, *, loop: bool = False
) -> Iterator[tuple[OutputFrame, NDArray[np.uint8]]]:
    """What is shown of each picture of a clip, with the picture before it was changed."""
    work = LiveProcessor(config, Controls(len(config.identities)))
    with one_thread(), FileCapture(clip, loop=loop, paced=False) as capture:
        try:
            for frame in capture:
                before = frame.rgb()
                yield work.process(frame, 0.0, PipelineStats()), before
        finally:
            work.close()


def changed(shown: OutputFrame, before: NDArray[np.uint8]) -> float:
    """Share of the pixels that differ."""
    return float((np.abs(shown.frame.rgb().astype(int) - before).max(2) > 8).mean())


def test_a_stranger_is_covered_and_then_swapped_while_they_are_still_enrolled(
    face: Identity, brief: None
) -> None:
    kept, met = [], []
    config = SessionConfig([face], None, keep=kept.append, meet=met.append)
    told: list[OutputFrame] = []
    for shown, before in run(config, CLIP, loop=True):
        if shown.ring is None:
            break
        told.append(shown)
        if shown.result.outcome != "swapped":
            assert changed(shown, before) > 0.05
        assert shown.original is not None
        time.sleep(0.05 * ("Training" in shown.message))  # the time is the training's
        assert len(told) < 20_000
    assert shown.result.outcome == "swapped"
    assert [len(kept), met[-1] is kept[0]] == [1, True]
    assert len(met) > 1
    outcomes = [one.result.outcome for one in told]
    begun = outcomes.index("swapped")
    assert set(outcomes[:begun]) == {"enrolling"}
    assert "enrolling" not in outcomes[begun:]
    rings = [one.ring for one in told]
    assert rings == sorted(rings)
    assert rings[begun] < 1 == rings[-1]
    assert told[0].missing == "6 s left · turn right · turn left"
    assert any("Speak" in one.message for one in told)
    assert any("Training" in one.message for one in told)


def test_ones_own_face_stays_covered_until_it_is_asked_for_again(face: Identity, p01: Identity) -> None:
    controls = Controls(2)
    work, outcomes = LiveProcessor(SessionConfig([p01, face], p01), controls), []
    with one_thread(), FileCapture(CLIP, loop=False, paced=False) as capture:
        for number, frame in enumerate(capture):
            shown = work.process(frame, 0.0, PipelineStats())
            outcomes.append((shown.result.outcome, "key 1" in shown.message))
            if number in (10, 20, 21):
                controls.press({10: "2", 20: "1", 21: "1"}[number])
            if number == 30:
                break
    work.close()
    assert outcomes[:11] == [("off", True)] * 11
    assert outcomes[11:20] == [("swapped", False)] * 9
    assert outcomes[21] == ("off", True)
    assert outcomes[22:] == [("swapped", False)] * 9


def test_a_session_that_ends_while_it_trains_leaves_nothing(
    face: Identity, brief: None, no_thread_left: None
) -> None:
    for shown, _ in run(SessionConfig([face], None), CLIP, loop=True):
        if "Training" in shown.message:
            break


def live(*arguments: object) -> int:
    return main(["live", *map(str, arguments)])


def test_a_file_into_a_file_keeps_every_frame_and_the_sound(
    tmp_path: Path, p01: Identity, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 90, clip="talk.mp4")
    person, out = tmp_path / "p01.guise", tmp_path / "out.mp4"
    p01.save(person)
    people = ("--source", person, "--identity", person)
    assert live("--input", clip, *people, "-o", out, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["files"] == [str(out)]
    assert report["frames"] == 90
    assert report["outcomes"]["swapped"] > 84
    with av.open(str(clip)) as before, av.open(str(out)) as after:
        assert [s.type for s in after.streams] == [s.type for s in before.streams]
        times = [[p.pts * p.time_base for p in c.decode(video=0)] for c in (before, after)]
        assert times[0] == times[1]


def test_a_file_is_written_whole_however_fast_it_would_play(
    tmp_path: Path, p01: Identity, capsys: pytest.CaptureFixture[str]
) -> None:
    """A clip that counts its frames, a thousand a second."""
    clip, out = empty_scene(tmp_path / "clip.mp4", 90, rate=1000), tmp_path / "out.mp4"
    p01.save(tmp_path / "p01.guise")
    assert live("--input", clip, "--source", tmp_path / "p01.guise", "-o", out, "--crf", 1, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["frames"], report["dropped"]) == (90, 0)
    levels = [float(picture.mean()) for picture in pictures(out)]
    assert levels == pytest.approx(levels[0] + np.arange(90), abs=1.5)


def test_the_model_of_a_file_is_made_once_and_its_notes_are_said(
    tmp_path: Path, p01: Identity, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = cut("p01", tmp_path / "clip.mp4", 30, clip="talk.mp4")
    clip = with_streams(
        tmp_path / "clip.mkv", plain, lambda out: (out.add_attachment("a.ttf", "font/ttf", b"font"), None)
    )
    points = clip.with_suffix(".npz")
    np.savez(points, landmarks=np.load(CLIP.with_suffix(".npz"))["landmarks"][:30])
    kept.keep(kept.video_key(clip, p01.reference.resolution, kept.video_key(points)), p01)
    person, out = tmp_path / "p01.guise", tmp_path / "out.mp4"
    p01.save(person)
    assert live("--input", clip, "--identity", person, "-o", out) == 0
    said = capsys.readouterr().err
    assert "enrolling" not in said
    assert "clip.mkv: Attachment stream" in said


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--input", "missing.mp4"], "does not exist"),
        (["--size", "huge"], "like 1280x720"),
        (["--input", CLIP, "--identity", "missing.guise"], "missing.guise"),
        (["--input", CLIP, "-o", "window", "-o", "window"], "each only once"),
        (["--output", "studio", "--output", "window"], "give it alone"),
        (["--camera", "97"], "camera 97 cannot be opened"),
    ],
)
def test_a_mistake_is_one_sentence(
    arguments: list[object], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert live(*arguments) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out.mp4").exists()
