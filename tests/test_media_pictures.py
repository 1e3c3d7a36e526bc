"""Photos as phones, cameras and browsers write them: told by their content, whole, and written as what they are."""

from __future__ import annotations

import contextlib
import io
import struct
from pathlib import Path
from unittest.mock import patch

import av
import cv2
import numpy as np
import pytest
from heif_files import grid_file
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from guise.app.media import Frame, MediaError, open_input, open_sink
from guise.app.media.boxes import box
from guise.app.media.file_kind import IMAGE_SUFFIXES, kind_of
from guise.app.media.image_writing import encode_deep, lost_in
from guise.app.media.images import DeepImage, read_deep

CASES = Path(__file__).parents[2] / "shared" / "cases" / "media"
TAGS = {"comment": "Synthetic face", "digital_source_type": "http://cv.iptc.org/x"}


def smooth(height: int, width: int, dtype: type = np.uint8, seed: int = 0) -> np.ndarray:
    top = np.iinfo(dtype).max
    noise = np.random.default_rng(seed).uniform(0, 1, (height, width, 3)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 9)
    return (cv2.normalize(blurred, None, 0.05, 0.95, cv2.NORM_MINMAX) * top).astype(dtype)


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Mean difference, in 8-bit levels."""
    assert one.shape == other.shape
    return float(np.abs(one.astype(float) - other).mean()) / (1 if one.dtype == np.uint8 else 257)


@pytest.mark.parametrize("suffix", sorted(IMAGE_SUFFIXES))
def test_every_form_is_written_and_read_whatever_it_is_called(tmp_path: Path, suffix: str) -> None:
    image = smooth(48, 64)
    data = encode_deep(DeepImage(image), suffix, TAGS)
    for name in (f"a{suffix}", "b.mp4", "c"):
        (tmp_path / name).write_bytes(data)
        assert kind_of(tmp_path / name) == "image"
        with open_input(tmp_path / name) as source:
            assert (source.kind, source.width, source.height) == ("image", 64, 48)
            assert apart(next(iter(source)).rgb(), image) < 3
    if suffix not in (".bmp", ".dib", ".j2k"):
        assert b"http://cv.iptc.org/x" in data


@settings(max_examples=25, deadline=None)
@given(
    form=st.sampled_from(["heic", "avif"]), deep=st.booleans(), rows=st.integers(1, 2), columns=st.integers(1, 3),
    cut=st.tuples(st.integers(0, 15), st.integers(0, 15)), turn=st.integers(0, 3), mirror=st.sampled_from([None, 0, 1]),
    edges=st.tuples(*[st.integers(0, 9)] * 4), derived=st.booleans(),
)  # fmt: skip
def test_tiles_are_one_picture(
    form: str, deep: bool, rows: int, columns: int, cut: tuple[int, int], turn: int, mirror: int | None,
    edges: tuple[int, int, int, int], derived: bool,
) -> None:  # fmt: skip
    image = smooth(64 * rows, 64 * columns, np.uint16 if deep else np.uint8)
    tiles = [[image[64 * r :, 64 * c :][:64, :64] for c in range(columns)] for r in range(rows)]
    size = image.shape[0] - cut[0], image.shape[1] - cut[1]
    left, top, right, bottom = edges
    kept = size[1] - left - right, 1, size[0] - top - bottom, 1, left - right, 2, top - bottom, 2
    properties = [box(b"clap", struct.pack(">IIIIiIiI", *kept)), box(b"irot", bytes([turn]))] + (
        [] if mirror is None else [box(b"imir", bytes([mirror]))]
    )
    data = grid_file(tiles, size, form, bits=10 if deep else 8, properties=properties, derived=derived)
    shown = np.rot90(image[top : size[0] - bottom, left : size[1] - right], turn)
    shown = shown if mirror is None else np.flip(shown, mirror)
    read = _read(data, Path("unused.heic"))
    assert apart(read.pixels, shown) < 2
    assert (read.bits, read.depth) == ((16, 10) if deep else (8, None))


def _read(data: bytes, path: Path) -> DeepImage:
    with patch.object(Path, "read_bytes", lambda self: data):
        return read_deep(path)


@settings(max_examples=20, deadline=None)
@given(
    suffix=st.sampled_from([".heic", ".avif", ".jp2"]), deep=st.booleans(), alpha=st.booleans(),
    height=st.integers(32, 80), width=st.integers(32, 80),
)  # fmt: skip
def test_depth_alpha_and_profile_are_kept(
    suffix: str, deep: bool, alpha: bool, height: int, width: int
) -> None:
    dtype = np.uint16 if deep else np.uint8
    cover = smooth(height, width, dtype, seed=1)[..., 0] if alpha else None
    depth = 10 if deep and suffix != ".jp2" else None
    image = DeepImage(smooth(height, width, dtype), cover, _profile(), depth)
    read = _read(encode_deep(image, suffix, TAGS), Path("unused.heic"))
    assert apart(read.pixels, image.pixels) < 3
    assert (read.depth, read.profile) == (image.depth, image.profile)
    assert (read.alpha is None) == (cover is None)
    assert cover is None or read.alpha is None or apart(read.alpha, cover) < 2
    assert lost_in(suffix, image) == []


def _profile() -> bytes:
    from PIL import ImageCms

    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


@pytest.mark.parametrize("code_points", [(9, 16), (12, 13)])
@pytest.mark.parametrize("suffix", [".heic", ".avif"])
def test_wide_and_hdr_colours_are_told_on(suffix: str, code_points: tuple[int, int]) -> None:
    image = DeepImage(smooth(32, 32, np.uint16), depth=10, code_points=code_points)
    assert _read(encode_deep(image, suffix, {}), Path("unused.heic")).code_points == code_points


@pytest.mark.parametrize("transfer", [16, 18])
@pytest.mark.parametrize("suffix", [".heic", ".avif", ".png"])
def test_an_hdr_photo_is_shown_as_sdr_and_stays_hdr(tmp_path: Path, suffix: str, transfer: int) -> None:
    levels = (smooth(48, 64, np.uint16) // 2 + 8000).astype(np.uint16)
    image = DeepImage(levels, depth=10, code_points=(9, transfer))
    (tmp_path / f"a{suffix}").write_bytes(encode_deep(image, suffix, {}))
    with open_input(tmp_path / f"a{suffix}") as source, open_sink(tmp_path / f"b{suffix}", source) as sink:
        frame = next(iter(source))
        before = read_deep(tmp_path / f"a{suffix}")
        assert apart(frame.rgb(), before.rgb8()) == 0
        assert (
            apart(before.rgb8().astype(np.uint16) * 257, before.pixels) > 5
        )  # PQ and HLG are flat as they are
        face = frame.rgb()[10:30, 10:30]
        frame.write_roi(10, 10, np.ascontiguousarray(np.full_like(face, 150)))
        sink.write(frame)
    after = read_deep(tmp_path / f"b{suffix}")
    assert after.code_points == (9, transfer)
    assert apart(after.pixels[32:], before.pixels[32:]) < 2
    assert np.abs(after.rgb8()[14:26, 14:26].astype(int) - 150).mean() < 6


def test_what_an_image_does_not_keep_is_said(tmp_path: Path) -> None:
    rgba = np.dstack([smooth(40, 48, np.uint16), smooth(40, 48, np.uint16, seed=1)[..., 0]])
    assert cv2.imwrite(str(tmp_path / "a.png"), rgba)
    with open_input(tmp_path / "a.png") as source, open_sink(tmp_path / "b.jpg", source) as sink:
        sink.write(next(iter(source)))
        assert source.problems[-1] == (
            "A .jpg file does not keep transparency and 16 bits per component: a .png file does."
        )


def test_heif_files_are_what_other_readers_take_them_for(tmp_path: Path) -> None:
    image = smooth(61, 83)
    cover = smooth(61, 83, seed=1)[..., 0]
    with Image.open(io.BytesIO(encode_deep(DeepImage(image, cover), ".avif", TAGS))) as read:
        pixels = np.asarray(read)
    assert apart(pixels[..., :3], image) < 3
    assert apart(pixels[..., 3], cover) < 2


@pytest.mark.parametrize("suffix", [".heic", ".avif"])
def test_a_damaged_heif_file_is_one_sentence(suffix: str) -> None:
    whole = encode_deep(DeepImage(smooth(48, 64)), suffix, TAGS)
    rng = np.random.default_rng(0)
    for _ in range(40):
        data = bytearray(whole)
        at = int(rng.integers(0, 500))
        data[at : at + 4] = rng.bytes(4)
        for damaged in (bytes(data), whole[: int(rng.integers(20, len(whole)))]):
            with contextlib.suppress(MediaError):
                _read(damaged, Path("unused.heic"))


def test_a_folder_takes_every_picture_and_says_what_it_skips(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    names = ["a.heic", "b.avif", "c.jfif", "d.jp2", "e.tif"]
    for name in names:
        (folder / name).write_bytes(encode_deep(DeepImage(smooth(32, 40)), Path(name).suffix, {}))
    (folder / "f").write_bytes(encode_deep(DeepImage(smooth(32, 40)), ".png", {}))
    (folder / "notes.txt").write_text("about them", encoding="utf-8")
    with open_input(folder) as source, open_sink(tmp_path / "out", source) as sink:
        for frame in source:
            sink.write(frame)
        notes = list(source.problems)
    assert notes == [
        "Skipped notes.txt, which are not single images.",
        "f was written as .png, because f cannot be written.",
    ]
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [*names, "f.png"]
    assert all(read_deep(file).pixels.shape == (32, 40, 3) for file in (tmp_path / "out").iterdir())


@pytest.mark.parametrize(
    ("suffix", "more"),
    [(".tga", {}), (".ppm", {}), (".qoi", {}), (".pcx", {}), (".gif", {}), (".tif", {"compression": "lzma"})],
)
def test_other_forms_are_read_and_not_called_damaged(
    tmp_path: Path, suffix: str, more: dict[str, str]
) -> None:
    image = Image.fromarray(smooth(40, 48)).quantize(64).convert("RGB")
    image.save(tmp_path / f"a{suffix}", **more)
    with open_input(tmp_path / f"a{suffix}") as source:
        assert (source.kind, source.problems) == ("image", [])
        np.testing.assert_array_equal(next(iter(source)).rgb(), np.asarray(image))
        if suffix not in (".gif", ".tif"):
            with pytest.raises(MediaError, match="reads but does not write"):
                open_sink(tmp_path / f"b{suffix}", source)


def test_colours_under_the_alpha_of_a_tiff_are_as_stored(tmp_path: Path) -> None:
    rgba = np.dstack([smooth(40, 48), smooth(40, 48, seed=1)[..., 0]])
    Image.fromarray(rgba).save(tmp_path / "a.tif")
    read = read_deep(tmp_path / "a.tif")
    np.testing.assert_array_equal(read.pixels, rgba[..., :3])
    np.testing.assert_array_equal(read.alpha, rgba[..., 3])


@pytest.mark.parametrize(
    ("made", "called", "kind"),
    [("mkv", "png", "video"), ("avi", "heic", "video"), ("mp4", "heic", "video"), ("png", "mp4", "image")],
)
def test_a_name_that_lies_is_not_believed(tmp_path: Path, made: str, called: str, kind: str) -> None:
    path = tmp_path / f"a.{made}"
    if made == "png":
        Image.fromarray(smooth(40, 48)).save(path)
    else:
        with av.open(str(path), "w") as container:
            stream = container.add_stream("mpeg4" if made == "mp4" else "libx264", 25)
            stream.width, stream.height, stream.pix_fmt = 48, 40, "yuv420p"
            for _ in range(3):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(smooth(40, 48), "rgb24")))
            container.mux(stream.encode(None))
    path = path.rename(tmp_path / f"a.{called}")
    assert kind_of(path) == kind
    with open_input(path) as source:
        assert source.kind == kind


def test_a_sequence_of_a_phone_is_read_as_the_video_that_it_is(tmp_path: Path) -> None:
    held = io.BytesIO()
    with av.open(held, "w", format="mp4") as container:
        stream = container.add_stream("libx265", 10, {"x265-params": "log-level=none"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(4):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(smooth(48, 64, seed=k), "rgb24")))
        container.mux(stream.encode(None))
    start = int.from_bytes(held.getvalue()[:4])
    head = box(b"ftyp", b"hevc", bytes(4), b"msf1", b"hevc", b"mif1")
    (tmp_path / "a.heics").write_bytes(head.ljust(start, b"\0") + held.getvalue()[start:])
    with open_input(tmp_path / "a.heics") as source:
        assert (source.kind, sum(1 for _ in source)) == ("video", 4)


def test_a_gain_map_that_is_left_out_is_said(tmp_path: Path) -> None:
    data = encode_deep(DeepImage(smooth(32, 32)), ".jpg", {})
    mark = b"http://ns.adobe.com/xap/1.0/\0<x xmlns:hdrgm='http://ns.adobe.com/hdr-gain-map/1.0/'/>"
    segment = b"\xff\xe1" + (len(mark) + 2).to_bytes(2) + mark
    (tmp_path / "a.jpg").write_bytes(data[:2] + segment + data[2:])
    with open_input(tmp_path / "a.jpg") as source:
        assert source.problems == ["The HDR gain map of a.jpg was left out: the result is SDR."]


def test_a_camera_raw_picture_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.dng"
    preview = Image.fromarray(smooth(24, 32))
    preview.save(path, "TIFF", tiffinfo={0xC612: b"\1\4\0\0"})
    with pytest.raises(MediaError, match="is a camera's raw picture"):
        open_input(path)


@pytest.mark.parametrize(
    ("kept", "words"), [(0.7, "what cannot be read of it is grey"), (1, "parts of it may be wrong")]
)
def test_a_damaged_jpeg_is_read_as_far_as_it_goes_and_told(tmp_path: Path, kept: float, words: str) -> None:
    data = bytearray(encode_deep(DeepImage(np.repeat(smooth(64, 64), 4, axis=0)), ".jpg", {}))
    if kept == 1:
        data[len(data) // 2 : len(data) // 2 + 500] = bytes(500)
    (tmp_path / "a.jpg").write_bytes(data[: int(kept * len(data))])
    with open_input(tmp_path / "a.jpg") as source:
        assert isinstance(next(iter(source)), Frame)
        assert source.problems == source.problems.damage == [f"a.jpg is damaged: {words}."]


@given(
    mode=st.sampled_from(["RGB", "L", "CMYK"]), progressive=st.booleans(), quality=st.integers(5, 100),
    subsampling=st.integers(0, 2), restart=st.integers(0, 3), size=st.tuples(st.integers(8, 70), st.integers(8, 70)),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_a_whole_jpeg_of_any_kind_is_not_called_damaged(
    mode: str, progressive: bool, quality: int, subsampling: int, restart: int, size: tuple[int, int]
) -> None:
    held = io.BytesIO()
    Image.fromarray(smooth(*size)).convert(mode).save(
        held,
        "JPEG",
        progressive=progressive,
        quality=quality,
        subsampling=subsampling,
        restart_marker_blocks=restart,
    )
    told: list[str] = []
    with patch.object(Path, "read_bytes", lambda self: held.getvalue()):
        read_deep(Path("a.jpg"), told.append)
    assert told == []


@pytest.mark.skipif(not CASES.is_dir(), reason="the files that fail are not here")
@pytest.mark.parametrize(
    ("name", "size"),
    [("photo.heic", (640, 480)), ("photo.avif", (640, 480)), ("photo.jfif", (640, 480)), ("photo.jp2", (640, 480)),
     ("grid.avif", (1280, 960))],
)  # fmt: skip
def test_the_cases_are_pictures_of_their_full_size(name: str, size: tuple[int, int]) -> None:
    with open_input(CASES / name) as source:
        assert (source.kind, source.width, source.height) == ("image", *size)
        assert next(iter(source)).rgb().std() > 20


def test_a_heif_file_of_a_kind_that_is_not_read_is_not_called_damaged() -> None:
    data = grid_file([[smooth(64, 64)]], (64, 64), "heic").replace(b"grid", b"iovl")
    with pytest.raises(MediaError, match="holds a picture of kind 'iovl', which Guise does not read"):
        _read(data, Path("unused.heic"))
