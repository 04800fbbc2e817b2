"""NLP of a problem and its solvers, brought to agree with the evaluator's integrator.

Fixed steps. The derivatives of an NLP solver need the same steps for all values of its
variables. If the rollouts use step size control, the number of steps in an interval is
chosen from a guess: from the state of the guess at each check, equal steps are compared
with steps ten times as accurate as the rollout's (rodas.py). The first step after a
jump of the controls is divided into parts, each four times as long as the one before,
so that a short transient needs few steps. There is one set of solvers for each number
of steps.

Deferred correction. An answer of the NLP keeps its limits on the collocated path, but
an evaluator with another integrator may disagree. Let x_k, u_k be the answer, and c_k
the inner unknowns that lead from x_k to the state that the evaluator reaches. The
equations of motion, the rows D(c) = 0, are shifted to

    D(c) = D(c_k),     x after(c) - x_k+1 = x after(c_k) - evaluator's state,

so that each interval leads to the evaluator's state. The solution of an NLP with these
rows, started from the answer, is closer to the evaluator by the accuracy of the
collocation. This is repeated until NLP and evaluator agree.

Source: Auzinger, Hofstaetter, Kreuzer and Weinmueller (2004), Modified defect
correction algorithms for ODEs, part I, Numerical Algorithms 36.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import compiling
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.integration.integrators import MORE_PARTS, PARTS, stiff_lengths
from swarmstart.ocp.integration.rodas import FIRST, ROUNDED, finer, followed, rodas4
from swarmstart.ocp.nlp.collocation import layout_of
from swarmstart.ocp.nlp.nlp_sources import last_line
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.polish_options import PolishOptions
from swarmstart.ocp.nlp.transcription import (
    Given,
    Limits,
    NonlinearProgram,
    multiple_shooting,
)
from swarmstart.ocp.nlp.watching import Iterates, Ratios, ratios_of
from swarmstart.ocp.rollout.fitness import Fitness, at_nodes
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting

_NONE: Mapping[str, Any] = MappingProxyType({})
_MOST_OPERATIONS = 25_000
"""Largest number of steps in an interval; an NLP with more takes too long to build."""
_TIMES = (1, 2, 4, 8)
_ALIKE = 2.0
"""Factor by which errors must differ to justify more steps."""
MOST_CORRECTIONS = 5
"""Largest number of times that an NLP is solved again."""


class FixedSteps(NamedTuple):
    """Numbers of steps from check to check.

    Attributes:
        steps: Number of equal steps.
        parts: Number of parts of the first step after a jump of the controls.
    """

    steps: int
    parts: int

    def shooting(self, of: Shooting) -> Shooting:
        """Return the functions of a problem with these steps."""
        stated = replace(of.stated, substeps=self.steps, integrator_tolerance=None)
        return Shooting(stated, parts=self.parts)


class Solvers(NamedTuple):
    """An NLP and its solvers, each built at its first use.

    Attributes:
        program: The NLP.
        far: Function (whether iterates are observed) -> the solver for starts far from
            an answer.
        near: Function (whether iterates are observed) -> the solver for starts near an
            answer.
        warm: Returns the solver that starts from multipliers, always observed, since
            its solve may have to be stopped.
        iterates: Receives the iterates of observed solvers.
        ratios: Cost of the derivatives, in rollouts.
    """

    program: NonlinearProgram
    far: Callable[[bool], ca.Function]
    near: Callable[[bool], ca.Function]
    warm: Callable[[], ca.Function]
    iterates: Iterates
    ratios: Ratios


class NlpSolvers:
    """Solvers of one problem; each is built at its first use and then kept.

    Attributes:
        has_fixed_steps: Whether all guesses share one NLP; if not, the number of its
            steps is chosen for each guess.
        built: Solvers built so far, by the steps of their NLP.
    """

    def __init__(self, fitness: Fitness, options: PolishOptions) -> None:
        """Try the options on a small NLP; the problem's own NLP is built when needed.

        Args:
            fitness: The problem's evaluator; if it is machine code, the NLP's functions
                are, too.
            options: Options of the solver.

        Raises:
            InvalidProblemError: If the solver refuses an option.
        """
        self._fitness, self._options = fitness, options
        self.built: dict[FixedSteps | None, Solvers] = {}
        problem = fitness.problem
        self.has_fixed_steps = not problem.is_adaptive or bool(problem.collocation)
        x = ca.MX.sym("x")
        # A trial, so that a refused option is reported now.
        self._solver({"x": x, "f": x}, _NONE, near=False)

    @property
    def program(self) -> NonlinearProgram | None:
        """The NLP; None if its steps are chosen for each guess."""
        return self(None).program if self.has_fixed_steps else None

    def __call__(self, steps: FixedSteps | None) -> Solvers:
        """Return the NLP for given steps with its solvers.

        Args:
            steps: Steps of the NLP; None: the problem's.
        """
        if steps not in self.built:
            with compiling():  # During planning.
                self.built[steps] = self._new(steps)
        return self.built[steps]

    def steps_of(self, program: NonlinearProgram) -> FixedSteps | None:
        """Return the steps of an NLP that was built here."""
        return next(n for n, one in self.built.items() if one.program is program)

    def _new(self, steps: FixedSteps | None) -> Solvers:
        own = self._fitness.shooting
        fixed = own if steps is None else steps.shooting(own)
        ipopt = self._options.plugin == "ipopt"
        # Other solvers ask CasADi for derivatives.
        program = multiple_shooting(
            fixed, compiled=ipopt and self._fitness.backend == "llvm"
        )
        given: Mapping[str, Any] = program.derivatives if ipopt else _NONE
        iterates = Iterates(program.nlp)

        # An unobserved one is faster by up to a tenth on small problems.
        @cache
        def solver(is_observed: bool, *, near: bool, warm: bool = False) -> ca.Function:
            report = {"iteration_callback": iterates} if is_observed else {}
            with compiling():  # During planning.
                return self._solver(
                    program.nlp, {**given, **report}, near=near, warm=warm
                )

        far = partial(solver, near=False)
        return Solvers(
            program,
            far,
            # Other solvers than IPOPT have one way to start.
            partial(solver, near=True) if ipopt else far,
            partial(solver, True, near=True, warm=True),
            iterates,
            ratios_of(program, own),
        )

    def _solver(
        self,
        nlp: dict[str, Any],
        given: Mapping[str, Any],
        *,
        near: bool,
        warm: bool = False,
    ) -> ca.Function:
        options = self._options
        settings = {
            "print_time": False,
            "show_eval_warnings": False,
            "error_on_fail": False,  # Not converging is a status.
            # Multipliers of the parameters, and their derivatives, are not used.
            "calc_lam_p": False,
            "no_nlp_grad": True,
            **given,
            **options.settings(near=near, warm=warm),
        }
        try:
            return ca.nlpsol("polish", options.plugin, nlp, settings)
        except RuntimeError as error:
            raise InvalidProblemError(
                f"{options.plugin} refuses its options: expected its own names and "
                f"types, found {dict(options.options)}: {last_line(error)}"
            ) from error


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
        first, *others = tried  # The first is kept in any case.
        self.candidates = [
            first, *(c for c in others if c.steps + c.parts - 1 <= most)
        ]  # fmt: skip

    def __call__(
        self, controls: Array, states: Array, arguments: tuple[Array, Array, Array]
    ) -> FixedSteps:
        """Return the steps that a guess needs; the finest if none is accurate enough.

        Args:
            controls: Controls, shape (nu, N).
            states: States at the nodes, shape (nx, nodes).
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
        signals = at_nodes(problem, flat)
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


