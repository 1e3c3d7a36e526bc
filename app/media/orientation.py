"""The right-angle turn and mirror between a stored picture and the picture shown.

Pixels, x right, y down; pixel centres at integers.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float32]
_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True)
class Orientation:
    """Stored to shown: transpose first, then mirror x, then mirror y."""

    transpose: bool = False
    flip_x: bool = False
    flip_y: bool = False

    @classmethod
    def from_display_matrix(cls, matrix: tuple[int, ...]) -> Orientation:
        """The nearest right-angle orientation of an FFmpeg display matrix (9 integers, 16.16 fixed point).

        The matrix takes stored (p, q) to shown (a p + c q, b p + d q) with a, b, c, d = matrix[0, 1, 3, 4].

        >>> Orientation.from_display_matrix((0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30)).rotation
        90
        """
        a, b, c, d = (matrix[i] for i in (0, 1, 3, 4))
        transpose = abs(b) + abs(c) > abs(a) + abs(d)
        along_x, along_y = (c, b) if transpose else (a, d)
        return cls(transpose, along_x < 0, along_y < 0)

    @property
    def is_identity(self) -> bool:
        """Whether the picture is shown as it is stored."""
        return not (self.transpose or self.flip_x or self.flip_y)

    @property
    def rotation(self) -> int:
        """Degrees clockwise that the stored picture is turned to be shown (a mirror is left out)."""
        if self.transpose:
            return 90 if self.flip_x else 270
        return 180 if self.flip_y else 0

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Shown width and height of a stored width and height."""
        return (height, width) if self.transpose else (width, height)

    def view(self, plane: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """The stored plane (h, w, ...) as shown, without copying; writing to the view writes to the plane."""
        if self.transpose:
            plane = plane.swapaxes(0, 1)
        return plane[:: -1 if self.flip_y else 1, :: -1 if self.flip_x else 1]

    def stored_view(self, shown: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """The inverse of `view`: a shown picture (h, w, ...) as it is stored."""
        flipped = shown[:: -1 if self.flip_y else 1, :: -1 if self.flip_x else 1]
        return flipped.swapaxes(0, 1) if self.transpose else flipped

    def stored_points(self, points: Points, width: int, height: int) -> Points:
        """Shown points (n, 2) of a shown width x height as points of the stored picture."""
        if self.flip_x or self.flip_y:
            mirrored = np.array([width - 1, height - 1], np.float32) - points
            points = np.where([self.flip_x, self.flip_y], mirrored, points)
        return points[:, ::-1] if self.transpose else points


AS_STORED = Orientation()


def parse_display_matrix(data: bytes) -> tuple[int, ...]:
    """The nine native-endian 32-bit integers of FFmpeg's display matrix side data."""
    return struct.unpack("=9i", data)
