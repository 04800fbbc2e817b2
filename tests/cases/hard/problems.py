"""Hard problems as the solver gets them, for these tests."""

from functools import cache

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.scenario import resolve
from swarmstart.cases.format.yaml_reader import parse_yaml
from swarmstart.cases.hard import draw, shipped_text
from swarmstart.cases.kinds.flight import first_problem

STATE_BOUNDS = "bounds of the states"


@cache
def shipped_problem(name: str) -> PlanningProblem:
    """Return a shipped problem as it is drawn; test_families compares the files."""
    return first_problem(resolve(parse_yaml(shipped_text(name), name=name)).posed())


def drawn_problem(family: str, *, seed: int, **sizes: int) -> PlanningProblem:
    text = draw(family, seed=seed, **sizes)
    return first_problem(resolve(parse_yaml(text, name=family)).posed())


def path_values(posed: PlanningProblem, states: Array) -> Array:
    """Return path expressions, no bounds, at states (nx, n), shape (rows, n)."""
    problem = posed.problem
    stated = [c for c in problem.path_constraints if c.name != STATE_BOUNDS]
    rows = ca.vertcat(*[c.expression for c in stated])
    at = ca.Function("path", [problem.model.states], [rows])
    return np.array(at(states))


def rates(posed: PlanningProblem, states: Array, controls: Array) -> Array:
    """Return the right-hand side at states (nx, n) and controls (nu, n)."""
    model = posed.problem.model
    at = ca.Function("rates", [model.states, model.controls], [model.ode])
    return np.array(at(states, controls))