def corrected(
    point: NlpPoint, sizes: Sizes, parameters: Array, signals: Array
) -> tuple[Array, Limits] | None:
    """Return the start and the limits of a further solve, which corrects an answer.

    In these limits the equations of motion are shifted, so that each interval leads to
    the state that the rollout's integrator reaches.

    Algebraic equations are not changed.

    Args:
        point: The answer of the NLP.
        sizes: Natural sizes of states, controls, cost and rows.
        parameters: Shape (np,).
        signals: Signals at the nodes, shape (ns, nodes).

    Returns:
        The new guess and limits; None if the integrator's states are not finite, or
        nothing is collocated.
    """
    program, problem = point.program, point.program.problem
    guess, layout = program.inner_guess, layout_of(problem)
    if guess is None or layout is None:
        return None
    nx, N = problem.model.nx, problem.intervals
    ends = point.ends * sizes.states[:, None]
    controls, _ = program.split(point.w, sizes)
    pieces = guess.followed(controls, ends[:, :-1], (parameters, signals), sizes)
    if not np.isfinite(pieces).all():
        return None
    given = Given(controls, pieces, parameters, signals)
    w = program.with_points(point.w, given, sizes)
    height = program.parts.interval.height
    g = np.array(program.derivatives["jac_g"](w, point.q)[0]).ravel()[: height * N]
    shift = g.reshape((N, height))[:, : nx + layout.states].copy()
    shift[:, :nx] += ((ends[:, 1:] - pieces[:, -1]) / sizes.states[:, None]).T
    lbg, ubg = point.limits.lbg.copy(), point.limits.ubg.copy()
    for bounds in (lbg, ubg):
        columns = bounds[: height * N].reshape((N, height))  # A view.
        columns[:, : nx + layout.states] = shift
    return w, point.limits._replace(lbg=lbg, ubg=ubg)
