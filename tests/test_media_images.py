"""Images and folders of images as inputs and outputs."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from guise.app.media import EncodeOptions, Frame, MediaError, open_input, open_sink, process
from guise.app.media.image_writing import encode_image
from guise.app.media.images import read_deep

USUAL = EncodeOptions()


def noise(height: int = 15, width: int = 21, channels: int = 3, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels)).astype(np.uint8)


def save(path: Path, image: np.ndarray) -> Path:
    """Write an image with its channels in RGB order."""
    order = [2, 1, 0, 3][: image.shape[2]] if image.ndim == 3 else ...
    assert cv2.imwrite(str(path), image[..., order])
    return path


def load(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image[..., [2, 1, 0, 3][: image.shape[2]]]


def run(
    inp: Path, out: Path, work: Callable[[Frame], None] = lambda frame: None,
    options: EncodeOptions = USUAL, *, force: bool = False, tags: dict[str, str] | None = None,
) -> tuple[str, ...]:  # fmt: skip
    with open_input(inp) as source, open_sink(out, source, options, force=force, tags=tags or {}) as sink:
        return process(source, sink, work).problems


def paint(frame: Frame) -> None:
    frame.write_roi(3, 4, np.full((5, 6, 3), 200, np.uint8))


def painted(image: np.ndarray) -> np.ndarray:
    image = image.copy()
    image[4:9, 3:9, :3] = 200
    return image


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp"])
def test_an_image_is_bit_identical_outside_the_rectangle(tmp_path: Path, suffix: str, channels: int) -> None:
    image = noise(channels=channels)
    if channels == 4:
        image[..., 3] |= 1  # WebP drops colours of transparent pixels
    save(tmp_path / "in.png", image)
    assert run(tmp_path / "in.png", tmp_path / f"out{suffix}", paint) == ()
    np.testing.assert_array_equal(load(tmp_path / f"out{suffix}"), painted(image))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in.png", f"out{suffix}"]


def test_describe_an_image(tmp_path: Path) -> None:
    with open_input(save(tmp_path / "in.png", noise())) as source:
        assert source.describe() == {
            "name": "in.png", "kind": "image", "width": 21, "height": 15, "frame_rate": "30",
            "frame_count": 1, "duration_seconds": 1 / 30, "rotation": 0, "has_audio": False,
        }  # fmt: skip
        frame = next(iter(source))
        assert (frame.pts, frame.index, frame.name) == (0, 0, "in.png")


def test_jpeg_output_is_close_and_refuses_lossless(tmp_path: Path) -> None:
    smooth = cv2.GaussianBlur(noise(64, 64), (0, 0), 6)
    clip = save(tmp_path / "in.png", smooth)
    run(clip, tmp_path / "out.jpg")
    assert np.abs(load(tmp_path / "out.jpg").astype(int) - smooth).mean() < 3
    with pytest.raises(MediaError, match=r"out2.jpg cannot be lossless, as JPEG never is: write to \.png\."):
        run(clip, tmp_path / "out2.jpg", options=EncodeOptions(lossless=True))


def test_exif_orientation_is_applied(tmp_path: Path) -> None:
    image = cv2.GaussianBlur(noise(32, 48), (0, 0), 6)
    save(tmp_path / "in.jpg", image)
    data = (tmp_path / "in.jpg").read_bytes()
    tiff = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"  # orientation 6: turn clockwise
    exif = b"Exif\0\0" + tiff
    (tmp_path / "in.jpg").write_bytes(
        data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]
    )
    with open_input(tmp_path / "in.jpg") as source:
        assert (source.width, source.height) == (32, 48)
        assert np.abs(next(iter(source)).rgb().astype(int) - np.rot90(image, -1)).mean() < 8


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jp2"])
def test_deep_images_stay_deep_where_nothing_is_drawn(tmp_path: Path, suffix: str) -> None:
    deep = np.random.default_rng(1).integers(0, 65536, (35, 41, 3)).astype(np.uint16)
    assert cv2.imwrite(str(tmp_path / "in.png"), deep)
    problems = run(tmp_path / "in.png", tmp_path / f"out{suffix}", paint)
    assert problems == ("in.png has 16 bits per component; faces are drawn with 8.",)
    deep[4:9, 3:9] = 200 * 257
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / f"out{suffix}"), cv2.IMREAD_UNCHANGED), deep)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_tags_are_in_the_file_and_harmless(suffix: str) -> None:
    data = encode_image(noise(), None, suffix, {"comment": "synthetic face é"})
    assert "synthetic face é".encode() in data
    plain = encode_image(noise(), None, suffix, {})
    decode = [cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR) for content in (data, plain)]
    np.testing.assert_array_equal(*decode)


def make_folder(tmp_path: Path, names: list[str]) -> Path:
    folder = tmp_path / "in"
    folder.mkdir()
    for seed, name in enumerate(names):
        save(folder / name, noise(16, 22, seed=seed))
    return folder


def test_a_folder_is_read_in_natural_order_and_written_with_its_names(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["f2.png", "f10.png", "F1.png"])
    (folder / "notes.txt").write_text("not an image")
    (folder / ".hidden.png").write_bytes(b"")
    with open_input(folder) as source:
        assert [frame.name for frame in source] == ["F1.png", "f2.png", "f10.png"]
        assert source.kind == "images"
        assert source.frame_count == 3
    run(folder, tmp_path / "out", paint)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["F1.png", "f10.png", "f2.png"]
    for seed, name in enumerate(["f2.png", "f10.png", "F1.png"]):
        np.testing.assert_array_equal(load(tmp_path / "out" / name), painted(noise(16, 22, seed=seed)))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in", "out"]


def test_a_folder_becomes_a_video(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["a.png", "b.png", "c.png"])
    run(folder, tmp_path / "out.mkv", options=EncodeOptions(encoder="ffv1"))
    with av.open(str(tmp_path / "out.mkv")) as result:
        frames = list(result.decode(video=0))
        assert [(frame.width, frame.height) for frame in frames] == [(22, 16)] * 3
        assert (frames[0].colorspace, frames[0].color_range) == (1, 1)


def test_an_image_that_cannot_be_read_is_skipped_and_reported(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["a.png", "b.png"])
    (folder / "aa.png").write_bytes(b"broken")
    problems = run(folder, tmp_path / "out")
    assert problems == (
        "aa.png is not an image that can be read: give a PNG, JPEG, HEIC, AVIF, TIFF or WebP file; it was skipped.",
    )
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["a.png", "b.png"]


def test_images_of_several_sizes_keep_them_in_a_folder_but_make_no_video(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["a.png"])
    save(folder / "b.png", noise(9, 33))
    run(folder, tmp_path / "out")
    assert load(tmp_path / "out" / "b.png").shape == (9, 33, 3)
    with pytest.raises(MediaError, match=r"Frame b.png has 33 x 9 pixels but the video 22 x 16"):
        run(folder, tmp_path / "out.mp4")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in", "out"]


def test_an_existing_folder_needs_force_and_keeps_other_files(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["a.png", "b.png"])
    out = tmp_path / "out"
    out.mkdir()
    run(folder, out)  # an empty folder is free
    (out / "diary.txt").write_text("mine")
    with pytest.raises(MediaError, match="out exists: use --force to replace it"):
        run(folder, out, paint)
    run(folder, out, paint, force=True)
    np.testing.assert_array_equal(load(out / "a.png"), painted(noise(16, 22, seed=0)))
    assert (out / "diary.txt").read_text() == "mine"
    with pytest.raises(MediaError, match="is the input itself"):
        run(folder, folder, force=True)


def test_an_error_leaves_no_folder(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["a.png", "b.png"])

    def work(frame: Frame) -> None:
        if frame.index == 1:
            raise KeyboardInterrupt

    for name in ("out", "out.mp4"):
        with pytest.raises(KeyboardInterrupt):
            run(folder, tmp_path / name, work)
    assert list(tmp_path.iterdir()) == [folder]


def test_one_image_output_takes_one_image(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, ["a.png", "b.png"])
    with pytest.raises(
        MediaError, match=r"out.png is one image but in is not: write to out.webp, which moves"
    ):
        run(folder, tmp_path / "out.png")
    lossy = save(folder / "c.jpg", noise())
    with pytest.raises(MediaError, match=r"c\.jpg cannot be written lossless"):
        run(folder, tmp_path / "out", options=EncodeOptions(lossless=True))
    assert lossy.exists()
    assert list(tmp_path.iterdir()) == [folder]


def test_a_header_of_a_picture_too_large_to_read_is_a_sentence(tmp_path: Path) -> None:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    parts = [chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(bytes(99))), chunk(b"IEND", b"")]
    (tmp_path / "large.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    with pytest.raises(MediaError, match=r"large\.png is not an image that can be read, or too large"):
        read_deep(tmp_path / "large.png")
