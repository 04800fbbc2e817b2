"""Panels of the signals that a problem depends on: tariffs, limits, references."""

from dataclasses import replace

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.panels import Labels, Panel, panels_of
from swarmstart.cases.drawing.plan_figures import Flown
from swarmstart.ocp import Solution
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.loop import rows_before_jumps
from swarmstart.ocp.statement import held_signals


def signals_of_solution(solution: Solution, labels: Labels) -> list[Panel]:
    """Return a panel for each signal, as the plan takes it: linear or held.

    Args:
        solution: The solution.
        labels: Words on the axes.
    """
    problem = solution.problem
    names, held = symbol_names(problem.signals), held_signals(problem)
    if not names:
        return []
    rows = np.atleast_2d(np.asarray(solution.known.signals, dtype=np.float64))
    instants, begun = solution.times[:: problem.checks], slice(0, -1, problem.checks)
    return [
        panel
        for name, row in zip(names, rows, strict=True)
        for panel in panels_of(
            [name], labels, *(
                (instants, row[None, begun])
                if name in held
                else (solution.times, row[None])
            )
        )
    ]  # fmt: skip


def signals_of_run(flown: Flown) -> list[Panel]:
    """Return a panel for each signal of the simulated system over time.

    Signals that a vehicle shares with an earlier one are drawn once.
    """
    times = flown.trajectory.dense_times
    steps = np.stack([times[:-1], times[1:]], axis=1)
    shown: dict[str, Array] = {}
    for number, problem in enumerate(flown.problems):
        reference = flown.signals_of(number)
        if reference is None:
            continue
        values = rows_before_jumps(reference, steps)
        for name, row in zip(symbol_names(problem.signals), values, strict=False):
            if np.array_equal(shown.get(name, row), row, equal_nan=True):
                shown[name] = row
            else:
                shown[f"{flown.labels.vehicles[number]}: {name}"] = row
    labels = replace(flown.labels, vehicles=("",))
    return panels_of([*shown], labels, steps.ravel(), np.array([*shown.values()]))
