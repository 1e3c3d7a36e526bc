"""Images with all that their files can hold: depth, alpha, orientation and colour profile."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from guise.app.media import MediaError
from guise.app.media.ifd import PROFILE, XMP, read_short, read_values, with_values
from guise.app.media.image_writing import encode_deep, lost_in
from guise.app.media.images import DeepImage, read_deep

RNG = np.random.default_rng(0)
TAGS = {"comment": "Synthetic face", "digital_source_type": "http://cv.iptc.org/x"}


def profile(space: bytes = b"RGB ", size: int = 600) -> bytes:
    """What libraries take for an ICC profile at first sight."""
    head = struct.pack(">I4s4s4s4s4s", size, b"lcms", b"\x04\x40\0\0", b"mntr", space, b"XYZ ")
    return (head + bytes(12) + b"acsp" + bytes(28) + b"\0\0\xf6\xd6\0\1\0\0\0\0\xd3\x2d").ljust(size, b"\0")


def picture(dtype: type, shape: tuple[int, ...]) -> np.ndarray:
    top = np.iinfo(dtype).max
    return cv2.GaussianBlur(RNG.integers(1, top, shape).astype(dtype), (0, 0), 3)


def written(path: Path, image: DeepImage) -> DeepImage:
    path.write_bytes(encode_deep(image, path.suffix, TAGS))
    return read_deep(path)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("alpha", [False, True])
def test_png_and_tiff_keep_everything(tmp_path: Path, suffix: str, dtype: type, alpha: bool) -> None:
    cover = picture(dtype, (19, 27)) if alpha else None
    image = DeepImage(picture(dtype, (19, 27, 3)), cover, profile(size=80_000 if suffix == ".tif" else 600))
    read = written(tmp_path / f"a{suffix}", image)
    np.testing.assert_array_equal(read.pixels, image.pixels)
    np.testing.assert_array_equal(read.alpha, cover) if alpha else None
    assert (read.bits, read.alpha is None) == (image.bits, not alpha)
    assert lost_in(suffix, image) == []
    assert b"http://cv.iptc.org/x" in (tmp_path / f"a{suffix}").read_bytes()


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_stays_grey(tmp_path: Path, suffix: str, dtype: type) -> None:
    read = written(tmp_path / f"a{suffix}", DeepImage(picture(dtype, (19, 27))))
    assert read.pixels.shape == (19, 27)
    assert read.bits == (8 if suffix == ".jpg" else np.iinfo(dtype).bits)
    assert read.rgb8().shape == (19, 27, 3)


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".webp"])
def test_long_profiles_are_carried(tmp_path: Path, suffix: str) -> None:
    image = DeepImage(picture(np.uint8, (19, 27, 3)), None, profile(size=200_000))
    assert written(tmp_path / f"a{suffix}", image).profile == image.profile


def test_a_profile_for_another_kind_of_picture_is_left_out(tmp_path: Path) -> None:
    for space, kept in ((b"GRAY", False), (b"CMYK", False), (b"RGB ", True)):
        image = DeepImage(picture(np.uint8, (19, 27, 3)), None, profile(space))
        assert (written(tmp_path / "a.tif", image).profile is not None) == kept


@pytest.mark.parametrize(
    ("suffix", "lost"),
    [
        (".png", []),
        (".webp", ["16 bits per component"]),
        (".jpg", ["transparency", "16 bits per component"]),
        (".bmp", ["16 bits per component", "colour profile"]),
    ],
)
def test_what_a_format_loses_is_said_and_true(tmp_path: Path, suffix: str, lost: list[str]) -> None:
    image = DeepImage(picture(np.uint16, (19, 27, 3)), picture(np.uint16, (19, 27)), profile())
    assert lost_in(suffix, image) == lost
    read = written(tmp_path / f"a{suffix}", image)
    assert (read.bits == 8) == ("16 bits per component" in lost)
    assert (read.alpha is None) == ("transparency" in lost)


def oriented(path: Path, orientation: int, stored: np.ndarray) -> Path:
    """A file with an EXIF orientation."""
    tiff = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0" + bytes([orientation]) + bytes(6)
    block = [np.frombuffer(tiff, np.uint8)]
    done, data = cv2.imencodeWithMetadata(path.suffix, stored, [cv2.IMAGE_METADATA_EXIF], block, [])
    assert done
    path.write_bytes(data.tobytes())
    return path


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_as_opencv_shows_it_also_with_alpha(tmp_path: Path, orientation: int) -> None:
    stored = picture(np.uint16, (19, 27, 4))
    path = oriented(tmp_path / "a.png", orientation, stored)
    shown = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    image = read_deep(path)
    np.testing.assert_array_equal(image.pixels, shown[..., ::-1])
    plain = oriented(tmp_path / "b.png", orientation, np.repeat(stored[..., 3:], 3, axis=2))
    np.testing.assert_array_equal(image.alpha, read_deep(plain).pixels[..., 0])


def test_tags_of_a_tiff_are_added_to_those_it_has() -> None:
    done, data = cv2.imencode(".tif", picture(np.uint16, (19, 27, 3)))
    assert done
    before = read_values(data.tobytes())
    after = with_values(data.tobytes(), {PROFILE: profile(), XMP: b"<x:xmpmeta/>"})
    assert read_values(after) == before | {PROFILE: profile(), XMP: b"<x:xmpmeta/>"}
    assert read_short(after, 256) == 27
    assert read_values(after[:60]) == {}
    assert read_values(b"no tiff") == {}


def test_what_is_no_picture_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "empty.png").write_bytes(b"")
    cv2.imwrite(str(tmp_path / "float.tif"), np.zeros((9, 9, 3), np.float32))
    for name, words in (("text", "is not an image"), ("empty", "is not an image")):
        with pytest.raises(MediaError, match=words):
            read_deep(tmp_path / f"{name}.png")
    with pytest.raises(MediaError, match="neither grey nor RGB of 8 or 16 bits"):
        read_deep(tmp_path / "float.tif")
    with pytest.raises(MediaError, match=r"cannot be read \(No such file"):
        read_deep(tmp_path / "missing.png")
