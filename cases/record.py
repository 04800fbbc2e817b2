"""A run's folder on disk: nothing half-written, nothing finished lost.

    scenario.yaml    the scenario as resolved
    trajectory.npz   the flight, see docs/record.md
    run.json         settings, measures, claims; written last: the commit mark
    partial.npz, partial.json   what an interrupted run had finished
    figures/

Every file is written under a temporary name, synced and renamed. The folder's name is
a hash of what determines the result, so that the same command finds the same folder.
"""

import hashlib
import io
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.versions import package_version
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import (
    Decision,
    Mode,
    Plan,
    PolishStatus,
    Source,
    Step,
    Trajectory,
)

Array = NDArray[np.float64]


class RecordError(SwarmstartError):
    """A file of a run could not be written or read."""


def run_key(settings: Mapping[str, Any], seed: int, backend: str) -> str:
    """Return the 16 characters that name a run: what determines its result.

    Args:
        settings: The resolved scenario.
        seed: The seed.
        backend: What evaluates populations.
    """
    determines = {
        "settings": settings,
        "seed": seed,
        "backend": backend,
        "version": package_version("swarmstart"),
    }
    text = json.dumps(
        determines, sort_keys=True, separators=(",", ":"), allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file under a temporary name, sync it and rename it.

    Args:
        path: The file; its folder is made where it is missing.
        write: Writes the content.

    Raises:
        RecordError: If the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise RecordError(f"{path}: expected a file to write to: {reason}") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, in UTF-8."""
    write_atomically(path, lambda file: file.write(text.encode("utf-8")))


def prepare_folder(folder: Path) -> None:
    """Make a folder, and make sure that files can be written there.

    Raises:
        RecordError: If they cannot.
    """
    probe = folder / "probe"
    write_atomically(probe, lambda file: None)
    probe.unlink(missing_ok=True)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically; what is not finite becomes null."""
    write_text(path, to_json(content, indent=2) + "\n")


def to_json(content: Any, *, indent: int | None = None) -> str:
    """Return JSON text; NaN and infinities become null."""
    return json.dumps(_without_nan(content), indent=indent, allow_nan=False)


def _without_nan(content: Any) -> Any:
    if isinstance(content, float) and not math.isfinite(content):
        return None
    if isinstance(content, Mapping):
        return {key: _without_nan(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_without_nan(value) for value in content]
    return content


def trajectory_arrays(trajectory: Trajectory) -> dict[str, Array]:
    """Return the arrays of trajectory.npz by name; docs/record.md describes them."""
    plans = [list(decision.plans) for decision in trajectory.decisions]
    linear = [d.mode is Mode.LINEAR for d in trajectory.decisions]
    return {
        "times": trajectory.times,
        "states": trajectory.states,
        "controls": trajectory.controls,
        "dense_times": trajectory.dense_times,
        "dense_states": trajectory.dense_states,
        "step_seconds": trajectory.step_seconds,
        "linear": np.array(linear),
        "plan_controls": np.array([[p.controls for p in row] for row in plans]),
        "plan_cost": _of_plans(plans, lambda p: p.cost),
        "plan_violation": _of_plans(plans, lambda p: p.violation),
        "plan_feasible": _of_plans(plans, lambda p: p.feasible).astype(bool),
        "plan_source": np.array([[p.source.name for p in row] for row in plans]),
        "search_cost": _of_plans(plans, lambda p: p.search_cost),
        "search_violation": _of_plans(plans, lambda p: p.search_violation),
        "plan_polish": np.array([[_polish_name(p) for p in row] for row in plans]),
        "plan_start_excess": _of_plans(plans, lambda p: p.start_excess),
        "plan_evaluations": _of_plans(plans, lambda p: p.evaluations).astype(np.int64),
        "search_history": _histories(plans),
    }


def _polish_name(plan: Plan) -> str:
    """Return the name of how a plan's polish ended; empty without a polish."""
    return plan.polish_status.name if plan.polish_status else ""


def _histories(plans: Sequence[Sequence[Plan]]) -> Array:
    """Return the searches' histories, shape (T, agents, longest), NaN at the end."""
    longest = max(plan.search_history.size for row in plans for plan in row)
    padded = np.full((len(plans), len(plans[0]), longest), np.nan)
    for k, row in enumerate(plans):
        for agent, plan in enumerate(row):
            padded[k, agent, : plan.search_history.size] = plan.search_history
    return padded


def _of_plans(plans: Sequence[Sequence[Plan]], value: Callable[[Plan], float]) -> Array:
    return np.array([[float(value(plan)) for plan in row] for row in plans])


def _unpadded(history: Array) -> Array:
    """Return a row of `_histories` without the NaN at its end."""
    return history[: np.flatnonzero(~np.isnan(history)).max(initial=-1) + 1]


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write an .npz file atomically."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_atomically(path, lambda file: file.write(buffer.getvalue()))


def save_partial(
    folder: Path, key: str, trajectory: Trajectory, rng_state: Mapping[str, Any]
) -> None:
    """Keep what an interrupted run had finished, to go on from.

    Args:
        folder: The run's folder.
        key: The run's key.
        trajectory: The finished steps.
        rng_state: State of the generator after them, `rng.bit_generator.state`.
    """
    arrays: dict[str, NDArray[Any]] = {**trajectory_arrays(trajectory)}
    write_arrays(folder / "partial.npz", {**arrays, "key": np.array(key)})
    mark = {"schema": 1, "key": key, "steps": len(trajectory.decisions)}
    write_json(folder / "partial.json", {**mark, "rng": rng_state})


def remove_partial(folder: Path) -> None:
    """Remove what `save_partial` kept; the mark first."""
    for name in ("partial.json", "partial.npz"):
        (folder / name).unlink(missing_ok=True)


def load_partial(
    folder: Path, key: str, substeps: int
) -> tuple[list[Step], Any] | None:
    """Return the finished steps of an interrupted run and the generator's state.

    Args:
        folder: The run's folder.
        key: The run's key; what another run left there is not used.
        substeps: Steps of the plant in a control interval.

    Returns:
        None where there is nothing to go on from.

    Raises:
        RecordError: If there is something, and it cannot be read.
    """
    mark = folder / "partial.json"
    if not mark.exists():
        return None
    try:
        kept = json.loads(mark.read_text())
        if kept["key"] != key:
            return None
        with (
            (folder / "partial.npz").open("rb") as file,
            np.load(file, allow_pickle=False) as arrays,
        ):
            if str(arrays["key"]) != key:
                return None
            # The arrays may be ahead of the mark, which is written after them.
            steps = _steps(dict(arrays), substeps)[: kept["steps"]]
    except (OSError, LookupError, TypeError, ValueError, EOFError, BadZipFile) as error:
        raise RecordError(
            f"{mark}: expected what an interrupted run had finished, found: {error}; "
            f"remove {folder} to start again"
        ) from error
    return steps, kept["rng"]


def _polish_status(name: str) -> PolishStatus | None:
    return PolishStatus[name] if name else None


def _steps(arrays: Mapping[str, NDArray[Any]], substeps: int) -> list[Step]:
    """Return arrays written by `trajectory_arrays` as steps."""
    steps = []
    for number, seconds in enumerate(arrays["step_seconds"]):
        plans = tuple(
            Plan(
                controls=arrays["plan_controls"][number, agent],
                states=np.empty((0, 0)),  # Not needed to go on, so not kept.
                cost=float(arrays["plan_cost"][number, agent]),
                violation=float(arrays["plan_violation"][number, agent]),
                feasible=bool(arrays["plan_feasible"][number, agent]),
                source=Source[str(arrays["plan_source"][number, agent])],
                search_cost=float(arrays["search_cost"][number, agent]),
                search_violation=float(arrays["search_violation"][number, agent]),
                evaluations=int(arrays["plan_evaluations"][number, agent]),
                search_history=_unpadded(arrays["search_history"][number, agent]),
                polish_status=_polish_status(str(arrays["plan_polish"][number, agent])),
                start_excess=float(arrays["plan_start_excess"][number, agent]),
            )
            for agent in range(arrays["plan_cost"].shape[1])
        )
        mode = Mode.LINEAR if arrays["linear"][number] else Mode.PLANNED
        control = arrays["controls"][:, number]
        first = number * substeps
        steps.append(
            Step(
                number=number,
                state=arrays["states"][:, number],
                decision=Decision(control=control, plans=plans, mode=mode),
                dense_states=arrays["dense_states"][
                    :, first + 1 : first + substeps + 1
                ],
                seconds=float(seconds),
            )
        )
    return steps
