"""Trains the audit's own face detector and writes it as ONNX.

    python -m training.train_audit --parts PARTS [--real DATA] --output OUT

As `train_detector`, with people of its own, and from crops of scenes at any roll and size.  OUT gets `audit.onnx`,
which `round_audit.py` rounds to 8 bits, `curves.csv` and the weights.
"""

from __future__ import annotations

import argparse
import copy
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from guise.aam.landmarks.schemes import IBUG68, mean_geometry
from guise.aam.landmarks.voting import Votes, whole_blocks
from guise.aam.similarity import align_complex
from guise.common.arrays import F32, F64, U8
from training.audit_net import SIDES, STRIDE, UNIT, AuditNet
from training.backgrounds import faceless_photos
from training.data import load_parts
from training.scenes import SIZE, Scene, Scenes, real_people
from training.stored_weights import halve
from training.train_detector import Batch, Course, Samples, train

LEVELS = 5  # of pictures, each half as large as the one before, when it is measured
CROP = 128  # pixels, the side of what it learns from
MAY = (10.0, 32.0)  # pixels, sides of faces that a cell may answer for
CORE, RIM = 0.7, 1.2  # of a face's ellipse, within which cells say so, and beyond which they must not
AGAIN = 12  # times that a scene is shown, each time turned, scaled and cut otherwise
AIMED = 0.7  # of the crops are about a face, at a side that the cells may answer for
IN_SIGHT = 0.3  # share of the points of a face that a crop cuts, from which cells say so
FALSE = 0.5  # weight of cells that are in no face
RECENT = 800  # scenes from which those shown again are taken
VALIDATION_SCENES = 160

Rng = np.random.Generator


