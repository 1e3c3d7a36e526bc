"""`guise analogy image` and `animate`: what they write, say and refuse, on frames of the sample clips."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from clips import cut, empty_scene, tags
from made_up import SAMPLES
from models import model_file

from guise.aam.landmarks import save_annotations
from guise.aam.landmarks.schemes import (
    INNER_LIPS,
    LIPS,
    LOWER_LIP_INNER,
    NOSE_BASE,
    OUTER_LIPS,
    UPPER_LIP_INNER,
)
from guise.aam.reference import ReferenceFrame
from guise.analogy.photo import PhotoError
from guise.app.cli.main import main
from guise.app.media import open_input
from guise.app.media.image_writing import encode_deep
from guise.app.media.images import DeepImage, read_deep
from guise.app.photos.driving_track import DrivingTrack
from guise.app.photos.faces import (
    PHOTO_LIMITS,
    Photo,
    PoseNormaliser,
    head_angles,
    quality_warnings,
    require_usable,
    shape_distance,
)

REST, OPEN = 0, 15  # frames of p01's talk2: at rest, and with an open mouth
WIDTH, HEIGHT = 311, 419  # of T, as in the paper
CORNER = (170, 10)  # of T, in a frame of p06


def frames(person: str, wanted: tuple[int, ...]) -> Iterator[np.ndarray]:
    with open_input(SAMPLES / person / "talk2.mp4") as source:
        for frame in source:
            if frame.index in wanted:
                yield frame.rgb()
            if frame.index >= max(wanted):
                return


def landmarks(person: str, *indices: int) -> np.ndarray:
    return np.load(SAMPLES / person / "talk2.npz")["landmarks"][list(indices)].astype(float)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with S, S1 of p01 and T of p06, their landmarks, and a clip of 8 frames."""
    folder = tmp_path_factory.mktemp("photos")
    points = landmarks("p01", REST, OPEN)
    for name, rgb, face in zip(("s", "s1"), frames("p01", (REST, OPEN)), points, strict=True):
        save(folder / f"{name}.png", rgb)
        save_annotations(folder / f"{name}.json", face[None])
    (target,) = frames("p06", (0,))
    corner = np.array(CORNER)
    save(folder / "t.png", target[corner[1] :, corner[0] :][:HEIGHT, :WIDTH])
    save_annotations(folder / "t.json", landmarks("p06", 0) - corner)
    cut("p01", folder / "clip.mp4", 8)
    return folder


