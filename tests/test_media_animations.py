"""Animated pictures and pages: every picture in and out, with its delay, and the loop."""

from __future__ import annotations

import io
import tempfile
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms

from guise.app.media import EncodeOptions, MediaError, open_input, open_sink
from guise.app.media.images import read_deep
from guise.app.media.picture_inputs import AnimationInput

CASES = Path(__file__).parents[2] / "shared" / "cases" / "media"
TAGS = {"comment": "Synthetic face", "digital_source_type": "http://cv.iptc.org/x"}
USUAL = EncodeOptions()
UNITS = {".gif": 10, ".webp": 1, ".png": 1, ".avif": 1}  # milliseconds


def pictures(count: int, size: tuple[int, int] = (96, 64), seed: int = 0) -> list[np.ndarray]:
    noise = np.random.default_rng(seed).uniform(0, 255, (count, size[1], size[0], 3)).astype(np.float32)
    return [
        cv2.normalize(cv2.GaussianBlur(one, (0, 0), 12), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        for one in noise
    ]


def save(path: Path, frames: list[np.ndarray], delays: list[int], loop: int = 0, **more: object) -> None:
    """An animation by Pillow; the alpha of frames (h, w, 4) is kept."""
    shown = [Image.fromarray(frame) for frame in frames]
    shown[0].save(path, save_all=True, append_images=shown[1:], duration=delays, loop=loop, **more)


def read(path: Path) -> tuple[list[float], list[np.ndarray], object]:
    """Delays in milliseconds, RGBA pictures and the loop of an animation, by Pillow."""
    with Image.open(path) as file:
        found = []
        for number in range(file.n_frames):
            file.seek(number)
            file.load()
            found.append((file.info["duration"], np.asarray(file.convert("RGBA"))))
        return [delay for delay, _ in found], [rgba for _, rgba in found], file.info.get("loop")


def pass_on(inp: Path, out: Path, options: EncodeOptions = USUAL) -> list[str]:
    with open_input(inp) as source, open_sink(out, source, options, tags=TAGS) as sink:
        for frame in source:
            sink.write(frame)
        return list(source.problems)


@settings(max_examples=15, deadline=None)
@given(
    source=st.sampled_from([".gif", ".webp", ".png", ".avif"]), target=st.sampled_from(list(UNITS)),
    delays=st.lists(st.integers(2, 60), min_size=2, max_size=5), loop=st.sampled_from([0, 1, 3]), twice=st.booleans(),
)  # fmt: skip
def test_pictures_delays_and_loop_pass(
    source: str, target: str, delays: list[int], loop: int, twice: bool
) -> None:
    delays = [10 * delay for delay in delays]
    frames = pictures(len(delays))
    with tempfile.TemporaryDirectory() as name:
        inp, out = Path(name, f"in{source}"), Path(name, f"out{target}")
        save(inp, frames, delays, loop)
        if twice:  # shown before already: no encoder may leave it out
            with open_input(inp) as media, open_sink(Path(name, f"twice{target}"), media) as sink:
                held = [frame.copy() for frame in media]
                last = held[-1].copy()
                last.pts += last.duration or held[-1].duration
                last.duration = held[-1].duration
                for frame in [*held, last]:
                    sink.write(frame)
            inp, delays, frames = Path(name, f"twice{target}"), [*delays, delays[-1]], [*frames, frames[-1]]
        assert pass_on(inp, out) == []
        with open_input(inp) as media:
            assert isinstance(media, AnimationInput)
            assert (media.kind, media.frame_count) == ("video", len(delays))
        found, shown, kept = read(out)
        assert found == pytest.approx(delays, abs=1)
        for one, other in zip(shown, frames, strict=True):
            assert np.abs(one[..., :3].astype(int) - other).mean() < 6
        if source != ".avif" and target != ".avif" and not twice:
            played = loop + 1 if source == ".gif" and loop else loop
            repeats = played - 1 if played > 1 else None if played else 0
            assert kept == (repeats if target == ".gif" else played)
        assert b"http://cv.iptc.org/x" in out.read_bytes()


@pytest.mark.parametrize("target", [".png", ".webp", ".gif"])
@pytest.mark.parametrize("source", [".png", ".webp", ".gif"])
def test_transparency_passes(tmp_path: Path, source: str, target: str) -> None:
    cover = np.zeros((64, 96), np.uint8)
    cover[20:40, 30:70] = 255
    frames = [np.dstack([rgb, np.roll(cover, 5 * k, axis=1)]) for k, rgb in enumerate(pictures(3))]
    save(tmp_path / f"in{source}", frames, [100] * 3, disposal=2)
    assert pass_on(tmp_path / f"in{source}", tmp_path / f"out{target}") == []
    _, shown, _ = read(tmp_path / f"out{target}")
    for one, other in zip(shown, frames, strict=True):
        np.testing.assert_array_equal(one[..., 3] > 127, other[..., 3] > 127)


def test_avif_says_that_it_keeps_no_transparency(tmp_path: Path) -> None:
    frames = [np.dstack([rgb, np.full(rgb.shape[:2], 99, np.uint8)]) for rgb in pictures(2)]
    save(tmp_path / "in.png", frames, [100, 100])
    assert pass_on(tmp_path / "in.png", tmp_path / "out.avif") == [
        "A .avif file does not keep transparency: a .png or .webp file does."
    ]


def test_avif_refuses_what_its_encoder_cannot_take(tmp_path: Path) -> None:
    save(tmp_path / "in.webp", pictures(2, (400, 20)), [100, 100])
    with pytest.raises(MediaError, match=r"at least 64 pixels a side, not 400 x 20: write to \.webp"):
        pass_on(tmp_path / "in.webp", tmp_path / "out.avif")
    assert [file.name for file in tmp_path.iterdir()] == ["in.webp"]


@pytest.mark.parametrize("target", [".png", ".webp", ".gif", ".avif"])
def test_the_colour_profile_is_kept_or_said_to_be_lost(tmp_path: Path, target: str) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    save(tmp_path / "in.webp", pictures(2), [100, 100], icc_profile=profile)
    notes = pass_on(tmp_path / "in.webp", tmp_path / f"out{target}")
    with Image.open(tmp_path / f"out{target}") as made:
        assert made.n_frames == 2
        kept = made.info.get("icc_profile") == profile
    lost = f"A {target} file does not keep the colour profile: a .png or .webp file does."
    assert (kept, notes) == ((True, []) if target in (".png", ".webp") else (False, [lost]))


def video(path: Path, rate: int, count: int, *, sound: bool = False) -> list[np.ndarray]:
    frames = pictures(count)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate, {"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        audio = container.add_stream("aac", 48000) if sound else None
        for rgb in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, "rgb24")))
        container.mux(stream.encode(None))
        if audio is not None:
            tone = av.AudioFrame.from_ndarray(np.zeros((1, 4800), np.float32), "fltp", "mono")
            tone.sample_rate, tone.pts = 48000, 0
            container.mux([*audio.encode(tone), *audio.encode(None)])
    return frames


