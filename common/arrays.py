"""Array types, named by their elements."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Bool = NDArray[np.bool_]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Floating = NDArray[np.floating]  # float32 or float64
I32 = NDArray[np.int32]
Int = NDArray[np.intp]
U8 = NDArray[np.uint8]

Array = TypeVar("Array", bound=NDArray[Any])


def side_by_side(array: Array) -> Array:
    """The array if its rows' entries lie side by side, as kernels want them, or a copy; rows may be apart.

    >>> picture = np.zeros((4, 6, 3))
    >>> side_by_side(picture[:, 2:]) is picture, side_by_side(picture[:, 2:4]).base is picture
    (False, True)
    """
    return array if array[:1].flags.c_contiguous else np.ascontiguousarray(array)  # type: ignore[return-value]
