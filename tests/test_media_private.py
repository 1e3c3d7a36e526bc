"""A private output says nothing of what the input said about people, places, devices and times."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from test_media import FAST, UNEVEN, add_sound, make_clip, run
from test_media_packets import put_together

from guise.app.media.image_writing import encode_image, xmp
from guise.app.media.stream_copies import without_vorbis_comments
from guise.app.media.synthetic import DIGITAL_SOURCE_TYPE, synthetic_tags
from guise.common.version import VERSION

SECRET = "SECRET"
PEOPLE = {
    "title": SECRET, "artist": SECRET, "comment": SECRET, "location": f"+60.1+024.9/{SECRET}", "make": SECRET,
    "model": SECRET, "com.apple.quicktime.location.ISO6709": SECRET, "com.apple.quicktime.creationdate": SECRET,
    "creation_time": "2020-02-02T02:02:02.000000Z", "encoder": SECRET, "keywords": SECRET,
}  # fmt: skip


def sei(kind: int, payload: bytes) -> bytes:
    """An H.264 message of supplementary information, with its length before it (H.264, 7.3.2.3)."""
    body = bytes([6, kind, len(payload)]) + payload + b"\x80"
    return len(body).to_bytes(4, "big") + body


MESSAGES = sei(5, bytes(16) + SECRET.encode()) + sei(4, b"\xb5\x00\x31GA94\x03\x41\xff\xfc\x41\x42\xff")


def rich_clip(path: Path) -> Path:
    """A clip that says more than it should, wherever its container can."""
    plain = make_clip(path.with_name("plain.mp4"), UNEVEN, sound=1, subtitles=True)
    options = {"movflags": "+use_metadata_tags"} if path.suffix != ".mkv" else {}
    with av.open(str(plain)) as source, av.open(str(path), "w", container_options=options) as out:
        out.metadata.update(PEOPLE)
        copies = {}
        for stream in source.streams:
            if stream.type == "subtitle" and path.suffix == ".mkv":
                continue
            copy = copies[stream.index] = out.add_stream_from_template(stream, opaque=True)
            names = {"title": SECRET, "handler_name": SECRET, "creation_time": PEOPLE["creation_time"]}
            copy.metadata.update(names | {"language": "fin"})
        if path.suffix == ".mkv":
            out.add_attachment(f"{SECRET}.txt", "text/plain", SECRET.encode())
        chapter = {
            "id": 1,
            "start": 0,
            "end": 200,
            "time_base": Fraction(1, 1000),
            "metadata": {"title": SECRET},
        }
        out.set_chapters([chapter])
        for packet in source.demux(*[source.streams[index] for index in copies]):
            if packet.dts is not None:
                out.mux(_with_messages(packet, copies[packet.stream_index]))
    if path.suffix != ".mkv":
        with path.open("ab") as file:
            file.write(_xmp_box())
    return path


def _with_messages(packet: av.Packet, stream: av.stream.Stream) -> av.Packet:
    if stream.type == "video":
        richer = av.Packet(MESSAGES + bytes(packet))
        richer.pts, richer.dts, richer.duration = packet.pts, packet.dts, packet.duration
        richer.time_base, richer.is_keyframe = packet.time_base, packet.is_keyframe
        packet = richer
    packet.stream = stream
    return packet


def _xmp_box() -> bytes:
    body = bytes.fromhex("BE7ACFCB97A942E89C71999491E3AFAC") + f"<x:xmpmeta>{SECRET}</x:xmpmeta>".encode()
    return (len(body) + 8).to_bytes(4, "big") + b"uuid" + body


def make(way: str, clip: Path, out: Path, *, private: bool) -> None:
    if way == "pieces":
        put_together(clip, out, FAST, private=private)
    else:
        run(clip, out, tags=synthetic_tags(), private=private)


@pytest.mark.parametrize("way", ["pieces", "one pass"])
@pytest.mark.parametrize(
    ("inner", "outer"), [(".mp4", ".mp4"), (".mov", ".mov"), (".mkv", ".mkv"), (".mp4", ".mkv")]
)
@pytest.mark.slow
def test_nothing_identifying_is_left(tmp_path: Path, inner: str, outer: str, way: str) -> None:
    clip, out = rich_clip(tmp_path / f"in{inner}"), tmp_path / f"out{outer}"
    assert clip.read_bytes().count(SECRET.encode()) > 10 + len(UNEVEN)
    make(way, clip, out, private=True)
    data = out.read_bytes()
    assert SECRET.encode() not in data
    assert b"GA94" not in data
    assert b"Lavf6" not in data
    with av.open(str(out)) as result:
        assert [stream.type for stream in result.streams] == ["video", "audio"]
        assert result.chapters() == []
        assert result.streams.audio[0].language == "fin"
        for metadata in (result.metadata, *(stream.metadata for stream in result.streams)):
            assert not {"creation_time", "timecode", "title", "location"} & {key.lower() for key in metadata}


def test_without_privacy_it_would_be_there(tmp_path: Path) -> None:
    clip = rich_clip(tmp_path / "in.mkv")
    make("one pass", clip, tmp_path / "out.mkv", private=False)
    data = (tmp_path / "out.mkv").read_bytes()
    assert data.count(SECRET.encode()) > 10
    assert b"GA94" in data


def test_what_was_left_out_is_said(tmp_path: Path) -> None:
    clip = rich_clip(tmp_path / "in.mp4")
    problems = run(clip, tmp_path / "out.mp4", private=True).problems
    assert (
        "Subtitle stream 2 (mov_text) was left out: it may name people or, as in drones' videos, places."
        in problems
    )


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_the_marks_of_synthetic_pictures_survive(tmp_path: Path, suffix: str) -> None:
    run(make_clip(tmp_path / "in.mp4"), tmp_path / f"out{suffix}", tags=synthetic_tags(), private=True)
    with av.open(str(tmp_path / f"out{suffix}")) as result:
        metadata = {key.lower(): value for key, value in result.metadata.items()}
    assert metadata["digital_source_type"] == DIGITAL_SOURCE_TYPE
    assert VERSION in metadata["comment"]


# -- sound ---------------------------------------------------------------------------------------------------


def vorbis_headers(comment: bytes) -> bytes:
    """The three headers of a Vorbis stream, laced; the first and the last are made up."""
    first, last = b"\x01vorbis" + bytes(23), b"\x05vorbis" + b"x" * 300
    lacing = bytes([2, len(first)]) + b"\xff" * (len(comment) // 255) + bytes([len(comment) % 255])
    return lacing + first + comment + last


@pytest.mark.parametrize("length", [0, 100, 600])
def test_the_comments_of_vorbis_are_emptied(length: int) -> None:
    comment = b"\x03vorbis" + SECRET.encode() * 3 + b"x" * length
    empty = b"\x03vorbis" + bytes(8) + b"\x01"
    assert without_vorbis_comments(vorbis_headers(comment)) == vorbis_headers(empty)


def test_vorbis_without_comments_still_plays(tmp_path: Path) -> None:
    clip = tmp_path / "in.mkv"
    video = make_clip(tmp_path / "v.mp4")
    with av.open(str(video)) as source, av.open(str(clip), "w") as out:
        copy = out.add_stream_from_template(source.streams.video[0], opaque=True)
        sound = out.add_stream("vorbis", 44100, {"strict": "experimental"})
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = copy
                out.mux(packet)
        add_sound(out, sound, 0)
    run(clip, tmp_path / "out.mkv", private=True)
    with av.open(str(clip)) as a, av.open(str(tmp_path / "out.mkv")) as b:
        for old, new in zip(a.decode(audio=0), b.decode(audio=0), strict=True):
            np.testing.assert_array_equal(old.to_ndarray(), new.to_ndarray())


# -- images --------------------------------------------------------------------------------------------------


def rich_image(path: Path) -> Path:
    """A picture with EXIF (GPS, device, author), XMP and an ICC profile, all of which say the secret."""
    rgb = np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8)
    text = SECRET.encode() + b"\0"
    tiff = (
        b"II*\0\x08\0\0\0\x01\0"
        + b"\x0f\x01\x02\0"
        + len(text).to_bytes(4, "little")
        + b"\x1a\0\0\0"
        + bytes(4)
        + text
    )
    blocks = [np.frombuffer(block, np.uint8) for block in (tiff, xmp({"comment": SECRET}))]
    done, data = cv2.imencodeWithMetadata(
        path.suffix, rgb, [cv2.IMAGE_METADATA_EXIF, cv2.IMAGE_METADATA_XMP], blocks, []
    )
    assert done
    path.write_bytes(data.tobytes())
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_images_lose_what_they_say_and_are_marked(tmp_path: Path, suffix: str) -> None:
    clip = rich_image(tmp_path / f"in{suffix}")
    assert clip.read_bytes().count(SECRET.encode()) == 2
    run(clip, tmp_path / f"out{suffix}", tags=synthetic_tags(), private=True)
    data = (tmp_path / f"out{suffix}").read_bytes()
    assert SECRET.encode() not in data
    assert b'Iptc4xmpExt:DigitalSourceType="' + DIGITAL_SOURCE_TYPE.encode() in data
    assert VERSION.encode() in data


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_the_marks_of_an_image_are_found_by_a_reader_of_xmp(suffix: str) -> None:
    data = encode_image(np.zeros((8, 9, 3), np.uint8), None, suffix, synthetic_tags() | {"x": "a <b> & 'c'"})
    picture, kinds, blocks = cv2.imdecodeWithMetadata(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (8, 9, 3)
    found = {kind: bytes(np.asarray(block).tobytes()) for kind, block in zip(kinds, blocks, strict=True)}
    assert b"a &lt;b&gt; &amp; 'c'" in found[cv2.IMAGE_METADATA_XMP]