@pytest.mark.parametrize("suffix", [".gif", ".webp", ".avif", ".apng"])
@pytest.mark.parametrize("rate", [24, 30])
def test_a_video_becomes_an_animation_of_the_same_length(tmp_path: Path, suffix: str, rate: int) -> None:
    frames = video(tmp_path / "in.mp4", rate, 7, sound=True)
    notes = pass_on(tmp_path / "in.mp4", tmp_path / f"out{suffix}")
    assert notes == [f"A {suffix} file holds no sound: the audio was left out."]
    delays, shown, _ = read(tmp_path / f"out{suffix}")
    assert len(shown) == 7
    assert sum(delays) == pytest.approx(7000 / rate, abs=10)
    assert all(np.abs(a[..., :3].astype(int) - b).mean() < 8 for a, b in zip(shown, frames, strict=True))


def test_gif_leaves_out_what_players_would_slow_down(tmp_path: Path) -> None:
    video(tmp_path / "in.mp4", 60, 12)
    assert pass_on(tmp_path / "in.mp4", tmp_path / "out.gif") == [
        "A .gif file shows at most 50 pictures a second: the rest was left out."
    ]
    delays = read(tmp_path / "out.gif")[0]
    assert min(delays) >= 20
    assert sum(delays) == pytest.approx(200, abs=10)


def test_lossless_is_lossless_or_refused(tmp_path: Path) -> None:
    frames = pictures(3)
    save(tmp_path / "in.png", frames, [40] * 3)
    lossless = EncodeOptions(lossless=True)
    for suffix in (".webp", ".png"):
        pass_on(tmp_path / "in.png", tmp_path / f"out{suffix}", lossless)
        np.testing.assert_array_equal([rgba[..., :3] for rgba in read(tmp_path / f"out{suffix}")[1]], frames)
    for suffix in (".gif", ".avif"):
        with pytest.raises(MediaError, match="cannot be lossless"):
            pass_on(tmp_path / "in.png", tmp_path / f"out{suffix}", lossless)


def test_an_animation_becomes_a_video_with_its_times(tmp_path: Path) -> None:
    save(tmp_path / "in.webp", pictures(4), [40, 200, 80, 120])
    assert pass_on(tmp_path / "in.webp", tmp_path / "out.mp4") == []
    with open_input(tmp_path / "out.mp4") as media:
        assert [frame.pts * frame.time_base for frame in media] == [
            0,
            Fraction(1, 25),
            Fraction(6, 25),
            Fraction(8, 25),
        ]
    with pytest.raises(MediaError, match=r"out\.jpg is one image but in\.webp is not"):
        pass_on(tmp_path / "in.webp", tmp_path / "out.jpg")


