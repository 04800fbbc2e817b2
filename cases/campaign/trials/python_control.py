"""`control.optimal.solve_ocp` on a planning problem, on the problem's own grid.

python-control integrates continuous systems with inputs that are linear between its
time points. So that it solves the very problem of the other solvers, with held
controls, it is given the sampled system of the core (ocp/statement/core_problem.py):

    (x, k)+ = (F(x, u), k + 1)     F integrates over interval k
    min sum L(x_k, u_k) + V(x_N)   L is the cost of interval k
    rows at the checks, limits of the controls, rows at the end

and its default way for sampled systems: shooting with SciPy's SLSQP, whose derivatives
are differences of whole simulations. An evaluation is one simulation of the horizon.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.building import Built, Trial
from swarmstart.cases.campaign.trials.history import Meter
from swarmstart.cases.campaign.trials.peers import BudgetSpent, PeerError
from swarmstart.ocp import zero_controls
from swarmstart.ocp.rollout import Shooting, at_nodes
from swarmstart.ocp.system import Rows

Numbers = Callable[[Array, Array], Any]
"""(x with k, u) -> numbers, as python-control calls its functions."""


def solve_ocp(made: Built, trial: Trial, meter: Meter) -> bool:
    """Solve a planning problem by `control.optimal.solve_ocp`, from zero controls.

    Args:
        made: The problem with its functions.
        trial: The budget and the options.
        meter: Told each iterate.

    Returns:
        Whether it ended by itself, and not by the budget.

    Raises:
        PeerError: If the problem decides more than controls, or it refuses an option.
    """
    import control
    import control.optimal

    problem = made.planner.problem
    if problem.free_starts or problem.integer:
        raise PeerError(
            "python-control decides controls only, found a problem that decides "
            "its end time, start, parameters or whole numbers, too"
        )
    shooting, options = made.planner.tracer.shooting, dict(trial.solver.options)
    x0, known, _ = made.planner.posed(made.posed.x0, made.posed.known)
    state, p, flat = made.planner.fitness.arguments(x0, known)
    posed = _Posed(shooting, p, at_nodes(problem, flat), meter)
    lower, upper = problem.control_limits
    system = control.NonlinearIOSystem(
        posed.step, None, states=state.size + 1, inputs=problem.model.nu, dt=1
    )

    def told(coefficients: Array, *_: object) -> None:
        """Record an iterate; python-control's coefficients are the inputs."""
        inputs = coefficients.reshape(problem.model.nu, -1)[:, :-1]
        controls = np.clip(inputs, lower[:, None], upper[:, None])
        value = made.planner.fitness.value(controls, state, known)
        meter.answered((controls, state), *value)

    guess = zero_controls(problem)
    guess = np.hstack([guess, guess[:, -1:]])  # It has inputs at the last time, too.
    told(guess)  # So that there is an answer if the budget ends the first iteration.
    limits = control.optimal.input_range_constraint(system, lower, upper)
    chosen = {"maxiter": options["maxiter"]} if "maxiter" in options else {}
    try:
        with warnings.catch_warnings():  # It warns of each end without success.
            warnings.simplefilter("ignore")
            found = control.optimal.solve_ocp(
                system,
                np.arange(problem.intervals + 1),
                np.append(state, 0.0),
                posed.cost,
                [limits, *posed.path_rows()],
                terminal_cost=posed.end_cost,
                terminal_constraints=posed.end_rows(),
                initial_guess=guess,
                print_summary=False,
                minimize_method=options.get("method", "SLSQP"),
                minimize_options=chosen,
                minimize_kwargs={"callback": told},
            )
    except BudgetSpent:
        return False
    except (ValueError, TypeError) as error:
        raise PeerError(f"python-control cannot be run: {error}") from error
    told(np.asarray(found.x))
    return True


