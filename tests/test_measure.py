"""`guise measure`: what it finds in an equal, a covered and a re-timed copy, and what it says to mistakes."""

import json
import math
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from clips import cut, empty_scene
from made_up import SAMPLES
from test_landmarks_onnx import linear_model

from guise.aam.landmarks import load_annotations
from guise.app.cli.main import main
from guise.app.measure.curves import CURVES
from guise.app.measure.faces import FaceTrack, MeasureError
from guise.app.measure.job import FaceMatcher, measure
from guise.app.measure.options import MeasureOptions
from guise.app.measure.pair import VideoTiming, require_alike
from guise.app.measure.people import Gallery, embeddings_in
from guise.app.measure.reported import NOT_REPORTED, read_report
from guise.app.measure.table import FIRST_HEADING, rows_of
from guise.app.media import open_input
from guise.app.media.pictures import save_picture
from guise.app.people.recogniser import Recogniser

FRAMES = 24
FACE = (190, 60, 430, 400)  # x0 y0 x1 y1, pixels: holds the sample person's face in all frames
CARD = """
name = "projection"
model = "projection.onnx"
[input]
size = [16, 16]
mean = 127.5
scale = 0.0078
[template]
points = [[5.3, 6.0], [10.7, 6.0], [8.0, 9.0], [5.8, 12.0], [10.2, 12.0]]
"""


def recogniser(folder: Path) -> Path:
    """A card whose model projects the 16 x 16 pixels of a face onto 24 random axes."""
    weights = np.random.default_rng(0).normal(size=(3 * 16 * 16, 24))
    (folder / "projection.onnx").write_bytes(linear_model((1, 3, 16, 16), weights, np.zeros(24)))
    (folder / "card.toml").write_text(CARD)
    return folder / "card.toml"


def rewritten(
    source: Path, target: Path, *, cover: bool = False, rate: int = 30, skip: int = 0, half: bool = False
) -> Path:
    """A lossless copy without sound; the face grey, another rate, the last frames left out, or half the size."""
    with av.open(str(source)) as reader, av.open(str(target), "w") as writer:
        stream = writer.add_stream("libx264", rate, {"qp": "0", "preset": "ultrafast"})
        frames = list(reader.decode(video=0))
        shrink = 2 if half else 1
        stream.width, stream.height = frames[0].width // shrink, frames[0].height // shrink
        stream.pix_fmt = "yuv420p"
        for index, frame in enumerate(frames[: len(frames) - skip]):
            rgb = frame.to_ndarray(format="rgb24")[::shrink, ::shrink].copy()
            if cover:
                rgb[FACE[1] : FACE[3], FACE[0] : FACE[2]] = 128
            new = av.VideoFrame.from_ndarray(rgb, "rgb24")
            new.pts, new.time_base = index, Fraction(1, rate)
            writer.mux(stream.encode(new))
        writer.mux(stream.encode(None))
    return target


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """original.mp4, covered.mp4, a recogniser, and a gallery of two other people (a video, and a folder)."""
    folder = tmp_path_factory.mktemp("measure")
    cut("p01", folder / "original.mp4", FRAMES, clip="talk.mp4")
    rewritten(folder / "original.mp4", folder / "covered.mp4", cover=True)
    recogniser(folder)
    (folder / "gallery" / "second").mkdir(parents=True)
    cut("p02", folder / "gallery" / "first.mp4", 6)
    cut("p06", folder / "gallery" / "second" / "clip.mp4", 6)
    (folder / "gallery" / "second" / "notes.txt").write_text("no picture")
    return folder


@pytest.fixture(scope="module")
def measured(folder: Path) -> dict[str, object]:
    """The figures of an equal and of a covered output, as JSON."""
    original = folder / "original.mp4"
    options = MeasureOptions((folder / "card.toml",), folder / "gallery")
    result = measure(original, [original, folder / "covered.mp4"], options)
    content = json.loads(json.dumps(result.as_json(), allow_nan=False))
    content["rows"] = {row[0]: row[1:] for row in rows_of(result)}
    return content


