"""Results as tables of pandas."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Solution, Trajectory

if TYPE_CHECKING:
    import pandas as pd


class MissingPackageError(SwarmstartError, ImportError):
    """A package that this needs, and the rest does not, is not installed."""


def dataframe_of(result: Solution | Trajectory) -> "pd.DataFrame":
    """Return states and controls over time; see `Presented.to_dataframe`.

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
    return pd.DataFrame(
        np.vstack([result.states, _controls(result)]).T,
        index=pd.Index(result.times, name="time [s]"),
        columns=[*result.state_names, *result.control_names],
    )


def _controls(result: Solution | Trajectory) -> NDArray[np.float64]:
    """Return the controls from each time on, or, of linear ones, at each time."""
    nodes, given = result.times.size, result.controls
    if isinstance(result, Solution) and result.problem.has_knots:
        at = np.linspace(0, given.shape[1] - 1, nodes)
        rows = [np.interp(at, np.arange(given.shape[1]), row) for row in given]
        return np.array(rows).reshape(len(given), nodes)
    held = np.repeat(given, (nodes - 1) // given.shape[1], axis=1)
    return np.hstack([held, np.full((held.shape[0], 1), np.nan)])
