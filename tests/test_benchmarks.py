"""Benchmarks: targets are judged rightly, tables hold what was measured, and the measures measure."""

import argparse
import json
import platform
import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks import common, embeddings, frame_child, frame_work, run_all, speed, threads
from benchmarks.children import CommandError, Ran, ran
from benchmarks.common import Criterion, Report, Table
from guise.aam.landmarks.schemes import LEFT_EYE, LEFT_MOUTH_CORNER, NOSE_TIP, RIGHT_EYE, RIGHT_MOUTH_CORNER


@pytest.mark.parametrize(
    ("measured", "sense", "met"),
    [
        (1.0, "<=", True),
        (1.0, "<", False),
        (1.0, ">=", True),
        (1.0, ">", False),
        (0.9, "<", True),
        (1.1, ">", True),
    ],
)
def test_target_is_judged_by_its_sense(measured: float, sense: common.Sense, met: bool) -> None:
    assert Criterion("x", measured, sense, 1.0).met is met


@pytest.mark.parametrize("sense", ["<=", ">=", "<", ">"])
def test_what_was_not_measured_is_not_met(sense: common.Sense) -> None:
    assert not Criterion("x", float("nan"), sense, 1.0).met


def test_report_survives_json() -> None:
    report = Report(
        "n", "T", [Criterion("x", 2.0, "<=", 1.0, "ms")], [Table("t", ("a", "b"), [("p", 0.5)])], ["note"]
    )
    again = run_all.report_of({"report": report.plain()})
    assert again.markdown() == report.markdown()
    assert "NOT MET" in again.markdown()


def test_every_script_is_run_and_listed() -> None:
    assert {"speed", "picture.truth", "deidentify.leaks", "live.closed", "mesh.transfer"} <= set(run_all.ALL)
    assert len(run_all.ALL) > 30
    listed = (Path(run_all.__file__).parent / "README.md").read_text()
    assert sorted(run_all.ALL) == sorted(re.findall(r"^\| `([a-z_.]+)` \|", listed, re.MULTILINE))


