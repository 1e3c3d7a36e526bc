"""What a user says of covers and draws: refused things stay, missed faces are covered and followed, or swapped."""

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from clips import cut
from made_up import SAMPLES

from guise.aam.landmarks.schemes import IBUG68
from guise.app.deidentify.covers import COLUMNS, rows_of
from guise.app.deidentify.options import DeidentifyError, DeidentifyOptions
from guise.app.deidentify.report.report import verdict
from guise.app.deidentify.run import places
from guise.app.deidentify.run.job import deidentify_file
from guise.app.deidentify.run.places import as_chosen
from guise.app.deidentify.stages import jobs
from guise.app.deidentify.stages.follow import follow
from guise.app.deidentify.stages.jobs import Job, perform
from guise.app.deidentify.stages.work import WorkFolder
from guise.app.deidentify.tracks import FileReport, MarkedPlace
from guise.app.media import EncodeOptions, Frame, open_input
from guise.app.people.faces import SegmentFaces, detect_faces
from guise.app.swapping.policy import COVERED
from guise.common.progress import mute, silent

pytestmark = pytest.mark.slow

FRAMES = 30
LOSSLESS = DeidentifyOptions(encode=EncodeOptions(lossless=True, preset="ultrafast"))


class Here:
    """Does jobs in this process."""

    def run(self, jobs: Sequence[Job], done: Callable[[Job], None]) -> None:
        for job in jobs:
            perform(job)
            done(job)


def missed(frames: Any) -> SegmentFaces:
    """What is found, as if the detector had been unsure of the only face throughout."""
    found = detect_faces(frames)
    rows = np.arange(0, FRAMES, 3)
    return replace(
        found, bystander_frame=found.frame[rows], bystander_box=found.box[rows], bystander_turn=found.turn[rows],
        bystander_score=found.confidence[rows], tracklet=found.tracklet[:0], frame=found.frame[:0],
        confidence=found.confidence[:0], box=found.box[:0], turn=found.turn[:0], points=found.points[:0],
    )  # fmt: skip


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut("p01", tmp_path_factory.mktemp("clip") / "party.mp4", FRAMES, clip="talk.mp4")


@pytest.fixture(scope="module")
def reviewed(clip: Path) -> Path:
    """The tracks of a review in which the face is a bystander; its work folder lies beside it."""
    output = clip.with_name("out.mp4")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "detect_faces", missed)
        run(clip, output, review=True)
    return output.with_name("out.tracks.json")


def run(clip: Path, output: Path, **more: Any) -> FileReport | None:
    return deidentify_file(clip, output, LOSSLESS, Here(), progress=silent, say=mute, **more)


def chosen(reviewed: Path, folder: Path, edit: Callable[[dict[str, Any]], object]) -> FileReport:
    """What comes of an edited review, in a folder of its own."""
    for path in reviewed.parent.iterdir():
        (shutil.copytree if path.is_dir() else shutil.copy)(path, folder / path.name)
    value = json.loads(reviewed.read_text(encoding="utf-8"))
    edit(value)
    (folder / reviewed.name).write_text(json.dumps(value), encoding="utf-8")
    report = run(reviewed.with_name("party.mp4"), folder / "out.mp4", resume=True)
    assert report is not None
    return report


def changed(clip: Path, output: Path, box: Sequence[float]) -> list[bool]:
    """By frame, whether most of a box has changed."""
    x0, y0, x1, y1 = map(round, box)
    with open_input(clip) as before, open_input(output) as after:
        pairs = [(a.rgb(), b.rgb()) for a, b in zip(before, after, strict=True)]
    found = [np.abs(a[y0:y1, x0:x1].astype(int) - b[y0:y1, x0:x1]).max(-1) > 4 for a, b in pairs]
    return [bool(one.mean() > 0.5) for one in found]


def face() -> list[float]:
    """The box of the face in the first frame."""
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0][list(IBUG68)]
    return [*points.min(0).tolist(), *points.max(0).tolist()]


def test_what_is_no_face_stays_also_when_it_begins_anew_and_the_report_says_so(
    reviewed: Path, clip: Path, tmp_path: Path
) -> None:
    """The face stands for a thing that every search takes for one."""
    (cover,) = json.loads(reviewed.read_text(encoding="utf-8"))["covers"]
    assert cover.items() >= {"reason": "bystander", "action": "cover", "first": 0, "last": FRAMES - 1}.items()
    report = chosen(reviewed, tmp_path, lambda value: value["covers"][0].update(action="leave"))
    assert (report.counts["left"], report.audit, report.covers) == (FRAMES, (), ())
    assert f"left as it is in {FRAMES} frames, as you said" in verdict(report)
    assert changed(clip, tmp_path / "out.mp4", face()) == [False] * FRAMES
    (again := tmp_path / "again").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "detect_faces", missed)
        run(clip, again / "out.mp4", tracks=tmp_path / "out.tracks.json")
    assert changed(clip, again / "out.mp4", face()) == [False] * FRAMES


def test_a_face_that_nothing_tracked_is_swapped(reviewed: Path, clip: Path, tmp_path: Path) -> None:
    report = chosen(reviewed, tmp_path, lambda value: value["covers"][0].update(action="swap"))
    (track,) = report.tracks
    assert (track.action, track.first, track.last) == ("swap", 0, FRAMES - 1)
    assert report.counts["swapped"] > FRAMES - 8
    assert report.counts["left"] == 0
    assert all(changed(clip, tmp_path / "out.mp4", face()))


