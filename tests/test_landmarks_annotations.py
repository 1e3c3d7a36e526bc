"""Annotation files: round trips, formats, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from guise.aam.landmarks import Annotations, LandmarkError, load_annotations, save_annotations, to_face81
from guise.aam.landmarks.schemes import IBUG68

SAMPLES = Path(__file__).parents[1] / "sample_videos"


def some_points(frames: int = 4, count: int = 81, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-20, 2000, (frames, count, 2)).astype(np.float32)


def pts_text(points: np.ndarray, header: int | None = None) -> str:
    rows = "\n".join(f"{x} {y}" for x, y in points)
    return f"version: 1\nn_points:  {len(points) if header is None else header}\n{{\n{rows}\n}}\n"


@pytest.mark.parametrize("ending", [".npz", ".json", ""])
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    points=arrays(np.float32, (3, 81, 2), elements=st.floats(-5000, 5000, width=32)),
    missing=st.sets(st.integers(0, 2), max_size=2),
)
def test_round_trip_gives_the_same_points(
    tmp_path: Path, ending: str, points: np.ndarray, missing: set[int]
) -> None:
    points = points.copy()
    points[sorted(missing)] = np.nan
    save_annotations(tmp_path / f"clip{ending}", points, overwrite=True)
    loaded = load_annotations(tmp_path / f"clip{ending}")
    tolerance = 0 if ending else 1e-6 * np.abs(np.nan_to_num(points)).max() + 1e-9
    np.testing.assert_allclose(loaded.points, points, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(loaded.present, [i not in missing for i in range(3)])


@pytest.mark.parametrize("ending", [".npz", ".json", ""])
def test_round_trip_of_68_points_completes_them(tmp_path: Path, ending: str) -> None:
    points = some_points(count=68)
    points[2] = np.nan
    save_annotations(tmp_path / f"clip{ending}", points, "ibug68")
    loaded = load_annotations(tmp_path / f"clip{ending}")
    assert loaded.scheme == "ibug68"
    np.testing.assert_allclose(loaded.points, to_face81(points, "ibug68"), atol=2e-3)


def test_single_pts_round_trip(tmp_path: Path) -> None:
    points = some_points(1)
    save_annotations(tmp_path / "one.pts", points)
    np.testing.assert_allclose(load_annotations(tmp_path / "one.pts").points, points, atol=1e-4)


def test_pts_counts_from_pixel_one(tmp_path: Path) -> None:
    points = some_points(1, 68)[0]
    (tmp_path / "face.pts").write_text(pts_text(points))
    loaded = load_annotations(tmp_path / "face.pts")
    np.testing.assert_allclose(loaded.points[0, IBUG68], points - 1, atol=1e-3)


def test_folder_is_in_natural_order(tmp_path: Path) -> None:
    points = some_points(12)
    for index, frame in enumerate(points):
        (tmp_path / f"f{index}.pts").write_text(pts_text(frame + 1))
    np.testing.assert_allclose(load_annotations(tmp_path).points, points, atol=1e-3)


def test_folder_is_matched_to_pictures(tmp_path: Path) -> None:
    points = some_points(2)
    (tmp_path / "b.pts").write_text(pts_text(points[0] + 1))
    (tmp_path / "a.pts").write_text(pts_text(points[1] + 1))
    loaded = load_annotations(tmp_path, images=["x/b.jpg", "x/none.jpg", "x/a.jpg"])
    np.testing.assert_array_equal(loaded.present, [True, False, True])
    np.testing.assert_allclose(loaded.points[[0, 2]], points, atol=1e-3)


@pytest.mark.parametrize("key", ["face81", "landmarks", "points"])
def test_npz_keys(tmp_path: Path, key: str) -> None:
    np.savez(tmp_path / "a.npz", **{key: some_points(), "other": np.zeros(3)})  # type: ignore[arg-type]
    np.testing.assert_array_equal(load_annotations(tmp_path / "a.npz").points, some_points())


def test_sample_truth_loads() -> None:
    annotations = load_annotations(SAMPLES / "p01" / "talk.npz")
    assert len(annotations.require_frames(300)) == 300
    assert annotations.note is None


def test_largest_of_several_faces_is_taken_and_told(tmp_path: Path) -> None:
    large, small = some_points(3), some_points(3, seed=1) / 10
    large[2] = np.nan
    np.savez(tmp_path / "a.npz", face81=np.stack([small, large], axis=1))
    annotations = load_annotations(tmp_path / "a.npz")
    np.testing.assert_array_equal(annotations.points, [large[0], large[1], small[2]])
    assert annotations.several == 2
    assert "several faces in 2 frames of 3; the largest is taken" in str(annotations.note)


def test_plain_json_list_and_repeated_index(tmp_path: Path) -> None:
    points = some_points(2, 68)
    (tmp_path / "list.json").write_text(json.dumps([points[0].tolist(), None]))
    assert load_annotations(tmp_path / "list.json").present.tolist() == [True, False]
    frames = [{"index": 3, "points": (points[i] / (1 + i)).tolist()} for i in range(2)]
    (tmp_path / "two.json").write_text(json.dumps({"scheme": "ibug68", "frames": frames}))
    annotations = load_annotations(tmp_path / "two.json")
    assert annotations.present.tolist() == [False, False, False, True]
    assert annotations.several == 1
    np.testing.assert_allclose(annotations.points[3, IBUG68], points[0], rtol=1e-6)


def test_half_missing_frame_counts_as_missing(tmp_path: Path) -> None:
    points = some_points()
    points[1, 5] = np.inf
    np.savez(tmp_path / "a.npz", face81=points)
    annotations = load_annotations(tmp_path / "a.npz")
    assert annotations.present.tolist() == [True, False, True, True]
    assert np.isnan(annotations.points[1]).all()


def test_points_are_read_only(tmp_path: Path) -> None:
    annotations = Annotations(some_points())
    with pytest.raises(ValueError, match="read-only"):
        annotations.points[0] = 0


def test_another_length_is_one_sentence() -> None:
    with pytest.raises(LandmarkError, match=r"landmarks for the 300 frames of the video, got 4; give"):
        Annotations(some_points()).require_frames(300)


@pytest.mark.parametrize(
    ("arrays_", "message"),
    [
        ({"face": some_points()}, "one of the arrays face81, landmarks, points, got face"),
        ({}, "got none"),
        ({"face81": some_points()[0]}, r"\(frames, points, 2\) .* got float32 \(81, 2\)"),
        ({"points": np.zeros((4, 81, 3))}, r"got float64 \(4, 81, 3\)"),
        ({"points": np.zeros((4, 70, 2))}, r"81 \(face81\), 68 \(ibug68\); got 70"),
        ({"points": np.full((4, 81, 2), np.nan)}, "at least one frame, got none in 4 frames"),
        ({"points": np.zeros((0, 81, 2))}, r"at least one frame, got an array of shape \(0, 1, 81, 2\)"),
        ({"points": np.zeros((3, 0, 81, 2))}, r"at least one frame, got an array"),
        ({"points": np.full((1, 81, 2), "x")}, "must be numbers"),
        ({"points": np.zeros((1, 81, 2), complex)}, "real numbers, got complex128"),
    ],
)
def test_bad_npz(tmp_path: Path, arrays_: dict[str, np.ndarray], message: str) -> None:
    np.savez(tmp_path / "bad.npz", **arrays_)  # type: ignore[arg-type]
    with pytest.raises(LandmarkError, match=message) as caught:
        load_annotations(tmp_path / "bad.npz")
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04 cut short", b"\x93NUMPY\x01"])
def test_npz_that_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.npz").write_bytes(content)
    with pytest.raises(LandmarkError, match="must be an npz file of plain arrays"):
        load_annotations(tmp_path / "bad.npz")


def test_npz_truncated_or_pickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "whole.npz", face81=some_points())
    (tmp_path / "cut.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:-300])
    np.savez(tmp_path / "pickled.npz", face81=np.array([{"a": 1}], dtype=object))
    np.save(tmp_path / "plain.npy", some_points())
    (tmp_path / "plain.npy").rename(tmp_path / "plain.npz")
    for name in ("cut", "pickled", "plain"):
        with pytest.raises(LandmarkError, match="must be an npz file of plain arrays"):
            load_annotations(tmp_path / f"{name}.npz")


FACE = np.zeros((81, 2)).tolist()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "must be a JSON file"),
        ("3", "list of frames or an object with scheme and frames, got int"),
        ('{"frames": [], "fps": 3}', "got frames, fps"),
        ('{"scheme": "face81"}', "got scheme"),
        (json.dumps({"frames": []}), "must name its scheme as face81 or ibug68, got None"),
        (json.dumps({"scheme": "wflw", "frames": []}), "one of face81, ibug68.* got 'wflw'"),
        (json.dumps({"scheme": "face81", "frames": []}), "got none in 0 frames"),
        (json.dumps({"scheme": "face81", "frames": [{"index": 0, "points": None}]}), "got none in 1 frames"),
        (
            json.dumps({"scheme": "face81", "frames": [3]}),
            "entry 0 of frames must have index and points, got int",
        ),
        (
            json.dumps({"scheme": "face81", "frames": [{"points": FACE}]}),
            "must have index and points, got points",
        ),
        (
            json.dumps({"scheme": "face81", "frames": [{"index": -1, "points": FACE}]}),
            "whole number .* got -1",
        ),
        (json.dumps({"scheme": "face81", "frames": [{"index": 10**9, "points": FACE}]}), "got 1000000000"),
        (json.dumps({"scheme": "face81", "frames": [{"index": True, "points": FACE}]}), "got True"),
        (
            json.dumps({"scheme": "face81", "count": 1, "frames": [{"index": 3, "points": FACE}]}),
            "count .* got 1",
        ),
        (
            json.dumps({"scheme": "ibug68", "frames": [{"index": 0, "points": FACE}]}),
            r"68 \(ibug68\) .* got 81",
        ),
        (json.dumps([FACE, FACE[: len(IBUG68)]]), "the same number of points in every frame, got 68, 81"),
        (json.dumps([FACE[:5]]), r"81 \(face81\), 68 \(ibug68\); got 5"),
        (json.dumps([[1, 2, 3]]), "points of frame 0 must be a list of"),
        (json.dumps([[["a", "b"]]]), "points of frame 0 must be a list of"),
        (json.dumps([None, None]), "got none in 2 frames"),
        ("[" * 100000, "must be a JSON file"),
    ],
)
def test_bad_json(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "bad.json").write_text(content)
    with pytest.raises(LandmarkError, match=message):
        load_annotations(tmp_path / "bad.json")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "got other text"),
        ("1 2\n3 4\n", "got other text"),
        (pts_text(some_points(1)[0], header=68), "the 68 points of its header, got 81"),
        (pts_text(some_points(1, 5)[0]), r"81 \(face81\), 68 \(ibug68\); got 5"),
        ("version: 1\nn_points: 1\n{\n1 2 3\n}\n", "two numbers a line"),
        ("version: 1\nn_points: 1\n{\n1 x\n}\n", "two numbers a line, got: .*'x'"),
        ("version: 1\nn_points: 0\n{\n}\n", "got none in 1 frames"),
    ],
)
def test_bad_pts(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.pts").write_text(text)
    with pytest.raises(LandmarkError, match=message):
        load_annotations(tmp_path / "bad.pts")


def test_bad_places(tmp_path: Path) -> None:
    with pytest.raises(LandmarkError, match=r"must hold .pts files, got none"):
        load_annotations(tmp_path)
    with pytest.raises(LandmarkError, match=r"expected at .*none.npz, got no such file"):
        load_annotations(tmp_path / "none.npz")
    with pytest.raises(LandmarkError, match=r"must be a .npz, .json or .pts file or a folder"):
        load_annotations(tmp_path / "points.csv")
    (tmp_path / "bin.pts").write_bytes(b"\xff\xfe")
    with pytest.raises(LandmarkError, match=r"readable .pts text file"):
        load_annotations(tmp_path / "bin.pts")
    (tmp_path / "bin.pts").write_text(pts_text(some_points(1)[0]))
    with pytest.raises(LandmarkError, match=r"named as the pictures, got bin.pts without one"):
        load_annotations(tmp_path, images=["a.png"])


def test_saving_refuses_what_it_cannot_do(tmp_path: Path) -> None:
    with pytest.raises(LandmarkError, match=r"shape \(frames, 81, 2\), got \(81, 2\)"):
        save_annotations(tmp_path / "a.npz", np.zeros((81, 2)))
    with pytest.raises(LandmarkError, match="landmarks of one picture, got 4 frames"):
        save_annotations(tmp_path / "a.pts", some_points())
    with pytest.raises(LandmarkError, match=r"\.npz, \.json, \.pts or a folder"):
        save_annotations(tmp_path / "a.csv", some_points())
    save_annotations(tmp_path / "a.npz", some_points())
    with pytest.raises(LandmarkError, match="exists already"):
        save_annotations(tmp_path / "a.npz", some_points())
    with pytest.raises(LandmarkError, match="could not be written"):
        save_annotations(tmp_path / "a.npz" / "b.npz", some_points())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.npz"]
