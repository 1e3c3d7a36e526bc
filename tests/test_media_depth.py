"""Pictures of more than 8 bits, HDR and alpha: kept as they are beside what is drawn."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from clips import cut
from deep_pictures import TICK, code_of, filled, stored
from models import model_file

from guise.aam.model import Identity
from guise.app.drawing.look import SWAP
from guise.app.media import EncodeOptions, Frame, open_input, open_sink
from guise.app.media.colour import BT709, LIMITED, yuv_matrix
from guise.app.media.encoder import AUTO, chosen_encoder, encoder_settings
from guise.app.media.encoding import encoding_for
from guise.app.media.frame import plane_arrays
from guise.app.media.hdr import light_levels
from guise.app.media.packets import PacketSink, assemble, read_packets
from guise.app.media.pipes import encoded_for, output_pipe
from guise.app.media.pixel_formats import NATIVE_FORMATS, depth, least_loss, nearest_format
from guise.app.media.rendition import HLG, PQ, WHITE_NITS
from guise.app.media.stream_copies import suffix_for
from guise.app.swapping.file import swap_file
from guise.app.swapping.report import SwapSettings

DISPLAY = "G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,50)"
GRADED = f"log-level=none:master-display={DISPLAY}:max-cll=1000,400"


def make(
    path: Path, encoder: str, fmt: str, frames: int = 3, transfer: int = BT709, params: str = ""
) -> Path:
    with av.open(str(path), "w") as out:
        option = {"libx265": "x265-params", "libsvtav1": "svtav1-params"}.get(encoder)
        stream = out.add_stream(
            encoder, 30, {option: params or "log-level=none"} if option == "x265-params" else {}
        )
        stream.width, stream.height, stream.pix_fmt = 64, 64, fmt
        context = stream.codec_context
        context.color_trc, context.colorspace, context.color_primaries, context.color_range = (
            transfer,
            9,
            9,
            LIMITED,
        )
        for number in range(frames):
            out.mux(stream.encode(timed(filled(fmt, number, 64, 64, transfer), number)))
        out.mux(stream.encode(None))
    return path


def timed(picture: av.VideoFrame, number: int) -> av.VideoFrame:
    picture.pts, picture.time_base = number, TICK
    return picture


def drawn(source: Path, output: Path, options: EncodeOptions) -> list[str]:
    """The problems of a run that paints a square."""
    with open_input(source) as media, open_sink(output, media, options) as sink:
        for frame in media:
            painted(frame)
            sink.write(frame)
        return list(media.problems)


def painted(frame: Frame) -> Frame:
    roi = frame.read_roi(16, 16, 24, 24)
    roi[4:-4, 4:-4, 0] = roi[4:-4, 4:-4, 0] // 2 + 60
    frame.write_roi(16, 16, roi)
    return frame


def same_beside_the_square(source: Path, frames: list[Frame]) -> None:
    with open_input(source) as media:
        for old, new in itertools.zip_longest(media, frames):
            assert old.video_frame.format.name == new.video_frame.format.name
            for number, (a, b) in enumerate(zip(stored(old), stored(new), strict=True)):
                square = tuple(slice(20 * side // 64, 36 * side // 64) for side in a.shape)
                a[square] = b[square]
                np.testing.assert_array_equal(a, b, err_msg=f"plane {number}")
            assert not np.array_equal(stored(old)[0], stored(new)[0])


def read(path: Path) -> list[Frame]:
    with open_input(path) as media:
        return [frame.copy() for frame in media]


@pytest.mark.parametrize("encoder", ["libx264", "libx265", "ffv1"])
@pytest.mark.parametrize("fmt", ["yuv420p10le", "yuv422p10le", "yuv444p10le"])
def test_ten_bits_stay_ten_bits_and_exact_beside_what_is_drawn(
    tmp_path: Path, fmt: str, encoder: str
) -> None:
    clip = make(tmp_path / "in.mkv", "ffv1", fmt)
    problems = drawn(clip, tmp_path / "out.mkv", EncodeOptions(encoder, preset="ultrafast", lossless=True))
    assert problems == []
    same_beside_the_square(clip, read(tmp_path / "out.mkv"))


@pytest.mark.parametrize("encoder", ["libx264", "libx265", "libsvtav1"])
@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_hdr_keeps_its_bits_tags_and_light_levels(tmp_path: Path, transfer: int, encoder: str) -> None:
    clip = make(tmp_path / "in.mp4", "libx265", "yuv420p10le", 3, transfer, GRADED)
    exact = encoder != "libsvtav1"
    options = EncodeOptions(encoder, preset="ultrafast" if exact else "veryfast", lossless=exact)
    assert drawn(clip, tmp_path / "out.mp4", options) == []
    frames = read(tmp_path / "out.mp4")
    if exact:
        same_beside_the_square(clip, frames)
    with open_input(clip) as before, open_input(tmp_path / "out.mp4") as after:
        old, new = before.first_picture, after.first_picture
        assert (new.format.name, new.color_trc, new.colorspace, new.color_primaries) == (
            "yuv420p10le",
            transfer,
            9,
            9,
        )
        first, second = light_levels(old), light_levels(new)
        assert first is not None
        assert second is not None
        assert first.content == second.content == (1000, 400)
        np.testing.assert_allclose(first.display, second.display, rtol=0.02, atol=1e-4)
        assert (
            after.stream.codec_context.codec_tag
            == {"libx264": "avc1", "libx265": "hvc1", "libsvtav1": "av01"}[encoder]
        )


@pytest.mark.parametrize(
    ("encoder", "suffix", "fmt"),
    [("libvpx-vp9", ".webm", "yuv420p"), ("mpeg4", ".mp4", "yuv420p"), ("ffv1", ".mkv", "yuv420p10le")],
)
def test_what_an_encoder_cannot_keep_of_hdr_is_said_with_that_word(
    tmp_path: Path, encoder: str, suffix: str, fmt: str
) -> None:
    clip = make(tmp_path / "in.mp4", "libx265", "yuv420p10le", 3, PQ, GRADED)
    problems = drawn(clip, tmp_path / f"out{suffix}", EncodeOptions(encoder))
    assert all("HDR" in problem for problem in problems)
    assert len(problems) == (1 if fmt.endswith("10le") else 2)
    assert read(tmp_path / f"out{suffix}")[0].video_frame.format.name == fmt


def test_the_changing_metadata_of_dolby_vision_is_told(tmp_path: Path) -> None:
    context = av.CodecContext.create("libx265", "w")
    assert isinstance(context, av.VideoCodecContext)
    context.width = context.height = 64
    context.pix_fmt, context.time_base, context.color_trc = "yuv420p10le", TICK, HLG
    context.options = {"x265-params": "log-level=none:repeat-headers=1"}
    packets = [context.encode(timed(filled("yuv420p10le", n, 64, 64, HLG), n)) for n in range(3)] + [
        context.encode(None)
    ]
    unit = b"\0\0\0\1" + bytes([62 << 1, 1]) + dolby_vision()  # that follows each picture
    clip = tmp_path / "in.h265"
    clip.write_bytes(b"".join(bytes(packet) + unit for some in packets for packet in some))
    problems = drawn(clip, tmp_path / "out.mp4", EncodeOptions(preset="ultrafast"))
    assert "Dolby Vision's metadata of every picture was left out: the pictures are kept as HLG." in problems


def dolby_vision() -> bytes:
    """The least metadata of a picture that FFmpeg's parser takes, of profile 8: each colour is mapped to itself."""

    def unsigned(value: int) -> str:  # Exp-Golomb
        code = f"{value + 1:b}"
        return "0" * (len(code) - 1) + code

    zero = unsigned(0)
    head = (
        f"{2:06b}{18:011b}{1:04b}{0:04b}1" + f"000{unsigned(23)}{1:02b}0"
    )  # kinds, then the form of coefficients
    depths = unsigned(2) + unsigned(2) + unsigned(4) + "000001"  # and no enhancement layer
    pivots = 3 * f"{zero}{0:010b}{1023:010b}"
    curves = 3 * f"{zero}{zero}0{zero}{0:023b}{unsigned(1)}{0:023b}"
    bits = head + depths + "00" + 3 * zero + pivots + 2 * zero + curves
    bits += "0" * (-len(bits) % 8)
    data = b"\x19" + int(bits, 2).to_bytes(len(bits) // 8, "big") + b"\1\2\3\4\x80"  # without a true checksum
    made = bytearray()
    for byte in data:
        made += b"\3" * (made[-2:] == b"\0\0" and byte <= 3) + bytes([byte])
    return bytes(made)


@pytest.mark.parametrize("suffix", [".webp", ".apng"])
def test_alpha_of_a_video_is_that_of_an_animation(tmp_path: Path, suffix: str) -> None:
    clip = make(tmp_path / "in.mov", "prores_ks", "yuva444p10le")
    out = tmp_path / f"out{suffix}"
    assert drawn(clip, out, EncodeOptions()) == []
    for old, new in zip(read(clip), read(out), strict=True):
        assert np.abs(old.opacity().astype(int) - new.opacity()).max() <= 2
        assert np.ptp(new.opacity()) > 128


def test_hdr_as_an_animation_is_sdr_and_said_so(tmp_path: Path) -> None:
    clip = make(tmp_path / "in.mkv", "ffv1", "yuv420p10le", 3, HLG)
    (problem,) = drawn(clip, tmp_path / "out.webp", EncodeOptions(lossless=True))
    assert problem == "A .webp file has 8 bits: its pictures are SDR, as which the HDR is shown."
    for old, new in zip(read(clip), read(tmp_path / "out.webp"), strict=True):
        assert np.abs(painted(old).rgb().astype(int) - new.rgb()).mean() < 1


def test_other_pictures_than_the_inputs_are_not_compared_with_them(tmp_path: Path) -> None:
    clip = make(tmp_path / "in.mp4", "libx265", "yuv420p10le", 3, PQ, GRADED)
    with open_input(clip) as media, open_sink(tmp_path / "out.mp4", media, size=(32, 32)) as sink:
        for frame in media:
            frame.show(np.full((32, 32, 3), 90, np.uint8))
            sink.write(frame)
        assert media.problems == []
    first, *_ = read(tmp_path / "out.mp4")
    assert (first.video_frame.format.name, first.video_frame.color_trc) == ("yuv420p", BT709)


def test_pieces_keep_ten_bits(tmp_path: Path) -> None:
    clip, output = make(tmp_path / "in.mp4", "libx265", "yuv420p10le", 3, PQ, GRADED), tmp_path / "out.mp4"
    options, parts = EncodeOptions(preset="ultrafast", lossless=True), [tmp_path / "0", tmp_path / "1"]
    with open_input(clip) as media:
        frames = [painted(frame.copy()) for frame in media]
        for part, some in zip(parts, (frames[:2], frames[2:]), strict=True):
            with PacketSink(part, media, options, output) as sink:
                for frame in some:
                    sink.write(frame)
        assemble(output, media, parts, options, tags={}, private=True)
    same_beside_the_square(clip, [frame for part in parts for frame in read_packets(part)])
    same_beside_the_square(clip, read(output))
    with open_input(output) as media:
        assert media.light_levels is not None
        assert media.light_levels.content == (1000, 400)


@pytest.mark.parametrize("encoder", ["libvpx-vp9", "ffv1"])
def test_pieces_keep_alpha(tmp_path: Path, encoder: str) -> None:
    clip, output = make(tmp_path / "in.mkv", "ffv1", "yuva420p"), tmp_path / "out.mkv"
    options, part = EncodeOptions(encoder, lossless=True), tmp_path / "0"
    with open_input(clip) as media:
        with PacketSink(part, media, options, output) as sink:
            for frame in media:
                sink.write(painted(frame))
        assemble(output, media, [part], options, tags={}, private=True)
    same_beside_the_square(clip, list(read_packets(part)))
    same_beside_the_square(clip, read(output))


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_the_shortest_videos_have_decoding_times(tmp_path: Path, frames: int) -> None:
    clip = make(tmp_path / "in.mkv", "ffv1", "yuv420p10le", frames)
    with open_input(clip) as media:
        media.frame_count = frames
        settings = encoding_for(media, EncodeOptions(), tmp_path / "out.mp4").settings
    assert ("bframes=0" in settings["x265-params"]) == (frames < 3)
    drawn(clip, tmp_path / "out.mp4", EncodeOptions())
    with av.open(str(tmp_path / "out.mp4")) as written:
        times = [packet.dts for packet in written.demux(video=0) if packet.size]
    assert len(times) == frames
    assert times == sorted(set(times))


@pytest.mark.parametrize(
    ("made_by", "fmt", "suffix", "codec"),
    [
        ("libx265", "yuv420p10le", ".mp4", "hevc"),
        ("libx265", "yuv420p10le", ".webm", "av1"),
        ("libx265", "yuv420p", ".mp4", "h264"),
        ("libx265", "yuv420p", ".webm", "vp9"),
        ("ffv1", "yuva420p", ".webm", "vp9"),
        ("ffv1", "yuva444p10le", ".mov", "prores"),
        ("qtrle", "argb", ".mp4", "h264"),
    ],
)
def test_what_is_written_unless_an_encoder_is_named(
    tmp_path: Path, made_by: str, fmt: str, suffix: str, codec: str
) -> None:
    clip = make_alpha(tmp_path / "in.mov" if made_by == "qtrle" else tmp_path / "in.mkv", made_by, fmt)
    problems = drawn(clip, tmp_path / f"out{suffix}", EncodeOptions())
    with av.open(str(tmp_path / f"out{suffix}")) as written:
        (stream,) = written.streams.video
        assert stream.codec_context.codec.canonical_name == codec
        assert depth(next(written.decode(stream)).format.name) >= min(depth(fmt), 10)
    assert len([problem for problem in problems if "ransparency" in problem]) == (fmt == "argb")


@pytest.mark.parametrize(
    ("made_by", "fmt", "encoder", "suffix", "exact"),
    [
        ("libvpx-vp9", "yuva420p", "libvpx-vp9", ".webm", True),
        ("libvpx-vp9", "yuva420p", "ffv1", ".mkv", True),
        ("ffv1", "yuva444p10le", "ffv1", ".mkv", True),
        ("prores_ks", "yuva444p10le", "prores_ks", ".mov", False),
        ("libvpx-vp9", "yuva420p", "prores_ks", ".mov", False),
        ("qtrle", "argb", "ffv1", ".mkv", False),
    ],
)
def test_alpha_is_kept_where_the_target_holds_it(
    tmp_path: Path, made_by: str, fmt: str, encoder: str, suffix: str, exact: bool
) -> None:
    ends = {"libvpx-vp9": ".webm", "ffv1": ".mkv"}
    clip = make_alpha(tmp_path / f"in{ends.get(made_by, '.mov')}", made_by, fmt)
    problems = drawn(clip, tmp_path / f"out{suffix}", EncodeOptions(encoder, lossless=exact))
    assert not [problem for problem in problems if "ransparency" in problem]
    if exact:
        same_beside_the_square(clip, read(tmp_path / f"out{suffix}"))
    for old, new in zip(read(clip), read(tmp_path / f"out{suffix}"), strict=True):
        shares = [stored(one)[3] / ((1 << depth(one.video_frame.format.name)) - 1) for one in (old, new)]
        assert np.ptp(shares[0]) > 0.5
        assert np.abs(shares[0] - shares[1]).max() < 0.02


def make_alpha(path: Path, encoder: str, fmt: str) -> Path:
    if fmt != "argb":
        return make(path, encoder, fmt)
    with av.open(str(path), "w") as out:
        stream = out.add_stream(encoder, 30)
        stream.width, stream.height, stream.pix_fmt = 64, 64, fmt
        for number in range(3):
            picture = filled("yuva444p", number, 64, 64).reformat(format=fmt)
            out.mux(stream.encode(timed(picture, number)))
        out.mux(stream.encode(None))
    return path


def test_alpha_that_the_target_does_not_hold_is_one_note(tmp_path: Path) -> None:
    clip = make(tmp_path / "in.webm", "libvpx-vp9", "yuva420p", 6)
    for name, encoder in (("out.mp4", "libx264"), ("out.mkv", "libx265")):
        (problem,) = drawn(clip, tmp_path / name, EncodeOptions(encoder, preset="ultrafast"))
        assert problem.startswith(
            f"Transparency was left out, as {encoder} has none: without --encoder, .webm"
        )


@pytest.mark.parametrize(
    ("kind", "made", "fmt", "transfer", "written", "said"),
    [
        ("y4m", "ffv1", "yuva444p10le", BT709, "yuv444p10le", "Transparency was left out, as y4m has none"),
        ("nut", "ffv1", "yuva444p10le", BT709, "yuva444p10le", None),
        ("y4m", "ffv1", "yuv420p10le", HLG, "yuv420p10le", "Raw pictures say nothing of HDR: they are HLG"),
        ("nut", "libx265", "yuv420p10le", PQ, "yuv420p10le", "they are PQ with the colours of BT.2020"),
    ],
)
def test_pipes_keep_what_they_hold_and_say_what_they_do_not(
    tmp_path: Path, kind: str, made: str, fmt: str, transfer: int, written: str, said: str | None
) -> None:
    clip, pipe = make(tmp_path / "in.mkv", made, fmt, 3, transfer, GRADED), output_pipe(kind)
    with open_input(clip) as media:
        found = encoding_for(media, encoded_for(pipe, EncodeOptions()), pipe)
        assert found.picture_format.fmt == written
        assert [said is not None and said in problem for problem in media.problems] == [True] * bool(said)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm"])
@pytest.mark.parametrize("fmt", ["yuv420p", "yuv420p10le", "yuva420p", "yuva444p10le"])
def test_whatever_is_chosen_can_be_lossless(suffix: str, fmt: str) -> None:
    encoder_settings(EncodeOptions(chosen_encoder(suffix, fmt, lossless=True), lossless=True))


def test_an_output_without_a_name_keeps_the_container_that_keeps_alpha(tmp_path: Path) -> None:
    webm = make(tmp_path / "a.webm", "libvpx-vp9", "yuva420p", 2)
    plain = make(tmp_path / "b.webm", "libvpx-vp9", "yuv420p", 2)
    mov = make(tmp_path / "c.mov", "prores_ks", "yuva444p10le", 2)
    assert [suffix_for(path, AUTO) for path in (webm, plain, mov)] == [".webm", ".mp4", ".mov"]
    assert suffix_for(webm, "libx264") == ".mp4"


def test_formats_are_chosen_by_what_they_keep() -> None:
    choices = ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le", "yuv444p10le", "gray"]
    wanted = {
        "yuv420p12le": "yuv420p10le", "yuv422p10le": "yuv444p10le", "yuva420p": "yuv420p", "nv12": "yuv420p",
        "gray": "gray", "gray12le": "yuv420p10le",
    }  # fmt: skip
    assert {name: least_loss(name, choices) for name in wanted} == wanted
    assert least_loss("yuv420p", ["rgb24", "bgr0"]) is None
    assert least_loss("yuva444p10le", ["yuv444p10le", "yuva420p"]) == "yuva420p"
    found = {
        name: nearest_format(av.VideoFrame(16, 16, name))
        for name in ("p010le", "p210le", "rgb48le", "gbrp12le", "bgra", "ya8", "yuv410p")
    }
    assert found == {
        "p010le": "yuv420p10le", "p210le": "yuv422p10le", "rgb48le": "yuv444p16le", "gbrp12le": "yuv444p12le",
        "bgra": "yuva444p", "ya8": "yuva444p", "yuv410p": "yuv420p",
    }  # fmt: skip
    assert set(found.values()) <= set(NATIVE_FORMATS)


# -- a face --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_face_is_drawn_into_hdr_as_into_the_same_video_in_sdr(tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "sdr.mp4", 4)
    with av.open(str(tmp_path / "hdr.mkv"), "w") as out, open_input(clip) as media:
        stream = out.add_stream("ffv1", 30)
        stream.width, stream.height, stream.pix_fmt = media.width, media.height, "yuv420p10le"
        context = stream.codec_context
        context.color_trc, context.colorspace, context.color_primaries, context.color_range = (
            PQ,
            9,
            9,
            LIMITED,
        )
        for frame in media:
            out.mux(stream.encode(timed(graded(frame.rgb()), frame.index)))
        out.mux(stream.encode(None))
    p01, p06 = (Identity.load(model_file(name)) for name in ("p01", "p06"))
    settings = SwapSettings(replace(SWAP, renderer="cpu"), EncodeOptions("ffv1"))
    faces, pictures = [], []
    for name, white in (("sdr.mp4", 1.0), ("hdr.mkv", WHITE)):
        report = swap_file(tmp_path / name, p06, tmp_path / f"{name}.mkv", source=p01, settings=settings)
        assert report.swapped == 4
        before, after = read(tmp_path / name)[-1].rgb(), read(tmp_path / f"{name}.mkv")[-1].rgb()
        faces.append((before != after).any(2))
        pictures.append(after / white)
    both = faces[0] & faces[1]
    assert both.sum() > 0.8 * (faces[0] | faces[1]).sum()
    gap = pictures[1][both] - pictures[0][both]
    assert np.abs(gap.mean(0)).max() < 4
    assert np.abs(gap).mean() < 6


WHITE = (100 / WHITE_NITS) ** (1 / 2.2)  # of SDR, where a display of 100 nits has it, as it is shown


def graded(rgb: np.ndarray) -> av.VideoFrame:
    """A picture of SDR (h, w, 3) as HDR shows it: PQ in 10 bits with the primaries of BT.2020."""
    mix = np.array([[0.6274, 0.0691, 0.0164], [0.3293, 0.9195, 0.0880], [0.0433, 0.0114, 0.8956]])
    code = (255 * code_of(100 * (rgb / 255) ** 2.2 @ mix, PQ)).astype(np.float32)
    video = av.VideoFrame(rgb.shape[1], rgb.shape[0], "yuv420p10le")
    parts = cv2.split(cv2.transform(code, yuv_matrix(9, LIMITED, 1080).from_rgb))
    for plane, part in zip(plane_arrays(video), parts, strict=True):
        plane[:] = np.rint(4 * cv2.resize(part, plane.shape[::-1], interpolation=cv2.INTER_AREA))
    return video
