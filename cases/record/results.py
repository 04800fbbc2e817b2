"""Results of the library: saved in folders, read back, passed to other packages.

    result.json      status, cost, names; written last, it marks a complete record
    solution.npz     of a Solution: nodes, controls and the finer path
    bound_certificate.json   of a Solution whose bound is proven by polynomials
    trajectory.npz   of a Trajectory, as in the record of a run

A record of `swarmstart run` is read the same way, and the first plan of any record can
be the guess of another run. No file is unpickled, no code is run. The other packages
are pandas and python-control; they get values over time.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import PATH, checked
from swarmstart.arrays import Array
from swarmstart.cases.format.document import shown
from swarmstart.cases.format.yaml_reader import read_yaml
from swarmstart.cases.record.bound_content import (
    CERTIFICATE,
    bound_content,
    write_certificate,
)
from swarmstart.cases.record.files import (
    RecordError,
    is_temporary,
    locked,
    read_arrays,
    said,
    write_arrays,
    write_json,
)
from swarmstart.cases.record.multiplier_arrays import (
    multiplier_arrays,
    multipliers_from,
    told,
)
from swarmstart.cases.record.partial import UNREADABLE
from swarmstart.cases.record.record import (
    MARK,
    SCENARIO,
    TRAJECTORY,
    OccupiedFolderError,
    versions,
)
from swarmstart.cases.record.trajectory_arrays import (
    held_controls,
    output_arrays,
    trajectory_arrays,
    trajectory_of,
    unit_arrays,
)
from swarmstart.errors import load_optional
from swarmstart.ocp import Solution, Trajectory
from swarmstart.ocp.nlp import Multipliers
from swarmstart.ocp.system import shown_units

if TYPE_CHECKING:
    import control
    import pandas as pd


RESULT, SOLUTION = "result.json", "solution.npz"
T = TypeVar("T")
LARGEST_FILE = 100 * 2**20
"""Largest size of a file that is read [B]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Record:
    """Content of a folder that a run, or `save` of a result, has written.

    Attributes:
        folder: The folder.
        summary: run.json of a run, result.json of a saved result; see docs/record.md.
        arrays: The arrays by name, as stored.
        trajectory: The simulated trajectory, whose plans have no states; None in the
            record of a Solution.
        scenario: The scenario as it was run, as plain data; None in a saved result.
        multipliers: Multipliers of the answer, or of the first plan of a run; None if
            no solver converged to it, or the record is of an older version.
        member_costs: Cost of each member of an ensemble, shape (M,); else empty.
    """

    folder: Path
    summary: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    trajectory: Trajectory | None = None
    scenario: Mapping[str, Any] | None = None
    multipliers: Multipliers | None = None
    member_costs: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __repr__(self) -> str:
        """Return folder and status in one line."""
        return f"Record in {self.folder}: {self.summary.get('status', 'a flight')}"


def save_solution(solution: Solution, folder: Path, *, force: bool) -> Path:
    """Write a solution; see `Presented.save`."""
    path, plan = solution.path, solution.plan
    arrays = {
        "times": solution.times,
        "states": solution.states,
        "controls": solution.controls,
        "dense_times": path.times,
        "dense_states": path.states,
        "state_names": np.array(solution.state_names),
        "control_names": np.array(solution.control_names),
        "member_costs": solution.member_costs,
        **multiplier_arrays(solution.multipliers),
    }
    if solution.problem.has_knots:
        arrays["knots"] = np.array(True)
    arrays |= output_arrays(solution.output_names, path.outputs)
    arrays |= unit_arrays(shown_units(solution.problem.model))
    if solution.algebraic_names:
        arrays["algebraic"] = solution.algebraic
        arrays["algebraic_names"] = np.array(solution.algebraic_names)
    summary = {
        "result": "solution",
        "status": solution.status.value,
        "reason": solution.reason,
        "advice": solution.advice,
        "cost": solution.cost,
        "violation": solution.violation,
        "decided": dict(solution.decided),
        "verified_cost": solution.verified_cost,
        "verified_violation": solution.verified_violation,
        "source": plan.source.value,
        "evaluations": plan.evaluations,
        "compile_seconds": solution.compile_seconds,
        "member_costs": solution.member_costs.tolist(),
        "multipliers": told(solution.multipliers),
        "bound": None,
    }
    return _saved(folder, SOLUTION, arrays, summary, force=force, bounded=solution)


