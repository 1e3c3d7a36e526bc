"""What the learned light is trained on, laid out on its coarse grid.

The pictures of `render_swaps.py` are sampled on the reference frame as the engine samples them, the donor's and the
scene's under the points that the shipped landmarker finds, the truth where the engine would draw the donor's face, and
averaged in the cells of the learned light: what is misplaced in a swap is misplaced here. Donors' faces are made even
and fit for the tone of the head, as in the engine. RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
from scipy.sparse import csr_matrix

from guise.aam.coarse_grid import gaussian_kernel
from guise.aam.even_light import symmetric, without_glints
from guise.aam.mask import skin_mask
from guise.aam.reference import ReferenceFrame
from guise.aam.skin_tone import in_tone_of
from guise.app.drawing.passes.light import CELL_FACE_WIDTHS, GRID, part_masks, places
from guise.common.arrays import F32, F64, U8, Bool, Int
from training.data import london_people
from training.placement import Group, mirrored, read_group, transferred

RESOLUTION = 64
POINT_NOISE_FACE_WIDTHS = 0.006  # of each point
SHIFT_NOISE_FACE_WIDTHS = 0.004  # of all points together
MAX_HAIR_SHARE = 0.1  # of a texel that is shown
FIELD_FACE_WIDTHS, FIELD_FLOOR, FIELD_LIMITS = 0.03, 1e-3, (0.04, 6.0)  # of factors of light


@dataclass(frozen=True, eq=False)
class Samples:
    """n swaps, in cells (h, w).

    Attributes
    ----------
    pictures : (m, 2, 3, h, w) uint8 means of skin and of other texels, to which the next ones are indices.
    donor, neutral : (n,) the face that is shown, with the scene's expression and at rest, fit for the head.
    scene : (n,) the person in the scene.
    own, own_now : (n,) that person in their own mild light, at rest and with the scene's expression.
    truth, untouched : (n, 3, h, w) uint8 means of all: the scene with the donor's face, and as it is, in the same
        places.
    shown : (n, h, w) uint8, weight of what no hair covers, 255 for a whole cell.
    keeps_face : (n,) bool, whether the face that is shown is the person's own.
    group : (n,)
    """

    pictures: U8
    donor: Int
    neutral: Int
    scene: Int
    own: Int
    own_now: Int
    truth: U8
    untouched: U8
    shown: U8
    keeps_face: Bool
    group: Int

    def __getitem__(self, rows: np.ndarray) -> Samples:
        columns = (getattr(self, field.name)[rows] for field in fields(self)[1:])
        return Samples(self.pictures, *columns)


class Cells:
    """Means of textures in cells.

    Attributes
    ----------
    weight : (2, h, w) float32, texels of skin and others in each cell over those of a whole one.
    parts : (parts, h, w) float32 share of each of the learned light's parts.
    """

    def __init__(self, resolution: int = RESOLUTION) -> None:
        self.reference = ReferenceFrame.canonical(resolution)
        at = places(self.reference)
        corner = np.floor(at).astype(int)
        x, y = (at - corner).T
        rows = [(corner[:, 1] + dy) * GRID[1] + corner[:, 0] + dx for dy in (0, 1) for dx in (0, 1)]
        shares = [(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x]
        texels = np.arange(len(at))
        self._splat = csr_matrix(
            (np.concatenate(shares), (np.concatenate(rows), np.tile(texels, 4))), (GRID[0] * GRID[1], len(at))
        )
        skin = skin_mask(self.reference)[self.reference.mask]
        self._kinds = [kind.astype(np.float32) for kind in (skin, ~skin)]
        whole = float(self._splat.sum(1).max())
        self.weight = np.stack([self._laid_out(kind) / whole for kind in self._kinds])
        every = self._laid_out(np.ones(len(at), np.float32))
        self.parts = np.stack(
            [self._laid_out(part) / np.maximum(every, 1e-6) for part in part_masks(self.reference)]
        )

    def kinds(self, texture: F32) -> U8:
        """(2, 3, h, w) means of skin and of other texels."""
        texture = np.clip(texture, 0, 255)
        return np.stack([self.means(texture, kind) for kind in self._kinds])

    def fitted(self, texture: F32, person: F32) -> F32:
        """A texture (t, 3) at rest as the engine makes it fit for a person's (t, 3).

        But for shading: few rendered people are shaded as `evenly_lit` knows it from real ones.
        """
        face, own = (self.reference.scatter(t) for t in (texture, person))
        even = without_glints(symmetric(face, self.reference), self.reference)
        return np.asarray(in_tone_of(even, own, self.reference)[self.reference.mask], np.float32)

    def means(self, texture: F32, weight: F32) -> U8:
        """(3, h, w) means, 0 where nothing is."""
        sums = np.stack([self._laid_out(plane * weight) for plane in texture.T])
        return np.asarray(sums / np.maximum(self._laid_out(weight), 1e-6) + 0.5, np.uint8)

    def share(self, weight: F32) -> U8:
        """(h, w) weight in each cell, 255 for a whole one."""
        return np.asarray(
            255 * np.clip(self._laid_out(weight) / float(self._splat.sum(1).max()), 0, 1), np.uint8
        )

    def _laid_out(self, values: F32) -> F32:
        return np.asarray(self._splat @ values, np.float32).reshape(GRID)


def load(files: list[Path], cells: Cells, seed: int = 0) -> Samples:
    """All swaps of the groups in files, also mirrored, and everyone with their own face."""
    pictures: list[U8] = []
    rows = []
    for path in files:
        number = int(path.stem.split("_")[1])
        for found, swaps in _swaps(path, cells, np.random.default_rng([seed, number])):
            first = len(pictures)
            pictures += found
            rows += [(*(first + i for i in at), *row, number) for at, row in swaps]
    return Samples(np.array(pictures), *(np.array(column) for column in zip(*rows, strict=True)))


def light_fields(samples: Samples, cells: Cells) -> F32:
    """(m, 3, h, w) factors between the skin of those who have their own face, in the scene and in mild light."""
    own = samples[samples.keeps_face]
    weight = (own.shown / np.float32(255) * cells.weight[0])[:, None]
    return field_between(samples.pictures[own.own_now][:, 0], samples.pictures[own.scene][:, 0], weight)


def field_between(mild: U8 | F32, lit: U8 | F32, weight: F32) -> F32:
    """(n, 3, h, w) smooth factors from skin (n, 3, h, w) in one light to the same in another."""
    rows, columns = (gaussian_kernel(n, FIELD_FACE_WIDTHS / CELL_FACE_WIDTHS) for n in GRID)
    below, above = (rows @ (x * weight + FIELD_FLOOR) @ columns.T for x in (mild, lit))
    return np.asarray(np.clip(above / below, *FIELD_LIMITS), np.float32)


def portraits(folder: Path, cells: Cells, seed: int = 0) -> tuple[U8, list[str]]:
    """Means (m, 2, 3, h, w) of the photographs of pairs/london that may be trained on, and who each shows."""
    rng, rows, names = np.random.default_rng(seed), [], []
    with np.load(folder / "face81_mediapipe.npz") as stored:
        points = {name: stored[name].astype(np.float64) for name in stored.files}
    for person in london_people(folder):
        for name in (f"{person}_neutral", f"{person}_smile"):
            picture = cv2.imread(str(folder / f"{name}.jpg"), cv2.IMREAD_COLOR)
            if picture is None or name not in points:
                continue
            width = float(np.ptp(points[name][:, 0]))
            soft = cv2.GaussianBlur(picture[..., ::-1], (0, 0), 0.4 * width / RESOLUTION)
            rows.append(cells.kinds(cells.reference.sampler.sample(soft, _noisy(points[name], rng))))
            names.append(person)
    return np.array(rows), names


def _swaps(path: Path, cells: Cells, rng: np.random.Generator):
    with np.load(path) as file:
        data = {name: file[name] for name in file.files}
    people, k = int(data["people"]), int(data["scenes"])
    pictures = [
        cv2.imdecode(data["jpeg"][end - length : end], cv2.IMREAD_COLOR)[..., ::-1].copy()
        for end, length in zip(np.cumsum(data["length"]), data["length"], strict=True)
    ]
    width = pictures[0].shape[1]
    hair = np.unpackbits(data["hair"], axis=3)[..., :width].reshape(people * k, *pictures[0].shape[:2])
    points = read_group(path)
    yield _sampled(pictures, points, hair, cells, rng)
    flipped = [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures]
    yield _sampled(flipped, mirrored(points, width), hair[:, :, ::-1], cells, rng)


def _sampled(pictures, points: Group, hair, cells: Cells, rng: np.random.Generator):
    """Pictures of donors, of scenes and of faces fit for heads, and the swaps of everyone's face on everyone's head."""
    (people, k), sampler = points.donors.shape[:2], cells.reference.sampler
    hair = np.ascontiguousarray(hair, np.float32)
    # Who is turned away so far that nothing is found is sampled by the true points.
    donors, scenes = (
        np.where(np.isfinite(found), found, true).reshape(people * k, *found.shape[2:])
        for found, true in ((points.donors, points.true_donors), (points.scenes, points.true_scenes))
    )
    textures = [
        sampler.sample(picture, shape)
        for picture, shape in zip(pictures, np.concatenate([donors, scenes]), strict=False)
    ]
    at_rest = textures[: people * k : k]
    found = [cells.kinds(texture) for texture in textures]
    for head, donor in np.ndindex(people, people):
        change = cells.fitted(at_rest[donor], at_rest[head]) - at_rest[donor]
        found += [cells.kinds(texture + change) for texture in textures[donor * k : (donor + 1) * k]]
    drawn = np.repeat(scenes.reshape(1, people, k, -1, 2), people, 0).swapaxes(0, 1)
    drawn = np.where(np.eye(people, dtype=bool)[..., None, None, None], drawn, points.truths)
    for place in transferred(points, rng):
        drawn[place.head, place.donor, place.scene] = _shifted(place.drawn(), rng)
    truth, swaps = 2 * people * k, []
    for head, donor, j in np.ndindex(people, people, k):
        scene, face = head * k + j, (2 + head) * people * k + donor * k
        own, shape = people * k + scene if donor == head else truth, drawn[head, donor, j]
        shown = (sampler.sample(hair[scene], shape) < MAX_HAIR_SHARE).astype(np.float32)
        ideal, untouched = (
            cells.means(sampler.sample(pictures[i], shape), shown) for i in (own, people * k + scene)
        )
        at = face + j, face, people * k + scene, head * k, scene
        swaps.append((at, (ideal, untouched, cells.share(shown), donor == head)))
        truth += donor != head
    return found, swaps


def _shifted(shape: F64, rng: np.random.Generator) -> F64:
    width = float(np.ptp(shape[:, 0]))
    return np.asarray(shape + rng.normal(0, SHIFT_NOISE_FACE_WIDTHS * width, 2))


def _noisy(shape: F64, rng: np.random.Generator) -> F64:
    width = float(np.ptp(shape[:, 0]))
    return _shifted(shape + rng.normal(0, POINT_NOISE_FACE_WIDTHS * width, shape.shape), rng)