class AuditSamples(Samples):
    """Batches of crops of scenes, of which some were shown before."""

    def __init__(self, scenes: Scenes, steps: int, batch: int, seed: int) -> None:
        super().__init__(scenes, steps, batch, seed)
        self._recent: list[Scene] = []

    def made(self, rng: Rng) -> Batch:
        """Pictures (batch, CROP, CROP, 3), and what their cells are to answer: see `target`."""
        new = [self.scenes.make(rng) for _ in range(-(-self.batch // AGAIN))]
        self._recent = [*self._recent, *new][-RECENT:]
        old = [self._recent[int(rng.integers(len(self._recent)))] for _ in range(self.batch - len(new))]
        crops = [crop(rng, scene, self.scenes.background(rng)) for scene in (*new, *old)]
        return np.stack([c.image for c in crops]), [np.stack([target(c) for c in crops])]


def crop(rng: Rng, scene: Scene, beyond: U8) -> Scene:
    """A square of CROP of the scene at any roll, mirrored or not: about a face, or anywhere at any size.

    beyond : (SIZE, SIZE, 3) what is beyond the scene's edges, unless that is one colour.
    """
    angle = rng.uniform(-np.pi, np.pi) if rng.random() < 0.6 else rng.normal(0, 0.2)
    at = rng.uniform(0.1, 0.9, 2) * SIZE
    zoom = float(np.exp(rng.uniform(np.log(0.12), np.log(1.4))))
    if len(scene.points) and rng.random() < AIMED:
        points = scene.points[int(rng.integers(len(scene.points)))]
        side = float(np.exp(rng.uniform(np.log(MAY[0]), np.log(MAY[1]))))
        zoom = min(side / float(np.ptp(points, axis=0).max()), 2.0)
        reach = 0.55 * CROP / zoom
        at = points.mean(0) + rng.uniform(-reach, reach, 2)
    return _taken(rng, scene, beyond, at, float(angle), zoom)


def _taken(rng: Rng, scene: Scene, beyond: U8, at: F64, angle: float, zoom: float) -> Scene:
    image, shrunk = scene.image, 1.0
    if zoom < 0.7:  # average before sampling, so that nothing aliases
        side = max(2, round(SIZE * zoom * 1.2))
        image, shrunk = (
            np.asarray(cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA), np.uint8),
            side / SIZE,
        )
    cos, sin = zoom * np.cos(angle), zoom * np.sin(angle)
    linear = np.array([[cos, -sin], [sin, cos]]) @ np.diag([1 if rng.random() < 0.5 else -1, 1])
    shift = np.full(2, (CROP - 1) / 2) - linear @ at
    small = np.column_stack([linear / shrunk, shift + linear @ np.full(2, 0.5 / shrunk - 0.5)])
    y, x = rng.integers(0, SIZE - CROP, 2)
    taken = beyond[y : y + CROP, x : x + CROP].copy()
    if rng.random() < 0.3:
        taken[:] = rng.uniform(0, 255, 3) if rng.random() < 0.3 else rng.uniform(0, 255)
    cv2.warpAffine(image, small, (CROP, CROP), taken, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    points = scene.points @ linear.T + shift
    seen = ((points >= 0) & (points < CROP)).all(2).mean(1) if len(points) else np.zeros(0)
    corners = scene.unsure[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2) @ linear.T + shift
    cut = points[(seen < IN_SIGHT) & (seen > 0)]
    unsure = [np.concatenate([c.min(0), c.max(0)]) for c in (*corners, *cut)]
    return Scene(
        taken, _boxes(points[seen >= IN_SIGHT]), np.array(unsure).reshape(-1, 4), points[seen >= IN_SIGHT]
    )


def _boxes(points: F64) -> F64:
    return np.concatenate([points.min(1), points.max(1)], axis=1) if len(points) else np.zeros((0, 4))


def upright(points: F64) -> tuple[F64, F64, float]:
    """Centre (2,), half width and height (2,) and turn of a face with points (68, 2), as if turned upright."""
    mean, given = mean_geometry().mean[list(IBUG68)], points[:, 0] + 1j * points[:, 1]
    scales = [
        align_complex(one, given)[0][0] for one in (mean, -mean.conj())
    ]  # the points of a mirrored face, too
    turn = float(np.angle(max(scales, key=abs)))
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    moved = points @ back.T
    low, high = moved.min(0), moved.max(0)
    return back.T @ ((low + high) / 2), (high - low) / 2, turn


def target(scene: Scene) -> F32:
    """(9, h, w): in a face, weight of that, share of a face's cells, and the other six answers."""
    cells = len(scene.image) // STRIDE
    out = np.zeros((9, cells, cells), np.float32)
    out[1] = 1
    ys, xs = np.mgrid[:cells, :cells] * float(STRIDE) + (STRIDE - 1) / 2
    places = np.stack([xs, ys], -1)
    for low, high in scene.unsure.reshape(-1, 2, 2):
        out[1][((places > low) & (places < high)).all(-1)] = 0
    for points in scene.points:
        centre, half, turn = upright(points)
        side = 2 * float(half.max())
        if not MAY[0] <= side < MAY[1]:
            continue
        cos, sin = np.cos(turn), np.sin(turn)
        off = places - centre
        away = np.hypot(
            (cos * off[..., 0] + sin * off[..., 1]) / half[0],
            (cos * off[..., 1] - sin * off[..., 0]) / half[1],
        )
        out[1][(away < RIM) & (out[0] == 0)] = 0
        if not SIDES[0] <= side < SIDES[1]:
            continue
        core = away < max(CORE, float(away.min()) + 1e-6)
        out[0][core], out[1][core], out[2][core] = 1, 1, 1 / core.sum()
        answer = [-off[..., 0] / UNIT, -off[..., 1] / UNIT, *np.log(half / UNIT), np.sin(turn), -np.cos(turn)]
        for row, value in enumerate(answer, 3):
            out[row][core] = np.broadcast_to(value, core.shape)[core]
    return out


def loss_of(found: Tensor, targets: list[Tensor]) -> tuple[Tensor, dict[str, float]]:
    """Focal loss (Lin et al. 2017) of being in a face, each face counted once, and the distances of the answers."""
    maps, wanted = found.float(), targets[0]
    logit, face, weight, share = maps[:, 0], wanted[:, 0], wanted[:, 1], wanted[:, 2]
    faces, p = share.sum().clamp(min=1), torch.sigmoid(logit)
    missed = (4 * share * (1 - p) ** 2 * F.softplus(-logit)).sum() / faces
    false = (FALSE * (1 - face) * weight * p**2 * F.softplus(logit)).sum() / faces
    off = maps[:, 1:] - wanted[:, 3:]
    error = off[:, :2].abs().sum(1) + 2 * off[:, 2:4].abs().sum(1) + 2 * (off[:, 4:] ** 2).sum(1)
    answers = (share * error).sum() / faces
    figures = {"missed": missed, "false": false, "answers": answers}
    return missed + false + answers, {k: float(v.detach()) for k, v in figures.items()}


@torch.no_grad()
def validate(net: AuditNet, scenes: list[Scene]) -> dict[str, float]:
    """Share of faces found at 0.5, false ones a scene, and error of their turns in degrees."""
    net.eval()
    found, faces, false, turns = 0, 0, 0, [np.pi]
    for scene in scenes:
        sides = [SIZE >> k for k in range(LEVELS)]
        images = [cv2.resize(scene.image, (side, side), interpolation=cv2.INTER_AREA) for side in sides]
        maps = [net(torch.from_numpy(whole_blocks(image))[None])[0].float().numpy() for image in images]
        result = Votes.of(maps, [SIZE / side for side in sides]).boxes(0.5)
        centres = (result.boxes[:, :2] + result.boxes[:, 2:]) / 2
        true = np.zeros(len(centres), bool)
        for points in scene.points:
            centre, half, turn = upright(points)
            size = (result.boxes[:, 2:] - result.boxes[:, :2]).max(1) / (2 * half.max())
            near = (np.hypot(*(centres - centre).T) < half.max()) & (np.abs(np.log(size)) < 0.6)
            true, found = true | near, found + bool(near.any())
            turns += [abs(np.angle(np.exp(1j * (result.turns[k] - turn)))) for k in np.flatnonzero(near)[:1]]
        faces += len(scene.points)
        allowed = (((centres > b[:2]) & (centres < b[2:])).all(1) for b in (*scene.unsure, *scene.boxes))
        false += int((~np.any([true, *allowed], axis=0)).sum())
    turned = float(np.degrees(np.median(turns)))
    return {"recall": found / max(faces, 1), "false_a_scene": false / len(scenes), "turn": turned}


def export(net: AuditNet, path: Path) -> None:
    """Write the network as ONNX: input `image` uint8 (1, h, w, 3), output `votes` (1, 7, h', w').

    Its large weights are stored as float16.
    """
    net = copy.deepcopy(net).eval().float()
    axes = {"image": {1: "height", 2: "width"}, "votes": {2: "rows", 3: "columns"}}
    torch.onnx.export(
        net, (torch.zeros(1, SIZE, SIZE, 3, dtype=torch.uint8),), str(path), dynamo=False, opset_version=17,
        input_names=["image"], output_names=["votes"], dynamic_axes=axes,
    )  # fmt: skip
    halve(path)


def main() -> None:
    parser = argparse.ArgumentParser(description="Train the audit's face detector.")
    parser.add_argument("--parts", type=Path, required=True, help="folder of rendered parts")
    parser.add_argument(
        "--real", type=Path, help="folder with pairs/london and real; without it, rendered alone"
    )
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--batch", type=int, default=48)
    parser.add_argument("--rate", type=float, default=3e-3)
    parser.add_argument(
        "--real-share", type=float, default=0.3, help="share of real people among those pasted"
    )
    parser.add_argument("--seed", type=int, default=57)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    torch.set_flush_denormal(True)
    torch.set_num_threads(1)
    cv2.setNumThreads(0)  # before OpenCV starts any: the workers are forked
    torch.manual_seed(options.seed)
    options.output.mkdir(parents=True, exist_ok=True)
    real = real_people(options.real)[::2] if options.real else []
    photos = faceless_photos(options.real / "real")[::2] if options.real else []
    rng = np.random.default_rng([options.seed, 3])
    held = Scenes(load_parts(options.parts, held_out=True), [], [], 0, options.seed + 1, backgrounds=60)
    validation = [held.make(rng) for _ in range(VALIDATION_SCENES)]
    rendered = load_parts(options.parts, held_out=False)
    print(
        f"{len(rendered)} rendered pictures, {len(real)} real ones, {len(photos)} photographs without faces"
    )
    scenes = Scenes(rendered, real, photos, options.real_share, options.seed)
    samples = AuditSamples(scenes, options.steps, options.batch, options.seed)
    net = AuditNet().to(memory_format=torch.channels_last)
    course = Course(
        loss_of, partial(validate, scenes=validation), options.rate, options.workers, options.output,
        resume=options.resume, name="audit",
    )  # fmt: skip
    export(train(net, samples, course), options.output / "audit.onnx")


if __name__ == "__main__":
    main()
