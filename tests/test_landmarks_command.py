"""`guise landmarks`: what it writes, by a landmarker that finds bright discs."""

import json
import re
import weakref
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from clips import cut, empty_scene, pictures
from discs import SIZE, Disc, Discs, face_at, scene
from made_up import SAMPLES

from guise.aam.landmarks import Face, LandmarkError, load_annotations, open_landmarker, register_landmarker
from guise.aam.landmarks.registry import _LANDMARKERS
from guise.aam.landmarks.schemes import CHIN, IBUG68
from guise.app.cli.main import main
from guise.app.landmarks.formats import face_columns
from guise.common.version import VERSION

ROOT = Path(__file__).parents[1]
PFLD = ROOT.parent / "shared" / "models" / "pfld.onnx"


@pytest.fixture(autouse=True)
def _discs() -> Iterator[None]:
    register_landmarker("discs", "discs", lambda argument, detector: Discs())
    yield
    del _LANDMARKERS["discs"]


def film(path: Path, scenes: list[list[Disc]], pts: list[int] | None = None) -> Path:
    """A lossless video of discs; pts in milliseconds, 40 a frame unless given."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 25, {"qp": "0", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv444p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for index, discs in enumerate(scenes):
            frame = av.VideoFrame.from_ndarray(scene(discs), "rgb24")
            frame.pts = pts[index] if pts else 40 * index
            frame.time_base = stream.codec_context.time_base
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def crossing() -> list[list[Disc]]:
    """A large face that moves right all the time; a smaller one that is gone in frames 5 and 6."""
    return [[(60 + 3 * i, 100, 30), *([(230, 120 + i, 20)] if i not in (5, 6) else [])] for i in range(12)]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    code = main(["landmarks", *arguments, "--landmarker", "discs"])
    said = capsys.readouterr()
    return code, said.out, said.err


def tracks(document: dict) -> list[list[int]]:
    return [[face["track"] for face in frame["faces"]] for frame in document["frames"]]


# -- what is written ----------------------------------------------------------------------------------------


def kinds(value: object) -> object:
    """The structure of a JSON value: keys and types; numbers are alike, a list is its first element that isn't null."""
    if isinstance(value, dict):
        return {key: kinds(v) for key, v in value.items()}
    if isinstance(value, list):
        return [kinds(next((v for v in value if v is not None), None))] if value else []
    return (
        "number" if isinstance(value, (int, float)) and not isinstance(value, bool) else type(value).__name__
    )


def test_the_output_has_the_documented_structure(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "landmarks.md").read_text(encoding="utf-8")
    example = json.loads(re.findall(r"^```json\n(.*?)^```", page, re.M | re.S)[0])
    film(here / "clip.mkv", crossing())
    assert run(capsys, "clip.mkv", "-o", "out.json")[0] == 0
    assert kinds(json.loads((here / "out.json").read_text())) == kinds(example)
    for key in [*example, *example["frames"][0], *example["frames"][0]["faces"][0]]:
        assert f"`{key}`" in page or key in ("format", "version", "scheme", "source", "frames"), key


