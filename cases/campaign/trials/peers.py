"""Solvers of other packages on the same problem: searches, and python-control.

A search runs as in its package, on the same objective and within the same bounds, with
the package's own defaults unless options replace them, and can end by its own rules. It
minimises one number,

    cost + weight * violation,

a static penalty. If the scenario's order is a static penalty, too, its weight is used;
else the weight is WORTH times the natural size of the cost, so that the result does not
depend on units. Values that are not finite count as LARGEST. The answer is the best of
all points that the search has evaluated: feasible before infeasible, then by cost. So
no peer has a disadvantage from its own order of points.

SciPy and cmaes evaluate whole generations, which the compiled evaluator computes at
once. pagmo evaluates point by point, with about ten microseconds of Python each:
compare it by evaluations rather than seconds.

A budget ends a peer by an exception from the objective: the last generation is cut at
the budget's last evaluation.

`control.optimal.solve_ocp` runs on the problem's own grid. python-control integrates
continuous systems with inputs that are linear between its time points. So that
python-control solves the very problem of the other solvers, with held controls, it is
given the sampled system of the core, that is, of the problem after all rewrites
(ocp/statement/rewrites/chain.py):

    (x, k)+ = (F(x, u), k + 1)     F integrates over interval k
    min sum L(x_k, u_k) + V(x_N)   L is the cost of interval k, V that of the end
    constraints at the checks, limits of the controls, constraints at the end

python-control uses its default method for sampled systems: shooting with SciPy's SLSQP,
whose derivatives are differences of whole simulations. An evaluation is one simulation
of the horizon.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.building import Built, Trial
from swarmstart.cases.campaign.trials.history import BudgetSpent, Meter
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Box
from swarmstart.ocp import zero_controls
from swarmstart.ocp.rollout import Shooting, at_nodes
from swarmstart.ocp.system import Rows

LARGEST = 1e30
"""Value that replaces one that is not finite."""
WORTH = 1e3
"""Penalty of a violation of 1, in natural sizes of the cost."""
_ENDLESS = 10**9
"""Number of generations that no budget reaches."""

Numbers = Callable[[Array, Array], Any]
"""(x with k, u) -> numbers, as python-control calls its functions."""


class PeerError(SwarmstartError):
    """A solver of another package refuses its options or its problem."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PeerTask:
    """Task of a peer, that is, of a search of another package.

    Attributes:
        objective: Population (dim, size) -> values to minimise (size,); raises
            BudgetSpent.
        box: Bounds of the search.
        seed: Seed of the solver's random numbers.
        options: Options of the solver; missing ones and None mean the package's
            default.
    """

    objective: Callable[[Array], Array]
    box: Box
    seed: int
    options: Mapping[str, Any]

    def given(self, *names: str) -> dict[str, Any]:
        """Return the options with these names that have a value."""
        return {n: self.options[n] for n in names if self.options.get(n) is not None}


def penalised(cost: Array, violation: Array, weight: float) -> Array:
    """Return the values that a peer minimises: cost + weight * violation.

    Args:
        cost: Costs, shape (size,).
        violation: Violations, same shape.
        weight: Penalty of a violation of 1.
    """
    values = cost + weight * violation
    return np.where(np.isfinite(values), np.minimum(values, LARGEST), LARGEST)


def scipy_de(task: PeerTask) -> None:
    """Run `scipy.optimize.differential_evolution`, a generation at a time."""
    from scipy.optimize import differential_evolution

    names = inspect.signature(differential_evolution).parameters
    # SciPy renamed it in version 1.15.
    seeding = "rng" if "rng" in names else "seed"
    differential_evolution(
        task.objective,
        list(zip(task.box.lower, task.box.upper, strict=True)),
        maxiter=_ENDLESS,
        polish=False,
        vectorized=True,
        updating="deferred",
        **{seeding: np.random.default_rng(task.seed)},
        **task.given("popsize", "strategy", "mutation", "recombination", "tol", "init"),
    )


def pygmo_de(task: PeerTask) -> None:
    """Run `pygmo.de`."""
    _evolve(task, "de", **task.given("F", "CR", "variant", "ftol", "xtol"))


