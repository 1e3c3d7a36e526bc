"""Triangle and quad meshes over one set of vertices.

Any unit of length; results keep it.  A mesh is clean: every vertex is finite and belongs to a face, no face has zero
area, and vertices split by a texture seam are welded (see `guise.analogy.cleaning`).  Open borders, several components
and edges with more than two faces are allowed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from guise.analogy.tents import Rings
from guise.common.arrays import F64, Int
from guise.common.errors import GuiseError

MIN_VOLUME_SHARE = (
    5e-3  # that the faces of a solid mesh enclose, of the cube around it: a head has 0.07 to 0.14
)


class MeshError(GuiseError):
    """A mesh or mesh file that cannot be used; one sentence."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices and their faces.

    Parameters
    ----------
    vertices : (N, 3), finite.   triangles : (t, 3) and quads : (q, 4), 0-based vertex ids.
    kinds : (N,) what each vertex belongs to, an index of `guise.analogy.anatomy.KINDS`; None where nobody has said.

    Raises
    ------
    MeshError
        When a shape is wrong, a vertex is not finite, an id is out of range, or there is no face.

    Examples
    --------
    >>> square = Mesh(np.eye(4, 3), np.empty((0, 3), np.intp), np.array([[0, 1, 2, 3]]))
    >>> square.faces.tolist()
    [[0, 1, 2], [0, 2, 3]]
    """

    vertices: F64
    triangles: Int
    quads: Int
    kinds: Int | None = None

    def __post_init__(self) -> None:
        _require_vertices(self.vertices, len(self.vertices))
        for name, faces, sides in (("triangles", self.triangles, 3), ("quads", self.quads, 4)):
            if faces.ndim != 2 or faces.shape[1] != sides:
                raise MeshError(f"{name} must be (n, {sides}), got {faces.shape}")
            if faces.size and not (faces.min() >= 0 and faces.max() < len(self.vertices)):
                raise MeshError(f"{name} must hold ids from 0 to {len(self.vertices) - 1}")
        if not len(self.triangles) + len(self.quads):
            raise MeshError("the mesh has no faces")

    @classmethod
    def of_triangles(cls, vertices: ArrayLike, triangles: ArrayLike) -> Mesh:
        """A mesh of triangles alone."""
        return cls(np.array(vertices, np.float64), np.array(triangles, np.intp), np.empty((0, 4), np.intp))

    @cached_property
    def faces(self) -> Int:
        """(m, 3) the triangles, then the first halves of all quads (0, 1, 2), then the second ones (0, 2, 3)."""
        return self.rings.triangles

    @cached_property
    def rings(self) -> Rings:
        """The one-rings; the diagonal of a quad is not an edge."""
        return Rings.of(len(self.vertices), self.triangles, self.quads)

    @cached_property
    def extent(self) -> float:
        """The longest side of the box around the vertices."""
        return float(np.ptp(self.vertices, axis=0).max())

    @cached_property
    def components(self) -> Int:
        """(N,) label of the connected component of each vertex; that of vertex 0 is 0."""
        rings = self.rings
        ones = np.ones(len(rings.start), np.int8)
        graph = sp.coo_array((ones, (rings.start, rings.end)), shape=(rings.count, rings.count))
        return np.asarray(connected_components(graph, directed=False)[1], np.intp)

    @property
    def is_inside_out(self) -> bool:
        """Whether its faces look inwards, as those of a mirrored head do: they enclose a negative volume.

        Holes, such as an open neck, don't matter.

        >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        >>> inwards = Mesh.of_triangles(corners, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
        >>> inwards.is_inside_out, inwards.turned().is_inside_out
        (True, False)
        """
        a, b, c = (self.vertices[self.faces[:, k]] - self.vertices.mean(axis=0) for k in range(3))
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        return bool(volume < -MIN_VOLUME_SHARE * self.extent**3)

    def turned(self) -> Mesh:
        """The same mesh with every face wound the other way."""
        return Mesh(self.vertices, self.triangles[:, ::-1], self.quads[:, ::-1], self.kinds)

    def with_vertices(self, vertices: F64) -> Mesh:
        """The same faces over other vertices (N, 3); what depends on the faces alone is kept.

        Raises
        ------
        MeshError
            When the number of vertices differs, or one is not finite.
        """
        _require_vertices(vertices, len(self.vertices))
        return self._like(vertices, self.kinds)

    def with_kinds(self, kinds: Int) -> Mesh:
        """The same mesh, with what each vertex (N,) belongs to."""
        return self._like(self.vertices, kinds)

    def _like(self, vertices: F64, kinds: Int | None) -> Mesh:
        other = Mesh(vertices, self.triangles, self.quads, kinds)
        for name in ("faces", "rings", "components"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other


def _require_vertices(vertices: F64, count: int) -> None:
    if vertices.shape != (count, 3):
        raise MeshError(f"vertices must be ({count}, 3), got {vertices.shape}")
    finite = np.isfinite(vertices)
    if not finite.all():
        bad = int(np.count_nonzero(~finite.all(axis=1)))
        raise MeshError(f"{bad} of {count} vertices are not finite (NaN or infinite)")


def printable_excerpt(text: str) -> str:
    """Text from a file as a short printable line, for a message.

    >>> printable_excerpt("v 1\\t2\\x00\\n3")
    'v 1 2 3'
    """
    return "".join(letter for letter in " ".join(text.split()) if letter.isprintable())[:60]
