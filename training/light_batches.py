"""Batches of what the learned light is trained on: rendered swaps and photographs, in random lights and cameras.

RGB 0..255; grids are those of the learned light.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from guise.aam.light import LUMA
from guise.app.drawing.passes.light import CELL_FACE_WIDTHS, GRID
from guise.common.arrays import F32, U8
from training import swap_data
from training.swap_data import Cells, Samples

OWN_SHARE, RENDERED_LIGHT_SHARE = 0.3, 0.6  # of the photographs
MAX_OTHER = 0.05  # share of texels that are not skin in a cell of skin


@dataclass(frozen=True)
class Disturbance:
    """Standard deviations of what cameras do, as logs unless said otherwise."""

    exposure: float = 0.12
    white_balance: float = 0.07
    gamma: float = 0.1
    saturation: float = 0.1
    noise_grey_levels: float = 1.5
    at_rest: float = 0.5  # share of faces whose expression is weakened
    enrolled_here: float = 0.4  # share of scenes in whose light the person was enrolled
    occluded: float = 0.25  # share of faces with something in front
    occluder_radius_face_widths: tuple[float, float] = (0.08, 0.3)
    # Of rendered scenes: the share in another smooth light, on top of their own, and its strength; the share in part of
    # that of another scene, and the power of what is taken of it. Of donors and people as enrolled: the first two.
    relit: tuple[float, float] = (0.3, 0.3)
    lit_as_another: tuple[float, float] = (0.15, 0.8)
    enrolled_otherwise: tuple[float, float] = (0.4, 0.15)


DISTURBANCE = Disturbance()


@dataclass(frozen=True, eq=False)
class Batch:
    """The network's inputs; the face's means, truth and untouched (n, 3, h, w); shown (n, h, w)."""

    skin: Tensor
    other: Tensor
    own: Tensor
    rest: Tensor
    face: Tensor
    truth: Tensor
    untouched: Tensor
    shown: Tensor


class Lights:
    """Random factors of light (n, 1, 3, h, w).

    fields : (f, 3, h, w) of rendered people.
    """

    def __init__(self, fields: F32) -> None:
        self._fields = torch.tensor(fields)
        ys, xs = np.mgrid[: GRID[0], : GRID[1]].astype(np.float32) * CELL_FACE_WIDTHS
        self.places = torch.tensor(np.stack([xs - xs.mean(), ys - ys.mean()]))  # face widths from the middle

    def rendered(self, count: int, rng: np.random.Generator) -> Tensor:
        """Of rendered people."""
        return self._fields[rng.integers(len(self._fields), size=count)][:, None]

    def of_scenes(self, count: int, rng: np.random.Generator) -> Tensor:
        """Of rendered people, or smooth."""
        return _chosen(rng, RENDERED_LIGHT_SHARE, self.rendered(count, rng), self.smooth(count, 1.0, rng))

    def smooth(self, count: int, strength: float, rng: np.random.Generator) -> Tensor:
        """Slopes, curvature, some colour, and for one in three a soft shadow's edge."""
        x, y = self.places
        fields = torch.stack([x, y, x * x, x * y, y * y])
        grey = torch.einsum("nk,khw->nhw", as_tensor(rng.normal(0, strength * 0.7, (count, 5))), fields)[
            :, None
        ]
        tint = torch.einsum("nck,khw->nchw", as_tensor(rng.normal(0, strength * 0.12, (count, 3, 5))), fields)
        angle = rng.uniform(0, 2 * np.pi, count)
        normal = as_tensor(np.stack([np.cos(angle), np.sin(angle)], 1))
        edge = torch.einsum("nk,khw->nhw", normal, self.places) - as_tensor(
            rng.normal(0, 0.15, (count, 1, 1))
        )
        depth = as_tensor(np.where(rng.random(count) < 0.35 * strength, rng.uniform(0.2, 0.7, count), 0))
        width = as_tensor(rng.uniform(0.02, 0.15, count))
        shade = 1 - depth[:, None, None] * torch.sigmoid(edge / width[:, None, None])
        return ((grey + tint).exp() * shade[:, None])[:, None]

    def on_top(self, count: int, rng: np.random.Generator) -> Tensor:
        """What changes the light of some rendered scenes."""
        d = DISTURBANCE
        fields = self.rendered(count, rng)
        fields = (fields / fields.mean((3, 4), keepdim=True).clamp(min=0.05)).clamp(0.2, 3)
        fields = fields ** as_tensor(rng.uniform(0, d.lit_as_another[1], (count, 1, 1, 1, 1)))
        none = torch.ones_like(fields)
        rest = _chosen(rng, d.lit_as_another[0] / (1 - d.relit[0]), fields, none)
        return _chosen(rng, d.relit[0], self.smooth(count, d.relit[1], rng), rest)

    def of_enrolment(self, count: int, rng: np.random.Generator) -> Tensor:
        """What changes the light in which some people were enrolled."""
        share, strength = DISTURBANCE.enrolled_otherwise
        smooth = self.smooth(count, strength, rng)
        return _chosen(rng, share, smooth, torch.ones_like(smooth))


