"""Damaged files: every reader must take or refuse them in a sentence, without a traceback, a hang or a crash.

Valid files of each kind are changed at random: bits, bytes, runs of bytes, numbers, lengths.  Readers run in processes
of their own with bounded memory, one for each kind at a time, so that a crash or a hang is told apart from an
exception.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from multiprocessing.connection import Connection
from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from guise.aam.landmarks import load_annotations
from guise.aam.landmarks.annotations import TRACKED_FORMAT, TRACKED_VERSION, pts_bytes, save_annotations
from guise.aam.landmarks.card import read_card
from guise.aam.model import Identity, read_header
from guise.aam.recognition import SIGNATURE_LENGTH
from guise.analogy.feature_points import FEATURE_POINT_NAMES, load_feature_points
from guise.analogy.formats.files import read_mesh, read_rig, write_rig
from guise.analogy.mesh import Mesh
from guise.app.deidentify.report.report import write_report
from guise.app.deidentify.report.review import read_tracks, write_tracks
from guise.app.deidentify.tracks import FileReport, Track, TrackOutcome
from guise.app.measure.reported import read_report
from guise.app.media import open_input
from guise.app.media.animation_writer import FORMS, open_writer
from guise.app.media.image_writing import encode_deep
from guise.app.media.images import DeepImage, read_deep
from guise.app.media.segments import scan
from guise.app.people.recogniser import read_recogniser_card
from guise.app.swapping.donors import KEY_FILE_FORMAT, KEY_FILE_VERSION, KeyFile, open_donor
from guise.common.errors import GuiseError

MUTATIONS = 20_000
KINDS = ("taken", "refused", "exception", "hang", "crash")
SECONDS_EACH = 30
MEMORY_BYTES = 6 << 30
SIZE_PIXELS = (48, 64)
COMMON_CARD = """model = "model.onnx"
[input]
size = [112, 112]
colour = "rgb"
mean = 127.5
scale = 0.0078
"""
CARDS = {
    "landmarks": 'scheme = "face81"\n' + COMMON_CARD + "[crop]\nenlarge = 1.1\n[box.lbp]\nshift = [0, 0.1]\n",
    "recogniser": COMMON_CARD + "[template]\npoints = [[38, 52], [74, 52], [56, 72], [42, 92], [71, 92]]\n",
}


@dataclass(frozen=True)
class Reader:
    """A kind of file: its suffix, how a valid one is written, and what reads it."""

    suffix: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]


# -- valid files ----------------------------------------------------------------------------------------------


def _points(path: Path) -> None:
    rng = np.random.default_rng(0)
    save_annotations(path, rng.uniform(0, 200, (3, 81, 2)).astype(np.float32), "face81")


def _compressed_points(path: Path) -> None:
    points = np.random.default_rng(0).uniform(0, 200, (3, 81, 2)).round().astype(np.float32)
    np.savez_compressed(path, face81=points)


def _picture(channels: int = 3, kind: type = np.uint8) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    noise = np.random.default_rng(0).integers(0, 256, (*SIZE_PIXELS, channels))
    return np.asarray(noise.astype(kind), kind)


def _image(channels: int = 3, kind: type = np.uint8) -> Callable[[Path], object]:
    return lambda path: cv2.imwrite(str(path), _picture(channels, kind))


def _still(path: Path) -> None:
    path.write_bytes(encode_deep(DeepImage(_picture()), path.suffix, {}))


def _animation(path: Path) -> None:
    writer = open_writer(path, FORMS[path.suffix], SIZE_PIXELS[::-1], 0, alpha=False, lossless=False)
    for k in range(3):
        writer.add(np.roll(_picture(), k, axis=1), Fraction(k, 10), Fraction(k + 1, 10))
    writer.close()


def _video(codec: str, **options: str) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        with av.open(str(path), "w") as out:
            stream = out.add_stream(codec, 25, options)
            stream.height, stream.width = SIZE_PIXELS
            stream.pix_fmt = "yuv420p"
            for _ in range(6):
                out.mux(stream.encode(av.VideoFrame.from_ndarray(_picture(), "rgb24")))
            out.mux(stream.encode(None))

    return write


def _mesh(suffix: str) -> Callable[[Path], object]:
    """A subdivided tetrahedron in the format of the suffix."""

    def write(path: Path) -> None:
        import trimesh

        mesh = trimesh.creation.icosphere(subdivisions=1)
        path.write_bytes(_bytes(mesh.export(file_type=suffix)))

    return write


def _bytes(made: str | bytes) -> bytes:
    return made.encode() if isinstance(made, str) else made


TRACKS = (
    Track(1, 1, 0, 9, 10, 80.0, (0.9, 0.8), "swap", can_swap=True, action="swap"),
    Track(2, 2, 3, 7, 5, 40.0, (0.4,), "cover", "too small"),
)


def _tracks(path: Path) -> None:
    write_tracks(path, TRACKS, input_name="in.mp4", fingerprint="f", frames=10, seconds=np.arange(10) / 25)


def _rig(path: Path) -> None:
    plain = path.with_suffix(".ply")
    _mesh("ply")(plain)
    neutral = read_mesh(plain)
    write_rig(path, neutral, ["smile"], neutral.mesh.vertices[None] * 1.1, expressions={}, authors=["nobody"])


def _ball() -> Mesh:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=1)
    return Mesh(np.array(ball.vertices), np.array(ball.faces), np.zeros((0, 4), np.int64))


def _tracked(path: Path) -> None:
    """What `guise landmarks` writes, as far as it is read."""
    points = np.random.default_rng(0).uniform(0, 90, (81, 2)).round(2).tolist()
    faces = [{"track": 0, "confidence": 0.9, "points": points}]
    frames = [{"index": k, "faces": faces} for k in range(3)]
    head = {"format": TRACKED_FORMAT, "version": TRACKED_VERSION, "scheme": "face81"}
    path.write_text(json.dumps(head | {"frames": frames}))


def _report(path: Path) -> None:
    frames = np.arange(5, dtype=np.int32)
    boxes = np.tile(np.array([1, 2, 30, 40], np.int32), (5, 1))
    done = np.array([0, 0, 1, 1, 0], np.uint8)
    outcome = TrackOutcome(1, frames, done, np.ones(5, np.float32), done, boxes)
    report = FileReport("a.mp4", "b.mp4", 5, np.arange(5) / 25, 64, 48, TRACKS[:1], (outcome,), ())
    write_report(path, report)


def _key_file(path: Path) -> None:
    person = {"name": "1", "donor": "p01", "signature": [0.1] * SIGNATURE_LENGTH}
    path.write_text(
        json.dumps({"format": KEY_FILE_FORMAT, "version": KEY_FILE_VERSION, "seed": 3, "people": [person]})
    )


def _feature_points(path: Path) -> None:
    path.write_text(json.dumps({name: place for place, name in enumerate(FEATURE_POINT_NAMES)}))


def _decoded(path: Path) -> None:
    with open_input(path) as media:
        for frame in media:
            frame.rgb()
    scan(path)


def _model(path: Path) -> None:
    read_header(path)
    Identity.load(path)


READERS = {
    "model": Reader(".guise", lambda path: open_donor("p01").save(path), _model),
    "landmarks npz": Reader(".npz", _points, load_annotations),
    "compressed npz": Reader(".npz", _compressed_points, load_annotations),
    "landmarks JSON": Reader(".json", _points, load_annotations),
    "tracked JSON": Reader(".json", _tracked, load_annotations),
    "landmarks pts": Reader(
        ".pts", lambda path: path.write_bytes(pts_bytes(np.ones((68, 2)))), load_annotations
    ),
    "card": Reader(".toml", lambda path: path.write_text(CARDS["landmarks"]), read_card),
    "recogniser card": Reader(
        ".toml", lambda path: path.write_text(CARDS["recogniser"]), read_recogniser_card
    ),
    "PNG": Reader(".png", _image(4), read_deep),
    "PNG of 16 bits": Reader(".png", _image(3, np.uint16), read_deep),
    "JPEG": Reader(".jpg", _image(), read_deep),
    "TIFF": Reader(".tif", _image(3, np.uint16), read_deep),
    "WebP": Reader(".webp", _image(), read_deep),
    "HEIC": Reader(".heic", _still, read_deep),
    "AVIF": Reader(".avif", _still, read_deep),
    "JPEG 2000": Reader(".jp2", _still, read_deep),
    "animated GIF": Reader(".gif", _animation, _decoded),
    "animated WebP": Reader(".webp", _animation, _decoded),
    "animated PNG": Reader(".png", _animation, _decoded),
    "pages": Reader(".tif", lambda path: cv2.imwritemulti(str(path), [_picture()] * 2), _decoded),
    "MP4": Reader(".mp4", _video("libx264"), _decoded),
    "Matroska": Reader(".mkv", _video("mpeg4"), _decoded),
    "AVI": Reader(".avi", _video("mpeg2video"), _decoded),
    "OBJ": Reader(".obj", _mesh("obj"), read_mesh),
    "PLY": Reader(".ply", _mesh("ply"), read_mesh),
    "GLB": Reader(".glb", _mesh("glb"), read_mesh),
    "rig": Reader(".glb", _rig, read_rig),
    "VRM": Reader(".vrm", _rig, read_rig),
    "feature points": Reader(".json", _feature_points, lambda path: load_feature_points(path, _ball())),
    "tracks": Reader(".json", _tracks, lambda path: read_tracks(path, TRACKS, "f")),
    "report": Reader(".json", _report, read_report),
    "key file": Reader(".json", _key_file, KeyFile.open),
}


# -- damage ---------------------------------------------------------------------------------------------------


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four random changes: a bit, a byte, a number, a run, something left out or twice, an early end."""
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at, run = int(rng.integers(0, max(len(made), 1))), int(rng.integers(1, 33))
        kind = int(rng.integers(0, 8))
        if not made:
            break
        if kind == 0:
            made[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            made[at] = int(rng.integers(0, 256))
        elif kind == 2:
            made[at : at + run] = rng.bytes(run)
        elif kind == 3:
            made[at : at + 4] = int(rng.choice([0, 1, 2**31 - 1, 2**31, 2**32 - 1])).to_bytes(4, "little")
        elif kind == 4:
            del made[at : at + run]
        elif kind == 5:
            made[at:at] = made[at : at + run]
        elif kind == 6:
            made[at : at + 1] = bytes(
                rng.choice([b"-", b"9" * 30, b"1e999", b"null", b"[", b'"', b"\xff", b"NaN"])
            )
        elif rng.random() < 0.3:
            del made[at:]
    return bytes(made)


# -- running --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """What a reader made of a damaged file: "taken", "refused", "exception", "hang" or "crash", and details."""

    reader: str
    seed: int
    what: str
    details: str = ""


def outcome(name: str, sample: bytes, seed: int, folder: Path) -> Outcome:
    """Let a reader read a damaged file."""
    reader = READERS[name]
    path = folder / f"damaged{reader.suffix}"
    path.write_bytes(damaged(sample, np.random.default_rng([seed, sorted(READERS).index(name)])))
    try:
        reader.read(path)
    except GuiseError as error:
        return Outcome(name, seed, "refused", str(error))
    except Exception as error:  # what is looked for
        places = traceback.extract_tb(error.__traceback__)
        own = [p for p in places if "/lib/python" not in p.filename] or list(places)
        return Outcome(
            name, seed, "exception",
            f"{type(error).__name__}: {str(error)[:100]} ({Path(own[-1].filename).name}:{own[-1].lineno})",
        )  # fmt: skip
    return Outcome(name, seed, "taken")


def valid(name: str, folder: Path) -> bytes:
    """A valid file of a reader, which takes it."""
    path = folder / f"valid{READERS[name].suffix}"
    READERS[name].write(path)
    READERS[name].read(path)
    return path.read_bytes()


def _work(pipe: Connection, name: str, seeds: Sequence[int]) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        sample = valid(name, Path(folder))
        for seed in seeds:
            pipe.send(outcome(name, sample, seed, Path(folder)))


def outcomes(name: str, seeds: Sequence[int]) -> Iterator[Outcome]:
    """What a reader makes of the damaged files of some seeds, in processes of their own."""
    context, left = multiprocessing.get_context("fork"), list(seeds)
    while left:
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(theirs, name, left))
        process.start()
        theirs.close()
        try:
            while left:
                if not ours.poll(SECONDS_EACH):
                    yield Outcome(name, left.pop(0), "hang")
                    break
                yield ours.recv()
                left.pop(0)
        except EOFError:
            process.join()
            yield Outcome(name, left.pop(0), "crash", f"exit code {process.exitcode}")
        process.kill()
        process.join()


