"""A controller that decides as an exported C file does, by the library's own code.

It makes the same decisions as controller.c, plan by plan, with the library's machine
code. So a C file can be compared with code that was not written as C.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.export.controller.numbers import (
    CLOSE,
    FIRST_MU,
    LITTLE,
    WARM_MU,
    Status,
)
from swarmstart.export.controller.posed import PosedController, start_controls
from swarmstart.ocp.answer.plan import JUMP
from swarmstart.ocp.lanes.interior import InteriorLanes
from swarmstart.ocp.lanes.solver import RHO
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.statement.guesses import shifted_controls
from swarmstart.terminal_set import TerminalSet

_Value = tuple[float, float, float]
"""Cost, sum of the sizes of its parts, and violation."""


class _Answer(NamedTuple):
    """Answer of a local solve: controls, states after each interval, and value."""

    plan: Array
    path: Array
    value: _Value
    is_optimal: bool


class Twin:
    """A controller that decides as a C file does.

    It remembers its last plan; `reset` begins anew.

    Attributes:
        size: Sum of the absolute values of the last plan's costs: of each interval, of
            the start and of the end.
    """

    def __init__(self, one: PosedController, *, iterations: int) -> None:
        """Compile the local solver of the lanes.

        Args:
            one: The numbers and functions that the C file is made of.
            iterations: Largest number of steps of a local solve.
        """
        self._one, self._problem = one, one.problem
        self._lanes = InteriorLanes(one.shooting, most=iterations)
        _, self._common = self._lanes.repeated(one.x0, one.known, 1)
        self.reset()

    def reset(self) -> None:
        """Forget the last plan, and begin anew."""
        self._plan, self._path = self._one.first, np.empty(0)
        self._cost, self.size, self._begun = 0.0, 0.0, False
        self._remembered = self._one.remembered

    def step(self, x: Array, known: Known | None = None) -> tuple[Array, Status]:
        """Return the control of a step, shape (nu,), and its origin.

        Args:
            x: State of the stated problem, finite.
            known: Parameters and signals of the core, that is, of the problem after all
                rewrites; None: those of the export.
        """
        known = self._one.known if known is None else known
        here = np.concatenate([x, self._remembered])
        if self._begun:
            self._shift(known)
        found = self._linear(here, known)
        if found is None:
            found = self._planned(here, known)
        value, status = found
        self._begun, self._cost, self.size = True, value[0], value[1]
        self._remembered = self._path[self._one.stated :, 0]
        return self._plan[:, 0].copy(), status

    def model(self, x: Array, u: Array) -> Array:
        """Return the state after an interval, with parameters of the export."""
        here = np.concatenate([x, np.zeros(self._problem.model.nx - x.size)])
        return self._interval(here, u, self._one.known, 0)[0][: x.size]

    def _shift(self, known: Known) -> None:
        last = self._path[:, -1]
        self._plan = shifted_controls(self._problem, self._plan, self._one.append)
        after, _, _ = self._interval(last, self._plan[:, -1], known, -1)
        self._path = np.hstack([self._path[:, 1:], after[:, None]])

    def _linear(self, x: Array, known: Known) -> tuple[_Value, Status] | None:
        """Return the value of the linear law's plan; None outside its set."""
        near = self._one.terminal_set
        if near is None or not bool(near.contains(x - near.x_ref)):
            return None
        self._plan = self._law(near, x, known)
        value, self._path = self._rolled(x, self._plan, known)
        return value, Status.LINEAR

    def _law(self, near: TerminalSet, x: Array, known: Known) -> Array:
        controls, limits = [], self._problem.control_limits
        for k in range(self._problem.intervals):
            u = np.clip(near.u_ref + near.feedback(x - near.x_ref), *limits)
            controls.append(u)
            x, _, _ = self._interval(x, u, known, k)
        return np.array(controls).T

    def _planned(self, x: Array, known: Known) -> tuple[_Value, Status]:
        """Return the value of the best plan found."""
        shifted, guess, status = self._plan, self._path, Status.SHIFTED
        best, self._path = self._rolled(x, shifted, known)
        states = np.hstack([x[:, None], guess]) if self._begun else None
        little = LITTLE["double"] * self._one.noise
        fits = best[2] <= self._problem.tolerance
        is_optimal = self._begun and best[1] <= little and fits
        if not is_optimal:  # Else there is nothing to gain.
            mu, close = (WARM_MU if self._begun else FIRST_MU), CLOSE * best[1]
            answer = self._solved(x, shifted, states, mu, known)
            is_optimal = answer.is_optimal
            is_close = is_optimal and answer.value[0] - best[0] <= close
            if is_close or self._is_better(answer.value, best):
                best, status = self._kept(answer), Status.PLANNED
        if self._must_search(best, is_optimal):
            for knots in self._one.starts:
                start = start_controls(knots, self._problem.intervals)
                answer = self._solved(x, start, None, FIRST_MU, known)
                if self._is_better(answer.value, best):
                    best, status = self._kept(answer), Status.SEARCHED
        return best, status

    def _must_search(self, best: _Value, is_optimal: bool) -> bool:
        """Return whether seeded starts are solved, too."""
        noise = self._one.noise
        return (
            not self._begun
            or not is_optimal
            or not best[2] <= self._problem.tolerance
            or best[0] - self._cost > max(JUMP * best[1], noise)
        )

    def _is_better(self, value: _Value, best: _Value) -> bool:
        """Return whether a plan is better, violation first."""
        tolerance = self._problem.tolerance
        return is_better(value[::2], best[::2], tolerance=tolerance)

    def _kept(self, answer: _Answer) -> _Value:
        """Keep an answer as the plan; return its value."""
        self._plan, self._path = answer.plan, answer.path
        return answer.value

    def _solved(
        self, x: Array, plan: Array, states: Array | None, mu: float, known: Known
    ) -> _Answer:
        """Return the answer of a lane."""
        instances, _ = self._lanes.repeated(x, known, 1)
        lower, upper = self._problem.control_limits
        start = np.clip(plan, lower[:, None], upper[:, None])[:, :, None]
        found = self._lanes(
            instances, start, np.empty((0, 1)),
            None if states is None else states[:, :, None],
            common=self._common, mu=mu, rho=RHO,
        )  # fmt: skip
        controls = found.controls[:, :, 0]
        value, path = self._rolled(x, controls, known)
        fits = value[2] <= self._problem.tolerance
        return _Answer(controls, path, value, bool(found.optimal[0]) and fits)

    def _interval(
        self, x: Array, u: Array, known: Known, k: int
    ) -> tuple[Array, float, float]:
        problem, signals = self._problem, np.atleast_2d(known.signals)
        k %= problem.intervals
        window = signals[:, k * problem.checks : (k + 1) * problem.checks + 1]
        after, cost, broken = self._one.interval(x, u, self._parameters(known), window)
        return np.array(after).ravel(), float(cost), float(broken)

    def _parameters(self, known: Known) -> Array:
        weights = self._one.lane.weights
        return np.concatenate([np.asarray(known.parameters, dtype=float), weights])

    def _rolled(self, x: Array, plan: Array, known: Known) -> tuple[_Value, Array]:
        """Return the value of a plan, and the states after each interval."""
        one, p, path = self._one, self._parameters(known), []
        signals, total = np.atleast_2d(known.signals), np.zeros(3)
        if one.begin is not None:
            cost, broken = map(float, one.begin(x, p, signals[:, 0]))
            total += cost, abs(cost), broken
        for k in range(self._problem.intervals):
            x, cost, broken = self._interval(x, plan[:, k], known, k)
            total += cost, abs(cost), broken
            path.append(x)
        cost, broken = map(float, one.end(x, p, signals[:, -1]))
        total += cost, abs(cost), broken
        if not np.isfinite(total).all():
            total[:] = np.inf
        return (total[0], total[1], total[2]), np.array(path).T