def _chosen(rng: np.random.Generator, share: float, first: Tensor, second: Tensor) -> Tensor:
    """A share of the rows of the first, the others of the second, both (n, ...)."""
    chosen = torch.tensor(rng.random(len(first)) < share)
    return torch.where(chosen.view(-1, *[1] * (first.dim() - 1)), first, second)


class Batches:
    """Samples as tensors, as they are or, with random lights, disturbed."""

    def __init__(self, samples: Samples, cells: Cells, lights: Lights | None = None) -> None:
        self._samples, self._weight = samples, torch.tensor(cells.weight)
        self._lights = lights
        ys, xs = np.mgrid[: GRID[0], : GRID[1]].astype(np.float32) * CELL_FACE_WIDTHS
        self._places = torch.tensor(xs), torch.tensor(ys)

    def plain(self, rows: np.ndarray) -> Batch:
        """As they are."""
        s = self._samples[rows]
        truth, untouched = (torch.tensor(x, dtype=torch.float32) for x in (s.truth, s.untouched))
        faces = [self._pictures(at) for at in (s.donor, s.scene, s.own, s.neutral)]
        return self._batch(
            *faces, truth, untouched, self._shown(s), self._weight.expand(len(rows), -1, -1, -1)
        )

    def random(self, count: int, rng: np.random.Generator) -> Batch:
        """Random ones in other lights and under the disturbances of three cameras."""
        d, lights = DISTURBANCE, self._lights
        assert lights is not None
        s = self._samples[rng.integers(len(self._samples.group), size=count)]
        donor, rest, scene, own = (self._pictures(at) for at in (s.donor, s.neutral, s.scene, s.own))
        truth, untouched = (torch.tensor(x, dtype=torch.float32) for x in (s.truth, s.untouched))
        share = as_tensor(np.where(rng.random(count) < d.at_rest, rng.random(count), 0)).view(-1, 1, 1, 1, 1)
        mild = lights.of_enrolment(count, rng)
        donor, rest = _camera([(donor + share * (rest - donor)) * mild, rest * mild], rng)
        lit, light = own * self._light(s)[:, None], lights.on_top(count, rng)
        scene, lit, truth, untouched = _camera(
            [one * light for one in (scene, lit, truth[:, None], untouched[:, None])], rng
        )
        (own,) = _camera([own * lights.of_enrolment(count, rng)], rng)
        here = torch.tensor(rng.random(count) < d.enrolled_here).view(-1, 1, 1, 1, 1)
        scene = scene + torch.randn(scene.shape) * d.noise_grey_levels
        seen = 0.3 + 0.7 * torch.rand(count, 1, *GRID)
        free = self._free(count, rng)
        weight, shown = self._weight * seen * free[:, None], self._shown(s) * free
        own = torch.where(here, lit, own)
        return self._batch(donor, scene, own, rest, truth[:, 0], untouched[:, 0], shown, weight)

    def _pictures(self, at: np.ndarray) -> Tensor:
        return torch.tensor(self._samples.pictures[at], dtype=torch.float32)

    def _shown(self, s: Samples) -> Tensor:
        return torch.tensor(s.shown, dtype=torch.float32) / 255

    def _light(self, s: Samples) -> Tensor:
        """(n, 3, h, w) factors of the scene's light."""
        mild, lit = s.pictures[s.own_now][:, 0], s.pictures[s.scene][:, 0]
        return torch.tensor(swap_data.field_between(mild, lit, self._weight[0].numpy()))

    def _batch(
        self, donor: Tensor, scene: Tensor, own: Tensor, rest: Tensor, truth: Tensor, untouched: Tensor,
        shown: Tensor, weight: Tensor,
    ) -> Batch:  # fmt: skip
        weight = weight[:, :, None]
        sums = torch.cat([donor * weight, scene * weight, weight], 2)
        whole = self._weight[:, None]
        face = (donor * whole).sum(1) / whole.sum(0).clamp(min=1e-6)
        return Batch(sums[:, 0], sums[:, 1], own, rest, face, truth, untouched, shown)

    def _free(self, count: int, rng: np.random.Generator) -> Tensor:
        """(n, h, w) 0 in an ellipse in some of them."""
        free = torch.ones(count, *GRID)
        for one in np.flatnonzero(rng.random(count) < DISTURBANCE.occluded):
            x, y = (rng.uniform(0, n * CELL_FACE_WIDTHS) for n in GRID[::-1])
            radius, slim = rng.uniform(*DISTURBANCE.occluder_radius_face_widths), rng.uniform(0.6, 1.6)
            free[one][(self._places[0] - x) ** 2 + ((self._places[1] - y) * slim) ** 2 < radius**2] = 0
        return free


