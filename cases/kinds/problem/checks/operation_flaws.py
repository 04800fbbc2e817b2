"""Errors of problems that take minutes to build: an interval is one expression."""

from collections.abc import Iterator

import casadi as ca

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.ocp import INTEGRATORS, OptimalControlProblem, held_step
from swarmstart.ocp.integration import PARTS

MOST_OPERATIONS = 40_000
"""Largest number of operations in an interval, which take up to 15 s to prepare."""


def operation_flaws(problem: OptimalControlProblem) -> Iterator[LocatedFlaw]:
    """Yield an error if an interval of a problem has too many operations."""
    model = problem.model
    symbols = [*problem.symbols().values(), model.time]
    rates = ca.Function("rates", symbols, [model.ode, problem.stage_cost])
    evaluations = INTEGRATORS[problem.integrator].evaluations
    steps = problem.substeps * problem.checks
    radau, points = problem.collocation, 0
    if radau is not None:
        points = radau.points * (radau.elements or problem.substeps) * problem.checks
    found = rates.n_instructions() * max(evaluations * steps, points)
    if problem.integrator == "stiff" and found <= MOST_OPERATIONS:
        # Also those of linear equations.
        dt = float(problem.expected_times[-1]) / problem.intervals
        first = held_step(model, dt, method="stiff")
        found = int(first.n_instructions() / PARTS * (steps + PARTS - 1))
    if found > MOST_OPERATIONS:
        yield (
            ("prediction",),
            f"expected at most {MOST_OPERATIONS} operations in an interval, those of "
            f"the rates in all substeps of all checks; found {found}: take more "
            "intervals, or fewer checks, substeps or elements",
        )