def test_where_a_face_to_swap_is_lost_it_stays_covered() -> None:
    """As far as it has become a track nothing else is done, and no farther."""
    box, frames = (10.0, 10.0, 50.0, 50.0), np.arange(10)
    others = {name: np.zeros(10, kind) for name, kind in COLUMNS.items() if name != "box"}
    others |= {
        "frame": frames,
        "box": np.tile(box, (10, 1)),
        "done": np.full(10, COVERED),
        "cover": np.ones(10, int),
    }
    for place in (MarkedPlace(0, 9, 0, box, "swap", 1), MarkedPlace(0, 9, 0, box, "swap")):
        case: Any = SimpleNamespace(places=[place], rate=30.0, cuts=[], work=WorkFolder(Path("none")))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(places, "_followed", lambda case, place: {0: np.array(box)})
            rows = rows_of(as_chosen(case, others, {0: dict.fromkeys(range(4), np.array(box, np.float32))}))
        assert set(rows["frame"][rows["done"] == COVERED].tolist()) == set(range(4, 10))


def test_somebody_who_comes_by_a_refused_thing_stays_covered() -> None:
    """A detection that moves on from it has its number."""
    box, frames = np.array([10.0, 10.0, 50.0, 50.0]), np.arange(10)
    others = {name: np.zeros(10, kind) for name, kind in COLUMNS.items() if name != "box"}
    moving = box + 8.0 * np.arange(10)[:, None] * (1, 0, 1, 0)
    others |= {"frame": frames, "box": moving, "done": np.full(10, COVERED), "cover": np.ones(10, int)}
    case: Any = SimpleNamespace(places=[MarkedPlace(0, 9, 0, (10.0, 10.0, 50.0, 50.0), "leave", 1)])
    rows = rows_of(as_chosen(case, others, {}))
    assert rows["frame"][rows["done"] == COVERED].tolist() == [4, 5, 6, 7, 8, 9]


def test_a_box_covers_its_frames_and_what_moves_on_from_it(
    reviewed: Path, clip: Path, tmp_path: Path
) -> None:
    edge, drawn = [20.0, 20.0, 90.0, 110.0], {"first": 4, "last": 20, "at": 10}

    def edit(value: dict[str, Any]) -> None:
        value["boxes"] = [drawn | {"box": edge}, drawn | {"box": face(), "action": "leave"}]

    report = chosen(reviewed, tmp_path, edit)
    assert changed(clip, tmp_path / "out.mp4", edge) == [4 <= n <= 20 for n in range(FRAMES)]
    (mine,) = [one for one in report.covers if one.reason == "your choice"]
    assert (mine.first, mine.last) == (4, 20)
    assert changed(clip, tmp_path / "out.mp4", face()) == [not 4 <= n <= 20 for n in range(FRAMES)]


MISTAKES: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda v: v["covers"][0].update(action="hide"), "cover 1: action must be one of swap, cover, leave"),
    (lambda v: v["covers"][0].update(action="leave", last=3), "cover 1: last must not be edited"),
    (lambda v: v["covers"][0].update(action="leave", number=9), "cover 9 can't get an action"),
    (lambda v: v["covers"].append(v["covers"][0]), "cover 1 appears twice"),
    (lambda v: v.update(box=[]), 'there is no field "box" at the top'),
    (lambda v: v.update(boxes={}), "boxes must be a list of objects"),
    (
        lambda v: v.update(boxes=[{"first": 3, "last": 99, "box": [0, 0, 9, 9]}]),
        "box 1: first, at and last must be",
    ),
    (
        lambda v: v.update(boxes=[{"first": 3, "last": 9, "box": [9, 0, 0, 9]}]),
        "box 1: box must be [x0, y0, x1, y1]",
    ),
    (lambda v: v.update(boxes=[{"frist": 3}]), 'box 1: there is no field "frist"'),
]


@pytest.mark.parametrize(("edit", "sentence"), MISTAKES, ids=[sentence for _, sentence in MISTAKES])
def test_a_mistake_is_named(
    reviewed: Path, tmp_path: Path, edit: Callable[[dict[str, Any]], object], sentence: str
) -> None:
    with pytest.raises(DeidentifyError) as error:
        chosen(reviewed, tmp_path, edit)
    assert sentence in str(error.value)


def test_a_thing_is_followed_to_where_it_goes() -> None:
    """By the flow of its points, forward and back, over a plain and a busy background."""
    rng = np.random.default_rng(0)
    thing, ground = rng.integers(0, 256, (40, 40, 3), np.uint8), rng.integers(0, 90, (120, 200, 3), np.uint8)

    def frames(first: int, last: int) -> Any:
        for n in range(first, last):
            rgb = ground.copy()
            rgb[40:80, 20 + 3 * n : 60 + 3 * n] = thing
            yield Frame.from_rgb(rgb, index=n)

    case: Any = SimpleNamespace(cuts=[], frames=frames)
    boxes = follow(case, MarkedPlace(0, 30, 15, (65.0, 40.0, 105.0, 80.0), "cover"))
    assert sorted(boxes) == list(range(31))
    for n, box in boxes.items():
        np.testing.assert_allclose(box, [20 + 3 * n, 40, 60 + 3 * n, 80], atol=4)
