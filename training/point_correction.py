"""Learn what the landmarker's points lack, from rendered people.

    python -m training.point_correction --swaps PARTS --turns TURNS

PARTS is the output of `render_swaps.py`, TURNS that of `render_turns.py`. The shipped landmarker, without correction,
finds the points of everyone's pictures; every fifth group and person is held back and measured. Where the landmarker
has another definition of a point than the renderer, which is the mean difference in pictures from the front, turned
with the head, it keeps its own; but the jaw's points lie on the true jaw's line, which is the outline. Writes
`aam/data/point_correction.npz`, see `PointCorrection`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.correction import DATA, PointCorrection, features, made_upright, turn_of
from guise.aam.landmarks.face import Face
from guise.aam.landmarks.schemes import JAW, LEFT_EYE, LEFT_EYE_OUTER, MIRROR, RIGHT_EYE, RIGHT_EYE_OUTER
from guise.common.arrays import F64, U8

MAX_MISS_FACE_WIDTHS = 0.08  # mean distance from the truth, beyond which the landmarker missed the face
HELD_OUT = 5  # every so manieth file
COMPONENTS, RIDGE = 120, 0.1
FRONT = 0.15  # turn, see `turn_of`, up to which a picture is from the front
PROFILE = 1.7  # tangent of the turn of a profile; that of others is smaller by the sine of their yaw


def pictures(path: Path) -> Iterator[tuple[U8, F64]]:
    """All pictures of a file, and their exact points (81, 2)."""
    with np.load(path) as file:
        data = {name: file[name] for name in file.files}
    ends = np.cumsum(data["length"])
    for end, length, exact in zip(ends, data["length"], data["face81"].astype(np.float64), strict=True):
        picture = cv2.imdecode(data["jpeg"][end - length : end], cv2.IMREAD_COLOR)
        yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8), exact


def pairs(path: Path) -> tuple[F64, F64]:
    """Found and exact points (m, 81, 2) of a file's pictures, also mirrored."""
    landmarker, rows = BuiltinLandmarker(corrected=False), []
    for picture, exact in pictures(path):
        face = landmarker.refine(picture, Face.around(exact, 1.0))
        if face is None:
            continue
        missed = np.linalg.norm(face.points - exact, axis=1).mean()
        if missed < MAX_MISS_FACE_WIDTHS * np.ptp(exact[:, 0]):
            rows.append((face.points.astype(np.float64), exact))
    found, exact = (np.array(column).reshape(-1, 81, 2) for column in zip(*rows, strict=True))
    order = list(MIRROR)
    return np.concatenate([found, found[:, order] * (-1, 1)]), np.concatenate(
        [exact, exact[:, order] * (-1, 1)]
    )


def redefined(found: F64, exact: F64) -> F64:
    """Exact points (m, 81, 2) as the landmarker defines them."""
    upright, back = made_upright(exact)
    turns = turn_of(upright)
    front = np.abs(turns) < FRONT
    usual = ((found - exact) @ np.linalg.inv(back))[front].mean(0)
    usual = (usual + usual[list(MIRROR)] * (-1, 1)) / 2
    sines = np.clip(np.tan(turns) / PROFILE, -0.99, 0.99)
    turned = np.stack([np.sqrt(1 - sines**2), np.ones(len(turns))], axis=1)
    out = np.asarray(exact + (usual * turned[:, None]) @ back)
    out[:, JAW] = [on_line(points, line) for points, line in zip(out[:, JAW], exact[:, JAW], strict=True)]
    return out


def on_line(points: F64, line: F64) -> F64:
    """The places nearest to points (n, 2) on a line, given its corners (m, 2)."""
    first, way = line[:-1], np.diff(line, axis=0)
    share = ((points[:, None] - first) * way).sum(2) / (way**2).sum(1)
    nearest = first + np.clip(share, 0, 1)[..., None] * way
    chosen = np.linalg.norm(points[:, None] - nearest, axis=2).argmin(1)
    return np.asarray(nearest[np.arange(len(points)), chosen])


def learn(found: F64, exact: F64) -> dict[str, np.ndarray]:
    """The arrays of `PointCorrection` from points (m, 81, 2), both in the landmarker's definition."""
    upright, back = made_upright(found)
    away = (exact - found) @ np.linalg.inv(back)
    centre = upright.mean(0)
    _, lengths, axes = np.linalg.svd(upright - centre, full_matrices=False)
    axes = axes[:COMPONENTS].T / (lengths[:COMPONENTS] / np.sqrt(len(upright)))
    scale = (turn_of(upright)[:, None] ** np.arange(1, 4)).std(0)
    known = features(upright, centre, axes, scale).astype(np.float64)
    damping = RIDGE * len(known) * np.eye(known.shape[1])
    damping[0, 0] = 0
    weights = np.linalg.solve(known.T @ known + damping, known.T @ away.reshape(len(away), -1))
    columns = weights.reshape(len(weights), -1, 2)
    for eye in (RIGHT_EYE, LEFT_EYE):  # as a whole: how far it is open is seen better than predicted
        columns[:, eye] = columns[:, eye].mean(1, keepdims=True)
    arrays = {"centre": centre, "axes": axes, "scale": scale, "weights": weights}
    return {name: values.astype(np.float32) for name, values in arrays.items()}


def error(points: F64, exact: F64, usual: F64) -> F64:
    """(m,) mean distances in per cent of the inter-ocular distance; a usual difference (81, 2) of upright points is one
    of definition."""
    _, back = made_upright(exact)
    missed = np.linalg.norm(points - exact - usual @ back, axis=2).mean(1)
    return np.asarray(
        100 * missed / np.linalg.norm(exact[:, RIGHT_EYE_OUTER] - exact[:, LEFT_EYE_OUTER], axis=1)
    )


def usual_difference(points: F64, exact: F64) -> F64:
    """(81, 2) mean difference of upright points."""
    return np.asarray(((points - exact) @ np.linalg.inv(made_upright(exact)[1])).mean(0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--swaps", type=Path, required=True)
    parser.add_argument("--turns", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=DATA)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    files = [*sorted(given.swaps.glob("group_*.npz")), *sorted(given.turns.glob("person_*.npz"))]
    everyone = [pairs(path) for path in files]
    held = [number % HELD_OUT == 0 for number in range(len(files))]
    found, exact = (np.concatenate(part) for part in zip(*everyone, strict=True))
    exact = redefined(found, exact)
    out = np.concatenate([np.full(len(one[0]), away) for one, away in zip(everyone, held, strict=True)])
    np.savez_compressed(given.out, **learn(found[~out], exact[~out]))
    correct = PointCorrection(given.out)
    corrected = np.array([correct(points) for points in found])
    turned = np.abs(turn_of(made_upright(exact)[0])) > np.median(np.abs(turn_of(made_upright(exact)[0])))
    for name, points in (("found", found), ("corrected", corrected)):
        missed = error(points, exact, usual_difference(points[~out], exact[~out]))
        print(
            f"{name}: {missed[out & ~turned].mean():.2f} % less turned, {missed[out & turned].mean():.2f} % more"
        )
    np.savez_compressed(given.out, **learn(found, exact))
    print(f"{len(found)} faces of {len(files)} files; {given.out.name} {given.out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