def test_every_face_of_every_frame_with_its_track_and_time(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = [0, 40, 80, 130, 160, 200, 240, 290, 333, 360, 400, 441]
    film(here / "clip.mkv", crossing(), times)
    code, out, err = run(capsys, "clip.mkv", "-o", "out.json", "--no-smooth")
    assert (code, err) == (0, "")
    assert re.fullmatch(
        r"out.json: 22 faces in 12 of 12 frames, 2 tracks; \S+ s, \S+ frames per second\n", out
    )
    document = json.loads((here / "out.json").read_text())
    assert tracks(document) == [[0] if i in (5, 6) else [0, 1] for i in range(12)]
    assert [frame["index"] for frame in document["frames"]] == list(range(12))
    numerator, denominator = document["time_base"]
    assert [1000 * frame["pts"] * numerator / denominator for frame in document["frames"]] == times
    assert {(frame["width"], frame["height"]) for frame in document["frames"]} == {(320, 240)}
    assert document["guise"] == VERSION
    assert document["landmarker"] == "discs"
    assert document["smoothed"] is False
    face = document["frames"][4]["faces"][0]
    np.testing.assert_allclose(face["points"], face_at(72, 100).points, atol=1)
    np.testing.assert_allclose(face["point_confidence"], np.linspace(0, 1, 81), atol=1e-4)
    assert np.abs(face["yaw_pitch_roll"]).max() < 12  # the mean face looks about straight ahead
    assert face["confidence"] == pytest.approx(230 / 255, abs=0.01)
    points = np.array(face["points"])
    assert face["box"] == [*points.min(axis=0), *points.max(axis=0)]


@pytest.mark.slow
def test_smoothing_is_reported_and_reduces_jitter(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)

    def shaking(self: Discs, rgb: np.ndarray, previous: Face) -> Face:
        return Face.around(face_at(150, 100).points + rng.normal(0, 0.1, (81, 2)), 0.9)

    monkeypatch.setattr(Discs, "refine", shaking)
    film(here / "clip.mkv", [[(150, 100, 30)]] * 40)
    steps = []
    for options in (["steady.json"], ["raw.json", "--no-smooth"]):
        assert run(capsys, "clip.mkv", "-o", *options)[0] == 0
        document = json.loads((here / options[0]).read_text())
        assert document["smoothed"] == (len(options) == 1)
        points = np.array([frame["faces"][0]["points"] for frame in document["frames"]])
        steps.append(np.abs(np.diff(points[10:], axis=0)).mean())
    assert steps[0] < 0.5 * steps[1]


def test_each_track_is_smoothed_by_itself(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = [[(60 + i, 100, 30), (230, 120 + i, 20)] for i in range(10)]
    for name, scenes in (("both", two), ("one", [discs[:1] for discs in two])):
        film(here / f"{name}.mkv", scenes)
        assert run(capsys, f"{name}.mkv", "-o", f"{name}.json")[0] == 0
    both, one = (json.loads((here / f"{name}.json").read_text())["frames"] for name in ("both", "one"))
    for together, alone in zip(both, one, strict=True):
        assert together["faces"][0]["points"] == alone["faces"][0]["points"]
        points = np.array(together["faces"][0]["points"])
        assert together["faces"][0]["box"] == [*points.min(axis=0), *points.max(axis=0)]


def test_json_can_be_read_again_and_holds_the_main_track(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenes = crossing()
    scenes[3] = [(230, 123, 20)]  # the main face is gone for a moment, the other one is not taken for it
    film(here / "clip.mkv", scenes)
    assert run(capsys, "clip.mkv", "-o", "out.json")[0] == 0
    annotations = load_annotations(here / "out.json")
    assert annotations.present.tolist() == [i != 3 for i in range(12)]
    assert annotations.several == 10
    assert str(annotations.note).endswith("; the one seen longest and largest is taken")
    for i in (0, 4, 11):
        np.testing.assert_allclose(annotations.points[i], face_at(60 + 3 * i, 100).points, atol=1)
    document = json.loads((here / "out.json").read_text())
    np.testing.assert_array_equal(
        annotations.points[4], np.float32(document["frames"][4]["faces"][0]["points"])
    )


def test_npz_holds_the_same_and_can_be_read_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film(here / "clip.mkv", crossing())
    for name in ("out.npz", "out.json"):
        assert run(capsys, "clip.mkv", "-o", name)[0] == 0
    document = json.loads((here / "out.json").read_text())
    with np.load(here / "out.npz") as stored:
        assert stored["face81"].shape == (12, 2, 81, 2)
        assert stored["face81"].dtype == np.float32
        assert stored["track"].tolist() == [[0, 1 if len(t) > 1 else -1] for t in tracks(document)]
        assert np.isnan(stored["face81"][5, 1]).all()
        assert np.isnan(stored["confidence"]).tolist() == (stored["track"] < 0).tolist()
        for index, frame in enumerate(document["frames"]):
            for column, face in enumerate(frame["faces"]):
                place = index, column
                np.testing.assert_array_equal(stored["face81"][place], np.float32(face["points"]))
                np.testing.assert_allclose(
                    stored["yaw_pitch_roll"][place], face["yaw_pitch_roll"], atol=0.051
                )
                seen = [(np.nan,) * 3 if iris is None else iris for iris in face["irises"]]
                np.testing.assert_allclose(stored["irises"][place], seen, atol=0.006)
                np.testing.assert_allclose(
                    stored["point_confidence"][place], face["point_confidence"], atol=1e-4
                )
        assert stored["pts"].tolist() == [frame["pts"] for frame in document["frames"]]
        head = json.loads(str(stored["about"]))
    assert head == {key: document[key] for key in head}
    np.testing.assert_array_equal(
        load_annotations(here / "out.npz").points, load_annotations(here / "out.json").points
    )


def test_pts_of_a_video_go_into_a_folder(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film(here / "clip.mkv", crossing()[:5])
    assert run(capsys, "clip.mkv", "-o", "points")[0] == 0
    names = [f"{i:06d}_0.pts" for i in range(5)] + [f"{i:06d}_1.pts" for i in range(5)]
    assert sorted(file.name for file in (here / "points").iterdir()) == sorted(names)
    text = (here / "points" / "000002_0.pts").read_text()
    assert text.startswith("version: 1\nn_points: 68\n{\n")
    first = [float(word) for word in text.splitlines()[3].split()]
    np.testing.assert_allclose(first, face_at(66, 100).points[0] + 1, atol=1)  # the first pixel is 1
    code, _, err = run(capsys, "clip.mkv", "-o", "one.pts")
    assert (code, err) == (
        2,
        "error: a .pts file holds one picture, and clip.mkv has more: name a folder, such as one\n",
    )


@pytest.mark.parametrize("kind", ["colour", "grey", "deep", "alpha"])
def test_pictures_of_every_kind(here: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    rgb = scene([(80, 100, 20), (220, 120, 30)])
    made = {
        "colour": rgb,
        "grey": rgb[..., 0],
        "deep": rgb.astype(np.uint16) * 257,
        "alpha": np.dstack([rgb, np.full(rgb.shape[:2], 200, np.uint8)]),
    }[kind]
    assert cv2.imwrite("in.png", made)
    assert run(capsys, "in.png", "-o", "face.pts", "--overlay", "drawn.png")[0] == 0
    assert sorted(file.name for file in here.iterdir()) == ["drawn.png", "face.pts", "face_1.pts", "in.png"]
    large, small = load_annotations(here / "face.pts"), load_annotations(here / "face_1.pts")
    np.testing.assert_allclose(large.points[0, IBUG68], face_at(220, 120).points[IBUG68], atol=1)
    np.testing.assert_allclose(small.points[0, IBUG68], face_at(80, 100, SIZE * 2 / 3).points[IBUG68], atol=1)
    drawn = cv2.imread("drawn.png", cv2.IMREAD_UNCHANGED)
    assert drawn is not None
    assert drawn.dtype == made.dtype
    drawn = drawn // 257 if kind == "deep" else drawn
    changed = np.abs(drawn[..., :3].astype(int) - rgb).max(axis=2) > 0
    assert changed[100:150, 190:250].any()
    assert not changed[:, 140:170].any()
    if kind == "alpha":
        assert (drawn[..., 3] == 200).all()


def test_pictures_of_a_folder_stand_each_for_itself(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "in").mkdir()
    cv2.imwrite("in/a2.png", scene([(80, 100, 30), (220, 120, 20)]))
    cv2.imwrite("in/a10.png", scene([(80, 100, 30)], 200, 180))
    cv2.imwrite("in/b.png", scene([], 64, 64))
    code, out, _ = run(capsys, "in", "-o", "out.json", "--overlay", "drawn")
    assert code == 0
    assert out.startswith("out.json: 3 faces in 2 of 3 frames; ")
    frames = json.loads((here / "out.json").read_text())["frames"]
    assert [frame["name"] for frame in frames] == ["a2.png", "a10.png", "b.png"]
    assert [(frame["width"], frame["height"]) for frame in frames] == [(320, 240), (200, 180), (64, 64)]
    assert [[face["track"] for face in frame["faces"]] for frame in frames] == [[None, None], [None], []]
    assert load_annotations(here / "out.json").present.tolist() == [True, True, False]
    assert sorted(file.name for file in (here / "drawn").iterdir()) == ["a10.png", "a2.png", "b.png"]
    assert run(capsys, "in", "-o", "points", "--format", "pts")[0] == 0
    names = ["a10.pts", "a2.pts", "a2_1.pts", "b.pts"]
    assert sorted(file.name for file in (here / "points").iterdir()) == names
    assert "n_points: 0" in (here / "points" / "b.pts").read_text()


def test_the_overlay_keeps_sound_and_times_and_the_rest_of_the_picture(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut("p01", here / "clip.mp4", 6)
    register_landmarker("truth", "truth", lambda argument, detector: Truth())
    code = main(["landmarks", "clip.mp4", "-o", "out.npz", "--overlay", "drawn.mp4", "--landmarker", "truth"])
    del _LANDMARKERS["truth"]
    assert code == 0
    with av.open("clip.mp4") as old, av.open("drawn.mp4") as new:
        assert len(new.streams.audio) == len(old.streams.audio) == 1
        times = [[frame.pts * frame.time_base for frame in file.decode(video=0)] for file in (old, new)]
        assert times[0] == times[1]
    points = load_annotations(here / "out.npz").points[0]
    change = np.abs(pictures(here / "drawn.mp4")[0].astype(int) - pictures(here / "clip.mp4")[0])
    left, top = points.min(axis=0).astype(int)
    right, bottom = points.max(axis=0).astype(int)
    x, y = points[CHIN].round().astype(int)
    assert change[y - 2 : y + 3, x - 2 : x + 3].max() > 40
    outside = change.copy()
    outside[top - 60 : bottom + 60, left - 60 : right + 60] = 0
    assert outside.mean() < 0.1 * change[top:bottom, left:right].mean()


class Truth:
    """The landmarks that lie beside a sample clip, frame by frame."""

    name = "truth"

    def __init__(self) -> None:
        self.points = iter(np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"])

    def detect(self, rgb: np.ndarray) -> list[Face]:
        return [Face.around(next(self.points), 1.0)]

    def refine(self, rgb: np.ndarray, previous: Face) -> Face:
        return Face.around(next(self.points), 1.0)


@pytest.mark.parametrize("output", ["out.json", "out.npz", "points"])
@pytest.mark.slow
def test_pictures_are_not_kept(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, output: str
) -> None:
    alive: list[weakref.ref[np.ndarray]] = []
    most = 0

    def refine(self: Discs, rgb: np.ndarray, previous: Face) -> Face:
        nonlocal most
        alive.append(weakref.ref(rgb))
        most = max(most, sum(ref() is not None for ref in alive))
        return previous

    monkeypatch.setattr(Discs, "refine", refine)
    film(here / "clip.mkv", [[(60, 100, 30)]] * 40)
    assert run(capsys, "clip.mkv", "-o", output)[0] == 0
    assert len(alive) == 39
    assert most <= 2


def test_the_command_has_help_quiet_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["landmarks", "--help"]) == 0
    said = capsys.readouterr().out
    assert "--quiet" in said
    assert "--json" in said


# -- no face, bad input, outputs ----------------------------------------------------------------------------


@pytest.mark.parametrize("output", ["out.json", "out.npz", "points"])
def test_without_a_face_the_file_says_so(here: Path, capsys: pytest.CaptureFixture[str], output: str) -> None:
    empty_scene(here / "nobody.mp4")
    code, out, err = run(capsys, "nobody.mp4", "-o", output)
    assert (code, err) == (0, "")
    assert out.startswith(f"{output}: no face found in 8 frames; ")
    if output == "out.json":
        assert [frame["faces"] for frame in json.loads(Path(output).read_text())["frames"]] == [[]] * 8
    elif output == "out.npz":
        assert np.load(output)["face81"].shape == (8, 0, 81, 2)
    else:
        assert list((here / "points").iterdir()) == []
        return
    with pytest.raises(LandmarkError):
        load_annotations(here / output)


def test_faces_below_the_confidence_are_left_out(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite("in.png", scene([(150, 100, 30)]))
    assert "1 face in 1 of 1 frame" in run(capsys, "in.png", "-o", "a.json", "--min-confidence", "0.9")[1]
    assert "no face found in 1 frame" in run(capsys, "in.png", "-o", "b.json", "--min-confidence", "0.95")[1]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["none.mp4", "-o", "out.json"], "none.mp4 does not exist: give a video file"),
        (
            ["clip.mkv", "-o", "out.txt"],
            "out.txt must end in .json, .npz or .pts; to use another name, add --format",
        ),
        (["clip.mkv", "-o", "old.json"], "old.json exists: use --force to replace it"),
        (["clip.mkv", "-o", "no/out.json"], "no/out.json cannot be written, there is no folder no"),
        (["clip.mkv", "-o", "clip.mkv", "--format", "json", "--force"], "clip.mkv is the input itself"),
        (["clip.mkv", "-o", "mixed", "--force"], "mixed holds files other than .pts"),
        (["clip.mkv", "-o", "full"], "full exists: use --force to replace it"),
        (["clip.mkv", "-o", "out.json", "--overlay", "old.json"], "old.json exists"),
        (
            ["clip.mkv", "-o", "out.json", "--overlay", "a.png"],
            "The output a.png is one image but clip.mkv is not",
        ),
        (
            ["clip.mkv", "-o", "out.json", "--overlay", "out.json"],
            "out.json cannot be both output and overlay",
        ),
        (
            ["clip.mkv", "-o", "out.json", "--overlay", "a.mp4", "--encoder", "x"],
            "Encoder 'x' is not available",
        ),
        (["clip.mkv", "-o", "out.json", "--detector", "magic"], "face detector must be one of"),
        (["void.png", "-o", "out.json"], "void.png is not an image that can be read"),
        (["clip.mkv"], "Missing option '--output'"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    film(here / "clip.mkv", crossing()[:3])
    (here / "void.png").write_bytes(b"")
    (here / "old.json").write_text("precious")
    for name in ("mixed/notes.txt", "full/a.pts"):
        (here / name).parent.mkdir()
        (here / name).write_text("precious")
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {sentence}")
    assert err.count("\n") == 1
    assert {path: path.read_bytes() for path in here.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("output", ["out.json", "out.npz", "points"])
def test_force_replaces_and_quiet_is_silent(
    here: Path, capsys: pytest.CaptureFixture[str], output: str
) -> None:
    film(here / "clip.mkv", crossing()[:4])
    film(here / "short.mkv", crossing()[:1])
    assert run(capsys, "clip.mkv", "-o", output, "--quiet") == (0, "", "")
    assert run(capsys, "short.mkv", "-o", output, "--quiet", "--force") == (0, "", "")
    if output == "points":
        assert sorted(file.name for file in (here / output).iterdir()) == ["000000_0.pts", "000000_1.pts"]
    else:
        assert len(load_annotations(here / output)) == 1


def test_json_is_one_object(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film(here / "clip.mkv", crossing())
    code, out, err = run(capsys, "clip.mkv", "-o", "out.json", "--json")
    assert code == 0
    assert {json.loads(line)["stage"] for line in err.splitlines()} == {"landmarks"}
    report = json.loads(out)
    assert (report["frames"], report["with_face"], report["faces"], report["tracks"]) == (12, 12, 22, 2)
    assert (report["output"], report["overlay"], report["landmarker"]) == ("out.json", None, "discs")


@pytest.mark.parametrize("output", ["out.json", "out.npz", "points"])
def test_interrupted_in_the_middle_nothing_is_left(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, output: str
) -> None:
    def interrupted(self: Discs, rgb: np.ndarray, previous: Face) -> Face:
        raise KeyboardInterrupt

    monkeypatch.setattr(Discs, "refine", interrupted)
    film(here / "clip.mkv", crossing())
    before = sorted(here.rglob("*"))
    assert run(capsys, "clip.mkv", "-o", output, "--overlay", "drawn.mp4")[0] == 130
    assert sorted(here.rglob("*")) == before


def test_pictures_of_one_name_are_refused_for_pts(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "in").mkdir()
    for name in ("a.png", "a.bmp"):
        cv2.imwrite(f"in/{name}", scene([(80, 100, 30)]))
    code, _, err = run(capsys, "in", "-o", "points")
    assert (code, err) == (
        2,
        "error: two pictures have a face for a.pts: rename one of them, or use --format json\n",
    )
    assert not (here / "points").exists()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"version": 9}, "must have guise-landmarks version 1, got 9"),
        ({"scheme": None}, "must have a scheme and frames"),
        ({"scheme": "magic"}, "landmark scheme must be one of"),
        ({"frames": [{"index": 1, "faces": []}]}, "frame 0 must have index 0 and faces"),
        ({"frames": [{"index": 0, "faces": [[1]]}]}, "frame 0 must have index 0 and faces"),
        (
            {"frames": [{"index": 0, "faces": [{"track": "a", "points": []}]}]},
            "must be a whole number or null",
        ),
        ({"frames": [{"index": 0, "faces": [{"points": [1]}]}]}, r"must be a list of \[x, y\] numbers"),
        ({"frames": [{"index": 0, "faces": [{"points": [[1, 2]]}]}]}, r"must have 81 \(face81\) points"),
        ({"frames": []}, "got none in 0 frames"),
    ],
)
def test_a_changed_file_is_refused_in_one_sentence(here: Path, change: dict, sentence: str) -> None:
    stored = {"format": "guise-landmarks", "version": 1, "scheme": "face81", "frames": []} | change
    (here / "a.json").write_text(json.dumps(stored))
    with pytest.raises(LandmarkError, match=sentence):
        load_annotations(here / "a.json")


def test_a_column_is_free_after_the_last_frame_of_its_track() -> None:
    rows = [[0, 1], [0], [0, 2], [0, 1], [3], [2, 3]]
    columns = face_columns(rows)
    assert columns == [[0, 1], [0], [0, 2], [0, 1], [0], [2, 0]]
    assert all(len(set(row)) == len(row) for row in columns)


@pytest.mark.skipif(not PFLD.is_file(), reason="needs a landmark model")
@pytest.mark.slow
def test_a_written_file_enrols_the_person(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "card.toml").write_text(
        f'model = "{PFLD}"\nscheme = "ibug68"\n[input]\nsize = [112, 112]\n[crop]\nenlarge = 1.1\n'
    )
    cut("p01", here / "clip.mp4", 40, clip="talk.mp4")
    assert main(["landmarks", "clip.mp4", "-o", "found.json", "--landmarker", "card.toml", "-q"]) == 0
    assert open_landmarker("card.toml").name in (here / "found.json").read_text()[:300]
    arguments = ["--landmarks", "found.json", "--frames", "16", "--resolution", "48", "-q"]
    assert main(["enroll", "clip.mp4", "-o", "p.guise", *arguments]) == 0
    assert (here / "p.guise").stat().st_size > 1000
