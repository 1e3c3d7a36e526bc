"""Each compiled kernel beside its NumPy twin, and every instruction set beside the others."""

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

import guise.aam.shape_filter
import guise.app.drawing.plan  # noqa: F401, so that all kernels are known
from guise.aam.irises import LIMITS
from guise.aam.mask import beyond_mask
from guise.app.drawing.passes.irises import MOVES, TOLD, TintNumbers
from guise.app.drawing.passes.light import TOLD as TOLD_OF_LIGHT
from guise.app.drawing.passes.turned import _edges as edges_of
from guise.app.drawing.passes.turned import _inner_edges as inner_edges
from guise.common.kernels import COMPILED, RUNNING, TWINS
from guise.render.mesh import TexturedMesh, snap

MOST_LEVELS = 1  # of 255 between a kernel and its twin in a picture
MOST_PIXELS = 1e-3  # between places of both
compiled = pytest.mark.skipif(COMPILED is None, reason="no kernels are built here")
seeds = st.integers(0, 2**32 - 1)


def both(name: str, given: Callable[[], tuple[Any, ...]], outputs: tuple[int, ...]) -> list[list[np.ndarray]]:
    """What the twin, then the kernel of each instruction set, write into those of the arguments, and return."""
    made = []
    arguments = given()
    returned = TWINS[name](*arguments)
    made.append([arguments[k] for k in outputs] + ([] if returned is None else [np.array(returned)]))
    for which in COMPILED.sets():
        COMPILED.use(which)
        arguments = given()
        returned = getattr(COMPILED, name)(*arguments)
        made.append([arguments[k] for k in outputs] + ([] if returned is None else [np.array(returned)]))
    COMPILED.use(RUNNING)
    return made


def assert_alike(made: list[list[np.ndarray]], most: float) -> None:
    """The twin's within a distance of the kernels', and these the same to the last bit."""
    twin, *kernels = made
    for one in kernels[1:]:
        for array, other in zip(one, kernels[0], strict=True):
            np.testing.assert_array_equal(array, other)
    for array, other in zip(twin, kernels[0], strict=True):
        away = np.abs(array.astype(np.float64) - other.astype(np.float64))
        assert away.max(initial=0) <= most, f"{away.max()} at {np.unravel_index(away.argmax(), away.shape)}"


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(4, 40), st.sampled_from([0.3, 1.0]), st.sampled_from([0.5, 3.0, 12.0]))
def test_composite(seed: int, points: int, opacity: float, spread: float) -> None:
    rng = np.random.default_rng(seed)
    height, width = (int(side) for side in rng.integers(8, 40, 2))
    uv = rng.uniform(0, (width - 1, height - 1), (points, 2)).astype(np.float32)
    mesh = TexturedMesh(Delaunay(uv).simplices.astype(np.int32), uv, height, width)
    # folded over itself, partly beside the picture, and some triangles without area
    vertices = 2 * uv + rng.normal(0, spread, uv.shape) - 10
    vertices[: points // 4] = np.round(vertices[: points // 4])
    snapped = snap(vertices, points)
    texture, alpha, frame = (
        rng.integers(0, 256, shape, np.uint8) for shape in ((height, width, 3), (height, width), (60, 70, 3))
    )

    def arguments() -> tuple[Any, ...]:
        target = frame.copy()[3:-2, 4:-7]
        return texture, alpha, snapped, mesh.triangles, mesh.grid, opacity, target

    assert_alike(both("composite", arguments, (6,)), MOST_LEVELS)


def on_mesh(rng: np.random.Generator, places: int, size: tuple[int, int]) -> tuple[Any, ...]:
    """Corners and weights (3, n) of places of a mesh, and its points, some of them beside a picture (h, w)."""
    points = rng.uniform(-8, np.array(size[::-1]) + 8, (30, 2))
    weights = rng.dirichlet((1, 1, 1), places).T.astype(np.float32)
    return rng.integers(0, len(points), (3, places)), np.ascontiguousarray(weights), points


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.sampled_from([0.0, 0.5]))
def test_show_through(seed: int, sharpening: float) -> None:
    rng = np.random.default_rng(seed)
    h, w, high, wide = (int(side) for side in rng.integers(1, 30, 4))
    roi = rng.integers(0, 256, (high + 5, wide + 9, 3), np.uint8)[2:-3, 4:-5]
    mesh = on_mesh(rng, h * w, (high, wide))

    def arguments() -> tuple[Any, ...]:
        return *mesh, roi, sharpening, np.zeros((h * w, 2), np.float32), np.zeros((h, w, 3), np.float32)

    made = both("show_through", arguments, (5, 6))
    assert_alike([[places] for places, _ in made], MOST_PIXELS)
    assert_alike([[own] for _, own in made], 0.1)


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(1, 5))
def test_sample_cells(seed: int, layers: int) -> None:
    rng = np.random.default_rng(seed)
    h, w, count = (int(side) for side in rng.integers(2, 30, 3))
    mesh = on_mesh(rng, count, (h, w))
    depth, across = rng.normal(0, 0.3, count).astype(np.float32), rng.normal(0, 3, 2).astype(np.float32)
    to_cells = np.eye(2, 3) + rng.normal(0, 0.1, (2, 3))
    maps = rng.random((h, w, layers), np.float32) / 16  # the twin reads at whole 32nds

    def arguments() -> tuple[Any, ...]:
        places, shares = np.empty((count, 2), np.float32), np.empty((layers, count), np.float32)
        return mesh[2], mesh[0], mesh[1], depth, across, maps, to_cells, places, shares

    assert_alike(both("sample_cells", arguments, (7, 8)), 1 / 255)


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.floats(0, 1))
def test_lay_over(seed: int, shown: float) -> None:
    rng = np.random.default_rng(seed)
    h, w = (int(side) for side in rng.integers(1, 30, 2))
    own = rng.uniform(-30, 290, (h, w, 3)).astype(np.float32)
    share = rng.random((h, w + 3), np.float32)[:, 2:-1]
    picture = rng.integers(0, 256, (h, w + 7, 3), np.uint8)

    def arguments() -> tuple[Any, ...]:
        return own, share, shown, picture.copy()[:, 3:-4]

    assert_alike(both("lay_over", arguments, (3,)), MOST_LEVELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 1200), st.integers(1, 9))