def save_trajectory(trajectory: Trajectory, folder: Path, *, force: bool) -> Path:
    """Write a trajectory; see `Presented.save`."""
    plans = [plan for decision in trajectory.decisions for plan in decision.plans]
    summary = {
        "result": "trajectory",
        "steps": len(trajectory.decisions),
        "plans": len(plans),
        "feasible_plans": sum(plan.feasible for plan in plans),
    }
    arrays = trajectory_arrays(trajectory)
    return _saved(folder, TRAJECTORY, arrays, summary, force=force)


def _saved(
    folder: Path,
    name: str,
    arrays: Mapping[str, NDArray[Any]],
    summary: Mapping[str, Any],
    *,
    force: bool,
    bounded: Solution | None = None,
) -> Path:
    """Write arrays, then the mark; an earlier mark is removed first."""
    with locked(folder):
        found = sorted(f.name for f in folder.iterdir() if not is_temporary(f.name))
        # `force` replaces results of `save`, but never the record of a run.
        if found and not (force and MARK not in found):
            whose = "the record of a run" if MARK in found else "other files"
            raise OccupiedFolderError(
                folder,
                f"{whose} ({', '.join(map(shown, found[:3]))})",
                expected="an empty folder",
                way="choose another, or replace an earlier result with force=True",
            )
        # The mark first: without it the folder counts as unfinished.
        for old in (RESULT, SOLUTION, TRAJECTORY, CERTIFICATE):
            (folder / old).unlink(missing_ok=True)
        write_arrays(folder / name, arrays)
        if bounded is not None and bounded.bound is not None:
            file = write_certificate(folder, bounded.bound)
            beside = bounded.beside(bounded.bound)
            bound = bound_content(bounded.bound, beside, certificate=file)
            summary = {**summary, "bound": bound}
        mark = {"schema": 1, **summary, "arrays": name, "versions": versions()}
        write_json(folder / RESULT, mark)
    return folder


@checked(folder=PATH)
def load(folder: str | Path) -> Record:
    """Return the record that a run, or `save` of a result, has written to a folder.

    Args:
        folder: The folder of a finished run; the record of an interrupted one is not
            complete.

    Raises:
        RecordError: If there is no finished record, or a file cannot be read.
        UnreadableFileError: If a run's scenario.yaml cannot be read.
        YamlError: If that file is not in the scenario format.

    Example:
        >>> import tempfile
        >>> import swarmstart as ss
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = ss.run("double_integrator", seed=0, search="none", out=folder)
        ...     record = ss.load(folder)
        >>> round(record.summary["measures"]["cost"], 3)
        12.03
        >>> record.arrays["states"].shape
        (2, 21)
    """
    folder = Path(folder)
    try:
        is_run = (folder / MARK).is_file()
        mark = folder / (MARK if is_run else RESULT)
        is_finished = mark.is_file()
    except OSError as error:  # A name that is too long, or a folder that is closed
        raise RecordError(
            f"{folder}: expected a folder that can be read: {said(error)}"
        ) from error
    if not is_finished:
        raise RecordError(
            f"{folder}: expected a finished record with {MARK} or {RESULT}, found "
            f"{'neither' if folder.is_dir() else 'no such folder'}"
        )
    summary = _read(mark, _summary)
    is_solution = summary.get("result") == "solution"
    file = folder / (SOLUTION if is_solution else TRAJECTORY)
    arrays = _read(file, read_arrays)
    return Record(
        folder=folder,
        summary=summary,
        arrays=arrays,
        trajectory=None
        if is_solution
        else _read(file, lambda _: trajectory_of(arrays)),
        scenario=read_yaml(str(folder / SCENARIO)).data if is_run else None,
        multipliers=_read(file, lambda _: multipliers_from(arrays)),
        member_costs=arrays.get("member_costs", np.empty(0)),
    )


