"""Streams beside the pictures: kept where the target holds them, encoded anew, or left out with one note."""

from __future__ import annotations

import io
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from recordings import SAMPLES, Adding, record, times, with_streams

from guise.app.media import EncodeOptions, open_input, open_sink, process
from guise.app.media.stream_copies import suffix_for

FAST = {
    "libx264": EncodeOptions(preset="ultrafast", crf=40),
    "libvpx-vp9": EncodeOptions("libvpx-vp9", crf=50),
}
TARGETS = [".mp4", ".mov", ".mkv", ".webm", ".ts", ".flv", ".3gp", ".m4v"]
KEPT = {
    "font": {".mkv"}, "text": {".mkv"}, "picture text": {".mkv", ".mp4"},
    "mov text": {".mp4", ".mov", ".m4v", ".3gp"}, "positions": {".ts"}, "cover": set(), "wma": set(),
    "pcm": {".mkv", ".mov", ".mp4"},
    "aac": set(TARGETS) - {".webm"},
}  # fmt: skip


def font(out: av.container.OutputContainer) -> Adding:
    return out.add_attachment("a.ttf", "application/x-truetype-font", bytes(100)), None


def cover(out: av.container.OutputContainer) -> Adding:
    file = io.BytesIO()
    Image.new("RGB", (32, 32)).save(file, "jpeg")
    return out.add_attachment("cover.jpg", "image/jpeg", file.getvalue()), None


def text(out: av.container.OutputContainer) -> Adding:
    return out.add_mux_stream("subrip"), b"hello"


def picture_text(out: av.container.OutputContainer) -> Adding:
    return out.add_mux_stream("dvd_subtitle"), bytes(16)


def mov_text(out: av.container.OutputContainer) -> Adding:
    return out.add_mux_stream("mov_text"), b"\0\5hello"


def positions(out: av.container.OutputContainer) -> Adding:
    return out.add_data_stream("klv"), b"\x06\x0e\x2b\x34" + bytes(16)


