"""Results as tables of pandas."""

from typing import TYPE_CHECKING

import numpy as np

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
    every = (result.times.size - 1) // result.controls.shape[1]
    held = np.repeat(result.controls, every, axis=1)
    none_at_end = np.full((held.shape[0], 1), np.nan)
    return pd.DataFrame(
        np.vstack([result.states, np.hstack([held, none_at_end])]).T,
        index=pd.Index(result.times, name="time [s]"),
        columns=[*result.state_names, *result.control_names],
    )