def _read(file: Path, read: Callable[[Path], T]) -> T:
    """Return the content of a file.

    Raises:
        RecordError: If the file cannot be read.
    """
    try:
        return read(file)
    except UNREADABLE as error:
        raise RecordError(
            f"{file}: expected a file of a record, found: {error}"
        ) from error


def _summary(file: Path) -> Mapping[str, Any]:
    found = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(found, dict):
        raise TypeError("no mapping")
    return found


def recorded_plan(folder: object) -> tuple[list[float], list[list[float]]]:
    """Return the starts of the intervals [s] and a row of values for each control.

    For linear controls the times are those of the knots, the last at the plan's end.

    Args:
        folder: The folder of a run of one problem, or of a saved Solution.

    Raises:
        ValueError: If no plan can be read, with the reason.
    """
    if not isinstance(folder, str):
        raise ValueError(f"expected guess.record to be a folder, found {folder!r}")
    saved, flown = Path(folder) / SOLUTION, Path(folder) / TRAJECTORY
    file = saved if saved.exists() else flown
    try:
        # The path comes from a file that may be of a stranger.
        if file.stat().st_size > LARGEST_FILE:
            raise ValueError("the file is too large")
        arrays = read_arrays(file)
        plan = arrays["controls"] if file == saved else arrays["plan_controls"][0, 0]
        rows = np.atleast_2d(np.asarray(plan, dtype=np.float64))
        # There is one knot more than intervals.
        steps = arrays["controls"].shape[1] - int("knots" in arrays)
        if "control_ends" in arrays:  # A plan keeps the ends of linear controls.
            rows = np.hstack([arrays["controls"][:, :1], rows])
        dt = float(arrays["times"][-1] - arrays["times"][0]) / steps
    except (*UNREADABLE, ArithmeticError) as error:
        raise ValueError(
            f"expected guess.record to be the folder of a run, found {folder!r}: "
            f"{error}"
        ) from None
    if not (np.isfinite(rows).all() and 0 < dt < np.inf):
        raise ValueError(f"expected a plan of finite numbers in {folder!r}")
    return (dt * np.arange(rows.shape[1])).tolist(), rows.tolist()


def dataframe_of(result: Solution | Trajectory) -> "pd.DataFrame":
    """Return a result over time as a table; see `Presented.to_dataframe`.

    Raises:
        MissingPackageError: If pandas is not installed.
    """
    pandas = load_optional("pandas", extra="pandas", need="a table")
    rows = [result.states, _controls(result)]
    names = [*result.state_names, *result.control_names]
    if isinstance(result, Solution) and result.algebraic_names:
        rows.append(result.algebraic)
        names += result.algebraic_names
    # An output that is a state or a control under its name has its column.
    more = [i for i, name in enumerate(result.output_names) if name not in names]
    rows.append(_outputs_at(result)[more])
    names += [result.output_names[i] for i in more]
    table = pandas.DataFrame(
        np.vstack(rows).T,
        index=pandas.Index(result.times, name="time [s]"),
        columns=names,
    )
    if isinstance(result, Solution):
        table.attrs["units"] = shown_units(result.problem.model)
    else:
        table.attrs["units"] = dict(result.units)
    return table


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
    # The response needs a value at the last time, too.
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
    # Outputs are given at the steps of the plant, as many in each interval.
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
    # At the last time nothing is held any more.
    return np.hstack([held, np.full((held.shape[0], 1), np.nan)])
