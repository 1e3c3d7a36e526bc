"""What the estimator of coefficients sees of rendered people, with the landmarker's points, in other light and cameras.

    python -m training.rig_sights --parts PARTS --output SIGHTS [--versions 3]

PARTS are those of `rig_pictures.py` (or of `render_people.py`, whose people have no picture at rest).  Every picture is
seen `versions` times, the first as it was rendered; the light of a sitting stays the same within a version.  For each
part a file of the same name with `eyes`, `mouth`, `shape` (see `guise.aam.rig.sight`), `weights` (n, 54), `group` (n,)
of what is one sitting in one version, `rest`, `person`, `glasses`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.rig.names import INDEX
from guise.aam.rig.sight import see
from guise.aam.solid_shape import SolidPrior
from guise.common.arrays import F64, U8
from training.arkit_shapes import UNIT_SHAPES
from training.camera import camera, lit

Rng = np.random.Generator
NOISE = 0.005  # standard deviation of what a landmarker finds in worse pictures, face widths
REAL, STILLS = 9_000_000, 9_100_000  # from which on numbers of groups are real clips, and stills
SITTINGS = 8  # room for a person's sittings in the number of a group


def of_units(names: list[str], weights: F64) -> F64:
    """(n, 54) of the renderer's own weights (n, k)."""
    found = np.zeros((len(weights), 54))
    for name, column in zip(names[:-2], weights.T, strict=False):
        for shape, share in UNIT_SHAPES.get(name, {}).items():
            found[:, INDEX[shape]] += share * column
    found[:, 52:] = weights[:, -2:]
    return found


def degraded(rng: Rng, light: Rng, image: U8) -> U8:
    """A picture in another light, by a camera of some kind; now and then from farther away."""
    image = lit(light, image)
    if rng.random() < 0.3:
        share = rng.uniform(0.35, 0.9)
        image = np.asarray(
            cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA), np.uint8
        )
    return camera(rng, image) if rng.random() < 0.7 else image


def sights(
    stored: Any, versions: int, landmarker: BuiltinLandmarker, offset: int
) -> Iterator[dict[str, Any]]:
    """The rows of one part."""
    prior, ends = SolidPrior.shipped(), np.cumsum(stored["length"])
    own = "weights" in stored.files
    count = len(ends)
    truth = (
        stored["weights"]
        if own
        else of_units(list(stored["expression_names"]), stored["expression"].astype(float))
    )
    sitting = stored["sitting"] if own else np.zeros(count, int)
    rest = stored["rest"] if own else np.zeros(count, bool)
    glasses = stored["glasses"] if own else np.zeros(count, bool)
    for k in range(count):
        code = stored["jpeg"][ends[k] - stored["length"][k] : ends[k]]
        image = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR)[..., ::-1], np.uint8)
        if not own and (abs(stored["pose"][k]) > (40, 28, 28)).any():
            continue
        ibug = stored["face81"][k][IBUG68]
        face = landmarker.points_in_box(
            np.ascontiguousarray(image), np.concatenate([ibug.min(0), ibug.max(0)])
        )
        if face is None:
            continue
        for version in range(versions):
            group = (int(stored["person"][k]) + offset) * SITTINGS * 4 + int(sitting[k]) * 4 + version
            shown, found = image, face.points.astype(np.float64)
            if version:
                rng, light = np.random.default_rng([k, group]), np.random.default_rng([7, group])
                cv2.setRNGSeed(group * 100 + k)
                shown = degraded(rng, light, np.ascontiguousarray(image))
                found = found + rng.normal(0, NOISE * np.ptp(found[IBUG68, 0]), found.shape)
                found = (found + 0.5) * (shown.shape[0] / image.shape[0]) - 0.5
            luma = cv2.cvtColor(shown, cv2.COLOR_RGB2GRAY)
            seen = see(np.asarray(luma, np.uint8), found, prior.fit(found).pose)
            yield {
                "eyes": seen.eyes, "mouth": seen.mouth, "shape": seen.shape.astype(np.float16),
                "weights": truth[k].astype(np.float32), "group": np.int64(group), "rest": rest[k],
                "person": np.int64(stored["person"][k] + offset), "glasses": glasses[k],
            }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--versions", type=int, default=3)
    parser.add_argument("--offset", type=int, default=0, help="added to the people's numbers")
    parser.add_argument(
        "--share", type=int, nargs=2, default=(0, 1), help="number of this process, of how many"
    )
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    landmarker = BuiltinLandmarker(turned=())
    for file in sorted(options.parts.glob("part_*.npz"))[options.share[0] :: options.share[1]]:
        path = options.output / file.name
        if path.exists():
            continue
        with np.load(file) as stored:
            rows = list(sights(stored, options.versions, landmarker, options.offset))
        whole = path.with_suffix(".partial")
        with whole.open("wb") as out:
            np.savez(out, **{key: np.array([row[key] for row in rows]) for key in rows[0]})
        whole.replace(path)
        print(path.name, len(rows), flush=True)


if __name__ == "__main__":
    main()