def test_expressed(seed: int, pixels: int, modes: int) -> None:
    rng = np.random.default_rng(seed)
    base = rng.uniform(0, 255, 3 * pixels).astype(np.float32)
    matrix = rng.normal(0, 10.0 ** rng.integers(-6, 1), (modes, 3 * pixels)).astype(np.float16)
    away, factors = rng.normal(0, 20, modes).astype(np.float32), rng.uniform(0, 2, pixels).astype(np.float32)

    def arguments() -> tuple[Any, ...]:
        return base, matrix, away, factors, np.empty_like(base)

    assert_alike(both("expressed", arguments, (4,)), 0.01)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds)
def test_lit_and_scattered(seed: int) -> None:
    rng = np.random.default_rng(seed)
    height, width = (int(side) for side in rng.integers(4, 30, 2))
    mask = rng.random((height, width)) < 0.7
    mask[0, 0] = True
    pixels = np.flatnonzero(mask)
    texture = rng.uniform(0, 255, (len(pixels), 3)).astype(np.float32)
    cells = rng.normal(1, 0.3, (6, height // 4 + 2, width // 4 + 2)).astype(np.float32)
    in_parts = np.sort(rng.permutation(len(pixels))[: len(pixels) // 3])
    shares = rng.random((2, len(in_parts))).astype(np.float32)
    parts, to_stored = (rng.normal(0.5, 0.2, shape).astype(np.float32) for shape in ((2, 3), (3, 4)))

    skin = rng.permutation(len(pixels))[: len(pixels) // 2]
    corners, corner_shares = rng.integers(0, cells[0].size, (4, len(skin))), rng.random((4, len(skin)))
    at_rest = (texture[skin] + rng.normal(0, 9, (len(skin), 3))).astype(np.float32)

    def light() -> tuple[Any, ...]:
        planes = np.empty((3, len(pixels)), np.float32)
        return (
            texture, pixels, width, 4.1, cells, skin, at_rest, corners, corner_shares, in_parts, shares, parts,
            to_stored, planes,
        )  # fmt: skip

    made = both("lit", light, (13,))
    assert_alike(made, 0.01)
    planes, (beside, nearest) = made[0][0], beyond_mask(mask)

    def layout() -> tuple[Any, ...]:
        return planes, pixels, beside, nearest, np.zeros((height, width, 3), np.uint8)

    assert_alike(both("scattered", layout, (4,)), 0)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(0, 300), st.integers(0, 4), st.integers(0, 4))
def test_texel_sums(seed: int, texels: int, planes: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    corners, shares = rng.integers(0, 5 * 6, (4, texels)), rng.random((4, texels))
    values = rng.uniform(0, 255, (texels, planes)).astype(np.float32)
    seen = rng.uniform(0, 255, (texels + 9, more)).astype(np.float32)
    weights, chosen = rng.random(len(seen)).astype(np.float32), rng.integers(0, len(seen), texels)

    def arguments() -> tuple[Any, ...]:
        return corners, shares, values, seen, chosen, weights, np.empty((planes + more + 1, 5, 6), np.float32)

    assert_alike(both("texel_sums", arguments, (6,)), 0.01)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(0, 1), st.sampled_from([120.0, 255.0]))
def test_move_light(seed: int, share: float, brightest: float) -> None:
    rng = np.random.default_rng(seed)
    size = tuple(int(side) for side in rng.integers(1, 30, 2))
    weights = rng.uniform(0, 3, size) * (rng.random(size) < 0.9)
    sums = np.concatenate([rng.uniform(20, brightest, (6, *size)) * weights, weights[None]]).astype(
        np.float32
    )
    at_rest, kept = (rng.uniform(0.5, 2, (count, *size)).astype(np.float32) for count in (3, 6))
    tone = rng.uniform(0.6, 1.6, 3).astype(np.float32)

    def arguments() -> tuple[Any, ...]:
        return (
            sums,
            100 * at_rest,
            tone,
            TOLD_OF_LIGHT,
            kept,
            share,
            np.empty_like(kept),
            np.empty(3, np.float32),
        )

    assert_alike(both("move_light", arguments, (6, 7)), 1e-3)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 40), st.integers(1, 40), st.integers(0, 2), st.integers(0, 1))
def test_merge_planes(seed: int, height: int, width: int, shift_x: int, shift_y: int) -> None:
    rng = np.random.default_rng(seed)
    left, top = (int(rng.integers(0, 1 << shift)) for shift in (shift_x, shift_y))
    cells = ((top + height - 1) >> shift_y) + 1, ((left + width - 1) >> shift_x) + 1
    luma, u, v = (
        rng.integers(0, 256, (rows, columns + 5), np.uint8)[:, 3:-2]
        for rows, columns in ((height, width), cells, cells)
    )

    def arguments() -> tuple[Any, ...]:
        return luma, u, v, shift_x, shift_y, left, top, np.empty((height, width, 3), np.uint8)

    assert_alike(both("merge_planes", arguments, (7,)), 0)


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.booleans(), st.booleans(), st.floats(0.3, 3.0))
def test_tint_iris(seed: int, is_light: bool, lightens: bool, blur: float) -> None:
    rng = np.random.default_rng(seed)
    h, w = (int(side) for side in rng.integers(5, 40, 2))
    ys, xs = np.mgrid[:h, :w].astype(np.float32)
    middle, radius = np.array([w, h]) / 2, 0.25
    away = np.hypot(xs - rng.normal(middle[0], w / 10), ys - middle[1])[..., None] / (radius * w)
    eye = np.where(away < 1, 70, 190) * rng.uniform(0.7, 1.4, (h, w, 1)) + rng.normal(0, 12, (h, w, 3))
    places = np.stack([xs, ys], -1).reshape(-1, 2) + rng.normal(0, 0.1, (h * w, 2))
    axes = np.array([middle, (1 / w, 0.001), (-0.001, 1 / w)], np.float32)
    cells = rng.random((9, 9), np.float32) ** 0.2
    to_cells = np.array([[7 / w, 0, 0.4], [0, 9 / h, -0.6]])
    lids = rng.random((h, w + 2), np.float32)[:, 1:-1]
    to_rgb, from_rgb = (np.asarray(np.eye(3, 4) + rng.normal(0, 0.05, (3, 4)), np.float32) for _ in range(2))
    factors = rng.uniform(0.3, 1.5, (2, 3)).astype(np.float32)
    profiles = rng.uniform(0.1, 1, (2, LIMITS.rings, 3)).astype(np.float32)
    told = TintNumbers(is_light, lightens, radius, 0.9, blur, 2.0, rng.uniform(0.1, 1), 0.25)
    place = rng.normal(0, 0.05, (2, 2))

    def arguments() -> tuple[Any, ...]:
        return (
            places.astype(np.float32), axes, cells, to_cells, lids, np.flatnonzero(lids > 0.5), to_rgb, from_rgb,
            MOVES, factors, profiles, np.hstack([told, TOLD]), place.copy(), eye.astype(np.float32),
        )  # fmt: skip

    made = both("tint_iris", arguments, (12, 13))
    assert_alike([[gaze] for gaze, _ in made], 1e-6)
    assert_alike([[picture] for _, picture in made], 0.1)


@compiled
@settings(max_examples=40, deadline=None)
@given(seeds, st.floats(0.0, 2.0))
def test_enlarge(seed: int, contrast: float) -> None:
    rng = np.random.default_rng(seed)
    height, width = (int(side) for side in rng.integers(1, 40, 2))
    picture = rng.integers(0, 256, (height, width, 3), np.uint8)
    detail = rng.normal(0, 40, (2 * height, 2 * width)).astype(np.float32)
    top, left = int(rng.integers(height)), int(rng.integers(width))
    fold = rng.random((height - top, int(rng.integers(1, width - left + 1)))).astype(np.float32)

    def arguments() -> tuple[Any, ...]:
        return picture, detail, contrast, fold, left, top, np.empty((*detail.shape, 3), np.uint8)

    assert_alike(both("enlarge", arguments, (6,)), MOST_LEVELS)


@compiled
@settings(max_examples=40, deadline=None)
@given(seeds, st.sampled_from([0.0, 0.05, 0.4, 1.0]), st.floats(0.5, 6.0))
def test_lay_skin(seed: int, amount: float, sigma: float) -> None:
    rng = np.random.default_rng(seed)
    height, width, rows, columns = (int(side) for side in rng.integers(3, 30, 4))
    roi = cv2.resize(rng.integers(0, 256, (height, width, 3), np.uint8), None, fx=2, fy=2)
    cells = rng.uniform(-5, 5 + 2 * max(height, width), (rows, columns, 2)).astype(np.float32)
    share = rng.random((4 * rows, 4 * columns)).astype(np.float32)
    texture = rng.integers(0, 256, (*share.shape, 3), np.uint8)
    fold = float(rng.choice([3.0, 30.0]))

    def arguments() -> tuple[Any, ...]:
        return roi, cells, share, sigma, fold, amount, texture.copy()

    assert_alike(both("lay_skin", arguments, (6,)), MOST_LEVELS)


@compiled
@settings(max_examples=40, deadline=None)
@given(seeds, st.integers(5, 30), st.sampled_from([0.05, 0.4]))
def test_find_folds(seed: int, count: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    grid = rng.uniform(0, 40, (count, 2))
    triangles = Delaunay(grid).simplices.astype(np.int32)
    to_edges = np.linalg.inv(edges_of(grid, triangles))
    points = 1.5 * grid * (rng.uniform(0.1, 1), 1) + rng.normal(0, 40 * spread, grid.shape)
    closing = rng.random(len(triangles)) < 0.2
    ends, sides = inner_edges(triangles, closing)
    limits, returned = np.array([1.5, 0.35, 0.15, 1.5]), []

    def arguments() -> tuple[Any, ...]:
        return (
            points,
            triangles,
            to_edges,
            closing,
            ends,
            sides,
            limits,
            np.zeros(len(triangles), np.float32),
            (np.zeros((len(ends), 2, 2))),
        )

    assert_alike(both("find_folds", arguments, (7, 8)), 1e-3)
    for run in (TWINS["find_folds"], COMPILED.find_folds):
        returned.append(run(*arguments()))
    assert returned[0] == returned[1]


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(1, 2), st.sampled_from([0.0, 0.01, 3.0, 20.0]))
def test_keep_brow(seed: int, factor: int, stretched: float) -> None:
    rng = np.random.default_rng(seed)
    h, w = (int(side) for side in rng.integers(2, 25, 2))
    inside, weights, at_rest = on_mesh(rng, h * w, (h, w))
    ends, end_weights, _ = on_mesh(rng, 2 * w, (h, w))
    drawn = at_rest + rng.normal(0, stretched, at_rest.shape)
    heights = rng.uniform(-0.5, 1.5, (h, w)).astype(np.float32)
    columns = np.array(
        [rng.uniform(0, 9, w), rng.uniform(5, 20, w), rng.uniform(0.2, 0.8, w), rng.uniform(0, 1, w)],
        np.float32,
    )
    picture = rng.integers(0, 256, (factor * h + 11, factor * w + 5, 3), np.uint8)

    def arguments() -> tuple[Any, ...]:
        part = picture.copy()[:, 2:-3]
        limits = np.array([1.0, 0.02, 0.6, 1.8, 0.8])
        return (
            inside, weights, ends, end_weights, drawn, at_rest, heights, columns, limits, 4, factor, part,
        )  # fmt: skip

    assert_alike(both("keep_brow", arguments, (11,)), MOST_LEVELS)


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.floats(0.5, 2.0), st.sampled_from([3, 9]))
def test_energies(seed: int, sigma: float, box: int) -> None:
    rng = np.random.default_rng(seed)
    h, w = (int(side) for side in rng.integers(12, 60, 2))
    picture = rng.integers(0, 256, (h, w + 4, 3), np.uint8)[:, 1:-3]
    places = rng.uniform(-3, np.array([w, h]) + 3, (50, 2)).astype(np.float32)

    for name, more in (("gradient_at", ()), ("grain_at", (box,))):

        def arguments(more: tuple[int, ...] = more) -> tuple[Any, ...]:
            return picture, places, sigma, *more, np.zeros(len(places), np.float32)

        # where a level is rounded the other way, a gradient changes by up to 3 / 8 of a level
        made = both(name, arguments, (3 + len(more),))
        assert_alike([[np.sqrt(energies), count] for energies, count in made], 0.5)


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(-6, 6))
def test_brow_shifts(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    h, w, shifts = (int(n) for n in rng.integers((12, 12, 15), (25, 25, 18)))
    luma = rng.integers(0, 256, (60, 50), np.uint8)
    xs, ys = np.meshgrid(np.arange(w), np.arange(h + shifts - 1))
    points = np.array([[0.0, 0.0], [40.0, 0.0], [0.0, 40.0]])
    places = np.column_stack([xs.ravel(), ys.ravel()]) / 40
    weights = np.vstack([1 - places.sum(1), places.T]).astype(np.float32)
    corners = np.tile(np.arange(3)[:, None], (1, 2 * len(places)))
    middle = shifts // 2 + rows
    at_rest = luma[middle : middle + h, :w].astype(np.float32) + rng.normal(0, 20, (h, w)).astype(np.float32)

    def arguments() -> tuple[Any, ...]:
        return (
            corners, np.ascontiguousarray(np.hstack([weights, weights])), points + 0.3, luma,
            at_rest, at_rest[::-1].copy(),
            np.array([0.006, 0.4, 0.6]), 0.001 * np.arange(-(shifts // 2), shifts - shifts // 2) ** 2.0,
            np.zeros(2),
        )  # fmt: skip

    assert_alike(both("brow_shifts", arguments, (8,)), 1e-5)


@compiled
@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(1, 3), st.floats(0.8, 5.0), st.integers(1, 4))
def test_paint_over(seed: int, reach: int, sigma: float, step: int) -> None:
    rng = np.random.default_rng(seed)
    high, wide = (int(side) for side in rng.integers(3 * step, 60, 2))
    size = -(-high // step), -(-wide // step)
    brows, skin = ((rng.random(size, np.float32) * 1.4).clip(0, 1) for _ in range(2))
    brows[: size[0] // 2] = 0
    told = np.array([reach, sigma, 0.06, 0.25, 0.5, 1.0, 0.003, 0.02])
    colours = np.array([150, 120, 140]) + rng.normal(0, 20, (high, wide + 5, 3))
    frame = colours.clip(0, 255).astype(np.uint8)

    def arguments() -> tuple[Any, ...]:
        return brows, skin, told, frame.copy()[:, 2:-3]

    assert_alike(both("paint_over", arguments, (3,)), MOST_LEVELS)


@compiled
def test_each_kernel_has_a_twin_and_is_used() -> None:
    kernels = {name for name in dir(COMPILED) if not name.startswith("_")} - {"sets", "use"}
    assert kernels == set(TWINS)


@compiled
def test_arrays_that_do_not_fit_are_refused() -> None:
    bytes_ = np.zeros((4, 4, 3), np.uint8)
    with pytest.raises(TypeError, match="7 arguments are wanted, not 1"):
        COMPILED.composite(bytes_)
    arguments = [
        bytes_,
        bytes_[..., 0],
        np.zeros((3, 2)),
        np.zeros((1, 3), np.int32),
        np.zeros((7, 1)),
        1.0,
        bytes_,
    ]
    arguments[6] = np.zeros((4, 8, 3), np.uint8)[:, ::2]
    with pytest.raises(ValueError, match="argument 7 must hold its entries side by side"):
        COMPILED.composite(*arguments)
    arguments[6] = bytes_
    arguments[1] = np.zeros((4, 4), np.float32)
    with pytest.raises(TypeError, match="argument 2 has the wrong type"):
        COMPILED.composite(*arguments)
    arguments[1] = np.zeros((5, 4), np.uint8)
    with pytest.raises(ValueError, match="alpha must be"):
        COMPILED.composite(*arguments)
    arguments[1] = np.zeros((4, 4), np.uint8)
    arguments[3] = np.full((1, 3), 9, np.int32)
    with pytest.raises(ValueError, match="triangles must name points"):
        COMPILED.composite(*arguments)
    read_only = np.zeros((4, 4, 3), np.uint8)
    read_only.setflags(write=False)
    arguments[6] = read_only
    with pytest.raises((ValueError, BufferError), match="read-only"):
        COMPILED.composite(*arguments)


@compiled
def test_inputs_in_pieces_and_of_the_other_width_are_copied() -> None:
    rng = np.random.default_rng(0)
    base, factors = rng.uniform(0, 255, (2, 30))[:, ::2], np.ones(10)[::2]
    matrix = rng.normal(0, 1, (15, 8)).astype(np.float16).T[::2]
    away = np.ones(4)
    made, whole = np.empty(15, np.float32), np.empty(15, np.float32)
    COMPILED.expressed(base[0], matrix, away, factors, made)
    floats = (np.ascontiguousarray(one, np.float32) for one in (base[0], away, factors))
    first, second, third = floats
    COMPILED.expressed(first, np.ascontiguousarray(matrix), second, third, whole)
    np.testing.assert_array_equal(made, whole)


def run(choice: str, code: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "GUISE_KERNELS": choice}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )


def test_the_environment_chooses_the_twins() -> None:
    done = run("numpy", "from guise.common.kernels import COMPILED, RUNNING; print(COMPILED, RUNNING)")
    assert done.stdout == "None numpy\n"


def test_an_unknown_choice_is_one_sentence() -> None:
    done = run("sse9", "from guise.app.cli.main import main; raise SystemExit(main(['doctor']))")
    assert done.returncode == 2
    assert "GUISE_KERNELS is 'sse9', but here only" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1
