"""Conversion of a trajectory with its plans to arrays without pickle, and back.

The steps are also written as a table for spreadsheets, steps.csv.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import (
    Decision,
    Mode,
    Plan,
    PolishStatus,
    SearchReport,
    Source,
    Step,
    Trajectory,
)
from swarmstart.ocp.statement import Profile

STEPS = "steps.csv"


def trajectory_arrays(trajectory: Trajectory) -> dict[str, Array]:
    """Return the arrays of trajectory.npz by name; docs/record.md describes them."""
    decisions = trajectory.decisions
    plans = [list(decision.plans) for decision in decisions]
    linear = [d.mode is Mode.LINEAR for d in trajectory.decisions]
    return {
        "times": trajectory.times,
        "states": trajectory.states,
        "controls": trajectory.controls,
        "dense_times": trajectory.dense_times,
        "dense_states": trajectory.dense_states,
        "step_seconds": trajectory.step_seconds,
        "linear": np.array(linear),
        "plan_controls": _stacked([[p.controls for p in row] for row in plans]),
        "plan_cost": _of_plans(plans, lambda p: p.cost),
        "plan_violation": _of_plans(plans, lambda p: p.violation),
        "plan_feasible": _of_plans(plans, lambda p: p.feasible).astype(bool),
        "plan_source": np.array([[p.source.name for p in row] for row in plans]),
        "search_cost": _of_plans(plans, lambda p: p.search.cost),
        "search_violation": _of_plans(plans, lambda p: p.search.violation),
        "plan_polish": np.array([[_polish_name(p) for p in row] for row in plans]),
        "plan_start_excess": _of_plans(plans, lambda p: p.start_excess),
        "plan_evaluations": _of_plans(plans, lambda p: p.evaluations).astype(np.int64),
        "plan_is_new": new_plans(trajectory.decisions),
        "search_history": _histories(plans, lambda search: search.history),
        "search_evaluations": _histories(plans, lambda search: search.evaluations),
        "search_violations": _histories(plans, lambda search: search.violations),
        "plan_start": _padded(plans, _start_of),
        **_stopped(plans),
        **_acting(decisions),
        **_lengths(decisions),
        **_ends_of_lines(decisions),
        "state_names": np.array(trajectory.state_names),
        "control_names": np.array(trajectory.control_names),
        **output_arrays(trajectory.output_names, trajectory.outputs),
        **unit_arrays(trajectory.units),
    }


def output_arrays(names: Sequence[str], outputs: Array) -> dict[str, NDArray[Any]]:
    """Return the arrays of the outputs of a model; empty without outputs."""
    return {"outputs": outputs, "output_names": np.array(names)} if names else {}


def unit_arrays(units: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Return the array of units, with a name and its unit in each row; may be empty."""
    return {"units": np.array([*units.items()])} if units else {}