def test_every_script_takes_what_it_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that its imports and its options are sound, too.  One test, as most of its time is one import of them all."""
    given = ["--peers-python=python", "--landmarker=card.toml", "--parts=parts", "--work=work", "--minutes=1"]
    told = run_all.arguments_of(run_all.parser().parse_args([*given, "--quick"]), Path("x.json"))
    made: list[argparse.ArgumentParser] = []
    monkeypatch.setattr(common, "run", lambda _, parser: made.append(parser))
    monkeypatch.setattr(threads, "one_thread", lambda module: None)  # it would start this process anew
    for name in run_all.ALL:
        path = Path(run_all.__file__).parent / f"{name.replace('.', '/')}.py"
        monkeypatch.setattr(sys, "argv", [name])
        runpy.run_path(str(path), run_name="__main__")
        options = made[-1].parse_args(told)
        assert (options.quick, options.landmarker, options.minutes) == (True, "card.toml", 1.0), name
    assert len(made) == len(run_all.ALL)


def test_what_is_kept_stands_beside_what_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured(value: float) -> Callable[[argparse.Namespace], Report]:
        return lambda options: Report("made.up", "T", [Criterion("x", value, "<=", 2.0, "ms")])

    monkeypatch.setattr(common, "RESULTS", tmp_path)
    for argument, value in (("--keep", 1.25), ("--shared=.", 1.5)):
        monkeypatch.setattr(sys, "argv", ["made_up", argument])
        common.run(measured(value), common.arguments("Made up."))
    assert capsys.readouterr().out.splitlines()[-2].split("|")[1:5] == [
        " x    ",
        " 1.5 ms   ",
        " 1.25 ms ",
        " <= 2 ms ",
    ]
    kept = json.loads((tmp_path / "made.up.json").read_text())
    assert kept["figures"] == {"x": 1.25}
    assert kept.keys() == {"day", "release", "revision", "processor", "cores", "figures"}


def test_figures_of_earlier_releases_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common, "RESULTS", tmp_path)
    for release, value in (("1", 1.0), ("1", 2.0), ("2", 3.0), ("3", 4.0)):
        monkeypatch.setattr(common, "_version", lambda name, release=release: release)
        common.keep(Report("made.up", "T", [Criterion("x", value, "<=", 2.0)]))
    kept = json.loads((tmp_path / "made.up.json").read_text())
    found = [(one["release"], one["figures"]["x"]) for one in (kept, *kept["earlier"])]
    assert found == [("3", 4.0), ("2", 3.0), ("1", 2.0)]


def test_figures_that_are_not_measured_again_stay_with_their_revision(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(common, "RESULTS", tmp_path)
    made = {"processor": "p", "cores": 2}
    for revision, what in (("a", "x"), ("b", "y"), ("c", "y")):
        monkeypatch.setattr(common, "machine", lambda r=revision: {"revision": r} | made)
        common.keep(Report("made.up", "T", [Criterion(what, 1.0, "<=", 2.0)]))
    kept = json.loads((tmp_path / "made.up.json").read_text())
    assert (kept["revision"], sorted(kept["figures"])) == ("c", ["x", "y"])
    assert {what: of[1] for what, of in kept["not_of_this_run"].items()} == {"x": "a"}


def test_a_part_of_the_work_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["made_up", "--keep", "--quick"])
    with pytest.raises(SystemExit, match="2"):
        common.run(lambda options: pytest.fail("was run"), common.arguments("Made up."))


@pytest.mark.parametrize("file", sorted(common.RESULTS.glob("*.json")), ids=lambda file: file.stem)
def test_what_is_kept_is_of_a_benchmark_that_is_there(file: Path) -> None:
    assert file.stem in run_all.ALL
    assert all(np.isfinite(value) for value in json.loads(file.read_text())["figures"].values())


def test_recogniser_sees_the_template_where_the_face_is() -> None:
    shape = np.zeros((81, 2))
    template = embeddings.TEMPLATE * 2 + 30
    (
        shape[RIGHT_EYE],
        shape[LEFT_EYE],
        shape[NOSE_TIP],
        shape[RIGHT_MOUTH_CORNER],
        shape[LEFT_MOUTH_CORNER],
    ) = template
    picture = np.zeros((300, 300, 3), np.uint8)
    x, y = np.round(template[2]).astype(int)
    picture[y - 3 : y + 4, x - 3 : x + 4] = 255
    face = embeddings.aligned(picture, shape)
    ys, xs = np.nonzero(face[..., 0] > 127)
    assert np.hypot(xs.mean() - embeddings.TEMPLATE[2, 0], ys.mean() - embeddings.TEMPLATE[2, 1]) < 0.6


def test_judged_and_enrolled_frames_of_a_person_differ() -> None:
    every = embeddings.spread(282, 40)
    assert len(every) == 40
    assert not set(every[::2]) & set(every[1::2])


def test_failed_command_is_told_with_its_words() -> None:
    with pytest.raises(CommandError, match="no such thing"):
        ran(["sh", "-c", "echo no such thing >&2; exit 3"])


def test_child_is_timed_and_its_memory_seen() -> None:
    run = ran(["sleep", "0.3"], sample_every=0.05)
    assert 0.25 < run.seconds < 5
    assert run.peak_mb > 0
    assert max(mb for _, mb in run.samples) > 0


def test_a_face_counts_as_changed_as_far_as_its_box_was() -> None:
    from benchmarks.deidentify.changes import share

    points = np.array([[x, y] for x in (20, 60) for y in (30, 80)] * 17, float)
    seen = np.ones(68, bool)
    changed = np.zeros((120, 120), bool)
    assert share(0, changed, points, seen).seen == 0
    changed[25:90, 10:70] = True
    assert share(0, changed, points, seen).seen == share(0, changed, points, seen).face == 1
    changed[:, 40:] = False
    assert 0.4 < share(0, changed, points, seen).seen < 0.6


def test_what_is_in_front_of_a_face_need_not_be_changed() -> None:
    from benchmarks.deidentify.changes import share
    from guise.aam.landmarks.schemes import IBUG68
    from guise.aam.reference import ReferenceFrame

    points = ReferenceFrame.canonical(100).points[IBUG68] + 20
    changed = np.ones((160, 160), bool)
    changed[85:] = False
    seen = points[:, 1] < 85
    assert not share(0, changed, points, seen).is_leaked
    assert share(0, changed, points, np.ones(68, bool)).is_leaked
    assert share(0, ~changed, points, seen).is_leaked


def test_a_cover_holds_every_point_of_the_face() -> None:
    from benchmarks.deidentify.changes import share

    points = np.array([[x, y] for x in np.linspace(20, 70, 17) for y in (20, 45, 70, 71)])
    seen, changed = np.ones(68, bool), np.zeros((100, 100), bool)
    changed[15:75, 15:66] = True  # more than nine tenths of the box, and not the last column of points
    assert not share(0, changed, points, seen, covered=False).is_leaked
    assert share(0, changed, points, seen, covered=True).is_leaked
    changed[15:75, 15:75] = True
    assert not share(0, changed, points, seen, covered=True).is_leaked


@pytest.mark.parametrize("form", ["0", "30", "180", "mirrored", "negative", "half-left", "half-below"])
def test_the_truth_follows_the_form_of_a_clip(tmp_path: Path, form: str) -> None:
    from benchmarks.deidentify.changes import Truth
    from benchmarks.deidentify.forms import in_form
    from guise.app.media import open_input

    clip = tmp_path / "clip.mkv"
    place = np.array([60.0, 40.0])
    rgb = np.zeros((90, 120, 3), np.uint8)
    rgb[36:45, 56:65] = 255
    with av.open(str(clip), "w") as out:
        stream = out.add_stream("libx264", 30, {"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = 120, 90, "yuv420p"
        for _ in range(3):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, "rgb24")))
        out.mux(stream.encode(None))
    truth = Truth(np.tile(place, (3, 68, 1)), np.ones((3, 68), bool))
    video, (moved,) = in_form(clip, [truth], form, tmp_path, 2)
    with open_input(video) as media:
        frames = [frame.rgb() for frame in media]
    assert len(frames) == 2
    assert moved.visible.all()
    x, y = moved.points[0, 0].round().astype(int)
    assert frames[0][y, x, 1] == pytest.approx(0 if form == "negative" else 255, abs=12)
    assert frames[0][min(y + 12, len(frames[0]) - 1), x, 1] != frames[0][y, x, 1] or form.startswith("half")


def test_faces_that_cannot_be_seen_are_a_line_without_figures() -> None:
    from benchmarks.deidentify.leaks import row

    assert row("clip", "guise", [])[:5] == ("clip", "guise", 0, 0, 0)


def test_speed_is_a_median_of_ratios_over_the_rounds() -> None:
    def one(transcode: float, swap: float) -> speed.Round:
        return speed.Round(Ran(transcode, transcode, 100.0), Ran(swap, 2 * swap, 300.0 + swap), 0.4, 0.5, 0.1)

    found = {"720p": speed.figures([one(2.0, 3.0), one(4.0, 8.0), one(1.0, 1.2)])}
    assert found["720p"]["wall over transcode"] == pytest.approx(1.5)
    assert found["720p"]["processor over transcode"] == pytest.approx(3.0)
    assert found["720p"]["peak, MB"] == pytest.approx(308)
    report = speed.summary(found)
    assert [(c.what, c.met) for c in report.criteria][:2] == [
        ("720p: wall over transcode", True),
        ("720p: processor over transcode", False),
    ]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="callgrind is asked in its machine code")
def test_callgrind_may_be_asked_where_it_is_not() -> None:
    tell = frame_child.counter()
    tell(frame_child.START)
    tell(frame_child.STOP)


def test_another_revision_is_imported_instead_of_what_is_installed(tmp_path: Path) -> None:
    tree = tmp_path / "tree"
    for place, text in (("guise", ""), ("aam", "told = 'the other'")):
        (tree / place).mkdir(parents=True)
        (tree / place / "__init__.py").write_text(text)
    (tree / "pyproject.toml").write_text(
        '[tool.setuptools]\npackage-dir = { guise = "guise", "guise.aam" = "aam" }'
    )
    folder = frame_work.packages(tree, tmp_path / "packages")
    (tmp_path / "script.py").write_text("from guise.aam import told; print(told)")
    given = {"PYTHONPATH": str(folder)}
    ran((sys.executable, tmp_path / "script.py"), output=tmp_path / "said", environment=given)
    assert (tmp_path / "said").read_text() == "the other\n"
