"""A formula that is fitted to roll-outs of a simulator, for plans with derivatives.

The rates f of a model get a correction by polynomials of states and controls,

    x' = f(x, u, p) + W m(z) + r(t),    z = ((x, u) - centre) / size

with W a matrix of factors, r a function of time, and m all monomials of z up to a
degree; if a degree has too many of them, only the powers of one state or control are
taken. W is found by least squares of the states after each step of all roll-outs, with
r = 0:

    minimise  sum of w |(x_k+1 - F(x_k, u_k, W)) / h|^2 + small |W|^2

F is one step of the classical Runge-Kutta method, h the length of the simulator's step,
w the weight of a roll-out, and `small` a small number. A few Newton steps solve this
problem. They take the slope of F in W as h times the mean of m over the step, by
Simpson's rule, so that the rows of W are independent. Of several degrees, the one is
used whose fit to three quarters of the roll-outs best predicts the others; the last fit
uses all roll-outs. Finally r is set to the errors that W leaves along the roll-out of
the largest weight, so that the formula repeats that roll-out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import Known, Model, OptimalControlProblem
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.integration import held_step

MOST_MONOMIALS = 60
"""Number of monomials above which a degree has only powers of one quantity."""
_MOST = 100
"""Number of monomials, such powers included, above which the degree is not raised."""
DEGREES = (1, 2, 3, 4, 5)
_MOST_STEPS = 4000
"""Largest number of steps to fit; of more, evenly spaced ones are used."""
_ROUNDS = 8
_RIDGE = 1e-9
_PART = 4
"""One in this many roll-outs is predicted instead of fitted, to find the degree."""


class RollOut(NamedTuple):
    """A roll-out of a simulator.

    Attributes:
        states: States at the start and after each step, shape (nx, n + 1).
        controls: Controls of each step, shape (nu, n).
        weight: Weight of its steps in a fit.
    """

    states: Array
    controls: Array
    weight: float


class Fit(NamedTuple):
    """A fitted correction, x' = f(x, u, p) + W m(((x, u) - centre) / size) + r(t).

    Attributes:
        parameters: Factors W of the monomials m, then centre and size of states and
            controls, to be appended to the model's own parameters p.
        rest: Errors r that W leaves along the roll-out of the largest weight, at the
            start and after each step, shape (nx, steps + 1).
        degree: Degree of the polynomials.
        error: Root mean square of the errors of steps that the fit has not seen,
            relative to the change of the state in a step.
    """

    parameters: Array
    rest: Array
    degree: int
    error: float


class Correction:
    """A problem whose rates are corrected by a formula with parameters.

    It is built once; each fit gives other values of these parameters.

    Attributes:
        problem: The problem with the correction.
    """

    def __init__(self, problem: OptimalControlProblem, step: float) -> None:
        """Add the correction to the model of a problem.

        Args:
            problem: The problem.
            step: Length of the simulator's steps [s].

        Raises:
            InvalidProblemError: If the model's rates depend on time or signals, it has
                algebraic equations, or it is in discrete time.
        """
        model = problem.model
        if (
            model.ns or model.time.numel() or model.is_discrete
            or model.elimination.unsolved.numel()
        ):  # fmt: skip
            raise InvalidProblemError(
                "a surrogate corrects rates of states, controls and parameters: "
                "expected a model in continuous time without signals, time and "
                "algebraic equations in its rates (surrogate=False searches any)"
            )
        self._step = step
        n = model.nx + model.nu
        whole = max(
            (d for d in DEGREES if math.comb(n + d, d) <= MOST_MONOMIALS),
            default=DEGREES[0],
        )
        self.degrees = [
            d
            for d in DEGREES
            if d <= whole or math.comb(n + whole, whole) + (d - whole) * n <= _MOST
        ]
        self._powers = [
            powers
            for degree in range(self.degrees[-1] + 1)
            for powers in combinations_with_replacement(range(n), degree)
            if degree <= whole or len(set(powers)) == 1
        ]
        count = len(self._powers)
        W = ca.SX.sym("W", model.nx, count)
        centre, size = ca.SX.sym("centre", n), ca.SX.sym("size", n)
        z = ca.SX.sym("z", n)
        monomials = ca.vertcat(
            *[
                math.prod((z[i] for i in powers), start=ca.SX(1))
                for powers in self._powers
            ]
        )
        scaled = (ca.vertcat(model.states, model.controls) - centre) / size
        rest = ca.SX.sym("rest", model.nx)
        rate = model.ode + W @ ca.substitute(monomials, z, scaled) + rest
        own = ca.vertcat(ca.vec(W), centre, size)
        self.problem = replace(
            problem,
            model=Model(
                states=model.states, controls=model.controls, ode=rate,
                parameters=ca.vertcat(model.parameters, own), signals=rest,
                state_names=model.state_names, control_names=model.control_names,
            ),
        )  # fmt: skip
        self._after = held_step(self.problem.model, step)
        self._monomials = ca.Function("monomials", [z], [monomials])

    def _predict(self, x: Array, u: Array, parameters: Array, own: Array) -> Array:
        """Return the states after a step, each column from one of x and u."""
        rest = np.zeros((len(x), 2 * x.shape[1]))  # At both ends of each step.
        return np.array(self._after(x, u, np.concatenate([parameters, own]), rest))

    def known(self, known: Known, fit: Fit) -> Known:
        """Return parameters with those of a fit appended, and its errors r as signals.

        The model of the problem itself has no signals.
        """
        own = np.asarray(known.parameters, dtype=np.float64).ravel()
        return known._replace(
            parameters=np.concatenate([own, fit.parameters]), signals=fit.rest
        )

    def fitted(self, rollouts: Sequence[RollOut], parameters: Array) -> Fit:
        """Return the correction that fits roll-outs.

        Args:
            rollouts: Roll-outs to fit, at least two.
            parameters: Parameters of the model, shape (np,).
        """
        seen = [one for i, one in enumerate(rollouts) if i % _PART != _PART - 1]
        unseen = [one for i, one in enumerate(rollouts) if i % _PART == _PART - 1]
        scales = self._scales(rollouts)
        errors = {}
        for degree in self.degrees:
            W = self._least_squares(seen, parameters, scales, degree)
            errors[degree] = self._error(unseen or seen, parameters, scales, W)
        degree = min(errors, key=lambda d: (not math.isfinite(errors[d]), errors[d]))
        W = self._least_squares(rollouts, parameters, scales, degree)
        own = self._own(W, scales)
        rest = self._rest(rollouts, parameters, own)
        return Fit(own, rest, degree, errors[degree])

    def _rest(
        self, rollouts: Sequence[RollOut], parameters: Array, own: Array
    ) -> Array:
        """Return r, the mean of the errors of W before and after each node."""
        nearest = max(rollouts, key=lambda one: one.weight)
        x, after = nearest.states[:, :-1], nearest.states[:, 1:]
        missed = after - self._predict(x, nearest.controls, parameters, own)
        rates = np.pad(missed / self._step, ((0, 0), (1, 1)), mode="edge")
        return (rates[:, :-1] + rates[:, 1:]) / 2

    def _scales(self, rollouts: Sequence[RollOut]) -> tuple[Array, Array, Array]:
        """Return centre and size of states and controls, and the spread of rates."""
        both = np.hstack([np.vstack([r.states[:, :-1], r.controls]) for r in rollouts])
        changes = np.hstack([np.diff(one.states) for one in rollouts])
        size = both.std(axis=1)
        spread = np.sqrt((changes**2).mean(axis=1))
        return (
            both.mean(axis=1),
            np.where(size > 0, size, 1.0),
            np.where(spread > 0, spread, 1.0),
        )

    def _own(self, W: Array, scales: tuple[Array, Array, Array]) -> Array:
        return np.concatenate([W.ravel(order="F"), scales[0], scales[1]])

    def _steps(self, rollouts: Sequence[RollOut]) -> tuple[Array, Array, Array, Array]:
        """Return states, controls, states after and weights of the steps to fit."""
        x = np.hstack([one.states[:, :-1] for one in rollouts])
        u = np.hstack([one.controls for one in rollouts])
        after = np.hstack([one.states[:, 1:] for one in rollouts])
        weights = np.hstack([np.full(r.controls.shape[1], r.weight) for r in rollouts])
        part = np.linspace(0, x.shape[1] - 1, min(x.shape[1], _MOST_STEPS)).astype(int)
        return x[:, part], u[:, part], after[:, part], weights[part]

    def _least_squares(
        self,
        rollouts: Sequence[RollOut],
        parameters: Array,
        scales: tuple[Array, Array, Array],
        degree: int,
    ) -> Array:
        """Return W (nx, monomials), zero above a degree."""
        x, u, after, weights = self._steps(rollouts)
        used = np.array([len(powers) <= degree for powers in self._powers])
        centre, size = scales[0][:, None], scales[1][:, None]
        at = [
            np.array(self._monomials((np.vstack([one, u]) - centre) / size))
            for one in (x, (x + after) / 2, after)
        ]
        A = self._step * ((at[0] + 4 * at[1] + at[2]) / 6)[used]
        square = (A * weights) @ A.T
        square += _RIDGE * np.trace(square) / len(square) * np.eye(len(square))
        W, best, least = np.zeros((len(x), used.size)), None, np.inf
        for _ in range(_ROUNDS):
            own = self._own(W, scales)
            missed = after - self._predict(x, u, parameters, own)
            rest = float((weights * (missed / scales[2][:, None]) ** 2).sum())
            if not rest < least:  # Also if it is no number.
                break
            best, least = W.copy(), rest
            W[:, used] += np.linalg.solve(square, (A * weights) @ missed.T).T
        return W if best is None else best

    def _error(
        self,
        rollouts: Sequence[RollOut],
        parameters: Array,
        scales: tuple[Array, Array, Array],
        W: Array,
    ) -> float:
        """Return the error of a step, relative to the change of the state in it."""
        x, u, after, weights = self._steps(rollouts)
        found = self._predict(x, u, parameters, self._own(W, scales))
        squares = (((after - found) / scales[2][:, None]) ** 2).mean(axis=0)
        return float(np.sqrt((squares * weights).sum() / weights.sum()))