def measure(options: argparse.Namespace) -> Report:
    """All readers, the same number of files each."""
    names = options.only or list(READERS)
    each = -(-(200 if options.quick else options.mutations) // len(names))
    rows, bad = [], list[Outcome]()
    for name in names:
        found = list(outcomes(name, range(options.seed, options.seed + each)))
        counts = Counter(one.what for one in found)
        rows.append((name, len(found), *(counts[what] for what in KINDS)))
        worse = [one for one in found if one.what not in KINDS[:2]]
        for details, count in Counter(one.details for one in worse).most_common():
            first = next(one for one in worse if one.details == details)
            common.say(f"{name}, seed {first.seed}, {count} times: {first.what} {details}")
        bad += worse
        common.say(str(rows[-1]))
    total = Counter(one.what for one in bad)
    return Report(
        "fuzz", "Damaged files of every kind that is read",
        [
            Criterion("exceptions that are no sentence", float(total["exception"]), "<=", 0.0),
            Criterion("hangs", float(total["hang"]), "<=", 0.0),
            Criterion("crashes", float(total["crash"]), "<=", 0.0),
        ],
        [Table("Files", ("kind", "files", *KINDS), rows)],
    )  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--mutations", type=int, default=MUTATIONS, help="damaged files in all")
    made.add_argument("--seed", type=int, default=0, help="of the first damaged file of each kind")
    made.add_argument("--only", nargs="*", choices=list(READERS), help="kinds; all by default")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
