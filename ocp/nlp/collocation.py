"""Collocation within an interval: the states at its points are unknowns of the NLP.

    x_k, X_1, X_2, ... (all elements of all checks)   instead of an integrator's steps
    rows: D X - h f(X, z, u, p, s(t)) = 0 at each point, divided by the states' sizes

x_k is the state at the start of interval k, X_i the states at the collocation points.
An element is a part of the time between two checks, of length h, and D X is h times the
slope there of the polynomial through the states of an element. f is the right-hand
side; u, p and s are controls, parameters and signals.

Only states with a rate are collocated; the others stay constant. Algebraic variables z
of nonlinear equations are unknowns as well, at the start of an interval and at each
point, with their equations g(x, z, u, p) = 0 as rows, so that the NLP needs no Newton
iterations of its own (`lifted`). Costs are integrated with the same points. Constraints
hold at the checks, as in multiple shooting.

The inner unknowns of an interval are, in this order: the states with a rate at each
point; z at the start and at each point.

A model's expressions contain Newton's method in place of z (algebraic.py). Such an
expression is read value by value, and each value that is z at a known point,

    z(x, u, p, s) = result of Newton's method there    ->    a symbol,

is replaced by a symbol; Newton's iterations then drop out of the expression. A value
that is not recognised is kept, so the expression has the same meaning in any case.

Source: Biegler (2010), Nonlinear Programming, chapter 10.
"""

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.integration.radau import radau_coefficients
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.tape import OPERATIONS, Node, Tape, UnknownOperationError, read_tape

_CODES = {name: code for code, name in OPERATIONS.items()}


class Layout(NamedTuple):
    """Layout of the collocation in an interval.

    Attributes:
        moving: Numbers of the states that have a rate.
        points: Number of collocation points in an element.
        elements: Number of elements from one check to the next.
        checks: Number of checks in an interval.
        lifted: Number of algebraic variables that are unknowns.
    """

    moving: tuple[int, ...]
    points: int
    elements: int
    checks: int
    lifted: int

    @property
    def places(self) -> int:
        """Number of collocation points in an interval."""
        return self.points * self.elements * self.checks

    @property
    def states(self) -> int:
        """Number of unknown states in an interval."""
        return self.places * len(self.moving)

    @property
    def size(self) -> int:
        """Number of inner unknowns of an interval, and of their equations."""
        return self.states + self.lifted * (self.places + 1 if self.lifted else 0)


def layout_of(problem: OptimalControlProblem) -> Layout | None:
    """Return the layout; None for multiple shooting, or if no state has a rate."""
    radau, model = problem.collocation, problem.model
    if radau is None:  # First, since this is asked for often.
        return None
    moving = tuple(i for i in range(model.nx) if not model.ode[i].is_zero())
    if not moving:
        return None
    return Layout(
        moving=moving,
        points=radau.points,
        elements=radau.elements or problem.substeps,
        checks=problem.checks,
        lifted=int(model.elimination.residual.numel()),
    )


def inner_unknowns(problem: OptimalControlProblem) -> int:
    """Return the number of unknowns that collocation adds to an interval."""
    layout = layout_of(problem)
    return 0 if layout is None else layout.size


def inner_sizes(problem: OptimalControlProblem, states: Array) -> Array:
    """Return the natural sizes of an interval's inner unknowns.

    Args:
        problem: The problem.
        states: Sizes of the states, shape (nx,).
    """
    layout = layout_of(problem)
    if layout is None:
        return np.empty(0)
    sizes = [np.tile(states[list(layout.moving)], layout.places)]
    if layout.lifted:
        scale = np.asarray(problem.model.elimination.scale, dtype=np.float64)
        sizes.append(np.tile(scale, layout.places + 1))
    return np.concatenate(sizes)


def lifts(problem: OptimalControlProblem) -> bool:
    """Return whether algebraic variables are unknowns of the NLP."""
    layout = layout_of(problem)
    return layout is not None and layout.lifted > 0


