"""Fixed steps for an NLP whose rollouts use step size control.

The derivatives of an NLP solver need the same steps for all values of its variables.
The number of steps in an interval is chosen at a guess: from its state at each check,
equal steps are compared with steps ten times as accurate as the rollout's
(adaptive.py). The first step after a jump of the controls is divided into parts, each
four times as long as the one before, so that a short transient needs few steps.
"""

from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.integration.adaptive import FIRST, ROUNDED, finer, followed
from swarmstart.ocp.integration.integrators import MORE_PARTS, PARTS, stiff_lengths
from swarmstart.ocp.integration.rosenbrock import rodas4
from swarmstart.ocp.rollout.shooting import Shooting

_MOST_OPERATIONS = 25_000
"""Largest number of steps in an interval; an NLP with more takes too long to build."""
_TIMES = (1, 2, 4, 8)
_ALIKE = 2.0
"""Factor by which errors must differ to justify more steps."""


class FixedSteps(NamedTuple):
    """Numbers of steps from check to check.

    Attributes:
        steps: Number of equal steps.
        parts: Number of parts of the first of them after a jump of the controls.
    """

    steps: int
    parts: int

    def shooting(self, of: Shooting) -> Shooting:
        """Return the functions of a problem with these steps."""
        stated = replace(of.stated, substeps=self.steps, integrator_tolerance=None)
        return Shooting(stated, parts=self.parts)


class StepChoice:
    """Choice of the fewest fixed steps that reach a problem's tolerance."""

    def __init__(self, shooting: Shooting) -> None:
        """Compile one step, and the finer steps for comparison.

        Args:
            shooting: Functions of a problem whose rollouts use step size control.
        """
        self._problem = problem = shooting.problem
        self._tolerance = problem.integrator_tolerance or 0.0
        model = problem.model
        y = ca.SX.sym("y", model.nx + problem.integrals)
        u, p = ca.SX.sym("u", model.nu), ca.SX.sym("p", model.np)
        s = ca.SX.sym("s", problem.ns, 2)
        t, h = ca.SX.sym("t"), ca.SX.sym("h")
        after = rodas4(shooting.rate(u, p, (s[:, 0], s[:, 1])), y, t, h)  # type: ignore[arg-type]
        self._step = ca.Function("step", [y, t, h, u, p, s], [ca.cse(after)])
        self._finer = followed(shooting.tick_to(finer(self._tolerance)))
        most = _MOST_OPERATIONS / self._step.n_instructions() / problem.checks
        tried = [
            FixedSteps(problem.substeps * times, parts)
            for times in _TIMES
            for parts in (PARTS, MORE_PARTS)
        ]
        first, *others = tried
        self.candidates = [
            first, *(c for c in others if c.steps + c.parts - 1 <= most)
        ]  # fmt: skip

    def __call__(
        self, controls: Array, states: Array, arguments: tuple[Array, Array, Array]
    ) -> FixedSteps:
        """Return the steps that a guess needs; the finest if none is accurate enough.

        Args:
            controls: Shape (nu, N).
            states: At the nodes, shape (nx, nodes).
            arguments: Other arguments of a rollout.
        """
        exact = self._reached(controls, states, arguments)
        known = np.flatnonzero(np.isfinite(exact.ends).all(axis=0))
        if not known.size:
            return self.candidates[0]
        errors: list[float] = []
        for steps in self.candidates:
            errors.append(self._error(steps, exact, known))
            if errors[-1] <= self._tolerance:
                return steps
        least = min(errors)
        enough = [error <= _ALIKE * least for error in errors]
        return (
            self.candidates[enough.index(True)] if any(enough) else self.candidates[0]
        )

    def _reached(
        self, controls: Array, states: Array, arguments: tuple[Array, Array, Array]
    ) -> "_Checks":
        """Return all checks, with their accurate end values."""
        problem = self._problem
        (_, p, flat), count = arguments, problem.nodes - 1
        y = np.vstack([states[:, :-1], np.zeros((problem.integrals, count))])
        signals = flat.reshape((problem.ns, problem.nodes), order="F")
        both = np.empty((problem.ns, 2 * count))
        both[:, ::2], both[:, 1::2] = signals[:, :-1], signals[:, 1:]
        u = np.repeat(controls, problem.checks, axis=1)
        z = np.vstack([y, np.abs(y), np.ones(count), np.full(count, FIRST)])
        many = np.tile(p[:, None], (1, count))
        ends = np.array(self._finer(z, u, many, both))[: y.shape[0]]
        rounded = ROUNDED / self._tolerance * p[p.size - y.shape[0] :]
        seen = np.hstack([y[:, np.isfinite(y).all(axis=0)], ends])
        reach = np.nan_to_num(np.abs(seen), nan=0.0, posinf=0.0).max(axis=1)
        own = many[: problem.model.np]
        return _Checks(y, u, own, both, ends, np.maximum(reach, rounded))

    def _error(
        self, steps: FixedSteps, exact: "_Checks", known: NDArray[np.intp]
    ) -> float:
        """Return the largest error of the steps, relative to each number's size."""
        problem, found = self._problem, exact.begins.copy()
        duration, checks = problem.dt / problem.checks, problem.checks
        for first in (True, False):
            columns = np.arange(found.shape[1])
            chosen = columns[(columns % checks == 0) == first]
            if not chosen.size:
                continue
            y, t = found[:, chosen], 0.0
            both = np.stack([2 * chosen, 2 * chosen + 1], axis=1).ravel()
            known_there = (
                exact.controls[:, chosen],
                exact.parameters[:, chosen],
                exact.signals[:, both],
            )
            parts = steps.parts if first else 1
            for h in stiff_lengths(duration / steps.steps, steps.steps, parts):
                one = np.ones((1, chosen.size))
                y, t = np.array(self._step(y, t * one, h * one, *known_there)), t + h
            found[:, chosen] = y
        off = np.abs(found - exact.ends)[:, known] / exact.reach[:, None]
        return float(np.nan_to_num(off, nan=np.inf).max(initial=0.0))


class _Checks(NamedTuple):
    """All checks of a horizon, one column each.

    Attributes:
        begins: Integrated quantities at the start of the checks.
        controls: Controls, which are held.
        parameters: Parameters of the model.
        signals: Signals at both ends of each check, two columns each.
        ends: Accurate values at the end of the checks.
        reach: Largest size of each number.
    """

    begins: Array
    controls: Array
    parameters: Array
    signals: Array
    ends: Array
    reach: Array
