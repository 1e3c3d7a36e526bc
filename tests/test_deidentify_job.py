"""A file from input to output: every face is another one or covered, and a run that was stopped ends the same."""

from __future__ import annotations

import gc
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import ClassVar

import av
import cv2
import numpy as np
import pytest
from clips import cut, empty_scene, pictures, tags
from made_up import SAMPLES

from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.schemes import INNER51
from guise.aam.model import Identity
from guise.aam.recognition import MIN_SAME_PERSON_SIMILARITY, cosine_similarity
from guise.aam.tracker_training import TrackerOptions
from guise.app.deidentify.options import DeidentifyError, DeidentifyOptions
from guise.app.deidentify.run import job as module
from guise.app.deidentify.run import redrawing
from guise.app.deidentify.run.job import deidentify_file
from guise.app.deidentify.stages import case, people
from guise.app.deidentify.stages.case import KEPT
from guise.app.deidentify.stages.case import Case as WorkCase
from guise.app.deidentify.stages.jobs import Job, perform
from guise.app.deidentify.stages.render import SegmentRenderer
from guise.app.deidentify.stages.work import MANIFEST, WorkFolder
from guise.app.deidentify.tracks import FileReport
from guise.app.media import EncodeOptions, Frame, MediaError, open_input, segments
from guise.app.media.pictures import save_picture
from guise.app.media.problems import ProblemLog
from guise.app.people.found import people_in_photo
from guise.app.swapping.donors import open_donor
from guise.common.arrays import U8

pytestmark = pytest.mark.slow

LOSSLESS = DeidentifyOptions(encode=EncodeOptions(lossless=True, preset="ultrafast"))
QUICK = DeidentifyOptions(encode=EncodeOptions(preset="ultrafast"))
QUICK_TRACKER = TrackerOptions(stages=2, copies=6, folds=2)
FRAMES = 24  # a person is enrolled from no fewer than 24


class Here:
    """Does jobs at once; may be told to die before the n-th.

    What a job before rendering makes depends on the input and the region alone, so it is made once for all tests, and
    given to each; a forgetful one does all jobs itself, and what it makes is given to others.
    """

    _made: ClassVar[dict[tuple[str, ...], dict[str, bytes]]] = {}

    def __init__(self, die_at: int | None = None, *, forgetful: bool = False) -> None:
        self.jobs: list[Job] = []
        self._die_at, self._forgetful = die_at, forgetful

    def run(self, jobs: Sequence[Job], done: Callable[[Job], None]) -> None:
        for job in jobs:
            if len(self.jobs) == self._die_at:
                raise KeyboardInterrupt
            if job.stage in ("trial", "render"):
                perform(job)
            else:
                self._perform_once(job)
            self.jobs.append(job)
            done(job)

    def _perform_once(self, job: Job) -> None:
        work = WorkFolder(Path(job.work))
        manifest = work.load_json(MANIFEST)
        key = manifest["fingerprint"], manifest["options"]["region"], job.stage, str(job.index)
        if self._forgetful or key not in self._made:
            before = {path: path.stat().st_mtime_ns for path in work.folder.iterdir()}
            perform(job)
            made = [path for path in work.folder.iterdir() if path.stat().st_mtime_ns != before.get(path)]
            self._made[key] = {path.name: path.read_bytes() for path in made}
            return
        for name, held in self._made[key].items():
            work.path(name).write_bytes(held)


def run(source: Path, output: Path, options: DeidentifyOptions = QUICK, **more: object) -> FileReport | None:
    engine = more.pop("engine", None) or Here()
    return deidentify_file(
        source, output, options, engine, progress=lambda stage, share: None, say=lambda text: None, **more
    )  # type: ignore[arg-type]


def first_of(source: Path) -> U8:
    """The first frame (h, w, 3)."""
    with open_input(source) as media:
        return next(iter(media)).rgb()


