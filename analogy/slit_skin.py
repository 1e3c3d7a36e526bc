"""Skin around eyes and corners of the mouth that neither crumples nor folds over, whatever the match is like there.

In a blink the lid slides by the height of the eye within a few vertices, and lips part from one vertex to the next.
There, small slips of a match between meshes of other topology leave neighbours out of order.  A lid or lip may roll,
however: what turns as far on the source is no fold.  Any unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from guise.analogy.geometry import cotangent_laplacian, face_normals
from guise.analogy.mesh import Mesh
from guise.analogy.solver import factorise
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class SlitSkinSettings:
    """Settings of the skin around slits; widths are the slit's (`FacePair.slits`)."""

    reach_widths: tuple[float, float] = (0.8, 1.2)  # from a slit's middle, over which the smoothing fades
    smoothing_widths: float = 0.03  # length below which displacements are smoothed
    folded_cosine: float = -0.17  # of a face's turn, below which it is smoothed out
    folded_rounds: int = (
        8  # in the second half of which faces that stay turned over take their neighbours along
    )
    beyond_source_cosine: float = 0.3  # farther than the skin of the source there, which both are to turn
    least_weight: float = 1e-9  # that keeps an isolated vertex where it is


SLIT_SKIN = SlitSkinSettings()


class SlitSkin:
    """Smooths displacements around slits; factorised once.

    Parameters
    ----------
    mesh : at rest.   skin : (N,) bool.   slits : the middle (3,) and width of each.
    source : neutral vertices (N_s, 3) of the source.   matched : (N, 3) the triangle of the source at each vertex.
    """

    def __init__(
        self, mesh: Mesh, skin: Bool, slits: list[tuple[F64, float]], source: F64, matched: Int
    ) -> None:
        share, width = _nearness(mesh.vertices, slits)
        inside = skin & (share > 0)
        self._rest, faces = mesh.vertices, mesh.faces[inside[mesh.faces].any(1)]
        self._rows = np.flatnonzero(inside)
        self._faces = faces[inside[faces].all(1)]
        self._normals = face_normals(self._rest, self._faces)
        self._matched = np.ascontiguousarray(matched[self._faces]).reshape(-1, 3)
        self._source_normals = face_normals(source, self._matched)
        self._laplacian, areas = cotangent_laplacian(self._rest, faces)
        self._areas = np.maximum(areas[self._rows], SLIT_SKIN.least_weight * areas.mean())
        if len(self._rows):
            length = SLIT_SKIN.smoothing_widths * (width * share)[self._rows]
            own = _scaled_laplacian(self._laplacian[self._rows][:, self._rows], length)
            self._solve = factorise(sp.diags_array(self._areas) + own)

    def smoothed(self, made: F64) -> F64:
        """Vertices (N, 3) with smoothed displacements: (A + l^2 L) x = A x_0, l the length, 0 beyond the reach."""
        if not len(self._rows):
            return made
        out = made.copy()
        way = (made - self._rest)[self._rows]
        out[self._rows] = self._rest[self._rows] + self._solve(self._areas[:, None] * way)
        return out

    def without_folds(self, made: F64, expressive: F64) -> F64:
        """Vertices (N, 3), with membranes in place of faces that are turned over, and around those that stay so.

        expressive : the source (N_s, 3) with the expression.  Of all rounds, the one with the fewest such faces counts.
        """
        least, best, fewest = self._least(expressive), made, len(self._faces)
        inside, loose = np.zeros(len(made), bool), np.zeros(len(made), bool)
        inside[self._rows] = True
        for step in range(SLIT_SKIN.folded_rounds):
            turned = self._faces[_cosines(face_normals(made, self._faces), self._normals) < least]
            if len(turned) < fewest:
                best, fewest = made, len(turned)
            if not fewest:
                break
            stuck = np.zeros(len(made), bool)
            if step >= SLIT_SKIN.folded_rounds // 2:
                stuck[turned[loose[turned].all(1)]] = True
            loose[turned] = True
            loose[self._faces[stuck[self._faces].any(1)]] = True
            made = self._with_membrane(made, np.flatnonzero(loose & inside))
        return best

    def _least(self, expressive: F64) -> F64:
        """(m,) the cosine from which a face is in order, smaller where the source's skin turns as well."""
        now = face_normals(expressive, self._matched)
        own = _cosines(now, self._source_normals).reshape(-1, 3).min(1)
        return np.asarray(np.minimum(SLIT_SKIN.folded_cosine, own - SLIT_SKIN.beyond_source_cosine))

    def _with_membrane(self, made: F64, loose: Int) -> F64:
        """Vertices (N, 3), the displacements of loose ones continued harmonically from the others."""
        known = np.ones(len(made), bool)
        known[loose] = False
        rows = self._laplacian[loose]
        way = made - self._rest
        hold = SLIT_SKIN.least_weight * sp.eye_array(len(loose))
        found = factorise(rows[:, loose] + hold)(-(rows[:, np.flatnonzero(known)] @ way[known]))
        out = made.copy()
        out[loose] = self._rest[loose] + found
        return out


def _cosines(now: F64, rest: F64) -> F64:
    """(m,) of the angles between normals (m, 3) of any length."""
    size = np.linalg.norm(now, axis=1) * np.linalg.norm(rest, axis=1)
    return np.asarray((now * rest).sum(1) / size.clip(1e-300))


def _scaled_laplacian(laplacian: sp.csr_array, length: F64) -> sp.csr_array:
    """l^2 L (n, n) for lengths (n,) that vary: each edge weighted by those of its ends; it keeps constants."""
    edges = sp.csr_array(laplacian - sp.diags_array(laplacian.diagonal()))
    edges = sp.diags_array(length) @ edges @ sp.diags_array(length)
    return sp.csr_array(edges - sp.diags_array(np.asarray(edges.sum(axis=1))))


def _nearness(vertices: F64, slits: list[tuple[F64, float]]) -> tuple[F64, F64]:
    """(N,) 1 near a slit, fading to 0, and the width (N,) of the nearest one."""
    full, none = SLIT_SKIN.reach_widths
    away = np.stack([np.linalg.norm(vertices - middle, axis=1) / width for middle, width in slits])
    nearest = away.argmin(0)
    share = np.clip((none - away.min(0)) / (none - full), 0, 1)
    return np.asarray(np.sqrt(share)), np.array([width for _, width in slits])[nearest]
