"""Results of the library saved in folders, and any record read back as data.

    result.json      status, cost, names; written last, it marks a complete record
    solution.npz     of a Solution: nodes, controls and the finer path
    bound_certificate.json   of a Solution whose bound is proven by polynomials
    trajectory.npz   of a Trajectory, as in the record of a run

A record of `swarmstart run` is read the same way. No file is unpickled, no code is run.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

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
    output_arrays,
    trajectory_arrays,
    trajectory_of,
)
from swarmstart.ocp import Solution, Trajectory
from swarmstart.ocp.nlp import Multipliers

RESULT, SOLUTION = "result.json", "solution.npz"
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Record:
    """Content of a folder that a run, or `save` of a result, has written.

    Attributes:
        folder: The folder.
        summary: run.json of a run, result.json of a saved result; see docs/record.md.
        arrays: The arrays by name, as stored.
        trajectory: The simulated trajectory; None in the record of a Solution. Its
            plans have no states.
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
        if found and not (force and MARK not in found):
            whose = "the record of a run" if MARK in found else "other files"
            raise OccupiedFolderError(
                folder,
                f"{whose} ({', '.join(map(shown, found[:3]))})",
                expected="an empty folder",
                way="choose another, or replace an earlier result with force=True",
            )
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


def load(folder: str | Path) -> Record:
    """Return the record that a run, or `save` of a result, has written to a folder.

    Args:
        folder: The folder of a finished run; the record of an interrupted one is not
            complete.

    Raises:
        RecordError: If there is no finished record, or a file cannot be read.
        UnreadableFileError: If a run's scenario.yaml cannot be read.
        YamlError: If that file is not the format.

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
    is_run = (folder / MARK).is_file()
    mark = folder / (MARK if is_run else RESULT)
    if not mark.is_file():
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