class Inner:
    """Inside of an interval: integrator steps, or collocation.

    The rows that collocation adds are collected check by check.
    """

    def __init__(
        self,
        shooting: Shooting,
        begin: tuple[ca.SX, ca.SX, ca.SX, ca.SX],
        unknown: ca.SX,
    ) -> None:
        """Start an interval.

        Args:
            shooting: The problem's functions.
            begin: State, controls, parameters and signals at the interval's start.
            unknown: Inner unknowns, not scaled; empty in multiple shooting.
        """
        state, self._u, self._p, s = begin
        self._shooting, self._layout = shooting, layout_of(shooting.problem)
        self._defects: list[ca.SX] = []
        self._at = [(state, s)]
        layout = self._layout
        if layout is not None:
            states, z = unknown[: layout.states, 0], unknown[layout.states :, 0]
            self._states = ca.reshape(states, len(layout.moving), layout.places)
            self._z = ca.reshape(z, layout.lifted, layout.places + 1)

    def check(
        self, state: ca.SX, ends: tuple[ca.SX, ca.SX], k: int
    ) -> tuple[ca.SX, ca.SX]:
        """Return the state at check k, and the cost since the check before.

        The cost is the integral of the stage cost, divided by the unit of the cost.

        Args:
            state: State at the check before, or at the start of the interval, shape
                (nx, 1).
            ends: Signals at the time of this state, and at check k.
            k: Number of the check in the interval, from 0.
        """
        u, p, layout = self._u, self._p, self._layout
        if layout is None:
            return self._shooting.check_step(state, u, p, ends, after_jump=k == 0)
        own = layout.points * layout.elements
        unknown = self._states[:, k * own : (k + 1) * own]
        reached = collocated_check(self._shooting, state, (u, p), ends, unknown)
        self._defects += reached.defects
        self._at += reached.at
        return reached.state, reached.cost

    def rows(self, sizes: ca.SX, residuals: ca.SX) -> ca.SX:
        """Return the collocation rows, which must be 0, divided by the sizes.

        Args:
            sizes: Natural sizes of the states, shape (nx, 1).
            residuals: Natural sizes of the algebraic equations, shape (nz, 1).
        """
        layout = self._layout
        if layout is None:
            return ca.SX(0, 1)
        rows = [row / sizes[list(layout.moving)] for row in self._defects]
        if layout.lifted:
            found = self._shooting.problem.model.elimination
            residual = self._at_points(found.residual, self._symbols)
            rows += [
                residual(x, self._u, self._p, s, self._z[:, i]) / residuals
                for i, (x, s) in enumerate(self._at)
            ]
        return ca.vertcat(ca.SX(0, 1), *rows)

    def lifted(self, cost: ca.SX, g: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return cost and rows in which Newton's iterations are replaced by unknowns.

        The unknowns are the algebraic variables at each point.

        Args:
            cost: Cost of the interval, a scalar.
            g: Rows of the interval, shape (m, 1).
        """
        layout = self._layout
        if layout is None or not layout.lifted:
            return cost, g
        found = self._shooting.problem.model.elimination
        solution = self._at_points(found.solution, ca.SX(0, 1))
        values = [solution(x, self._u, self._p, s, ca.SX(0, 1)) for x, s in self._at]
        both = lifted(ca.vertcat(cost, g), ca.vertcat(*values), ca.vec(self._z))
        return both[0], both[1:, 0]

    @property
    def _symbols(self) -> ca.SX:
        return self._shooting.problem.model.elimination.symbols

    def _at_points(self, expression: ca.SX, z: ca.SX) -> ca.Function:
        """Return the function (x, u, p, s, z) -> an expression."""
        names = [*self._shooting.problem.symbols().values(), z]
        return ca.Function("at_points", names, [expression])


class Reached(NamedTuple):
    """Result of collocation from one check to the next.

    Attributes:
        state: State at the second check, shape (nx, 1).
        cost: Integral of the stage cost between the checks, divided by the unit of the
            cost.
        defects: Collocation rows, which must be 0, in the units of the states.
        at: Pair (state, signals) at each collocation point.
    """

    state: ca.SX
    cost: ca.SX
    defects: list[ca.SX]
    at: list[tuple[ca.SX, ca.SX]]


def collocated_check(
    shooting: Shooting,
    state: ca.SX,
    known: tuple[ca.SX, ca.SX],
    ends: tuple[ca.SX, ca.SX],
    unknown: ca.SX,
) -> Reached:
    """Return the result of collocation from one check to the next.

    Args:
        shooting: The problem's functions.
        state: State at the first of the two checks, shape (nx, 1).
        known: Controls, which are held, and parameters.
        ends: Signals at both checks.
        unknown: Unknown states at the collocation points between the checks, of the
            states with a rate only, shape (moving, points * elements).
    """
    problem, layout, (u, p) = shooting.problem, layout_of(shooting.problem), known
    if layout is None:
        raise ValueError("expected a problem with collocation")
    coefficients = radau_coefficients(layout.points)
    h = problem.dt / problem.checks / layout.elements
    moving, ns = list(layout.moving), problem.model.ns
    cost, defects, at = ca.SX(0), [], []
    for element in range(layout.elements):
        first = element * layout.points
        own = unknown[:, first : first + layout.points]
        through = ca.horzcat(state[moving], own)
        for i, (time, weight) in enumerate(
            zip(coefficients.times, coefficients.weights, strict=True)
        ):
            x = ca.SX(state)  # A copy; states without a rate keep their values.
            x[moving] = own[:, i]
            s = shooting.signals_at(ends, (element + float(time)) / layout.elements)
            slope = through @ ca.DM(coefficients.slopes[i])
            rate = shooting.dynamics(x, u, p, s[:ns, 0])
            defects.append(slope - h * rate[moving])
            if problem.quadrature == "integral":
                cost += h * float(weight) * shooting.stage_cost(x, u, p, s)
            at.append((x, s))
        state = at[-1][0]  # The last Radau point is the element's end.
    return Reached(state, cost, defects, at)


def lifted(expressions: ca.SX, values: ca.SX, symbols: ca.SX) -> ca.SX:
    """Return expressions with symbols in place of given values.

    Args:
        expressions: Expressions that contain the values, shape (m, 1).
        values: Values to replace, shape (n, 1).
        symbols: The symbols that replace them, shape (n, 1).
    """
    given = ca.symvar(ca.vertcat(expressions, values))
    known = ca.vertcat(ca.SX(0, 1), *given)
    function = ca.Function("whole", [known], [ca.densify(expressions), values])
    try:
        tape = read_tape(function)
    # The expressions stay correct; they only keep Newton's iterations.
    except UnknownOperationError:
        return expressions
    places: dict[int, ca.SX] = {}
    for number, symbol in zip(tape.outputs[1], ca.vertsplit(symbols), strict=True):
        node = tape.nodes[number]
        if node.operation == "neg":  # x - (-a) becomes x + a.
            places.setdefault(node.arguments[0], -symbol)
        if node.operation != "constant":
            places.setdefault(number, symbol)
    return _rebuilt(tape, known, places)


def _rebuilt(tape: Tape, known: ca.SX, places: Mapping[int, ca.SX]) -> ca.SX:
    """Return the first output of a tape, with some of its values given."""
    turned = {
        node.arguments[::-1]: places[number]
        for number, node in enumerate(tape.nodes)
        if number in places and node.operation == "sub"
    }
    values: list[ca.SX] = []
    for number, node in enumerate(tape.nodes):
        if number in places:
            values.append(places[number])
        elif node.operation == "sub" and node.arguments in turned:
            values.append(-turned[node.arguments])  # CasADi has -(a - b) as b - a.
        elif node.operation == "input":
            values.append(known[node.arguments[1]])
        elif node.operation == "constant":
            values.append(ca.SX(node.value))
        else:
            values.append(_applied(node, values))
    return ca.vertcat(ca.SX(0, 1), *[values[number] for number in tape.outputs[0]])


def _applied(node: Node, values: list[ca.SX]) -> ca.SX:
    """Return the result of one operation."""
    arguments = [values[number] for number in node.arguments]
    if len(arguments) == 1:
        return ca.SX.unary(_CODES[node.operation], *arguments)
    return ca.SX.binary(_CODES[node.operation], *arguments)