def trajectory_of(arrays: Mapping[str, NDArray[Any]]) -> Trajectory:
    """Return a trajectory from its `trajectory_arrays`, without the states of plans."""
    # All control intervals have the same number of steps of the plant.
    pieces, count = arrays["dense_times"].size - 1, arrays["step_seconds"].size
    steps = steps_of(arrays, pieces // count)
    return Trajectory(
        times=arrays["times"],
        states=arrays["states"],
        controls=arrays["controls"],
        dense_times=arrays["dense_times"],
        dense_states=arrays["dense_states"],
        decisions=tuple(step.decision for step in steps),
        step_seconds=arrays["step_seconds"],
        state_names=tuple(map(str, arrays.get("state_names", ()))),
        control_names=tuple(map(str, arrays.get("control_names", ()))),
        outputs=arrays.get("outputs", np.empty((0, pieces + 1))),
        output_names=tuple(map(str, arrays.get("output_names", ()))),
        units={str(name): str(unit) for name, unit in arrays.get("units", ())},
    )


def steps_of(arrays: Mapping[str, NDArray[Any]], substeps: int) -> list[Step]:
    """Return the steps in `arrays`, each of `substeps` steps of the plant."""
    steps: list[Step] = []
    for number, seconds in enumerate(arrays["step_seconds"]):
        is_new = arrays["plan_is_new"][number]
        plans = tuple(
            _plan(arrays, number, agent)
            if is_new[agent]
            # The same object, by which `new_plans` sees that the plan is followed on.
            else steps[-1].decision.plans[agent]
            for agent in range(is_new.size)
        )
        mode = Mode.LINEAR if arrays["linear"][number] else Mode.PLANNED
        control = arrays["controls"][:, number]
        first = number * substeps
        length, piece = (
            _number(arrays, name, number) for name in ("interval_s", "profile_s")
        )
        # Only runs that decide an end time have this array.
        is_last = bool(arrays["is_last"][number]) if "is_last" in arrays else False
        profile = None
        if piece is not None:
            profile = _profile(arrays, number, plans[0], piece)
        steps.append(
            Step(
                number=number,
                state=arrays["states"][:, number],
                decision=Decision(
                    control=control,
                    plans=plans,
                    mode=mode,
                    dt=length,
                    is_last=is_last,
                    profile=profile,
                    acting=arrays["acting"][:, number] if "acting" in arrays else None,
                ),
                dense_states=arrays["dense_states"][
                    :, first + 1 : first + substeps + 1
                ],
                seconds=float(seconds),
                dt=length,
            )
        )
    return steps


def _polish_name(plan: Plan) -> str:
    """Return the name of the status of a plan's polish; empty without a polish."""
    return plan.polish_status.name if plan.polish_status else ""


def _histories(
    plans: Sequence[Sequence[Plan]], history: Callable[[SearchReport], Array]
) -> Array:
    """Return the searches' histories, shape (T, agents, longest), NaN at the end."""
    return _padded(plans, lambda plan: history(plan.search))


def _padded(
    plans: Sequence[Sequence[Plan]], values_of: Callable[[Plan], Array]
) -> Array:
    """Return values of the plans, shape (T, agents, most), NaN at the end."""
    sizes = [values_of(plan).size for row in plans for plan in row]
    padded = np.full((len(plans), len(plans[0]), max(sizes, default=0)), np.nan)
    for k, row in enumerate(plans):
        for agent, plan in enumerate(row):
            values = values_of(plan)
            padded[k, agent, : values.size] = values
    return padded


def _acting(decisions: Sequence[Decision]) -> dict[str, Array]:
    """Return the controls that acted, shape (nu, T), if others than the commanded."""
    found = [d.acting for d in decisions]
    if any(acting is None for acting in found) or not found:
        return {}
    return {"acting": np.stack([a for a in found if a is not None], axis=1)}


def _lengths(decisions: Sequence[Decision]) -> dict[str, Array]:
    """Return arrays of the intervals of a decided end time; empty without one."""
    if not any(d.dt is not None or d.profile or d.is_last for d in decisions):
        return {}
    return {
        "interval_s": np.array([np.nan if d.dt is None else d.dt for d in decisions]),
        "profile_s": np.array(
            [np.nan if d.profile is None else d.profile.piece for d in decisions]
        ),
        "is_last": np.array([d.is_last for d in decisions]),
        **_profiles(decisions),
    }


def _profiles(decisions: Sequence[Decision]) -> dict[str, Array]:
    """Return the controls held in each step, if they are not those of its plan."""
    same = [d.profile is None or d.profile.controls is d.plans[0].controls
            for d in decisions]  # fmt: skip
    if all(same):
        return {}
    none = np.empty((decisions[0].control.size, 0))
    rows = [[none if d.profile is None else d.profile.controls] for d in decisions]
    return {"profile_controls": _stacked(rows)[:, 0]}


def _stacked(rows: Sequence[Sequence[Array]]) -> Array:
    """Return controls of plans, shape (T, agents, nu, N); missing entries are NaN."""
    shapes = np.array([[one.shape for one in row] for row in rows])
    # The usual case needs no padding.
    if not shapes.size or (shapes == shapes[0, 0]).all():
        return np.array(rows)
    stacked = np.full((*shapes.shape[:2], *shapes.max(axis=(0, 1))), np.nan)
    for k, row in enumerate(rows):
        for agent, one in enumerate(row):
            stacked[k, agent, : one.shape[0], : one.shape[1]] = one
    return stacked


def _unstacked(controls: Array) -> Array:
    """Return controls without the rows and columns that `_stacked` has filled."""
    # Controls are finite, so NaN is padding.
    kept = ~np.isnan(controls)
    return controls[kept.any(axis=1)][:, kept.any(axis=0)]


def _ends_of_lines(decisions: Sequence[Decision]) -> dict[str, Array]:
    """Return the values at which linear controls end; empty for held controls.

    They are NaN for intervals that differ from those of the plan.
    """
    profiles = [d.profile for d in decisions]
    if not any(p is not None and not p.is_held for p in profiles):
        return {}
    none = np.full(decisions[0].control.size, np.nan)
    ends = [
        p.controls[:, 0] if p is not None and p.controls.shape[1] == 1 else none
        for p in profiles
    ]
    return {"control_ends": np.stack(ends, axis=1)}


def _profile(
    arrays: Mapping[str, NDArray[Any]], number: int, plan: Plan, piece: float
) -> Profile:
    """Return the controls over the interval of a step."""
    if "control_ends" not in arrays:
        held = plan.controls
        if "profile_controls" in arrays:
            held = _unstacked(arrays["profile_controls"][number])
        return Profile(controls=held, piece=piece)
    begin, end = (arrays[name][:, number] for name in ("controls", "control_ends"))
    controls = plan.controls[: begin.size] if np.isnan(end).any() else end[:, None]
    return Profile(controls=controls, piece=piece, start=begin)


def _start_of(plan: Plan) -> Array:
    """Return a plan's initial state; empty if an old record has none."""
    is_kept = plan.states.size or plan.start is not None
    return plan.x0 if is_kept else np.empty(0)


def _number(arrays: Mapping[str, NDArray[Any]], name: str, place: int) -> float | None:
    """Return an entry of an array; None if it is NaN or the array is missing."""
    value = float(arrays[name][place]) if name in arrays else np.nan
    return None if np.isnan(value) else value


def control_rows(trajectory: Trajectory) -> Array | None:
    """Return linear controls at the ends of the plant's steps, shape (nu, T, m + 1).

    None if controls are held, not linear.
    """
    decisions, steps = trajectory.decisions, trajectory.controls.shape[1]
    if not any(d.profile is not None and not d.profile.is_held for d in decisions):
        return None
    m = (trajectory.dense_times.size - 1) // steps
    found = [
        np.repeat(d.control[:, None], m + 1, axis=1)
        if d.profile is None
        else d.profile.ends(float(length), m)
        for d, length in zip(decisions, np.diff(trajectory.times), strict=True)
    ]
    return np.stack(found, axis=1)


def held_controls(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return times (n + 1,) [s], and the controls held between them, (nu, n).

    The times are the control instants. If the intervals of a plan differ from the
    control intervals, the times are those of the plant's steps. Linear controls are
    given at the times of these steps, (nu, n + 1).
    """
    decisions, steps = trajectory.decisions, trajectory.controls.shape[1]
    rows = control_rows(trajectory)
    if rows is not None:
        begins = rows[:, :, :-1].reshape(len(rows), -1)
        return trajectory.dense_times, np.hstack([begins, rows[:, -1, -1:]])
    if not any(decision.profile for decision in decisions):
        return trajectory.times, trajectory.controls
    m = (trajectory.dense_times.size - 1) // steps
    held = [
        np.repeat(decision.control[:, None], m, axis=1)
        if decision.profile is None
        else decision.profile.means(float(length), m)
        for decision, length in zip(decisions, np.diff(trajectory.times), strict=True)
    ]
    return trajectory.dense_times, np.hstack(held)


def _of_plans(plans: Sequence[Sequence[Plan]], value: Callable[[Plan], float]) -> Array:
    return np.array([[float(value(plan)) for plan in row] for row in plans])


def _plan(arrays: Mapping[str, NDArray[Any]], number: int, agent: int) -> Plan:
    """Return the plan of an agent at a step."""
    return Plan(
        controls=_unstacked(arrays["plan_controls"][number, agent]),
        states=np.empty((0, 0)),  # Not needed to continue, so not kept.
        cost=float(arrays["plan_cost"][number, agent]),
        violation=float(arrays["plan_violation"][number, agent]),
        feasible=bool(arrays["plan_feasible"][number, agent]),
        source=Source[str(arrays["plan_source"][number, agent])],
        search=SearchReport(
            cost=float(arrays["search_cost"][number, agent]),
            violation=float(arrays["search_violation"][number, agent]),
            history=_unpadded(arrays["search_history"][number, agent]),
            evaluations=_unpadded(arrays["search_evaluations"][number, agent]),
            # Records of earlier versions have none.
            violations=_unpadded(arrays["search_violations"][number, agent])
            if "search_violations" in arrays
            else np.empty(0),
        ),
        evaluations=int(arrays["plan_evaluations"][number, agent]),
        polish_status=_polish_status(str(arrays["plan_polish"][number, agent])),
        start_excess=float(arrays["plan_start_excess"][number, agent]),
        start=_unpadded(arrays["plan_start"][number, agent])
        if "plan_start" in arrays
        else None,
        stopped="plan_stopped" in arrays
        and bool(arrays["plan_stopped"][number, agent]),
    )


def _stopped(plans: Sequence[Sequence[Plan]]) -> dict[str, NDArray[np.bool_]]:
    """Return whether plans were stopped in time; empty if none was."""
    found = _of_plans(plans, lambda p: p.stopped).astype(bool)
    return {"plan_stopped": found} if found.any() else {}


def _unpadded(history: Array) -> Array:
    """Return a row of `_histories` without the NaN at its end."""
    # Up to the last number: NaN before it stays. -1: there is no number.
    return history[: np.flatnonzero(~np.isnan(history)).max(initial=-1) + 1]


def _polish_status(name: str) -> PolishStatus | None:
    return PolishStatus[name] if name else None


def plan_costs(trajectory: Trajectory) -> Array:
    """Return the cost J of each step, summed over the agents that plan, shape (T,)."""
    return np.array([sum(p.cost for p in d.plans) for d in trajectory.decisions])


def new_plans(decisions: Sequence[Decision]) -> NDArray[np.bool_]:
    """Return whether each plan was made at its step, shape (T, agents).

    A plan that is followed for several steps is the same object in each of them.
    """
    last = [(None,) * len(decisions[0].plans), *[d.plans for d in decisions[:-1]]]
    return np.array(
        [
            [now is not then for now, then in zip(d.plans, before, strict=True)]
            for d, before in zip(decisions, last, strict=True)
        ]
    )


def effort(trajectory: Trajectory) -> dict[str, Measure]:
    """Return the measures of the planning effort over all steps."""
    evaluations = [[p.evaluations for p in d.plans] for d in trajectory.decisions]
    seconds = trajectory.step_seconds
    return {
        # A plan that is followed for several steps counts once.
        "evaluations": int(np.sum(evaluations, where=new_plans(trajectory.decisions))),
        "steps_starting_outside": sum(
            any(plan.start_excess > 0 for plan in decision.plans)
            for decision in trajectory.decisions
        ),
        "step_seconds_median": float(np.median(seconds)),
        "step_seconds_max": float(np.max(seconds)),
    }


def planned(decision: Decision) -> bool:
    """Return whether a step was planned, and did not follow the linear law."""
    return decision.mode is Mode.PLANNED


def step_table(trajectory: Trajectory) -> str:
    """Return the steps of a run as CSV text, with one line for each step.

    Columns: the step from 0 on, its beginning [s], the wall time of its plans [s]
    (empty if it is not known), and for each agent the origin of its plan,
    named as `plan_source` in trajectory.npz.
    """
    agents = len(trajectory.decisions[0].plans)
    head = ["step", "time_s", "step_seconds"]
    lines = [head + [f"plan_{agent}" for agent in range(1, agents + 1)]]
    for step, decision in enumerate(trajectory.decisions):
        seconds = float(trajectory.step_seconds[step])
        lines.append([
            str(step),
            f"{float(trajectory.times[step]):.9g}",
            # An empty cell reads as missing in a spreadsheet; "nan" reads as text.
            f"{seconds:.6g}" if np.isfinite(seconds) else "",
            *(plan.source.name for plan in decision.plans),
        ])  # fmt: skip
    return "".join(",".join(line) + "\n" for line in lines)