class _Posed:
    """The functions of a problem in the form of python-control."""

    def __init__(
        self, shooting: Shooting, p: Array, signals: Array, meter: Meter
    ) -> None:
        """Compile the functions.

        Args:
            shooting: The problem's functions.
            p: Parameters with the numbers of a rollout.
            signals: At the nodes, shape (ns, nodes).
            meter: Counts a simulation after each N steps.
        """
        self._problem, self._shooting = shooting.problem, shooting
        self._p, self._signals, self._meter = p, signals, meter
        self._steps = 0

    def step(self, t: float, x: Array, u: Array, params: Any) -> Array:
        """Return the state after the interval that the last entry of x numbers.

        Raises:
            BudgetSpent: If the budget is spent.
        """
        del t, params
        self._steps += 1
        if self._steps % self._problem.intervals == 0:
            self._meter.counted(1.0)
            if self._meter.is_over:
                raise BudgetSpent
        after = self._stage(x, u)[0].full()[:, -1]
        return np.append(after, x[-1] + 1.0)

    def cost(self, x: Array, u: Array) -> float:
        """Return the cost of an interval."""
        return float(self._stage(x, u)[1])

    def end_cost(self, x: Array, u: Array) -> float:
        """Return the cost at the end of the horizon."""
        del u
        return float(self._shooting.terminal(x[:-1], self._p, self._signals[:, -1])[0])

    def path_rows(self) -> list[Any]:
        """Return the path constraints over an interval, for python-control."""
        problem = self._problem
        rows = [c.smooth(c.expression) for c in problem.path_constraints]
        value, lower, upper = _stacked(rows, [*problem.symbols().values()])
        if not lower.size:
            return []
        # A row with controls holds at the start of a check, too.
        firsts = np.cumsum([0, *(r.lower.size for r in rows)])
        several = zip(firsts, self._shooting.rows_with_controls, strict=False)
        driven = [int(first) + row for first, own in several for row in own]
        np_ = problem.model.np
        # python-control asks for the rows at the last time point as well, although
        # no interval begins there: any value within the limits will do.
        inside = np.where(np.isfinite(lower), lower, upper)
        blocks = problem.checks
        ends = np.tile(inside, blocks), np.tile(inside[driven], blocks)

        def over(x: Array, u: Array) -> Array:
            k = round(x[-1])
            if k >= problem.intervals:
                return np.concatenate(ends)
            s, states = self._within(k), self._stage(x, u)[0].full()
            begins = np.column_stack([x[:-1], states[:, :-1]])
            many = np.tile(u[:, None], (1, blocks))
            shared = np.tile(self._p[:np_, None], (1, blocks))
            after = value(states, many, shared, s[:, 1:]).full()
            before = value(begins, many, shared, s[:, :-1]).full()[driven]
            return np.concatenate([after.ravel("F"), before.ravel("F")])

        low, high = (
            np.concatenate([np.tile(side, blocks), np.tile(side[driven], blocks)])
            for side in (lower, upper)
        )
        return [_constraint(over, low, high)]

    def end_rows(self) -> list[Any]:
        """Return the terminal constraints, for python-control."""
        problem = self._problem
        names = [*problem.symbols().values()]
        rows = [c.smooth(c.expression) for c in problem.terminal_constraints]
        value, lower, upper = _stacked(rows, [names[0], names[2], names[3]])
        if not lower.size:
            return []

        def at_end(x: Array, u: Array) -> Array:
            del u
            found = value(x[:-1], self._p[: problem.model.np], self._signals[:, -1])
            return np.asarray(found.full().ravel())

        return [_constraint(at_end, lower, upper)]

    def _stage(self, x: Array, u: Array) -> Sequence[ca.DM]:
        """Return the states at the checks, cost and violation of an interval."""
        # A simulation may ask for one interval beyond the last.
        k = min(round(x[-1]), self._problem.intervals - 1)
        arguments = [x[:-1], u, self._p, self._within(k)]
        found: Sequence[ca.DM] = self._shooting.stage.call(arguments)
        return found

    def _within(self, k: int) -> Array:
        """Return the signals at the nodes of an interval, (ns, checks + 1)."""
        m = self._problem.checks
        return self._signals[:, k * m : (k + 1) * m + 1]


def _stacked(
    rows: Sequence[Rows], symbols: list[ca.SX]
) -> tuple[ca.Function, Array, Array]:
    """Return rows of several constraints as one function, and their limits."""
    values = ca.vertcat(ca.SX(0, 1), *[r.values for r in rows])
    lower, upper = (
        np.concatenate([np.empty(0), *(getattr(r, side) for r in rows)])
        for side in ("lower", "upper")
    )
    return ca.Function("rows", symbols, [values]), lower, upper


def _constraint(function: Numbers, lower: Array, upper: Array) -> Any:
    """Return a constraint in the form of python-control."""
    from scipy.optimize import NonlinearConstraint

    return NonlinearConstraint, function, lower, upper
