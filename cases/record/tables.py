"""Results over time for other packages: pandas and python-control."""

from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.record.trajectory_arrays import held_controls
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Solution, Trajectory

if TYPE_CHECKING:
    import control
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
    # An output that is a state or a control under its name has its column.
    more = [i for i, name in enumerate(result.output_names) if name not in names]
    rows.append(_outputs_at(result)[more])
    names += [result.output_names[i] for i in more]
    return pd.DataFrame(
        np.vstack(rows).T,
        index=pd.Index(result.times, name="time [s]"),
        columns=names,
    )


def time_response_of(result: Solution | Trajectory) -> "control.TimeResponseData":
    """Return a result as a response of python-control.

    See `Presented.to_time_response`.
    """
    import control

    if isinstance(result, Solution):
        path, nx = result.path, len(result.state_names)
        times, states, outputs = path.times, path.states[:nx], path.outputs
        inputs = _on_path(result)
    else:
        times, states, outputs = (
            result.dense_times, result.dense_states, result.outputs,
        )  # fmt: skip
        inputs = _dense(held_controls(result)[1], times.size)
    is_named = bool(result.output_names)
    return control.TimeResponseData(
        times,
        outputs if is_named else states,
        states,
        inputs if inputs.size else None,
        issiso=False,  # Else one output would lose its row.
        output_labels=list(result.output_names if is_named else result.state_names),
        state_labels=list(result.state_names),
        input_labels=list(result.control_names) or None,
    )


def _dense(controls: Array, count: int) -> Array:
    """Return controls at all times, from their values held over equal steps."""
    if controls.shape[1] == count:  # linear ones, given at the times themselves
        return controls
    held = np.repeat(controls, (count - 1) // controls.shape[1], axis=1)
    return np.hstack([held, held[:, -1:]])


def _on_path(result: Solution) -> Array:
    """Return the controls along the finer path of a solution, shape (nu, n)."""
    count, given = result.path.times.size, result.controls
    if not result.problem.has_knots:
        return _dense(given, count)
    at = np.linspace(0, given.shape[1] - 1, count)
    return np.array([np.interp(at, np.arange(given.shape[1]), row) for row in given])


def _outputs_at(result: Solution | Trajectory) -> Array:
    """Return the outputs at the nodes or control instants, shape (ny, n)."""
    if isinstance(result, Solution) or not result.output_names:
        return np.reshape(result.outputs, (-1, result.times.size))
    every = (result.dense_times.size - 1) // (result.times.size - 1)
    return result.outputs[:, ::every]


def _controls(result: Solution | Trajectory) -> Array:
    """Return held controls from each time on, or linear controls at each time."""
    nodes, given = result.times.size, result.controls
    if isinstance(result, Solution) and result.problem.has_knots:
        at = np.linspace(0, given.shape[1] - 1, nodes)
        rows = [np.interp(at, np.arange(given.shape[1]), row) for row in given]
        return np.array(rows).reshape(len(given), nodes)
    held = np.repeat(given, (nodes - 1) // given.shape[1], axis=1)
    return np.hstack([held, np.full((held.shape[0], 1), np.nan)])