def pygmo_de1220(task: PeerTask) -> None:
    """Run `pygmo.de1220`."""
    _evolve(task, "de1220", **task.given("variant_adptv", "ftol", "xtol"))


def pygmo_pso(task: PeerTask) -> None:
    """Run `pygmo.pso`."""
    names = ("omega", "eta1", "eta2", "max_vel", "variant", "neighb_type")
    _evolve(task, "pso", **task.given(*names, "neighb_param"))


def pygmo_cmaes(task: PeerTask) -> None:
    """Run `pygmo.cmaes`, within the bounds."""
    given = task.given("sigma0", "ftol", "xtol")
    _evolve(task, "cmaes", force_bounds=True, **given)


class _Posed:
    """The problem for pagmo; a copy is the same object, since it counts evaluations."""

    def __init__(self, task: PeerTask) -> None:
        self._task = task

    def __deepcopy__(self, memo: object) -> _Posed:
        return self

    def fitness(self, x: Array) -> list[float]:
        return [float(self._task.objective(np.array(x)[:, None])[0])]

    def get_bounds(self) -> tuple[Array, Array]:
        return self._task.box.lower, self._task.box.upper


def pagmo_problem(task: PeerTask) -> Any:
    """Return the problem of a task for pagmo, which needs the package pygmo."""
    import pygmo

    return pygmo.problem(_Posed(task))


def _evolve(task: PeerTask, name: str, **options: Any) -> None:
    """Run an algorithm of pagmo."""
    import pygmo

    kind = getattr(pygmo, name)
    algorithm = pygmo.algorithm(kind(gen=_ENDLESS, seed=task.seed, **options))
    posed = pagmo_problem(task)
    size = task.options.get("size", 20)
    population = pygmo.population(posed, size=size, seed=task.seed)
    algorithm.evolve(population)


def cmaes_ipop(task: PeerTask) -> None:
    """Run `cmaes.CMA` from the middle of the bounds, with restarts (IPOP).

    Variables are scaled to [0, 1]. Each restart doubles the population and begins at a
    uniform random point within the bounds.
    """
    from cmaes import CMA

    box, rng = task.box, np.random.default_rng(task.seed)
    if box.dim == 1:
        raise PeerError("cmaes needs at least 2 variables, found 1")
    mean, size = np.full(box.dim, 0.5), task.options.get("size")
    while True:
        search = CMA(
            mean=mean,
            sigma=task.options.get("sigma") or 0.3,
            bounds=np.tile([0.0, 1.0], (box.dim, 1)),
            # Each restart draws other numbers.
            seed=int(rng.integers(2**31)),
            population_size=size,
        )
        while not search.should_stop():
            asked = [search.ask() for _ in range(search.population_size)]
            points = np.stack(asked, axis=1)
            values = task.objective(box.lower[:, None] + box.width[:, None] * points)
            search.tell(list(zip(asked, values.tolist(), strict=True)))
        mean, size = rng.random(box.dim), 2 * search.population_size


def peers_best(run: Callable[[PeerTask], None], task: PeerTask, name: str) -> bool:
    """Run a search of another package; return whether it ended by itself.

    If not, the budget ended it.

    Raises:
        PeerError: If the solver refuses its options.
    """
    try:
        run(task)
    except BudgetSpent:
        return False
    except (ValueError, TypeError, RuntimeError, AssertionError) as error:
        if "BudgetSpent" in str(error):  # As text, through a library's own handler.
            return False
        said = " ".join(str(error).split()) or type(error).__name__
        raise PeerError(f"{name} cannot be run: {said}") from error
    return True


def solve_ocp(made: Built, trial: Trial, meter: Meter) -> bool:
    """Solve a planning problem by `control.optimal.solve_ocp`, from zero controls.

    Returns:
        Whether the solver ended by itself, and not by the budget.

    Raises:
        PeerError: If the problem has other unknowns than controls, if controls must be
            whole numbers, or if the solver refuses an option.
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
    posed = _ControlSystem(shooting, p, at_nodes(problem, flat), meter)
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


class _ControlSystem:
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
        """Return the state at the end of an interval.

        The last entry of x is the number of the interval, and the last entry of the
        returned state that of the next interval.

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
