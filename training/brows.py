"""Where the brows' hair is on a rendered person: the mesh's own brow points lie on the skin, wherever the hair grows.

Hand-placed iBUG points follow the upper edge of the hair, so that is where points 17 to 26 of the training pictures go.
Positions are in the renderer's units (decimetres, x right, y up, z to the viewer).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

BROWS = slice(17, 27)
OPAQUE = 0.4  # of the largest alpha, from which the brow's texture counts as hair
FEWEST = 12  # samples that a point is the edge of
FINE = 8  # samples along a triangle's side
WINDOW = 0.09  # of a brow's length, within which its upper edge is looked for


def hair_points(person: Any, image: Any) -> F64:
    """Upper edge of both brows at rest, points 17-26 (10, 3).

    person : the renderer's Person; image : its reader of textures.
    """
    surface, name = person.surf["brows"], person.spec["brows"]
    alpha = image(f"eyebrows/{name}/{name}.png")[..., 3].astype(np.float64) / 255
    shares = np.array([(i, j, FINE - i - j) for i in range(FINE + 1) for j in range(FINE + 1 - i)]) / FINE
    corners = surface.positions(person.base)[surface.vmap][surface.tri]
    places = np.einsum("sk,tkc->tsc", shares, corners).reshape(-1, 3)
    uv = np.einsum("sk,tkc->tsc", shares, surface.uv[surface.tri].astype(np.float64)).reshape(-1, 2)
    size = np.array(alpha.shape[::-1])
    at = np.clip((uv * (1, -1) + (0, 1)) * size, 0, size - 1).astype(int)
    hair = places[alpha[at[:, 1], at[:, 0]] > OPAQUE * alpha.max()]
    right, left = _edge(hair[hair[:, 0] < 0]), _edge(hair[hair[:, 0] > 0])
    return np.concatenate([right[::-1], left])


def _edge(hair: F64) -> F64:
    """Five points (5, 3) along the upper edge of one brow, from the nose outwards."""
    across = np.abs(hair[:, 0])
    inner, outer = np.percentile(across, (2, 98))
    points = []
    for x in np.linspace(inner, outer, 5):
        far = np.abs(across - x)
        near = hair[far <= max(WINDOW * (outer - inner), np.sort(far)[min(FEWEST, len(far)) - 1])]
        top = near[near[:, 1] >= np.percentile(near[:, 1], 85)]
        points.append([np.sign(hair[0, 0]) * x, *top[:, 1:].mean(0)])
    return np.array(points)