def copied(source: Path, suffix: str) -> tuple[Path, list[str]]:
    """The file through the media layer into another container, and the notes."""
    target = source.with_name(f"{source.stem}.out{suffix}")
    options = FAST["libvpx-vp9" if suffix == ".webm" else "libx264"]
    with open_input(source) as media, open_sink(target, media, options, force=True) as sink:
        process(media, sink, lambda frame: None)
        return target, list(media.problems)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One file for each kind of stream."""
    folder = tmp_path_factory.mktemp("sources")
    plain = record(folder / "plain.mp4", sound=None)
    many = {"font": font, "text": text, "picture text": picture_text, "cover": cover}
    made = {
        kind: with_streams(folder / f"{kind.replace(' ', '')}.mkv", plain, add) for kind, add in many.items()
    }
    return made | {
        "mov text": with_streams(folder / "movtext.mp4", plain, mov_text),
        "positions": with_streams(folder / "positions.ts", plain, positions),
        "wma": record(folder / "wma.wmv"),
        "pcm": record(folder / "pcm.mov", codecs=("libx264", "pcm_s16le")),
        "aac": record(folder / "aac.mp4"),
    }


@pytest.mark.parametrize("suffix", TARGETS)
@pytest.mark.parametrize("kind", KEPT)
def test_what_a_target_holds_is_kept_and_the_rest_is_noted_once(
    sources: dict[str, Path], kind: str, suffix: str
) -> None:
    target, notes = copied(sources[kind], suffix)
    with av.open(str(sources[kind])) as before, av.open(str(target)) as after:
        other = [s for s in before.streams if s.type != "video"]
        kept = [s for s in after.streams if s.type != "video" and s.type in [o.type for o in other]]
        assert len(list(after.decode(video=0))) == 24
        sound = "audio" in [s.type for s in other]
        assert bool(kept) == (sound or suffix in KEPT[kind])
        if suffix in KEPT[kind]:
            assert not notes
            assert {(s.type, s.name) for s in kept} == {(s.type, s.name) for s in other}
        else:
            assert len(notes) == 1
            assert ("encoded anew" if sound else "left out") in notes[0]


def heard(path: Path) -> np.ndarray:
    """The sound, 48,000 samples a second, from a second before the first picture on."""
    found, first = np.zeros(3 * SAMPLES), float(times(path)[0][0])
    with av.open(str(path)) as media:
        blocks = [block for block in media.decode(audio=0) if block.pts is not None]
    parts = [b.to_ndarray().astype(float).reshape(-1, 1 if b.format.is_planar else 2) for b in blocks]
    samples = np.concatenate([part[: b.samples, 0] for part, b in zip(parts, blocks, strict=True)])
    begin = round((blocks[0].time - first + 1) * SAMPLES)
    found[begin : begin + len(samples)] = samples
    return found


@pytest.mark.parametrize(
    ("kind", "suffix"), [("wma", ".mp4"), ("wma", ".webm"), ("pcm", ".flv"), ("aac", ".webm")]
)
def test_sound_that_is_encoded_anew_is_the_same_in_time(
    sources: dict[str, Path], kind: str, suffix: str
) -> None:
    target = copied(sources[kind], suffix)[0]
    before, after = heard(sources[kind]), heard(target)
    products = np.fft.irfft(np.fft.rfft(after) * np.conj(np.fft.rfft(before)))
    lag = (np.argmax(products) + len(before) // 2) % len(before) - len(before) // 2
    assert abs(lag) / SAMPLES < 0.003
    assert products.max() / np.sqrt((before**2).sum() * (after**2).sum()) > 0.8
    lengths = []
    for file in (sources[kind], target):
        with av.open(str(file)) as media:
            lengths.append(sum(block.samples for block in media.decode(audio=0)))
    assert 0 <= lengths[1] - lengths[0] < 3 * 1024  # an encoder's first and last blocks


@pytest.mark.parametrize("layout", ["mono", "5.1(side)", "7.1"])
@pytest.mark.parametrize("suffix", [".flv", ".webm", ".ts", ".mp4"])
def test_sound_of_many_channels_is_kept_as_it_is_or_in_a_codec_of_the_target(
    tmp_path: Path, suffix: str, layout: str
) -> None:
    source = record(tmp_path / "in.mov", codecs=("libx264", "pcm_s16le"), layout=layout)
    target, notes = copied(source, suffix)
    with av.open(str(target)) as media:
        assert media.streams.audio[0].channels == {"mono": 1, "5.1(side)": 6, "7.1": 8}[layout]
        assert sum(block.samples for block in media.decode(audio=0)) == pytest.approx(48000, abs=3000)
    assert len(notes) == (suffix != ".mp4")


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".ts"])
@pytest.mark.parametrize("code", ["01:00:00:00", "10:59:59;29", "220:69:233;230", "no code"])
def test_a_time_code_is_carried_where_it_is_one(tmp_path: Path, suffix: str, code: str) -> None:
    source = tmp_path / "in.mov"
    with av.open(str(source), "w") as out:
        stream = out.add_stream("libx264", 30, {"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        if code[:2].isdigit():
            stream.metadata["timecode"] = code
        for shade in range(5):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64), shade, np.uint8), "gray")
            out.mux(stream.encode(frame.reformat(format="yuv420p")))
        out.mux(stream.encode(None))
    target, notes = copied(source, suffix)
    with av.open(str(target)) as media:
        found = {v for s in media.streams.video for k, v in s.metadata.items() if k.lower() == "timecode"}
    good = code in ("01:00:00:00", "10:59:59;29")
    assert found == ({code} if good and suffix != ".ts" else set())
    assert len(notes) == (code != "no code" and not found)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm"])
def test_a_video_without_other_streams_keeps_its_container(tmp_path: Path, suffix: str) -> None:
    assert suffix_for(tmp_path / f"silent{suffix}", "libvpx-vp9") == suffix


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".ts", ".flv"])
def test_many_streams_and_chapters_make_a_note_each(tmp_path: Path, suffix: str) -> None:
    plain = record(tmp_path / "plain.mp4", sound=None)
    source = with_streams(tmp_path / "many.mkv", plain, *[font] * 5, text, text, chapters=True)
    target, notes = copied(source, suffix)
    holder = "" if suffix == ".mkv" else suffix[1:].replace("ts", "mpegts")
    streams = f"5 attachment streams were left out: {holder} cannot hold them, .mkv can."
    texts = "Subtitle stream 1 (srt), Subtitle stream 2 (srt)"
    assert sorted(notes) == sorted(
        [f"{texts}, {streams}"] * bool(holder)
        + [f"The chapters were left out: {holder} has none."] * (suffix in (".ts", ".flv"))
    )
    with av.open(str(target)) as media:
        assert bool(media.chapters()) == (suffix in (".mp4", ".mkv"))
