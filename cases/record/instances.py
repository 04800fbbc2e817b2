"""Answers to many instances: saved in one .npz file, read back, made into tables.

The file has the names of the problem, the data of all instances and the answers to the
core, that is, to the problem after all rewrites, without pickles. A file that is read
must have these arrays, in the shapes of the problem that is given with it; the answers
themselves are not computed again.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.record.files import RecordError, read_arrays, write_arrays
from swarmstart.cases.record.partial import UNREADABLE
from swarmstart.errors import load_optional
from swarmstart.ocp import OptimalControlProblem, Solutions, SolutionStatus
from swarmstart.ocp.common import symbol_names
from swarmstart.ocp.instances import Answers, How, InstanceData, counted_near
from swarmstart.ocp.rollout import shooting_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray

FORMAT = "swarmstart solutions 1"
Arrays = dict[str, NDArray[Any]]
_OF_EACH = ("solver", "start", "attempts")
_KINDS = {"solver": "U", "start": "U", "attempts": "i", "iterations": "i"}
"""Kinds of arrays that hold no real numbers."""


def save_solutions(solutions: Solutions, path: Path, *, force: bool) -> Path:
    """Write answers into a file; see `Solutions.save`."""
    if path.exists() and not force:
        raise RecordError(
            f"{path}: expected the name of a new file, found a file or a folder "
            "(force=True replaces a file)"
        )
    data, how = solutions.data, solutions.how
    answers = solutions.core_answers._asdict()
    answers["status"] = np.array([one.name for one in solutions.status])
    invalid = sorted(solutions.invalid)
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "x0": data.x0,
        "parameters": data.parameters,
        "signals": data.signals,
        "time": np.array(data.time),
        "invalid": np.array(invalid, dtype=np.int64),
        "reasons": np.array(
            [solutions.invalid[number] for number in invalid], dtype="U"
        ),
        "sampled": np.array(solutions.sampled),
        "seconds": np.array(solutions.seconds),
        "repair": np.array(how.repair),
        "seed": np.array([str(part) for part in how.seed]),
        **_names(solutions.problem),
        **{name: getattr(solutions, name) for name in _OF_EACH},
        **answers,
    }
    if data.previous is not None:
        arrays["previous"] = np.asarray(data.previous, dtype=np.float64)
    write_arrays(path, arrays)
    return path


def load_solutions(path: Path, problem: OptimalControlProblem) -> Solutions:
    """Return the answers in a file; see `Solutions.load`."""
    try:
        return _read(read_arrays(path), problem)
    except UNREADABLE as error:
        raise RecordError(
            f"{path}: expected answers that Solutions.save has written, to this "
            f"problem: {error}"
        ) from error


def _names(problem: OptimalControlProblem) -> Arrays:
    """Return the names that a file and its problem have in common."""
    model = problem.model
    parameters = symbol_names(model.parameters)
    return {
        "state_names": np.array(model.state_names, dtype="U"),
        "control_names": np.array(model.control_names, dtype="U"),
        "parameter_names": np.array(
            [name for name in parameters if name not in problem.decided], dtype="U"
        ),
        "signal_names": np.array(symbol_names(problem.signals), dtype="U"),
        "decided_names": np.array([*problem.decided], dtype="U"),
    }


def _sampled(arrays: Arrays, M: int) -> int:
    """Return the number of instances drawn."""
    number = int(_array(arrays, "sampled", (), "i"))
    if not 0 <= number <= M:
        raise ValueError(f"expected a sample of at most {M} instances, found {number}")
    return number


def _read(arrays: Arrays, problem: OptimalControlProblem) -> Solutions:
    """Return answers from arrays.

    Raises:
        ValueError: If an array is missing or of another kind or shape.
    """
    found = arrays.get("format", np.array(""))
    if found.shape != () or str(found) != FORMAT:
        raise ValueError(f"expected the format {FORMAT!r}, found {found!s:.40}")
    for name, names in _names(problem).items():
        here = arrays.get(name, np.array([], dtype="U"))
        if here.tolist() != names.tolist():
            raise ValueError(
                f"expected the {name.replace('_', ' ')} {', '.join(names) or 'none'}, "
                f"found {', '.join(map(str, here.ravel()[:10])) or 'none'}"
            )
    data = _data(arrays, problem)
    M = data.size
    core = shooting_of(counted_near(problem, data)).problem
    shapes = {
        "controls": (core.model.nu, core.intervals, M),
        "states": (core.model.nx, core.nodes, M),
        "costates": (core.model.nx, M),
    }
    each = {
        name: _array(arrays, name, shapes.get(name, (M,)), _KINDS.get(name, "f"))
        for name in (*Answers._fields, *_OF_EACH)
        if name not in {"status", "by_interval"}
    }
    each["by_interval"] = _array(arrays, "by_interval", (M,), "b")
    each["status"] = _statuses(_array(arrays, "status", (M,), "U"))
    numbers = _array(arrays, "invalid", None, "i")
    reasons = _array(arrays, "reasons", numbers.shape, "U")
    if numbers.tolist() != np.flatnonzero(_is_invalid(each["status"])).tolist():
        raise ValueError(
            f"expected the numbers of the instances with the status INVALID, found "
            f"{numbers.ravel()[:10].tolist()}"
        )
    seed = tuple(map(int, _array(arrays, "seed", None, "U").ravel()))
    np.random.default_rng(seed)  # Raises an error if it is no seed.
    return Solutions(
        problem=problem,
        data=data,
        invalid=dict(zip(numbers.tolist(), reasons.tolist(), strict=True)),
        sampled=_sampled(arrays, M),
        seconds=float(_array(arrays, "seconds", (), "f")),
        **{name: each[name] for name in _OF_EACH},
        core_answers=Answers(**{name: each[name] for name in Answers._fields}),
        how=How(
            repair=bool(_array(arrays, "repair", (), "b")),
            seed=seed,
        ),
    )


def _data(arrays: Arrays, problem: OptimalControlProblem) -> InstanceData:
    """Return the data of the instances."""
    rows, M = _array(arrays, "x0", None, "f").shape
    members = 1 if problem.risk is None else problem.risk.members
    if rows not in {problem.model.nx, problem.model.nx // members}:
        raise ValueError(f"x0 has {rows} rows for {problem.model.nx} states")
    names = _names(problem)
    parameters, signals = names["parameter_names"], names["signal_names"]
    return InstanceData(
        x0=_array(arrays, "x0", (rows, M), "f"),
        parameters=_array(arrays, "parameters", (parameters.size, M), "f"),
        signals=_array(arrays, "signals", (signals.size, problem.nodes, M), "f"),
        time=float(_array(arrays, "time", (), "f")),
        previous=_array(arrays, "previous", None, "f")
        if "previous" in arrays
        else None,
        guesses=None,
        names=(*problem.model.state_names[:rows], *parameters.tolist()),
    )


def _statuses(names: NDArray[Any]) -> NDArray[Any]:
    """Return statuses from their names."""
    return np.array([SolutionStatus[name] for name in names.tolist()], dtype=object)


def _is_invalid(statuses: NDArray[Any]) -> list[bool]:
    return [status is SolutionStatus.INVALID for status in statuses]


def _array(
    arrays: Arrays, name: str, shape: tuple[int, ...] | None, kind: str
) -> NDArray[Any]:
    """Return an array of a file.

    Args:
        arrays: The arrays by name.
        name: Name of the array.
        shape: Its shape; None for any.
        kind: Its kind, as `numpy.dtype.kind`.

    Raises:
        ValueError: If it is missing, or of another kind or shape.
    """
    found = arrays.get(name)
    if found is None:
        raise ValueError(f"the array {name} is missing")
    if found.dtype.kind != kind or (shape is not None and found.shape != shape):
        raise ValueError(
            f"the array {name} has shape {found.shape} and type {found.dtype}, "
            f"expected shape {shape} and kind {kind!r}"
        )
    return found


def columns_of(solutions: Solutions) -> dict[str, NDArray[Any]]:
    """Return the columns of a table with a row for each instance."""
    data = solutions.data
    rows = len(data.x0)
    names = [f"x0 {name}" for name in data.names[:rows]]
    names += [f"known {name}" for name in data.names[rows:]]
    return {
        **dict(zip(names, data.numbers, strict=True)),
        "status": np.array([one.name for one in solutions.status]),
        **{
            name: getattr(solutions, name)
            for name in (
                *("solver", "start", "cost", "verified_cost", "violation", "excess"),
                *("end_difference", "attempts", "iterations"),
            )
        },
        **{f"decided {name}": row for name, row in solutions.decided.items()},
    }


def dataframe_of(solutions: Solutions) -> "pd.DataFrame":
    """Return a table with a row for each instance; see `Solutions.to_dataframe`.

    Raises:
        MissingPackageError: If pandas is not installed.
    """
    pandas = load_optional("pandas", extra="pandas", need="a table")
    index = pandas.RangeIndex(len(solutions), name="instance")
    return pandas.DataFrame(columns_of(solutions), index=index)


def dataset_of(solutions: Solutions) -> "xarray.Dataset":
    """Return the answers as a Dataset; see `Solutions.to_xarray`.

    Raises:
        MissingPackageError: If xarray is not installed.
    """
    xarray = load_optional("xarray", extra="xarray", need="a Dataset")
    model = solutions.problem.model
    states, controls = solutions.states, solutions.controls
    columns = {
        name: ("instance", values) for name, values in columns_of(solutions).items()
    }
    return xarray.Dataset(
        {
            "states": (("instance", "time", "state"), states.transpose(2, 1, 0)),
            "controls": (
                ("instance", "interval", "control"),
                controls.transpose(2, 1, 0),
            ),
            **columns,
        },
        coords={
            "instance": np.arange(len(solutions)),
            "time": solutions.times,
            "state": list(model.state_names),
            "interval": np.arange(controls.shape[1]),
            "control": list(model.control_names),
        },
    )
