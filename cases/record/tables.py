"""Results as tables of pandas."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Solution, Trajectory

if TYPE_CHECKING:
    import pandas as pd


class MissingPackageError(SwarmstartError, ImportError):
    """An optional package that a function needs is not installed."""


def dataframe_of(result: Solution | Trajectory) -> "pd.DataFrame":
    """Return a result over time as a table; see `Presented.to_dataframe`.

    Raises:
        MissingPackageError: If pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise MissingPackageError(
            "a table needs pandas, which is not installed: "
            "pip install 'swarmstart[pandas]'"
        ) from error
    rows = [result.states, _controls(result)]
    names = [*result.state_names, *result.control_names]
    if isinstance(result, Solution) and result.algebraic_names:
        rows.append(result.algebraic)
        names += result.algebraic_names
    return pd.DataFrame(
        np.vstack(rows).T,
        index=pd.Index(result.times, name="time [s]"),
        columns=names,
    )


def _controls(result: Solution | Trajectory) -> NDArray[np.float64]:
    """Return held controls from each time on, or linear controls at each time."""
    nodes, given = result.times.size, result.controls
    if isinstance(result, Solution) and result.problem.has_knots:
        at = np.linspace(0, given.shape[1] - 1, nodes)
        rows = [np.interp(at, np.arange(given.shape[1]), row) for row in given]
        return np.array(rows).reshape(len(given), nodes)
    held = np.repeat(given, (nodes - 1) // given.shape[1], axis=1)
    return np.hstack([held, np.full((held.shape[0], 1), np.nan)])
