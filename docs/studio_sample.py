"""Make the moving sample of the studio's first page: a sample clip, and beside it the same with other faces.

python docs/studio_sample.py
"""

from __future__ import annotations

import tempfile
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

import guise
from guise.app import studio
from guise.app.media import open_input
from guise.app.media.pictures import Picture

OUTPUT = Path(studio.__file__).parent / "static" / "sample.mp4"
CLIP = Path(__file__).parents[1] / "sample_videos" / "p06" / "talk.mp4"
FACES = ("Elena", "Mei", "Asha")
FPS, FRAMES_PER_FACE = 30, 54
CROP = np.s_[:, 80:560]  # of a frame
CRF = "25"


def main() -> None:
    """Swap the clip once for each face, and show them one after the other."""
    person = guise.enroll(CLIP)
    before, after = frames(CLIP), []
    with tempfile.TemporaryDirectory() as folder:
        for place, face in enumerate(FACES):
            swapped = Path(folder, f"{face}.mp4")
            guise.swap_file(CLIP, guise.load(face), swapped, source=person)
            after += frames(swapped)[place * FRAMES_PER_FACE : (place + 1) * FRAMES_PER_FACE]
    with av.open(str(OUTPUT), "w", options={"movflags": "faststart"}) as out:
        stream = out.add_stream("libx264", FPS, {"crf": CRF, "preset": "veryslow"})
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, FPS)
        stream.height, stream.width = after[0].shape[0], 2 * after[0].shape[1]
        for pair in zip(before, after, strict=False):
            picture = np.concatenate(pair, axis=1)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        out.mux(stream.encode(None))
    print(OUTPUT.name, OUTPUT.stat().st_size, "bytes")


def frames(path: Path) -> list[Picture]:
    """The frames of a video, cropped."""
    with open_input(path) as media:
        return [np.ascontiguousarray(frame.rgb()[CROP]) for frame in media]


if __name__ == "__main__":
    main()
