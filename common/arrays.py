"""Array types, named by their elements."""

import numpy as np
from numpy.typing import NDArray

Bool = NDArray[np.bool_]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Floating = NDArray[np.floating]  # float32 or float64
I32 = NDArray[np.int32]
Int = NDArray[np.intp]
U8 = NDArray[np.uint8]