@pytest.fixture
def here(stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with links to what is stored."""
    monkeypatch.chdir(tmp_path)
    for file in stored.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path


def save(
    path: Path, pixels: np.ndarray, alpha: np.ndarray | None = None, profile: bytes | None = None
) -> None:
    path.write_bytes(encode_deep(DeepImage(pixels, alpha, profile), path.suffix, {}))


KNOWN = ("--landmarks-s", "s.json", "--landmarks-s1", "s1.json", "--landmarks-t", "t.json")
IMAGE = ("image", "s.png", "s1.png", "t.png", *KNOWN, "-o", "out.png")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `guise analogy`."""
    code = main(["analogy", *arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def refused(capsys: pytest.CaptureFixture[str], here: Path, *arguments: str) -> str:
    """The sentence by which a command line is refused; it leaves nothing behind."""
    before = sorted(here.iterdir())
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert sorted(here.iterdir()) == before
    return err.splitlines()[-1]


def mouth(pixels: np.ndarray, points: np.ndarray) -> np.ndarray:
    low, high = points[LIPS].min(0).astype(int), points[LIPS].max(0).astype(int)
    return pixels[low[1] : high[1], low[0] : high[0]]


def test_image_puts_the_expression_on_the_face_and_leaves_the_rest(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, *IMAGE, "--picture", "row.png", "--json")
    assert code == 0
    report = json.loads(out)
    assert (report["width"], report["height"], report["bits"]) == (WIDTH, HEIGHT, 8)
    made, before = read_deep(Path("out.png")).pixels, read_deep(Path("t.png")).pixels
    points = landmarks("p06", 0)[0] - CORNER
    assert np.abs(mouth(made, points).astype(int) - mouth(before, points)).mean() > 5
    np.testing.assert_array_equal(made[:20], before[:20])
    for file in ("out.png", "row.png"):
        assert b"compositeWithTrainedAlgorithmicMedia" in Path(file).read_bytes()
    row = read_deep(Path("row.png")).pixels
    assert row.shape[1] > 2 * 640 * HEIGHT / 480 + 2 * WIDTH
    assert not list(here.glob("*.part"))


@pytest.mark.slow
def test_without_files_the_landmarks_are_found(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "image", "s.png", "s1.png", "t.png", "-o", "out.webp")
    assert (code, err) == (0, "")
    assert out.startswith("out.webp: 311 x 419, tents;")
    given = run(capsys, *IMAGE[:-1], "known.webp")
    assert given[0] == 0
    found, known = (read_deep(Path(name)).pixels.astype(int) for name in ("out.webp", "known.webp"))
    assert np.abs(found - known).mean() < 3


@pytest.mark.slow
def test_methods_and_strengths_differ(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = {"a": (), "b": ("--method", "ratio"), "c": ("--method", "warp"), "d": ("--open-mouth", "none")}
    for name, more in {**options, "zero": ("--strength", "0")}.items():
        assert run(capsys, *IMAGE[:-1], f"{name}.png", *more)[0] == 0
    made = [read_deep(Path(f"{name}.png")).pixels.astype(int) for name in options]
    assert min(np.abs(x - y).max() for x, y in itertools.combinations(made, 2)) > 20
    zero, target = (read_deep(Path(f"{name}.png")).pixels.astype(int) for name in ("zero", "t"))
    assert np.abs(zero - target).max() <= 1


def test_depth_alpha_and_profile_of_t_are_kept(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rgb = read_deep(Path("t.png")).pixels.astype(np.uint16) * 257 + 3
    alpha = np.arange(rgb[..., 0].size, dtype=np.uint32).reshape(rgb.shape[:2]).astype(np.uint16)
    save(here / "deep.tif", rgb, alpha, srgb())
    assert run(capsys, *IMAGE[:3], "deep.tif", *KNOWN, "-o", "out.tif")[0] == 0
    made = read_deep(Path("out.tif"))
    assert (made.bits, made.profile) == (16, srgb())
    np.testing.assert_array_equal(made.alpha, alpha)
    np.testing.assert_array_equal(made.pixels[:20], rgb[:20])
    code, _, err = run(capsys, *IMAGE[:3], "deep.tif", *KNOWN, "-o", "out.jpg")
    assert code == 0
    assert "out.jpg does not keep transparency and 16 bits per component" in err


def test_a_grey_photo_stays_grey(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(here / "grey.png", read_deep(Path("t.png")).pixels[..., 1])
    save(here / "grey_s.png", read_deep(Path("s.png")).pixels[..., 1])
    assert run(capsys, "image", "grey_s.png", "s1.png", "grey.png", *KNOWN, "-o", "out.png")[0] == 0
    assert read_deep(Path("out.png")).pixels.shape == (HEIGHT, WIDTH)


def test_a_turned_photo_is_used_as_it_is_shown(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lying = np.rot90(cv2.imread("t.png"))
    exif = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"  # turn clockwise to see it
    _, data = cv2.imencodeWithMetadata(
        ".png", lying, [cv2.IMAGE_METADATA_EXIF], [np.frombuffer(exif, np.uint8)], []
    )
    (here / "lying.png").write_bytes(data.tobytes())
    assert run(capsys, *IMAGE)[0] == 0
    assert run(capsys, *IMAGE[:3], "lying.png", *KNOWN, "-o", "turned.png")[0] == 0
    np.testing.assert_array_equal(*(read_deep(Path(name)).pixels for name in ("out.png", "turned.png")))


@cache
def srgb() -> bytes:
    from PIL import ImageCms

    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def swapped() -> bytes:
    """A profile by which red is called green, and green red."""
    return srgb().replace(b"rXYZ", b"?XYZ").replace(b"gXYZ", b"rXYZ").replace(b"?XYZ", b"gXYZ")


def test_other_colours_of_s_are_seen_as_they_are_meant(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, *IMAGE)[0] == 0
    for name in ("s", "s1"):
        save(here / f"{name}_p.png", read_deep(Path(f"{name}.png")).pixels[..., [1, 0, 2]], None, swapped())
    arguments = ("image", "s_p.png", "s1_p.png", "t.png", *KNOWN, "-o", "p.png")
    assert run(capsys, *arguments)[0] == 0
    as_meant, as_stored = (read_deep(Path(name)).pixels.astype(int) for name in ("p.png", "out.png"))
    assert np.abs(as_meant - as_stored).max() <= 8
    assert read_deep(Path("p.png")).profile is None


def test_a_profile_that_cannot_be_used_is_said(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = srgb()[:200].ljust(len(srgb()), b"\0")
    save(here / "s_p.tif", read_deep(Path("s.png")).pixels, None, broken)
    code, _, err = run(capsys, "image", "s_p.tif", "s1.png", "t.png", *KNOWN, "-o", "out.png")
    assert code == 0
    assert "s_p.tif: its colour profile cannot be used" in err


def test_of_two_faces_the_larger_one_is_taken(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    large, small = read_deep(Path("t.png")).pixels, read_deep(Path("s.png")).pixels[::2, ::2]
    both = np.full((HEIGHT, WIDTH + small.shape[1], 3), 128, np.uint8)
    both[:, :WIDTH], both[: small.shape[0], WIDTH:] = large, small
    save(here / "both.png", both)
    code, _, err = run(capsys, *IMAGE[:3], "both.png", *KNOWN[:4], "-o", "out.png")
    assert (code, err) == (
        0,
        "both.png shows 2 faces; using the largest; choose another with --landmarks-t\n",
    )
    made = read_deep(Path("out.png")).pixels
    np.testing.assert_array_equal(made[:, WIDTH:], both[:, WIDTH:])
    assert (made[:, :WIDTH] != large).any()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["s.png", "s1.png", "empty.png", "-o", "o.png"],
            "no face found in empty.png: use a photo that shows one upright and from the front, or give its landmarks "
            "with --landmarks-t",
        ),
        (
            ["tiny.png", "s1.png", "t.png", "-o", "o.png", "--landmarks-s", "tiny.json"],
            "the face in tiny.png is too small, 14 pixels between the outer eye corners instead of at least 24: use a "
            "larger picture of it",
        ),
        (
            ["s.png", "missing.png", "t.png", "-o", "o.png"],
            "missing.png cannot be read (No such file or directory): ",
        ),
        (["s.png", "s1.png", "text.png", "-o", "o.png"], "text.png is not an image that can be read: "),
        (
            ["s.png", "s1.png", "t.png", "-o", "t.png", "--force"],
            "t.png would be overwritten, t.png is an input: ",
        ),
        (["s.png", "s1.png", "t.png", "-o", "text.png"], "text.png exists: use --force to replace it, "),
        (
            ["s.png", "s1.png", "t.png", "-o", "nowhere/o.png"],
            "nowhere/o.png cannot be written, there is no folder ",
        ),
        (
            ["s.png", "s1.png", "t.png", "-o", "o.mp4"],
            "o.mp4 must be a picture: name it .png, .jpg, .heic, .avif, .tif or .webp",
        ),
        (
            ["s.png", "s1.png", "t.png", "-o", "o.png", "--picture", "o.png"],
            "o.png would be overwritten, two outputs have that name: ",
        ),
        (
            ["s.png", "s1.png", "t.png", "-o", "o.png", "--landmarks-t", "many.npz"],
            "many.npz contains landmarks of 3 frames: give --landmarks-t a file for the photo alone",
        ),
        (
            ["s.png", "s1.png", "t.png", "-o", "o.png", "--landmarks-t", "s.json"],
            "the face in t.png is cut off, or its landmarks belong to another picture: ",
        ),
        (["s.png", "s1.png", "t.png", "-o", "o.png", "--strength", "3"], "Invalid value for '--strength'"),
    ],
)
@pytest.mark.slow
def test_a_mistake_about_images_is_one_sentence(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    save(here / "empty.png", np.full((200, 300, 3), 120, np.uint8))
    save(here / "tiny.png", cv2.resize(read_deep(Path("s.png")).pixels, None, fx=0.12, fy=0.12))
    save_annotations(here / "tiny.json", landmarks("p01", REST) * 0.12)
    save_annotations(here / "many.npz", landmarks("p01", 0, 1, 2))
    (here / "text.png").write_text("no picture")
    assert refused(capsys, here, "image", *arguments).startswith(f"error: {sentence}")


def head(degrees: float) -> np.ndarray:
    """Landmarks of the canonical head, 160 pixels wide, turned to the image right."""
    frame = ReferenceFrame.canonical(160)
    x, y = (frame.points - frame.points.mean(0)).T
    angle, z = np.radians(degrees), np.degrees(frame.yaw_mode[:, 0])
    return np.column_stack([x * np.cos(angle) + z * np.sin(angle), y]) + 150


def test_faces_that_cannot_be_used_are_told_apart() -> None:
    require_usable(head(0), 300, 300, "a.png", "--landmarks-s")
    require_usable(head(-25), 300, 300, "a.png", "--landmarks-s")
    with pytest.raises(
        PhotoError, match=r"the head in a\.png is turned \d\d degrees to the side, more than the 35"
    ):
        require_usable(head(45), 300, 300, "a.png", "--landmarks-s")
    with pytest.raises(PhotoError, match=r"the face in a\.png is cut off"):
        require_usable(head(0), 180, 300, "a.png", "--landmarks-s")
    with pytest.raises(PhotoError, match=r"the face in a\.png is too small, \d\d pixels"):
        require_usable(head(0) / 6, 300, 300, "a.png", "--landmarks-s")


@pytest.mark.parametrize("degrees", [-25, -10, 0, 10, 25])
def test_turns_are_measured(degrees: float) -> None:
    assert head_angles(head(degrees)) == pytest.approx((degrees, 0), abs=2)


def test_two_people_and_turned_heads_are_said() -> None:
    def photo(points: np.ndarray, name: str) -> Photo:
        return Photo(Path(name), DeepImage(np.zeros((9, 9, 3), np.uint8)), points)

    rest, smile = landmarks("p01", REST, OPEN)
    (other,) = landmarks("p02", REST)
    assert shape_distance(rest, smile) < PHOTO_LIMITS.max_shape_distance < shape_distance(rest, other)
    assert quality_warnings(photo(rest, "s"), photo(smile, "s1"), photo(rest, "t")) == []
    (said,) = quality_warnings(photo(rest, "s"), photo(other, "s1"), photo(rest, "t"))
    assert said.startswith("s and s1 do not look like the same person (eyes and nose differ by ")
    (said,) = quality_warnings(photo(head(0), "s"), photo(head(5), "s1"), photo(head(30), "t"))
    assert re.match(r"the heads in s and t are turned \d\d degrees apart: ", said)


def test_a_turn_of_the_head_is_no_expression() -> None:
    frame = ReferenceFrame.canonical(160)
    normaliser = PoseNormaliser(frame.points)
    np.testing.assert_allclose(normaliser(frame.points), frame.points, atol=1e-9)
    turn = 12 * frame.yaw_mode * [1, 0]
    mouth_open = np.zeros((81, 2))
    mouth_open[[*OUTER_LIPS[7:], *INNER_LIPS[5:]], 1] = 15
    expressed = normaliser(1.5 * (frame.points + turn + mouth_open) + 30) - frame.points
    np.testing.assert_allclose(expressed, mouth_open, atol=0.6)
    assert np.abs(turn).max() > 10


def test_the_resting_frame_has_its_mouth_shut() -> None:
    points = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"].astype(float)
    gap = np.linalg.norm(points[:, UPPER_LIP_INNER] - points[:, LOWER_LIP_INNER], axis=1)
    points[:3] = np.nan
    resting = DrivingTrack(points).rest_index
    assert resting >= 3
    assert gap[resting] < np.quantile(gap, 0.4)


ANIMATE = ("animate", "clip.mp4", "t.png", "-o", "out.mp4")


@pytest.mark.slow
def test_animate_keeps_times_and_sound_and_says_what_it_did(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, *ANIMATE, "--json")
    assert code == 0
    report = json.loads(out)
    assert (report["frames"], report["animated"], report["held"]) == (8, 8, 0)
    assert report["neutral"].startswith("frame ")
    assert "extended from 311 x 419 to 312 x 420, as libx264 needs even sizes" in err
    assert tags(Path("out.mp4"))["comment"].startswith("Synthetic face")
    with open_input("clip.mp4") as old, open_input("out.mp4") as new:
        assert (new.width, new.height, new.has_audio) == (312, 420, True)
        assert [f.pts * f.time_base for f in new] == [f.pts * f.time_base for f in old]


@pytest.mark.slow
def test_animate_by_a_photo_and_by_a_model(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "p01.guise").symlink_to(model_file("p01"))
    code, out, _ = run(
        capsys, "animate", "s.png", *ANIMATE[1:], "--source", "p01.guise", "--landmarks-s", "s.json", "--lossless"
    )  # fmt: skip
    assert code == 0
    assert out.startswith("out.mp4: 8 of 8 frames animated, 0 held; neutral is s.png;")
    assert run(capsys, "animate", "s.png", *ANIMATE[1:3], "-o", "b.mp4", "--lossless")[0] == 0
    with open_input("out.mp4") as by_model, open_input("b.mp4") as by_landmarker:
        pairs = [(a.rgb().astype(int), b.rgb()) for a, b in zip(by_model, by_landmarker, strict=True)]
    assert 0 < max(np.abs(a - b).mean() for a, b in pairs) < 3


def with_box(path: Path, frames: slice, box: tuple[slice, slice] = np.s_[:, :]) -> Path:
    """The clip, with a part of the picture covered in some frames."""
    with open_input("clip.mp4") as source, av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30, {"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuv444p"
        for frame in source:
            rgb = frame.rgb()
            if frame.index in range(*frames.indices(8)):
                rgb[box] = 90
            picture = av.VideoFrame.from_ndarray(rgb, "rgb24")
            picture.pts, picture.time_base = frame.index, Fraction(1, 30)
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("hidden", ["everything", "mouth"])
@pytest.mark.slow
def test_a_lost_or_hidden_face_holds_the_expression_and_is_counted(
    here: Path, capsys: pytest.CaptureFixture[str], hidden: str
) -> None:
    middle = int(landmarks("p01", 3)[0, NOSE_BASE, 1])  # of the face, below the nose
    with_box(here / "gap.mp4", slice(3, 6), np.s_[middle:, :] if hidden == "mouth" else np.s_[:, :])
    code, out, _ = run(capsys, "animate", "gap.mp4", "t.png", "-o", "out.mp4", "--lossless", "--json")
    assert code == 0
    report = json.loads(out)
    assert (report["frames"], report["animated"], report["held"]) == (8, 5, 3)
    with open_input("out.mp4") as made:
        pictures = [frame.rgb() for frame in made]
    np.testing.assert_array_equal(pictures[2], pictures[5])
    assert (pictures[2] != pictures[6]).any()


@pytest.mark.slow
def test_before_the_face_is_seen_the_photo_is_itself(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with_box(here / "late.mp4", slice(0, 2))
    assert run(capsys, "animate", "late.mp4", "t.png", "-o", "out.mkv", "--encoder", "ffv1")[0] == 0
    with open_input("out.mkv") as made:
        first = next(iter(made)).rgb()
    photo = read_deep(Path("t.png")).pixels
    assert np.abs(first[:HEIGHT, :WIDTH].astype(int) - photo).mean() < 2  # ffv1 takes 4:2:0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["s.png", "t.png", "-o", "o.mp4"],
            "s.png is a picture, not a clip: use `guise analogy image` for it",
        ),
        (
            ["clip.mp4", "t.png", "-o", "o.png"],
            "o.png has the name of a picture: give the name of a video, such as o.mp4",
        ),
        (
            ["nobody.mp4", "t.png", "-o", "o.mp4"],
            "no face found in the 8 frames of nobody.mp4: use a clip that ",
        ),
        (["clip.mp4", "empty.png", "-o", "o.mp4"], "no face found in empty.png: use a photo that shows one "),
        (
            ["empty.png", "clip.mp4", "t.png", "-o", "o.mp4"],
            "no face found in empty.png: use a photo that shows one ",
        ),
        (
            ["clip.mp4", "t.png", "-o", "clip.mp4", "--force"],
            "clip.mp4 would be overwritten, clip.mp4 is an input: ",
        ),
        (["clip.mp4", "-o", "o.mp4"], "Invalid value: expected CLIP and T, or S, CLIP and T, got 1 files"),
        (["missing.mp4", "t.png", "-o", "o.mp4"], "missing.mp4 does not exist: give a video file, "),
        (
            ["clip.mp4", "t.png", "-o", "o.xyz"],
            "o.xyz does not name a video container: use .mp4, .mov or .mkv.",
        ),
        (
            ["clip.mp4", "t.png", "-o", "o.mp4", "--landmarks", "many.npz"],
            "many.npz must have landmarks for the 8 frames of the video, got 3; give the landmarks of this very video",
        ),
        (
            ["clip.mp4", "t.png", "-o", "o.mp4", "--landmarks", "many.npz", "--source", "p01.guise"],
            "Invalid value: give either --source or --landmarks",
        ),
    ],
)
@pytest.mark.slow
def test_a_mistake_about_clips_is_one_sentence(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    save(here / "empty.png", np.full((200, 300, 3), 120, np.uint8))
    save_annotations(here / "many.npz", landmarks("p01", 0, 1, 2))
    empty_scene(here / "nobody.mp4")
    assert refused(capsys, here, "animate", *arguments).startswith(f"error: {sentence}")
