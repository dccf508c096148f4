"""The types of arrays in annotations; docstrings say their shapes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Complex = NDArray[np.complex128]
