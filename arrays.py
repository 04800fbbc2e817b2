"""Array: the type of the project's arrays of real numbers, for annotations.

What must not import this package has an alias of its own: the checker of certificates,
and the judge of the tests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of 64-bit floating-point numbers; docstrings give its shape and units."""
