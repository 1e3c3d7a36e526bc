"""Make the pictures of the README from the sample clips: docs/images/*.jpg.

python docs/make_pictures.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from aam.model import Identity
from app.deidentify.engines import open_engine
from app.deidentify.job import deidentify_file
from app.deidentify.options import Options
from app.demo import FACE, HEAD, run_demo
from app.media import open_source
from app.montage import montage
from app.pictures import Picture, labelled, save_picture, sheet
from app.puppet import puppet_file
from app.run import Settings

ROOT = Path(__file__).parents[1]
SAMPLES, IMAGES = ROOT / "sample_videos", ROOT / "docs" / "images"
FRAMES = (51, 77, 153)  # of the clip talk2: different mouths and head turns
NOBODY = "p07"  # of the gallery
WIDTH = 280  # pixels, of a frame


def frames(video: Path) -> list[Picture]:
    """The chosen frames of a video, small."""
    with open_source(video) as source:
        chosen = [frame.rgb() for frame in source if frame.index in FRAMES]
    return [np.asarray(cv2.resize(p, size(p), interpolation=cv2.INTER_AREA), np.uint8) for p in chosen]


def size(picture: Picture) -> tuple[int, int]:
    """Width and height of a small picture."""
    return WIDTH, round(picture.shape[0] * WIDTH / picture.shape[1])


def captioned(pictures: Sequence[Picture], text: str) -> list[Picture]:
    """The pictures with one caption under each."""
    return [labelled(picture, text) for picture in pictures]


def main() -> None:
    """Enrol, swap, puppet, and draw."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        report = run_demo(SAMPLES, out / "demo", Settings(say=print))
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
    for picture in sorted(IMAGES.glob("*.jpg")):
        print(picture.relative_to(ROOT), picture.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
