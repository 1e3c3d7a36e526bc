"""Make all pictures of the pages (docs/images) from the sample clips and heads, and the models that ship with Guise.

python docs/make_pictures.py [swap|heads|photos|gallery|studio ...]   (all by default; studio needs Chromium)
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import guise
from guise.aam.model import Identity
from guise.analogy.formats.files import read_mesh, read_rig
from guise.app.deidentify.options import DeidentifyOptions, Region
from guise.app.deidentify.run.job import deidentify_file
from guise.app.deidentify.run.registry import open_engine
from guise.app.media import open_input
from guise.app.media.images import read_deep
from guise.app.media.pictures import Picture, labelled, save_picture, sheet
from guise.app.meshes.context import RunContext
from guise.app.meshes.options import TransferOptions
from guise.app.meshes.pair import prepare_pair
from guise.app.meshes.points import write_feature_points
from guise.app.meshes.previewing import preview_files
from guise.app.meshes.registering import register_files
from guise.app.meshes.transferring import draw_report_picture
from guise.app.people.montage import montage, portrait
from guise.app.photos.image import analogy_image
from guise.app.swapping.donors import gallery, open_donor
from guise.app.swapping.report import SwapSettings
from guise.app.tools.demo import FACE, HEAD, run_demo
from guise.common.progress import silent

ROOT = Path(__file__).parents[1]
SAMPLES, IMAGES = ROOT / "sample_videos", ROOT / "docs" / "images"
FICTIONAL = "p07"  # of the gallery
WIDTH = 280  # pixels, of a frame
GALLERY_PIXELS = 160  # side of a portrait
HEADS = SAMPLES / "heads"
SHOWN = ("anger", "open", "pucker", "smile", "surprise")  # morph targets of the mean head
MESH_WIDTH = 1400  # pixels, of the widest picture of heads
# Person and frame of talk2: at rest and with an expression, and another person at rest.
ANALOGIES = (
    (("p01", 126), ("p01", 116), ("p06", 132)),
    (("p06", 173), ("p06", 62), ("p01", 0)),
    (("p02", 0), ("p02", 158), ("p01", 126)),
)
STRETCH = range(40, 172, 2)  # frames of talk2 in the moving picture, at half their rate
FPS, STUDIO_FPS = 15.0, 10.0
QUALITY = 70  # of WebP, 0..100
CLOCK_SECONDS = 1.0  # by which times of files may lie behind the clock
HEAD_AND_SHOULDERS = np.s_[20:420, 140:500]  # of a frame


def small(picture: Picture, width: int = WIDTH) -> Picture:
    """The picture at a smaller width."""
    size = width, round(picture.shape[0] * width / picture.shape[1])
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


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
        rows.append([small(read_deep(file).rgb8()) for file in files])
    names = ["S, at rest", "S', with an expression", "T, at rest", "guise analogy image: T'"]
    return [[labelled(p, name) for p, name in zip(row, names, strict=True)] for row in rows]


def heads(folder: Path) -> None:
    """The pictures of guise analogy mesh."""
    source, target = HEADS / "mean.obj", HEADS / "other.obj"
    rig, head = read_rig(HEADS / "mean.glb"), read_mesh(target)
    work = _work(folder / "mesh.png")
    pair = prepare_pair(rig.file, head, TransferOptions(), work)
    faces = [rig.shapes[rig.names.index(name)] for name in SHOWN]
    draw_report_picture(pair.heads, faces, [pair.transfer(face) for face in faces], SHOWN, work)
    register_files(source, target, folder / "fitted.obj", None, _work(folder / "mesh-chessboard.png"))
    write_feature_points(
        source, folder / "points.json", None, None, None, _work(folder / "mesh-landmarks.png")
    )
    preview_files(source, HEADS / "mean_smile.obj", folder / "mesh-preview.png", _work(None))
    for path in sorted(folder.glob("mesh*.png")):
        picture = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        shrunk = small(np.asarray(picture, np.uint8), min(MESH_WIDTH, picture.shape[1]))
        save_picture(IMAGES / f"{path.stem}.jpg", shrunk)


def _work(picture: Path | None) -> RunContext:
    return RunContext(True, silent, print, picture)


def swaps(folder: Path) -> None:
    """The moving picture of swap and deidentify, and the picture of a model."""
    report = run_demo(SAMPLES, folder / "demo", SwapSettings(say=print))
    clip, private, whole = SAMPLES / HEAD / "talk2.mp4", folder / "private.mp4", folder / "whole.mp4"
    regions: tuple[tuple[Path, Region], ...] = ((private, "face"), (whole, "head"))
    for video, region in regions:
        deidentify_file(
            clip, video, DeidentifyOptions(donor=FICTIONAL, region=region), open_engine("local", 1),
            progress=lambda stage, share: None, say=print,
        )  # fmt: skip
    save_moving(IMAGES / "swap.webp", moving((clip, Path(report.swap.output), private, whole)), FPS)
    save_picture(IMAGES / "model.jpg", montage(Identity.load(folder / "demo" / f"{FACE}.guise"), modes=4))


def moving(videos: Sequence[Path]) -> list[Picture]:
    """The same stretch of several videos beside each other, head and shoulders."""
    strips = []
    for video in videos:
        with open_input(video) as media:
            strips.append(
                [small(frame.rgb()[HEAD_AND_SHOULDERS]) for frame in media if frame.index in STRETCH]
            )
    return [np.concatenate(pictures, axis=1) for pictures in zip(*strips, strict=True)]


def save_moving(path: Path, pictures: Sequence[Picture], fps: float) -> None:
    """Write an animated WebP that repeats for ever."""
    first, *others = (Image.fromarray(picture) for picture in pictures)
    first.save(
        path, save_all=True, append_images=others, duration=1000 / fps, loop=0, quality=QUALITY, method=6
    )


def photos(folder: Path) -> None:
    """The picture of guise analogy image."""
    save_picture(IMAGES / "photo-analogy.jpg", sheet(analogies(folder)))


def portraits(folder: Path) -> None:
    """The picture of the donors that ship with Guise."""
    faces = [portrait(open_donor(name), GALLERY_PIXELS) for name in gallery()]
    save_picture(IMAGES / "gallery.jpg", np.concatenate(faces, axis=1))


def studio(folder: Path) -> None:
    """The moving picture of the studio."""
    from studio_picture import film_studio

    clip, model = SAMPLES / HEAD / "talk.mp4", folder / f"{HEAD}.guise"
    guise.enroll(clip).save(model)
    shots = film_studio(folder, model, clip, STUDIO_FPS)
    save_moving(IMAGES / "studio.webp", shots, STUDIO_FPS)


# What makes which files of docs/images.
PICTURES: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "swap": (swaps, ("swap.webp", "model.jpg")),
    "heads": (heads, ("mesh.jpg", "mesh-chessboard.jpg", "mesh-landmarks.jpg", "mesh-preview.jpg")),
    "photos": (photos, ("photo-analogy.jpg",)),
    "gallery": (portraits, ("gallery.jpg",)),
    "studio": (studio, ("studio.webp",)),
}


def make(name: str) -> None:
    """Make the pictures of a name.  RuntimeError when one of its files was not written."""
    maker, files = PICTURES[name]
    start = time.time()
    with tempfile.TemporaryDirectory() as folder:
        maker(Path(folder))
    for picture in (IMAGES / file for file in files):
        if not picture.exists() or picture.stat().st_mtime < start - CLOCK_SECONDS:
            raise RuntimeError(f"{name} did not make {picture.relative_to(ROOT)}")
        print(picture.relative_to(ROOT), picture.stat().st_size, "bytes", flush=True)


def main() -> None:
    """Make the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="|".join(PICTURES))
    names = parser.parse_args().names or list(PICTURES)
    if unknown := set(names) - PICTURES.keys():
        parser.error(f"names must be of {', '.join(PICTURES)}, got {', '.join(sorted(unknown))}")
    IMAGES.mkdir(exist_ok=True)
    for name in names:
        make(name)


if __name__ == "__main__":
    main()
