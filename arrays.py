"""Array: the type of the project's arrays of real numbers, for annotations.

Code that must not import this package defines the alias itself: the checker of
certificates, and the judge of the tests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of 64-bit floating-point numbers; docstrings give its shape and units."""
