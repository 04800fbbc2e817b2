"""Validation of the numbers and words given to a problem and its constraints."""

from collections.abc import Callable, Mapping, Sequence
from numbers import Real

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import a_count
from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened

Limit = float | Sequence[float] | Array
"""One number for all, or one for each row."""
_COUNT = a_count(least=1)


def limits_of(role: str, limits: Sequence[Limit], size: int) -> tuple[Array, Array]:
    """Return (lower, upper) as read-only arrays of one size.

    Args:
        role: Description of the limited values, for the message.
        limits: The pair (lower, upper), each a number or shape (size,).
        size: Number of limited values.

    Raises:
        InvalidProblemError: If they do not broadcast, are not numbers, or cross.
    """
    try:
        # A copy, since a broadcast array shares one number among its elements.
        lower, upper = (np.broadcast_to(vector_of(v), (size,)).copy() for v in limits)
    except (TypeError, ValueError) as error:
        raise InvalidProblemError(
            f"limits of the {role} must be a pair (lower, upper) of numbers or of "
            f"{size} numbers, got {brief(limits)}"
        ) from error
    if not np.all((lower <= upper) & (lower < np.inf) & (upper > -np.inf)):
        raise InvalidProblemError(
            f"limits of the {role} must have lower <= upper, lower below inf and "
            f"upper above -inf, got {lower} and {upper}"
        )
    lower.flags.writeable = upper.flags.writeable = False
    return lower, upper


def scales_given(role: str, scale: Limit | None, size: int) -> Array | None:
    """Return scales as a read-only array of one size; None stays None.

    Args:
        role: Description of the scaled values, for the message.
        scale: One number for all, or shape (size,); None: to be found automatically.
        size: Number of scaled values.

    Raises:
        InvalidProblemError: If a scale is not positive and finite, or the size differs.
    """
    if scale is None:
        return None
    try:
        scales = np.broadcast_to(vector_of(scale), (size,)).copy()
    except (TypeError, ValueError) as error:
        raise InvalidProblemError(
            f"scale of the {role} must be a positive number or {size} of them, "
            f"got {brief(scale)}"
        ) from error
    if not np.all((scales > 0) & (scales < np.inf)):
        raise InvalidProblemError(f"scale of the {role} must be positive, got {scale}")
    scales.flags.writeable = False
    return scales


def sizes_given(given: object, names: Sequence[str]) -> dict[str, float]:
    """Return validated sizes by name; a copy.

    Args:
        given: Mapping of names to positive numbers.
        names: Names that may have a size.

    Raises:
        InvalidProblemError: If a name is unknown, or a size is not positive and finite.
    """
    if not isinstance(given, Mapping):
        raise InvalidProblemError(
            "scales must be a mapping of names of states and controls to sizes, got "
            f"{brief(given)}"
        )
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InvalidProblemError(
            f"scales must name states and controls, some of {', '.join(names)}, got "
            f"{', '.join(map(str, unknown))}"
        )
    found = {n: require_number(f"scale of {n}", value) for n, value in given.items()}
    for name, value in found.items():
        if not 0 < value < np.inf:
            raise InvalidProblemError(
                f"scale of {name} must be a positive finite number, got {value}"
            )
    return found


def vector_of(values: object) -> Array:
    """Return numbers as an array; a column of CasADi's DM becomes a vector.

    Raises:
        TypeError: If they are not numbers; text is not converted.
        ValueError: If they do not form an array.
    """
    if isinstance(values, ca.DM):
        return np.array(values, dtype=np.float64).ravel()
    array = np.asarray(values)
    # Booleans, integers and floats only: NumPy would also convert text to numbers.
    if array.dtype.kind not in "biuf":
        raise TypeError(f"expected numbers, got {values!r}")
    return array.astype(np.float64)


def numbers_of(role: str, values: ArrayLike) -> Array:
    """Return numbers as an array; a copy.

    Raises:
        InvalidProblemError: If they are not numbers.
    """
    try:
        array = np.array(values)
        if array.dtype.kind not in "biuf":
            raise TypeError("no numbers")
    except (TypeError, ValueError, NotImplementedError) as error:
        raise InvalidProblemError(
            f"{role} must be numbers, got {shortened(values)}"
        ) from error
    return array.astype(np.float64)


def require_number(role: str, number: object) -> float:
    """Return a number as a float.

    Raises:
        InvalidProblemError: If it is not a real number; text is not converted.
    """
    # A bool is a Real in Python.
    if isinstance(number, bool) or not isinstance(number, Real):
        raise InvalidProblemError(
            f"{role} must be a number, got {brief(number)} ({type(number).__name__})"
        )
    return float(number)


def require_count(role: str, count: int) -> None:
    """Raise unless a value is an integer of at least one.

    Raises:
        InvalidProblemError: With the value given.
    """
    if not _COUNT.accepts(count):
        raise refused(role, count, _COUNT.allowed)


def require_seconds(role: str, seconds: object) -> None:
    """Validate a time limit: None, or a positive finite number of seconds.

    Raises:
        InvalidProblemError: If the value is invalid.
    """
    is_number = isinstance(seconds, Real) and not isinstance(seconds, bool)
    if seconds is None or (is_number and 0.0 < seconds < np.inf):  # type: ignore[operator]
        return
    raise InvalidProblemError(
        f"{role} must be a positive number of seconds, got {shortened(seconds)}"
    )


def require_distance(role: str, distance: float, *margins: float) -> None:
    """Raise unless a distance is positive and each margin is at least zero and finite.

    Raises:
        InvalidProblemError: With the value given.
    """
    if not 0 < require_number(role, distance) < np.inf:
        raise InvalidProblemError(f"{role} must be positive, got {distance}")
    for margin in margins:
        if not 0 <= require_number("margins", margin) < np.inf:
            raise InvalidProblemError(f"margins must be at least 0, got {margin}")


def require_choice(role: str, choice: str, allowed: Sequence[str]) -> None:
    """Raise unless a word is one of the allowed ones.

    Raises:
        InvalidProblemError: With the value given and what is allowed.
    """
    if not isinstance(choice, str) or choice not in allowed:
        raise InvalidProblemError(
            f"{role} must be {' or '.join(allowed)}, got {choice!r:.80}"
        )


def shaped(
    role: str,
    values: ArrayLike,
    shape: tuple[int, ...],
    meaning: Callable[[], str] = str,
) -> Array:
    """Return a validated copy of values, since the caller may change them later.

    Args:
        role: Name of the values in messages.
        values: The values.
        shape: Shape that they must have.
        meaning: Words at the end of the message on a wrong shape: what the values are.

    Raises:
        InvalidProblemError: If the shape is another, or a value is not finite.
    """
    array = numbers_of(role, values)
    if len(shape) == 1 and array.shape == (*shape, 1):
        array = array[:, 0]  # A column, as of CasADi's DM.
    if array.shape != shape:
        raise InvalidProblemError(
            f"{role} must have shape {shape}, got {array.shape}{meaning()}"
        )
    if not np.isfinite(array).all():
        raise InvalidProblemError(f"{role} must be finite, got {array}")
    return array
