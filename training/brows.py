"""Where the brows' hair is on a rendered person: the mesh's own brow points lie on the skin, wherever the hair grows.

Hand-placed iBUG points follow the upper edge of the hair, so that is where points 17 to 26 of the training pictures go.
Positions are in the renderer's units (decimetres, x right, y up, z to the viewer).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from guise.common.arrays import F64

MIN_RELATIVE_ALPHA = 0.4  # of the largest alpha, from which the brow's texture counts as hair
MIN_EDGE_SAMPLES = 12  # of the hair, whose edge a point is
SAMPLES_PER_SIDE = 8  # of a triangle
EDGE_WINDOW_BROW_LENGTHS = 0.09  # within which a brow's upper edge is looked for


def hair_points(person: Any, image: Any) -> F64:
    """Upper edge of both brows at rest, points 17-26 (10, 3).

    person : the renderer's Person; image : its reader of textures.
    """
    surface, name = person.surf["brows"], person.spec["brows"]
    alpha = image(f"eyebrows/{name}/{name}.png")[..., 3].astype(np.float64) / 255
    shares = (
        np.array(
            [
                (i, j, SAMPLES_PER_SIDE - i - j)
                for i in range(SAMPLES_PER_SIDE + 1)
                for j in range(SAMPLES_PER_SIDE + 1 - i)
            ]
        )
        / SAMPLES_PER_SIDE
    )
    corners = surface.positions(person.base)[surface.vmap][surface.tri]
    places = np.einsum("sk,tkc->tsc", shares, corners).reshape(-1, 3)
    uv = np.einsum("sk,tkc->tsc", shares, surface.uv[surface.tri].astype(np.float64)).reshape(-1, 2)
    size = np.array(alpha.shape[::-1])
    at = np.clip((uv * (1, -1) + (0, 1)) * size, 0, size - 1).astype(int)
    hair = places[alpha[at[:, 1], at[:, 0]] > MIN_RELATIVE_ALPHA * alpha.max()]
    right, left = _edge(hair[hair[:, 0] < 0]), _edge(hair[hair[:, 0] > 0])
    return np.concatenate([right[::-1], left])


def _edge(hair: F64) -> F64:
    """Five points (5, 3) along the upper edge of one brow, from the nose outwards."""
    across = np.abs(hair[:, 0])
    inner, outer = np.percentile(across, (2, 98))
    points = []
    for x in np.linspace(inner, outer, 5):
        far = np.abs(across - x)
        near = hair[
            far
            <= max(
                EDGE_WINDOW_BROW_LENGTHS * (outer - inner), np.sort(far)[min(MIN_EDGE_SAMPLES, len(far)) - 1]
            )
        ]
        top = near[near[:, 1] >= np.percentile(near[:, 1], 85)]
        points.append([np.sign(hair[0, 0]) * x, *top[:, 1:].mean(0)])
    return np.array(points)