@pytest.mark.slow
def test_an_equal_output_is_the_same_person_with_the_same_expression(measured: dict) -> None:
    equal = measured["outputs"][0]
    private, useful, files = equal["privacy"], equal["utility"], equal["files"]
    assert private["to_source"]["mean"] == pytest.approx(private["unswapped"]["mean"], abs=0.02)
    assert private["rank_one"] == private["unswapped_rank_one"] == 1
    assert private["people"][0]["rank"] == 1
    assert private["people"][0]["similarity"] > 0.99
    assert useful["found"] == 1
    moved = [value for value in useful["correlation"].values() if value is not None]
    assert moved
    assert moved == pytest.approx([1.0] * len(moved))
    assert useful["landmark_error"] == pytest.approx(0, abs=1e-6)
    assert useful["jitter_ratio"] == pytest.approx(1)
    assert files["times_identical"]
    assert files["untouched_identical"]
    assert [stream["state"] for stream in files["sound"]] == ["identical"]


@pytest.mark.slow
def test_a_covered_output_is_nobody_and_nothing_outside_the_face_changed(measured: dict) -> None:
    covered = measured["outputs"][1]
    private, useful, files = covered["privacy"], covered["utility"], covered["files"]
    assert private["to_source"]["count"] == FRAMES  # looked at although no face can be found there
    assert private["to_source"]["mean"] < private["unswapped"]["mean"] - 0.3
    assert useful["found"] == 0
    assert useful["expression"] is None
    assert set(useful["correlation"]) == set(CURVES)
    assert files["times_identical"]
    assert files["untouched_psnr"] > 45
    assert not files["untouched_identical"]
    assert [stream["state"] for stream in files["sound"]] == ["dropped"]


def test_the_gallery_is_the_folder_and_the_people_of_the_original(measured: dict) -> None:
    assert measured["gallery"]["people"] == 3
    assert measured["gallery"]["impostor_pairs"] == measured["gallery"]["pictures"] == 12
    assert not measured["gallery"]["enough_pairs"]
    assert any("too few" in note for note in measured["notes"])
    assert measured["outputs"][0]["privacy"]["chance"] == pytest.approx(1 / 3, abs=1e-5)
    assert not measured["landmarker"]["independent"]


def test_the_table_has_a_cell_for_each_output(measured: dict) -> None:
    rows = measured["rows"]
    assert {len(cells) for cells in rows.values()} == {2}
    assert rows["sound"] == ["identical", "dropped"]
    assert rows["faces found in both"] == ["100.0 %", "0.0 %"]
    assert rows["expression kept, mean correlation"] == ["1.00", "-"]


def test_without_a_recogniser_only_utility_is_measured_and_it_says_so(folder: Path) -> None:
    said: list[str] = []
    original = folder / "original.mp4"
    truth = folder / "truth.npz"
    np.savez(truth, landmarks=np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][:FRAMES])
    result = measure(original, [original], MeasureOptions(landmarks=truth), say=said.append)
    assert result.as_json()["outputs"][0]["privacy"] is None
    assert result.outputs[0].utility.found == 1
    assert 0 < result.outputs[0].utility.landmark_error < 10  # found points beside the true ones
    assert any("privacy is not measured" in text for text in said)
    assert len(load_annotations(truth)) == FRAMES


@pytest.mark.slow
def test_the_report_says_what_was_done_with_each_face(folder: Path, tmp_path: Path) -> None:
    report = tmp_path / "covered.report.json"
    rows = {"frame": [*range(10)], "done": [0] * 5 + [1] * 5, "confidence": [0.9] * 10}
    rows |= {key: [value] * 10 for key, value in zip(("x0", "y0", "x1", "y1"), FACE, strict=True)}
    nothing = {key: [] for key in rows}
    track = {"donor": "", "rows": rows}
    content = {"format": "guise-report", "output": "covered.mp4", "done": ["swapped", "covered", "left"]}
    report.write_text(json.dumps(content | {"tracks": [track], "bystanders": {"rows": nothing}}))
    original, options = folder / "original.mp4", MeasureOptions((folder / "card.toml",), reports=(report,))
    plain, told = measure(original, [original, folder / "covered.mp4"], options).outputs
    assert plain.privacy is not None
    assert told.privacy is not None
    assert plain.privacy.by_state == {}
    assert {state: scores.count for state, scores in told.privacy.by_state.items()} == {
        "swapped": 5, "covered": 5, NOT_REPORTED: FRAMES - 10,
    }  # fmt: skip
    assert math.isnan(told.privacy.verification)