@pytest.mark.parametrize("suffix", [".gif", ".png", ".webp"])
def test_one_picture_is_an_image_though_the_form_can_move(tmp_path: Path, suffix: str) -> None:
    Image.fromarray(pictures(1)[0]).save(tmp_path / f"in{suffix}")
    with open_input(tmp_path / f"in{suffix}") as media:
        assert media.kind == "image"
    assert pass_on(tmp_path / f"in{suffix}", tmp_path / f"out{suffix}") == []


@pytest.mark.parametrize("suffix", [".gif", ".png", ".webp"])
def test_a_cut_animation_says_what_is_missing(tmp_path: Path, suffix: str) -> None:
    save(tmp_path / f"whole{suffix}", pictures(6), [100] * 6)
    data = (tmp_path / f"whole{suffix}").read_bytes()
    (tmp_path / f"in{suffix}").write_bytes(data[: len(data) * 2 // 3])
    if suffix == ".webp":  # which is read as a whole
        with pytest.raises(MediaError, match="is damaged: none of its pictures can be read"):
            open_input(tmp_path / "in.webp")
        return
    with open_input(tmp_path / f"in{suffix}") as media:
        count = sum(1 for _ in media)
        assert 0 < count < 6
        assert any(f"is damaged after {count} of its" in problem for problem in media.problems)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_pages_of_a_tiff_stay_pages_and_previews_are_none(tmp_path: Path, dtype: type) -> None:
    rng = np.random.default_rng(0)
    pages = [rng.integers(0, np.iinfo(dtype).max, (h, 40, 3)).astype(dtype) for h in (30, 30, 50)]
    assert cv2.imwritemulti(str(tmp_path / "in.tif"), pages)
    pass_on(tmp_path / "in.tif", tmp_path / "out.tif")
    done, found = cv2.imreadmulti(str(tmp_path / "out.tif"), flags=cv2.IMREAD_UNCHANGED)
    assert done
    for page, same in zip(pages, found, strict=True):
        np.testing.assert_array_equal(page, same)
    pass_on(tmp_path / "in.tif", tmp_path / "folder")
    assert len(list((tmp_path / "folder").iterdir())) == 3
    preview = io.BytesIO()
    Image.fromarray(pictures(1)[0]).save(
        preview, "TIFF", save_all=True, append_images=[Image.new("RGB", (12, 8))], tiffinfo={}
    )
    data = bytearray(preview.getvalue())
    (tmp_path / "two.tif").write_bytes(data)
    with open_input(tmp_path / "two.tif") as media:
        assert (media.kind, media.frame_count) == ("images", 2)


def test_pages_in_other_colours_are_converted_or_refused_and_not_called_damaged(tmp_path: Path) -> None:
    first, second = (Image.fromarray(rgb) for rgb in pictures(2))
    cyan = [picture.convert("CMYK") for picture in (first, second)]
    cyan[0].save(tmp_path / "one.tif")
    cyan[0].save(tmp_path / "two.tif", save_all=True, append_images=cyan[1:])
    np.testing.assert_array_equal(read_deep(tmp_path / "one.tif").pixels, np.asarray(first))
    with open_input(tmp_path / "two.tif") as media:
        for frame, picture in zip(media, (first, second), strict=True):
            np.testing.assert_array_equal(frame.rgb(), np.asarray(picture))
            assert frame.opacity() is None
    deep = [np.asarray(first), np.zeros((9, 9), np.float32)]
    assert cv2.imwritemulti(str(tmp_path / "float.tif"), deep)
    with open_input(tmp_path / "float.tif") as media, pytest.raises(MediaError, match="Page 2 of float"):
        list(media)


def test_views_of_a_stereo_camera_are_kept_and_previews_are_none(tmp_path: Path) -> None:
    left, right = (Image.fromarray(rgb) for rgb in pictures(2))
    left.save(
        tmp_path / "in.mpo", save_all=True, append_images=[right, Image.new("RGB", (20, 10))], quality=95
    )
    assert pass_on(tmp_path / "in.mpo", tmp_path / "out.mpo") == []
    with Image.open(tmp_path / "out.mpo") as made:
        assert (made.format, made.n_frames, made.size) == ("MPO", 2, (96, 64))
    left.save(tmp_path / "one.jpg", "MPO", save_all=True, append_images=[Image.new("RGB", (20, 10))])
    with open_input(tmp_path / "one.jpg") as media:
        assert media.kind == "image"


@pytest.mark.skipif(not CASES.is_dir(), reason="the files that fail are not here")
@pytest.mark.parametrize(("name", "count"), [("anim.webp", 5), ("anim.png", 5), ("anim.avif", 4)])
def test_the_cases_have_all_their_pictures(tmp_path: Path, name: str, count: int) -> None:
    assert pass_on(CASES / name, tmp_path / name) == []
    assert read(tmp_path / name)[0] == [200] * count
