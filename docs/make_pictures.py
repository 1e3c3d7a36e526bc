"""Make the pictures of the pages from the sample clips and heads: docs/images/*.jpg.

python docs/make_pictures.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from guise.aam.model import Identity
from guise.analogy.formats.files import read_mesh, read_rig
from guise.app.deidentify.options import Options
from guise.app.deidentify.run.job import deidentify_file
from guise.app.deidentify.run.registry import open_engine
from guise.app.media import open_input
from guise.app.media.images import read_deep
from guise.app.media.pictures import Picture, labelled, save_picture, sheet
from guise.app.meshes.context import RunContext
from guise.app.meshes.pair import TransferOptions, prepare_pair
from guise.app.meshes.points import write_feature_points
from guise.app.meshes.previewing import preview_files
from guise.app.meshes.registering import register_files
from guise.app.meshes.transferring import draw_report_picture
from guise.app.people.montage import montage
from guise.app.photos.image import analogy_image
from guise.app.swapping.puppet import puppet_file
from guise.app.swapping.settings import SwapSettings
from guise.app.tools.demo import FACE, HEAD, run_demo
from guise.common.progress import silent

ROOT = Path(__file__).parents[1]
SAMPLES, IMAGES = ROOT / "sample_videos", ROOT / "docs" / "images"
FRAMES = (51, 77, 153)  # of the clip talk2: different mouths and head turns
NOBODY = "p07"  # of the gallery
WIDTH = 280  # pixels, of a frame
HEADS = SAMPLES / "heads"
SHOWN = ("anger", "open", "pucker", "smile", "surprise")  # morph targets of the mean head
MESH_WIDTH = 1400  # pixels, of the widest picture of heads
# Person and frame of talk2: at rest and with an expression, and another person at rest.
ANALOGIES = (
    (("p01", 126), ("p01", 116), ("p06", 132)),
    (("p06", 173), ("p06", 62), ("p01", 0)),
    (("p02", 0), ("p02", 158), ("p01", 126)),
)
HEAD_AND_SHOULDERS = np.s_[20:420, 140:500]  # of a frame


def frames(video: Path) -> list[Picture]:
    """The chosen frames of a video, small."""
    with open_input(video) as source:
        chosen = [frame.rgb() for frame in source if frame.index in FRAMES]
    return [np.asarray(cv2.resize(p, size(p), interpolation=cv2.INTER_AREA), np.uint8) for p in chosen]


def size(picture: Picture) -> tuple[int, int]:
    """Width and height of a small picture."""
    return WIDTH, round(picture.shape[0] * WIDTH / picture.shape[1])


def captioned(pictures: Sequence[Picture], text: str) -> list[Picture]:
    """The pictures with one caption under each."""
    return [labelled(picture, text) for picture in pictures]


def analogies(folder: Path) -> list[list[Picture]]:
    """Rows of S, S', T and T', small."""
    rows = []
    for number, faces in enumerate(ANALOGIES):
        files = [folder / f"{number}{role}.png" for role in ("s", "s1", "t", "t1")]
        for file, (person, index) in zip(files, faces, strict=False):
            with open_input(SAMPLES / person / "talk2.mp4") as source:
                picture = next(frame.rgb() for frame in source if frame.index == index)
            save_picture(file, picture[HEAD_AND_SHOULDERS])
        analogy_image(*files)
        row = [read_deep(file).rgb8() for file in files]
        rows.append([np.asarray(cv2.resize(p, size(p), interpolation=cv2.INTER_AREA), np.uint8) for p in row])
    names = ["S, at rest", "S', with an expression", "T, at rest", "guise analogy image: T'"]
    return [[labelled(p, name) for p, name in zip(row, names, strict=True)] for row in rows]


def heads(folder: Path) -> None:
    """The pictures of guise analogy mesh."""
    source, target = HEADS / "mean.obj", HEADS / "other.obj"
    rig, head = read_rig(HEADS / "mean.glb"), read_mesh(target)
    work = _work(folder / "mesh.png")
    carrier = prepare_pair(rig.file, head, TransferOptions(), work)
    faces = [rig.shapes[rig.names.index(name)] for name in SHOWN]
    draw_report_picture(carrier, faces, [carrier.transfer(face) for face in faces], SHOWN, work)
    register_files(source, target, folder / "fitted.obj", None, _work(folder / "mesh-chessboard.png"))
    write_feature_points(source, folder / "points.json", None, None, _work(folder / "mesh-landmarks.png"))
    preview_files(source, HEADS / "mean_smile.obj", folder / "mesh-preview.png", _work(None))
    for path in sorted(folder.glob("mesh*.png")):
        picture = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        width = min(MESH_WIDTH, picture.shape[1])
        small = width, round(picture.shape[0] * width / picture.shape[1])
        shrunk = np.asarray(cv2.resize(picture, small, interpolation=cv2.INTER_AREA), np.uint8)
        save_picture(IMAGES / f"{path.stem}.jpg", shrunk)


def _work(picture: Path | None) -> RunContext:
    return RunContext(True, silent, print, picture)


def main() -> None:
    """Enrol, swap, puppet, and draw."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        report = run_demo(SAMPLES, out / "demo", SwapSettings(say=print))
        head, face = (Identity.load(out / "demo" / f"{name}.guise") for name in (HEAD, FACE))
        clip = SAMPLES / HEAD / "talk2.mp4"
        puppet_file(clip, face, out / "puppet.mp4", source=head)
        deidentify_file(
            clip, out / "private.mp4", Options(donor=NOBODY), open_engine("local", 1),
            progress=lambda stage, share: None, say=print,
        )  # fmt: skip
        rows = [
            captioned(frames(clip), "the video"),
            captioned(frames(Path(report.swap.output)), "guise swap: another face"),
            captioned(frames(out / "puppet.mp4"), "guise puppet: another head"),
            captioned(frames(out / "private.mp4"), "guise deidentify: nobody's face"),
        ]
        save_picture(IMAGES / "swap.jpg", sheet(rows))
        save_picture(IMAGES / "model.jpg", montage(face, modes=4))
        heads(out)
        save_picture(IMAGES / "photo-analogy.jpg", sheet(analogies(out)))
    for picture in sorted(IMAGES.glob("*.jpg")):
        print(picture.relative_to(ROOT), picture.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
