"""Array types that the package's signatures share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
# Real in one caller and complex in the other.
AnyArray = NDArray[Any]