@pytest.fixture(scope="module", autouse=True)
def quick_training() -> Iterator[None]:
    """A person's tracker is trained on less."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(people, "TRAINING", replace(people.TRAINING, tracker=QUICK_TRACKER))
        yield


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut("p02", tmp_path_factory.mktemp("clip") / "talk.mp4", FRAMES)


def decoded(patch: pytest.MonkeyPatch) -> list[bool]:
    """Grows by one whenever a window of a file is decoded."""
    passes: list[bool] = []

    def window(*arguments: object) -> Iterator[Frame]:
        passes.append(True)
        return whole_window(*arguments)  # type: ignore[arg-type]

    whole_window = segments._window
    patch.setattr(segments, "_window", window)
    return passes


@pytest.fixture(scope="module")
def whole(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FileReport, int, object]:
    """The output and the report of a run, how often its input was decoded, and the frames that it still keeps."""
    output = tmp_path_factory.mktemp("done") / "out.mp4"
    with pytest.MonkeyPatch.context() as patch:
        passes = decoded(patch)
        report = run(clip, output, LOSSLESS, engine=Here(forgetful=True))
    assert report is not None
    return output, report, len(passes), KEPT.frames(clip, ProblemLog())


@pytest.fixture(scope="module")
def done(whole: tuple[Path, FileReport, int, object]) -> tuple[Path, FileReport]:
    return whole[:2]


def test_a_short_file_is_decoded_once_for_all_stages_and_then_let_go(
    clip: Path, whole: tuple[Path, FileReport, int, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output, _, passes, kept = whole
    assert passes == 1
    assert kept is None
    again = decoded(monkeypatch)
    monkeypatch.setattr(case, "KEPT_BYTES", 0)
    run(clip, tmp_path / "anew.mp4", LOSSLESS, engine=Here(forgetful=True))
    assert len(again) > 2
    assert (tmp_path / "anew.mp4").read_bytes() == output.read_bytes()


def test_the_face_is_swapped_in_every_frame_and_the_rest_stays(
    clip: Path, done: tuple[Path, FileReport]
) -> None:
    output, report = done
    assert report.counts == {"without face": 0, "swapped": FRAMES, "covered": 0, "left": 0}
    truth = np.load(SAMPLES / "p02" / "talk2.npz")["landmarks"]
    for i, (before, after) in enumerate(zip(pictures(clip), pictures(output), strict=True)):
        (x0, y0), (x1, y1) = truth[i, INNER51].min(0).astype(int), truth[i, INNER51].max(0).astype(int)
        change = np.abs(after.astype(int) - before.astype(int))
        assert change[y0:y1, x0:x1].mean() > 5
        far = np.ones(change.shape, bool)
        far[max(0, y0 - 100) : y1 + 60, max(0, x0 - 60) : x1 + 60] = False
        assert change[far].max() == 0


def test_sound_and_times_are_the_input_s(clip: Path, done: tuple[Path, FileReport]) -> None:
    sound, times = [], []
    for path in (clip, done[0]):
        with av.open(str(path)) as container:
            packets = [(p.stream.type, p.pts, bytes(p)) for p in container.demux() if p.size]
            sound.append([(pts, data) for kind, pts, data in packets if kind == "audio"])
        with av.open(str(path)) as container:
            times.append([float(f.time) for f in container.decode(video=0)])
    assert sound[0] == sound[1]
    assert times[0] == times[1]


def test_the_output_says_that_it_is_synthetic_and_nothing_of_the_input(done: tuple[Path, FileReport]) -> None:
    found = tags(done[0])
    assert "Guise" in found["comment"]
    assert found["digital_source_type"].endswith("compositeWithTrainedAlgorithmicMedia")


def test_reports_lie_beside_the_output_and_the_work_folder_is_gone(done: tuple[Path, FileReport]) -> None:
    output, report = done
    assert sorted(p.name for p in output.parent.iterdir()) == [
        "out.mp4",
        "out.report.html",
        "out.report.json",
    ]
    told = json.loads(output.with_name("out.report.json").read_text())
    assert told["counts"] == report.counts


def test_an_interrupted_run_goes_on_and_ends_with_the_same_bytes(clip: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.mp4"
    run(clip, whole)
    for die_at, forgetful in ((1, True), (3, False)):  # before anybody is enrolled, and after
        output = tmp_path / f"stopped{die_at}.mp4"
        with pytest.raises(KeyboardInterrupt):
            run(clip, output, engine=Here(die_at))
        assert not output.exists()
        rest = Here(forgetful=forgetful)
        run(clip, output, engine=rest, resume=True)
        assert len(rest.jobs) == 5 - die_at
        assert output.read_bytes() == whole.read_bytes()


def test_what_was_left_is_not_taken_for_another_run(clip: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.mp4"
    with pytest.raises(KeyboardInterrupt):
        run(clip, output, engine=Here(3))
    with pytest.raises(DeidentifyError, match="--resume"):
        run(clip, output)
    with pytest.raises(DeidentifyError, match="other options"):
        run(clip, output, replace(QUICK, cover="blur"), resume=True)
    assert run(clip, output, replace(QUICK, cover="blur"), force=True) is not None


def test_an_output_that_is_there_is_not_replaced(clip: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.mp4"
    output.write_bytes(b"mine")
    with pytest.raises(MediaError, match="--force"):
        run(clip, output)
    assert output.read_bytes() == b"mine"
    assert not output.with_name("out.mp4.work").exists()


def test_a_review_stops_before_the_output_and_its_edits_are_followed(clip: Path, tmp_path: Path) -> None:
    output, tracks = tmp_path / "out.mp4", tmp_path / "out.tracks.json"
    assert run(clip, output, review=True) is None
    assert not output.exists()
    assert (tmp_path / "out.tracks.jpg").stat().st_size > 5000
    edited = json.loads(tracks.read_text())
    assert [t["action"] for t in edited["tracks"]] == ["swap"]
    edited["tracks"][0]["action"] = "cover"
    tracks.write_text(json.dumps(edited))
    later = Here()
    report = run(clip, output, engine=later, resume=True)
    assert {job.stage for job in later.jobs} == {"render"}
    assert report is not None
    assert report.counts["covered"] == FRAMES
    detector = FaceDetector(min_score=0.5)
    grey = [detector.detect(np.repeat(p[..., None], 3, axis=2)) for p in pictures(output)[::10]]
    assert all(len(boxes) == 0 for boxes in grey)


def test_options_may_change_after_a_review(clip: Path, tmp_path: Path) -> None:
    output, whole = tmp_path / "out.mp4", tmp_path / "whole.mp4"
    blurred, later = replace(QUICK, cover="blur", audio="drop", donor="p03"), Here()
    run(clip, output, review=True)
    run(clip, output, blurred, resume=True, engine=later)
    assert {job.stage for job in later.jobs} == {"trial", "render"}
    run(clip, whole, blurred)
    assert output.read_bytes() == whole.read_bytes()


def test_a_head_is_replaced_and_a_run_that_reviewed_faces_ends_with_the_same_bytes(
    clip: Path, tmp_path: Path
) -> None:
    head = replace(QUICK, region="head")
    report = run(clip, tmp_path / "whole.mp4", head)
    assert report is not None
    assert report.counts["swapped"] > 0.75 * FRAMES
    run(clip, tmp_path / "other.mp4", review=True)
    with pytest.raises(KeyboardInterrupt):
        run(clip, tmp_path / "other.mp4", head, resume=True, engine=Here(die_at=1))
    run(clip, tmp_path / "other.mp4", head, resume=True)
    assert (tmp_path / "whole.mp4").read_bytes() == (tmp_path / "other.mp4").read_bytes()
    above = np.load(SAMPLES / "p02" / "talk2.npz")["landmarks"][20].min(0).astype(int)
    before, after = (list(pictures(path))[20].astype(int) for path in (clip, tmp_path / "whole.mp4"))
    hair = np.s_[above[1] - 30 : above[1] - 10, above[0] + 60 : above[0] + 120]
    assert np.abs(before[hair] - after[hair]).mean() > 10


def test_which_faces_are_swapped_is_found_again_for_another_region(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from guise.app.deidentify.stages import jobs

    run(clip, tmp_path / "out.mp4", review=True)
    monkeypatch.setattr(jobs, "knows_head", lambda parsing, shape: False)
    head = replace(QUICK, region="head")
    report = run(clip, tmp_path / "out.mp4", head, resume=True, engine=Here(forgetful=True))
    assert report is not None
    assert report.counts["swapped"] == 0
    assert report.counts["covered"] == FRAMES


def test_reports_call_the_files_as_they_are_told(clip: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.guise"
    shutil.copy(resources.files("guise.app").joinpath("gallery", "p03.guise"), mine)
    names = ("holiday.mov", "holiday_deidentified.mp4")
    report = run(clip, tmp_path / "out.mp4", replace(QUICK, donor=str(mine)), names=names)
    assert report is not None
    assert (report.input, report.output) == names
    text = (tmp_path / "out.report.json").read_text() + (tmp_path / "out.report.html").read_text()
    assert "mine.guise" in text
    assert all(name in text for name in names)
    assert str(tmp_path) not in text, "folders may tell who somebody is"


def test_a_face_left_by_the_user_is_untouched(clip: Path, tmp_path: Path) -> None:
    output, tracks = tmp_path / "out.mp4", tmp_path / "out.tracks.json"
    run(clip, output, LOSSLESS, review=True)
    tracks.write_text(tracks.read_text().replace('"action": "swap"', '"action": "leave"'))
    report = run(clip, output, LOSSLESS, resume=True)
    assert report is not None
    assert report.counts["left"] == FRAMES
    for before, after in zip(pictures(clip), pictures(output), strict=True):
        np.testing.assert_array_equal(before, after)


def test_a_face_that_the_first_look_missed_is_covered_after_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from guise.app.deidentify.stages import jobs as stages

    clip = cut("p02", tmp_path / "talk.mp4", 12)
    blind = lambda frames: stages_detect([])  # noqa: E731
    stages_detect = stages.detect_faces
    monkeypatch.setattr(stages, "detect_faces", blind)
    report = run(clip, tmp_path / "out.mp4", engine=Here(forgetful=True))
    assert report is not None
    assert len(report.tracks) == 0
    assert len({find.frame for find in report.audit if find.covered}) > 0
    assert not any(not find.covered for find in report.audit)
    detector = FaceDetector(min_score=0.5)
    for picture in pictures(tmp_path / "out.mp4")[::4]:
        assert len(detector.detect(np.repeat(picture[..., None], 3, axis=2))) == 0


def joined(path: Path, *pieces: tuple[str, int]) -> Path:
    """A clip of pieces, each the first frames of a sample person's, or of an empty room."""
    from fractions import Fraction

    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30, {"crf": "12", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuv420p"
        index = 0
        for person, count in pieces:
            rgbs = [np.full((480, 640, 3), 90, np.uint8)] * count
            if person:
                with open_input(SAMPLES / person / "talk2.mp4") as source:
                    rgbs = [frame.rgb() for frame, _ in zip(source, range(count), strict=False)]
            for rgb in rgbs:
                frame = av.VideoFrame.from_ndarray(rgb, "rgb24")
                frame.pts, frame.time_base = index, Fraction(1, 30)
                index += 1
                out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def models() -> int:
    """How many are in memory."""
    gc.collect()
    return sum(isinstance(one, Identity) for one in gc.get_objects())


def test_who_leaves_and_returns_keeps_the_donor_and_another_person_gets_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(self: SegmentRenderer, frame: Frame) -> None:
        plain(self, frame)
        engines.append(len(self._session.engines))

    engines: list[int] = []
    plain = SegmentRenderer.draw
    monkeypatch.setattr(SegmentRenderer, "draw", draw)
    open_donor.cache_clear()
    before = models()
    clip = joined(tmp_path / "in.mp4", ("p02", 24), ("", 40), ("p02", 24), ("p06", 12))
    report = run(clip, tmp_path / "out.mp4", replace(QUICK, keyfile=tmp_path / "people.key"))
    assert report is not None
    assert [(t.first, t.last) for t in report.tracks] == [(0, 23), (64, 87), (88, 99)]
    assert [t.person for t in report.tracks] == [1, 1, 3]
    first, again, other = (t.donor for t in report.tracks)
    assert first == again != other
    assert report.counts["without face"] > 20
    later = run(
        joined(tmp_path / "later.mp4", ("p06", 10)),
        tmp_path / "out2.mp4",
        replace(QUICK, keyfile=tmp_path / "people.key"),
    )
    assert later is not None
    assert later.tracks[0].donor == other
    assert set(engines) == {0, 1}  # those of tracks that have ended are gone
    assert models() - before <= 2  # donors: a long video shows many people


def test_without_faces_everything_stays(tmp_path: Path) -> None:
    source = empty_scene(tmp_path / "empty.mp4", 12)
    report = run(source, tmp_path / "out.mp4", LOSSLESS)
    assert report is not None
    assert report.counts == {"without face": 12, "swapped": 0, "covered": 0, "left": 0}


def test_a_picture_shows_another_face(clip: Path, tmp_path: Path) -> None:
    rgb = first_of(clip)
    save_picture(tmp_path / "one.png", rgb)
    report = run(tmp_path / "one.png", tmp_path / "out.png", replace(QUICK, donor="p03"))
    assert report is not None
    assert report.counts["swapped"] == 1
    assert not report.unclear
    pairs = (people_in_photo(Frame.from_rgb(one)).people for one in (rgb, first_of(tmp_path / "out.png")))
    (own,), (other,) = pairs
    assert cosine_similarity(own.signature, other.signature) < MIN_SAME_PERSON_SIMILARITY


@pytest.mark.parametrize(
    ("alike", "drawn", "shown"), [((0.5, 0.1), 3, 1), ((0.5, 0.9, 0.8, 0.7), 6, 1), ((0.9,), 6, 0)]
)
def test_who_is_still_recognised_gets_another_face_or_the_best_or_a_cover(
    alike: tuple[float, ...], drawn: int, shown: int, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    save_picture(tmp_path / "one.png", first_of(clip))
    donors: list[str] = []

    def likeness(sums: object) -> dict[int, float]:
        donors.append(WorkCase(WorkFolder(tmp_path / "out.png.work")).tracks[0].donor)
        first = donors.index(donors[-1])
        return {1: alike[min(first, len(alike) - 1)] if donors[-1] else 0.0}

    monkeypatch.setattr(redrawing, "likeness", likeness)
    report = run(tmp_path / "one.png", tmp_path / "out.png")
    assert report is not None
    assert (len(donors), report.counts["swapped"]) == (drawn, shown)
    assert report.tracks[0].donor == ("" if not shown else donors[alike.index(min(alike))])
    assert [one.reason for one in report.covers] == (["still recognised"] if not shown else [])


def test_a_small_face_in_a_picture_is_covered(clip: Path, tmp_path: Path) -> None:
    rgb = first_of(clip)
    factor = 30 / people_in_photo(Frame.from_rgb(rgb)).people[0].width
    small = cv2.resize(rgb, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    save_picture(tmp_path / "one.png", cv2.copyMakeBorder(small, 0, 200, 0, 200, cv2.BORDER_REPLICATE))
    report = run(tmp_path / "one.png", tmp_path / "out.png")
    assert report is not None
    assert report.counts["covered"] == 1
    assert len(FaceDetector(min_score=0.5).detect(first_of(tmp_path / "out.png"))) == 0


def test_a_video_gives_an_animation_where_that_is_asked_for(clip: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.gif"
    report = run(clip, output)
    assert isinstance(report, FileReport)
    assert report.problems == ("A .gif file holds no sound: the audio was left out.",)
    made, before = pictures(output), pictures(clip)
    assert len(made) == len(before) == FRAMES
    changed = [np.abs(a.astype(int) - b) for a, b in zip(made, before, strict=True)]
    assert all(one.max() > 40 > 6 * np.median(one) for one in changed)


def test_a_folder_of_pictures_gives_a_folder_of_pictures(clip: Path, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    with open_input(clip) as source:
        for frame, name in zip(source, "abc", strict=False):
            save_picture(folder / f"{name}.png", frame.rgb())
    assert run(folder, tmp_path / "out") is not None
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["a.png", "b.png", "c.png"]


def test_a_run_that_was_killed_after_the_output_was_named_still_writes_its_report(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "out.mp4"

    def killed(*args: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "write_reports", killed)
        with pytest.raises(KeyboardInterrupt):
            run(clip, output)
    made = output.read_bytes()
    run(clip, output, resume=True)
    assert output.read_bytes() == made
    assert output.with_name("out.report.json").exists()
    assert not output.with_name("out.mp4.work").exists()


def test_an_input_that_vanishes_can_come_back(clip: Path, tmp_path: Path) -> None:
    source, output = tmp_path / "in.mp4", tmp_path / "out.mp4"
    shutil.copy(clip, source)
    with pytest.raises(KeyboardInterrupt):
        run(source, output, engine=Here(1))
    source.unlink()
    with pytest.raises(MediaError, match="does not exist"):
        run(source, output, resume=True)
    shutil.copy(clip, source)
    assert run(source, output, resume=True) is not None