@pytest.mark.slow
def test_the_command_writes_json_and_plot(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("COLUMNS", "160")
    arguments = [
        "--recogniser",
        folder / "card.toml",
        "--distractors",
        folder / "gallery",
        "--identity",
        "p03",
    ]
    arguments += ["-o", tmp_path / "out.json", "--plot", tmp_path / "out.png"]
    code = main(["measure", *map(str, [folder / "original.mp4", folder / "covered.mp4", *arguments])])
    said = capsys.readouterr()
    assert code == 0, said.err
    content = json.loads((tmp_path / "out.json").read_text())
    assert content["format"] == "guise-measure"
    assert content["outputs"][0]["privacy"]["people"][0]["donor"] == "p03"
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    assert f"  {FIRST_HEADING} " in said.out
    assert "covered.mp4" in said.out
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.json", "out.png"]


def test_a_plot_without_matplotlib_is_refused_before_any_work(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("guise.app.measure.plot.find_spec", lambda name: None)
    code = main(["measure", "missing.mp4", "missing.mp4", "--plot", str(tmp_path / "out.png")])
    assert code == 2
    assert capsys.readouterr().err == (
        "error: a plot needs matplotlib, which is not installed: pip install 'guise-video[plots]'\n"
    )


# -- mistakes -----------------------------------------------------------------------------------------------


def sentence(folder: Path, *arguments: object, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command that cannot be done says; it must be the user's mistake, in one line."""
    code = main(["measure", *(str(a) for a in arguments), "--quiet"])
    said = capsys.readouterr()
    assert code == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err.replace(f"{folder}/", "")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"skip": 3}, "other.mp4 must have the 24 frames of original.mp4, got 21"),
        ({"half": True}, "other.mp4 must have the size of original.mp4, 640 x 480, got 320 x 240"),
        ({"rate": 25}, "frame 3 of other.mp4 must be at 0.100 s as in original.mp4, got 0.120 s"),
    ],
    ids=["length", "size", "rate"],
)
@pytest.mark.slow
def test_an_output_of_other_frames_is_refused(
    folder: Path, tmp_path: Path, change: dict, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    other = rewritten(folder / "original.mp4", tmp_path / "other.mp4", **change)
    assert expected in sentence(folder, folder / "original.mp4", other, capsys=capsys)


def test_a_video_without_a_face_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = empty_scene(tmp_path / "empty.mp4")
    assert "no face found in empty.mp4" in sentence(tmp_path, empty, empty, capsys=capsys)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--recogniser", "none.toml"], "recogniser card expected at none.toml, got no such file"),
        (["--distractors", "gallery"], "give one with --recogniser"),
        (["--identity", "p03"], "give one with --recogniser"),
        (["--output-report", "none.json"], "report expected at none.json, got no such file"),
        (["--output-report", "card.toml"], "card.toml must be a report that `guise deidentify` wrote"),
        (["--recogniser", "card.toml", "--distractors", "card.toml"], "a gallery must be a folder"),
        (["--recogniser", "card.toml", "--distractors", "nobody"], "no face found in the gallery nobody"),
        (["--recogniser", "card.toml", "--identity", "p99"], "there is no face p99"),
        (["--landmarker", "magic"], "landmarker must be one of"),
        (["--plot", "out.jpg"], "a plot must be a .png file, got out.jpg"),
        (["-o", "card.toml"], "card.toml exists"),
    ],
)
@pytest.mark.slow
def test_mistakes_are_one_sentence(
    folder: Path, options: list[str], expected: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    (folder / "nobody").mkdir(exist_ok=True)
    assert expected in sentence(folder, "original.mp4", "original.mp4", *options, capsys=capsys)


@pytest.mark.parametrize("frame", [10**30, float("inf"), "one"])
def test_a_report_with_a_frame_that_is_none_is_refused(tmp_path: Path, frame: object) -> None:
    report = tmp_path / "x.report.json"
    rows = {key: [frame] for key in ("frame", "done", "x0", "y0", "x1", "y1")}
    content = {"format": "guise-report", "output": "elsewhere.mp4", "done": [], "tracks": []}
    report.write_text(json.dumps(content | {"bystanders": {"rows": rows}}))
    with pytest.raises(MeasureError, match="must be a report"):
        read_report(report)


def test_the_report_of_another_video_is_refused(folder: Path, tmp_path: Path) -> None:
    report = tmp_path / "x.report.json"
    rows = {key: [] for key in ("frame", "done", "x0", "y0", "x1", "y1")}
    content = {"format": "guise-report", "output": "elsewhere.mp4", "done": [], "tracks": []}
    report.write_text(json.dumps(content | {"bystanders": {"rows": rows}}))
    assert read_report(report).output == "elsewhere.mp4"
    outputs = [folder / "covered.mp4", folder / "original.mp4"]
    with pytest.raises(MeasureError, match="which is not among the outputs"):
        measure(folder / "original.mp4", outputs, MeasureOptions(reports=(report,)))


def test_times_may_be_rounded_but_not_by_half_a_frame() -> None:
    times = tuple(Fraction(i, 30) for i in range(90))
    original = VideoTiming("a", times, 64, 48)
    rounded = tuple(Fraction(round(t * 1000) + 80, 1000) for t in times)  # milliseconds, and a later start
    require_alike(original, VideoTiming("b", rounded, 64, 48))
    late = (*times[:50], times[50] + Fraction(1, 59), *times[51:])
    with pytest.raises(MeasureError, match=r"frame 50 of c must be at 1\.667 s as in a, got 1\.684 s"):
        require_alike(original, VideoTiming("c", late, 64, 48))


def test_pictures_of_a_folder_show_a_person_each(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for person in ("p01", "p02"):
        with av.open(str(SAMPLES / person / "talk.mp4")) as reader:
            rgb = next(reader.decode(video=0)).to_ndarray(format="rgb24")
            save_picture(folder / f"{person}.png", rgb)
    result = measure(folder, [folder], MeasureOptions((recogniser(tmp_path),)))
    assert result.faces == (1, 1)
    (figures,) = result.outputs
    assert figures.utility.found == 1
    assert math.isnan(figures.utility.expression)
    assert figures.privacy is not None
    assert [person.rank for person in figures.privacy.people] == [1, 1]
    assert figures.privacy.unswapped is None
    assert {row[0]: row[1] for row in rows_of(result)}["rank of each person over all frames"] == "1, 1 of 2"


def test_the_higher_score_of_both_places_counts(folder: Path) -> None:
    """Looked at beside the face, the original scores little; where its faces are found, it is itself."""
    original, truth = folder / "original.mp4", np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][:FRAMES]
    face = FaceTrack(np.arange(FRAMES, dtype=np.int32), truth.astype(np.float32))
    beside = FaceTrack(face.frames, face.points + 60)
    nowhere = FaceTrack(np.zeros(0, np.int32), np.zeros((0, 81, 2), np.float32))
    half = FaceTrack(face.frames[::2], face.points[::2])
    recognise = Recogniser(folder / "card.toml")
    with open_input(original) as source:
        rows = embeddings_in(source, [face], recognise)[0]
    judge = FaceMatcher(recognise, Gallery.of([]), [(beside, rows)], [])
    missed, some = (judge.scores(original, [again])[0].own for again in (nowhere, half))
    assert (some[::2] > missed[::2] + 0.1).all()
    assert some[::2].mean() > 0.9
    assert np.array_equal(some[1::2], missed[1::2])