class Portraits:
    """Photographs of real people, all taken in the same light, relit: with their own face, or another's.

    Another's face in their light is known: that of its photograph in the same light, in the skin tone of the first.
    Tones differ by a factor of second order in place, as in the rendered truth.

    Parameters
    ----------
    means : (m, 2, 3, h, w) of skin and of other texels.
    people : who each shows.
    """

    def __init__(self, means: U8, people: list[str], lights: Lights, cells: Cells) -> None:
        self._means, self.people = torch.tensor(means, dtype=torch.float32), np.array(people)
        self._lights, self._weight = lights, torch.tensor(cells.weight)
        x, y = lights.places
        skin = self._weight[0] * (self._weight[1] < MAX_OTHER)
        ways = torch.stack([torch.ones_like(x), x, y, x * x, x * y, y * y]).flatten(1)
        weighted = ways * skin.flatten()
        logs = (self._means[:, 0].flatten(2) + 1).log()
        fit = torch.linalg.solve(weighted @ ways.T, torch.einsum("kc,mpc->kmp", weighted, logs).flatten(1))
        self._tones = torch.einsum("kx,kc->xc", fit, ways).view(len(means), 3, *GRID)
        self._skin = skin

    def random(self, count: int, rng: np.random.Generator) -> Batch:
        """A batch, whose truth is the face in the light of the scene."""
        face = rng.integers(len(self.people), size=count)
        seen, own = rng.integers(len(self.people), size=count), rng.random(count) < OWN_SHARE
        for row in np.flatnonzero(own):
            seen[row] = rng.choice(np.flatnonzero(self.people == self.people[face[row]]))
        light = self._lights.of_scenes(count, rng)
        tone = (self._tones[seen] - self._tones[face]).exp()[:, None]
        same = torch.tensor(own | (self.people[face] == self.people[seen]))
        truth = torch.where(same.view(-1, 1, 1, 1, 1), self._means[seen], self._means[face] * tone)
        mild = self._lights.smooth(count, 0.3, rng)
        donor, rest = _camera([self._means[face] * mild, self._means[self._at_rest(face)] * mild], rng)
        person = self._means[self._at_rest(seen)]
        scene, lit, truth = _camera([self._means[seen] * light, person * light, truth * light], rng)
        (own,) = _camera([person * self._lights.smooth(count, 0.3, rng)], rng)
        here = torch.tensor(rng.random(count) < DISTURBANCE.enrolled_here).view(-1, 1, 1, 1, 1)
        scene = scene + torch.randn(scene.shape) * DISTURBANCE.noise_grey_levels
        weight = self._weight.expand(count, -1, -1, -1)[:, :, None]
        whole = self._weight.sum(0).clamp(min=1e-6)
        face_means, truth, untouched = ((x * weight).sum(1) / whole for x in (donor, truth, scene))
        sums = torch.cat([donor * weight, scene * weight, weight], 2)
        shown = torch.where(same[:, None, None], self._weight.sum(0), self._skin)
        own = torch.where(here, lit, own)
        return Batch(sums[:, 0], sums[:, 1], own, rest, face_means, truth, untouched, shown)

    def _at_rest(self, rows: np.ndarray) -> np.ndarray:
        """The first photograph of who is shown, which is at rest."""
        return np.array([np.flatnonzero(self.people == self.people[row])[0] for row in rows])

    def few(self) -> Iterable[Batch]:
        """Always the same batches."""
        rng = np.random.default_rng(0)
        with torch.random.fork_rng():
            torch.manual_seed(0)
            return [self.random(32, rng) for _ in range(6)]


def as_tensor(values: np.ndarray) -> Tensor:
    return torch.tensor(values, dtype=torch.float32)


def _camera(pictures: list[Tensor], rng: np.random.Generator) -> list[Tensor]:
    """Pictures (n, k, 3, h, w) as another camera would show them, the same one for all of a row."""
    d, n = DISTURBANCE, len(pictures[0])
    gain = as_tensor(np.exp(rng.normal(0, d.exposure, (n, 1)) + rng.normal(0, d.white_balance, (n, 3))))
    gamma = as_tensor(np.exp(rng.normal(0, d.gamma, n))).view(-1, 1, 1, 1, 1)
    saturation = as_tensor(np.exp(rng.normal(0, d.saturation, n))).view(-1, 1, 1, 1, 1)
    luma = torch.tensor(LUMA)[:, None, None]
    made = []
    for picture in pictures:
        lit = (picture / 255).clamp(1 / 512, 1) ** gamma * gain[:, None, :, None, None]
        grey = (lit * luma).sum(2, keepdim=True)
        made.append((255 * (grey + (lit - grey) * saturation)).clamp(0, 255))
    return made
