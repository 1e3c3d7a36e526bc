"""Learn how people's faces are shaded in even light.

    python -m training.shading --real DATA

DATA holds `pairs/london`: photographs in the same soft light from the front, of which those that may be trained on are
used. Writes `aam/data/shading.npz`: `shading` (2, h, w, 3), the mean and the standard deviation over the people of
what `guise.aam.even_light.shading` measures, on the reference frame of `resolution` pixels; and its card beside it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from guise.aam.even_light import DATA, shading, symmetric
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64
from training.data import london_people

RESOLUTION = 64
CARD = """# Model card: shading in even light

Mean and standard deviation of how faces are shaded in soft light from the front (`training/shading.py`, which writes
this page), with which a donor's face is taken out of the light of their clip (`aam/even_light.py`).

- Licence: that of Guise (Apache-2.0).
- Data: photographs of {people} people of the Face Research Lab London Set (CC BY 4.0; DeBruine and Jones 2017,
  doi:10.6084/m9.figshare.5047666), without those kept for evaluation. Only the mean and the deviation are kept.
- Not meant for telling who somebody is; it cannot. Broad folds and stains of skin that few of these people have are
  softened.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--real", type=Path, required=True, help="folder with pairs/london")
    parser.add_argument("--out", type=Path, default=DATA)
    given = parser.parse_args()
    reference = ReferenceFrame.canonical(RESOLUTION)
    folder = given.real / "pairs" / "london"
    with np.load(folder / "face81_mediapipe.npz") as stored:
        points = {name: stored[name].astype(np.float64) for name in stored.files}
    names = [f"{person}_neutral" for person in london_people(folder)]
    seen = np.array([photographed(folder / f"{n}.jpg", points[n], reference) for n in names if n in points])
    learned = np.stack([seen.mean(0), seen.std(0)])
    np.savez_compressed(given.out, shading=learned.astype(np.float16), resolution=RESOLUTION)
    given.out.with_suffix(".md").write_text(CARD.format(people=len(seen)))
    print(f"{len(seen)} people, {given.out.stat().st_size} bytes")


def photographed(path: Path, points: F64, reference: ReferenceFrame) -> F32:
    """Shading (h, w, 3) of a face with points (81, 2) in a photograph."""
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert picture is not None, path
    soft = cv2.GaussianBlur(picture[..., ::-1], (0, 0), 0.4 * np.ptp(points[:, 0]) / reference.resolution)
    texture = reference.scatter(np.asarray(reference.sampler.sample(soft, points), np.float32))
    return shading(symmetric(texture, reference), reference)[0]


if __name__ == "__main__":
    main()
