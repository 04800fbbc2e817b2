"""Cost and violation of a whole population of control sequences.

A decision vector is ca.vec of the controls (nu, N), interval after interval, followed
by the decisions about the start: one number for each of `problem.free_starts`. For a
single control sequence, these numbers are entries of the initial state.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    choice,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.machine_code import Pointers, compiling
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.common.limits import shaped
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.compiled.backend import (
    BatchEvaluator,
    BoundEvaluator,
    CasadiMap,
    chosen_backend,
    evaluator,
)
from swarmstart.ocp.compiled.simd import Ticking, compile_rollout
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS, Precision
from swarmstart.ocp.integration.rodas import FIRST, MOST_TICKS
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import Lowered
from swarmstart.ocp.statement.rewrites.changed import meaning_of_known, signal_rows
from swarmstart.ocp.statement.rewrites.counted_from import from_near


class Objective:
    """Cost and violation of populations from one initial state, as a function."""

    def __init__(self, outputs: BoundEvaluator, dim: int) -> None:
        """Wrap a rollout with fixed state, parameters and signals.

        Args:
            outputs: Population -> cost and violation, (2, size).
            dim: Number of variables of an individual, nu * N.
        """
        self._outputs = outputs
        self._dim = dim

    def __call__(self, population: Array) -> tuple[Array, Array]:
        """Return cost and violation, each (size,), of a population (dim, size).

        Raises:
            InvalidProblemError: If the population has another shape.
        """
        if population.ndim != 2 or population.shape[0] != self._dim:  # noqa: PLR2004
            raise InvalidProblemError(
                f"a population must have shape ({self._dim}, size), "
                f"got {population.shape}"
            )
        values = self._outputs(population)
        return values[0], values[1]  # Unpacking takes three times as long.

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        """Bind the objective to buffers; see `heuristics.CompiledObjective`."""
        return self._outputs.attach(asked, (cost, violation))


class BlockObjective(Objective):
    """Objective in fewer variables, each of which stands for several decisions."""

    def __init__(self, every: Objective, places: NDArray[np.intp], dim: int) -> None:
        """Wrap the objective of all decisions.

        Args:
            every: The objective.
            places: Index of the variable for each decision.
            dim: Number of variables.
        """
        super().__init__(every._outputs, dim)
        self._places = places

    def __call__(self, population: Array) -> tuple[Array, Array]:
        """Return cost and violation, each (size,), of a population (dim, size)."""
        values = self._outputs(np.ascontiguousarray(population[self._places]))
        return values[0], values[1]

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        """Return None: only the call from Python is possible."""
        del asked, cost, violation
        return None


@checked(
    refused,
    parameters=reals(),
    signals=reals(),
    time=a_number(),
    previous=optional(reals()),
)
class Known(NamedTuple):
    """Data that a planning problem needs besides its initial state.

    Attributes:
        parameters: Values of the parameters that are not decided, shape (np,).
        signals: Values of the signals at the nodes, shape (ns, nodes).
        time: Time at the start of the horizon [s].
        previous: Control of the interval before the horizon, shape (nu,). For a delay,
            controls of several intervals before, the latest last, shape (nu, k): the
            first column also stands for all earlier intervals, and controls older than
            the delay are ignored. None: the allowed value nearest to zero.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u, k = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("k")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=k * u, parameters=k), horizon=1.0,
        ...     intervals=5, stage_cost=u**2, terminal=[(x, 1)],
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> known = ss.Known(parameters=[2.0])
        >>> found = ss.solve(problem, [0.0], known=known, search=None, lanes=0, seed=0)
        >>> round(found.cost, 4)
        0.25
    """

    parameters: ArrayLike = ()
    signals: ArrayLike = ()
    time: float = 0.0
    previous: ArrayLike | None = None


NOTHING = Known()
KNOWN = of_kind(Known, "a Known")

LEAST_COST, MOST_COST = 1e-4, 1e3
"""Range of the size of a cost along a trajectory, relative to its natural size."""
LEAST_STATE = 1e-8
"""Least size of a state of a stiff problem, relative to its natural size."""


@checked(
    refused,
    problem=of_kind(OptimalControlProblem | Shooting, "an OptimalControlProblem"),
    backend=optional(text()),
    precision=choice(FORMATS),
    threads=a_count(least=1),
)
class Fitness(Called):
    """Evaluator of one problem, compiled once when needed, for any initial state.

    Attributes:
        problem: The problem.
        shooting: Compiled functions of the problem.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-2, 2)), terminal=[x - 1],
        ... )
        >>> fitness = ss.Fitness(problem, backend="casadi")
        >>> objective = fitness.objective([0.0])
        >>> cost, violation = objective(np.array([[0.0, 1.0]] * 4))
        >>> print(cost, violation > 0)
        [0. 1.] [ True False]
    """

    def __init__(
        self,
        problem: OptimalControlProblem | Shooting,
        *,
        backend: str | None = None,
        precision: Precision = "double",
        threads: int = 1,
    ) -> None:
        """Keep a problem; its rollout is compiled at its first use.

        Args:
            problem: The problem, or its compiled functions.
            backend: Backend that evaluates populations: "llvm" (machine code), "casadi"
                or "auto"; None means SWARMSTART_BACKEND if it is set, else "auto".
            precision: Precision of the machine code's arithmetic, as in
                `compile_batch`. "single" is enough for a first look at many points, not
                for constraints to 1e-6.
            threads: Largest number of threads that share a population in machine code.

        Raises:
            InvalidProblemError: If the backend or the precision is unknown, or
                `threads` is not a positive whole number.
        """
        self.shooting = shooting_of(problem)
        self.problem = self.shooting.problem
        self._chosen = chosen_backend(backend)
        self._precision, self._threads = precision, threads

    @cached_property
    def arguments(self) -> Arguments:
        """Arguments that all individuals share."""
        return Arguments(self.shooting)

    @cached_property
    def _evaluate(self) -> BatchEvaluator:
        """The rollout of populations, compiled at its first use."""
        shooting, problem = self.shooting, self.problem
        decided = problem.start_decisions
        with compiling():  # During planning.
            return evaluator(
                lambda: compile_rollout(
                    shooting.stage_without_path,
                    shooting.terminal,
                    intervals=problem.intervals,
                    signals_per_interval=problem.ns * problem.checks,
                    decided=tuple(map(decided.get, range(problem.model.nx))),
                    begin=shooting.begin if shooting.has_begin else None,
                    ticking=_ticking(shooting, self._precision),
                    precision=self._precision,
                    threads=self._threads,
                ),
                lambda: CasadiMap(shooting.rollout),
                self._chosen,
            )

    @property
    def backend(self) -> str:
        """Name of the backend that evaluates populations."""
        return self._evaluate.backend

    def prepare(self) -> None:
        """Build and compile all functions now, not at their first use."""
        # Reading an attribute makes what it needs.
        _ = self.arguments, self.backend, self.shooting.trajectory

    @checked(refused, x0=reals(), known=KNOWN)
    def objective(self, x0: ArrayLike, known: Known = NOTHING) -> Objective:
        """Return a function: population (decisions, size) -> cost, violation (size,).

        Args:
            x0: Initial state, shape (nx,); copied.
            known: Parameters and signals; copied.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or x0 is not finite.
        """
        bound = self._evaluate.bind(self.arguments(x0, known))
        return Objective(bound, self.problem.decisions)

    @checked(refused, controls=reals(), x0=reals(), known=KNOWN)
    def value(
        self, controls: Array, x0: ArrayLike, known: Known = NOTHING
    ) -> tuple[float, float]:
        """Return cost and violation of one control sequence.

        Args:
            controls: Controls, shape (nu, N).
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
        """
        objective = self.objective(x0, known)
        cost, violation = objective(self.decision(controls, x0)[:, None])
        return float(cost[0]), float(violation[0])

    @checked(refused, controls=reals(), x0=reals(), known=KNOWN)
    def states(self, controls: Array, x0: ArrayLike, known: Known = NOTHING) -> Array:
        """Return the states at the nodes, shape (nx, nodes).

        Args:
            controls: Controls, shape (nu, N).
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
        """
        return self.followed(controls, x0, known)[0]

    @checked(refused, controls=reals(), x0=reals(), known=KNOWN)
    def followed(
        self, controls: Array, x0: ArrayLike, known: Known = NOTHING
    ) -> tuple[Array, float]:
        """Return the states at the nodes, and the largest scaled excess at the start.

        The excess is of state bounds and of path constraints without controls, relative
        to their scales; 0 if the start keeps them.

        Args:
            controls: Controls, shape (nu, N).
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
        """
        shared = self.arguments(x0, known)
        decision = self.decision(controls, x0)
        states, outside = self.shooting.trajectory(decision, *shared)
        return np.array(states), float(outside)

    @checked(refused, x0=reals(), states=reals(), known=KNOWN)
    def with_threshold(
        self, x0: ArrayLike, states: Array, known: Known
    ) -> tuple[ArrayLike, Array]:
        """Return start and states with values of the decisions that make a risk smooth.

        Such a risk combines the costs of an ensemble's members with kinks, as their
        maximum does. For any other problem nothing is changed.

        Args:
            x0: Initial state, shape (nx,).
            states: At the nodes, shape (nx, nodes).
            known: Values of the parameters and signals.
        """
        epigraph = self.problem.epigraph
        if epigraph is None:
            return x0, states
        x, p, flat = shared_arguments(self.problem, x0, known)
        at_end = self._member_costs(
            states[:, -1], p, flat[flat.size - self.problem.ns :]
        )
        values = epigraph.values(np.array(at_end).ravel())
        states = np.array(states)  # A copy: the caller keeps its own.
        x[epigraph.states], states[epigraph.states] = values, values[:, None]
        return x, states

    @cached_property
    def _member_costs(self) -> ca.Function:
        """Function (x, p, s) at the end -> the members' costs."""
        problem = self.problem
        symbols, epigraph = problem.symbols(), problem.epigraph
        return ca.Function(
            "member_costs",
            [symbols["states"], symbols["parameters"], symbols["signals"]],
            [epigraph.costs if epigraph else ca.SX(0, 1)],
        )

    @checked(refused, controls=reals(), x0=reals())
    def decision(self, controls: Array, x0: ArrayLike) -> Array:
        """Return the decision vector of controls, which need not be finite.

        Args:
            controls: Controls, shape (nu, N).
            x0: Initial state, shape (nx,), including the decisions about the start.
        """
        shape = (self.problem.model.nu, self.problem.intervals)
        if np.shape(controls) != shape:
            raise InvalidProblemError(
                f"controls must have shape {shape}, got {np.shape(controls)}"
            )
        starts = self.problem.free_starts
        if not starts:
            return flatten(controls)
        state = np.asarray(x0, dtype=np.float64).ravel()
        return np.concatenate(
            [flatten(controls), [state[one.states[0]] for one in starts]]
        )


_SINGLE = 1e-3
"""Smallest tolerance of steps that are computed in single precision."""


def _ticking(shooting: Shooting, precision: Precision) -> Ticking | None:
    """Return the adaptive steps of an interval; None if its function has its steps."""
    problem = shooting.problem
    if not problem.is_adaptive:
        return None
    tolerance = problem.integrator_tolerance or 0.0
    if precision == "single":
        tolerance = max(tolerance, _SINGLE)
    return Ticking(
        tick=shooting.tick_to(tolerance),
        checks=problem.checks,
        first=FIRST / problem.substeps,
        most=MOST_TICKS,
    )


def started(problem: OptimalControlProblem, x0: ArrayLike, decided: Array) -> Array:
    """Return an initial state with the decisions about it.

    Args:
        problem: The problem.
        x0: Initial state, shape (nx,).
        decided: One number for each of the problem's free starts.
    """
    state = np.array(x0, dtype=np.float64).ravel()
    for one, value in zip(problem.free_starts, decided, strict=True):
        state[list(one.states)] = value
    return state


class Arguments:
    """Arguments of a rollout that all individuals share: all but the decisions."""

    def __init__(self, shooting: Shooting) -> None:
        """Keep the functions of a problem."""
        self._problem, self._sizing = shooting.problem, shooting.sizing
        self._shooting = shooting
        self._last: tuple[bytes, Array] | None = None

    def __call__(self, x0: ArrayLike, known: Known) -> tuple[Array, Array, Array]:
        """Return x0, parameters with the rows' weights, and ca.vec of the signals.

        The weights are 1 / scale of the rows whose scale the problem leaves open; with
        step size control, sizes of states and integrals follow. All are copies.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value is not
                finite.
        """
        state, parameters, signals = shared_arguments(self._problem, x0, known)
        if not self._problem.automatic:
            return state, parameters, signals
        asked = b"".join(values.tobytes() for values in (state, parameters, signals))
        # One planning problem asks for the same sizes many times, and they take long.
        if self._last is None or self._last[0] != asked:
            sizes = self.sizes(state, known)
            self._last = asked, self._shooting.automatic(sizes)
        return state, np.concatenate([parameters, self._last[1]]), signals

    def sizes(
        self,
        x0: ArrayLike,
        known: Known,
        guess: Array | None = None,
        states: Array | None = None,
    ) -> Sizes:
        """Return the natural sizes for an initial state; see scaling.py."""
        problem = self._problem
        state, parameters, flat = shared_arguments(problem, x0, known)
        return self._sizing(state, parameters, at_nodes(problem, flat), guess, states)

    def sizes_along(
        self,
        controls: Array,
        states: Array,
        x0: ArrayLike,
        known: Known,
        *,
        is_guess: bool = False,
    ) -> Sizes:
        """Return the natural sizes, with the cost's size along a trajectory.

        For a stiff problem the sizes of the states are adapted as well: fast states may
        stay far below the size that their rates at the start suggest.

        Args:
            controls: Controls, shape (nu, N).
            states: States at the nodes, shape (nx, nodes).
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
            is_guess: Whether the natural size of a state without bounds is its range in
                these states.
        """
        problem = self._problem
        start, parameters, flat = shared_arguments(problem, x0, known)
        signals = at_nodes(problem, flat)
        natural = self.sizes(x0, known, controls, states if is_guess else None)
        if problem.integrator == "stiff" and np.isfinite(states).all():
            reach = np.abs(states - start[:, None]).max(axis=1)
            floor = LEAST_STATE * natural.states
            names = problem.model.state_names
            # Sizes that are decisions' or the user's are not adapted.
            kept = [i for one in problem.nlp_starts for i in one.states]
            kept += [names.index(name) for name in problem.scales if name in names]
            floor[kept] = natural.states[kept]
            natural = replace(natural, states=np.clip(reach, floor, natural.states))
            # The cost was measured within the old sizes of the states.
            cost = self._sizing.cost_around(start, parameters, signals[:, 0], natural)
            natural = replace(natural, cost=cost)
        along = self._sizing.cost_along(states, controls, parameters, signals)
        if not np.isfinite(along):
            return natural
        least, most = LEAST_COST * natural.cost, MOST_COST * natural.cost
        return replace(natural, cost=min(max(along, least), most))


def shared_arguments(
    problem: OptimalControlProblem, x0: ArrayLike, known: Known
) -> tuple[Array, Array, Array]:
    """Return x0, parameters and ca.vec of the signals, validated and copied.

    Raises:
        InvalidProblemError: If a shape is not the problem's, or a value is not finite.
    """
    return (
        shaped("x0", x0, (problem.model.nx,)),
        shaped(
            "parameters",
            known.parameters,
            (problem.model.np,),
            lambda: meaning_of_known(problem, "parameters"),
        ),
        flatten(signal_rows(problem, known.signals)),
    )


def core_known(lowered: Lowered, known: Known) -> Known:
    """Convert the known data of a stated problem to those of its core.

    Args:
        lowered: The problem as stated and as rewritten (core).
        known: The known data of the stated problem.
    """
    return Known(*lowered.known(known.parameters, known.signals, known.time))


def from_near_start(
    shooting: Shooting, x0: ArrayLike, known: Known
) -> OptimalControlProblem:
    """Return a stated problem whose large states are shifted by values near a start.

    A state is large if its start is far from zero, compared with its natural size. A
    problem with phases is returned unchanged.

    Args:
        shooting: Functions of the problem.
        x0: Initial state of the stated problem, shape (nx,).
        known: Known data of the stated problem.

    Raises:
        InvalidProblemError: If a shape is not the problem's.
    """
    stated, lowered = shooting.stated, shooting.lowered
    if stated.clock:  # Phases count their states themselves.
        return stated
    start = lowered.start(x0, known.previous)
    sizes = Arguments(shooting).sizes(start, core_known(lowered, known))
    nx = stated.model.nx
    return from_near(stated, start[:nx], sizes.states[:nx])


def stated_known(
    lowered: Lowered, x0: Array, parameters: Array, signals: Array
) -> Known:
    """Return a stated problem's known data, including the parameters it decides."""
    model, given = lowered.stated.model, lowered.known_parameters
    row = lowered.time_row
    decided = lowered.decided_parameters(x0)
    names = symbol_names(model.parameters)
    values = np.array([decided.get(name, np.nan) for name in names])
    values[given] = parameters[: len(given)]
    if row is None:
        return Known(values, signals)
    without_tau = np.delete(signals, row, axis=0)
    return Known(values, without_tau, time=float(parameters[-1]))


def at_nodes(problem: OptimalControlProblem, flat: Array) -> Array:
    """Return the signals at the nodes, shape (ns, nodes), from ca.vec of them.

    Args:
        problem: The problem.
        flat: Signals, shape (ns * nodes,); or (ns * nodes, n), for which the result is
            (ns, nodes, n).
    """
    return flat.reshape((problem.ns, problem.nodes, *flat.shape[1:]), order="F")


def replay(
    problem: OptimalControlProblem | Shooting,
    controls: Array,
    x0: ArrayLike,
    known: Known = NOTHING,
    *,
    ends: Array | None = None,
) -> tuple[Array, float, float]:
    """Return states (nx, nodes), cost and violation of one control sequence.

    The function of one interval is called N times. This suits a single evaluation of a
    problem, for which compiling the rollout would take longer than it saves.

    Args:
        problem: The problem, or its compiled functions.
        controls: Controls, shape (nu, N).
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        ends: States between the intervals, shape (nx, N + 1), from which each interval
            begins anew; the distances from the end of one interval to the start of the
            next, relative to the states' sizes, count in the violation. None: each
            interval begins where the last one ends.
    """
    shooting = shooting_of(problem)
    problem = shooting.problem
    x, p, flat = Arguments(shooting)(x0, known)
    signals, checks = at_nodes(problem, flat), problem.checks
    interval, states = shooting.stage, [x[:, None]]
    cost, violation = map(float, shooting.begin(x, p, signals[:, 0]))
    sizes = None if ends is None else Arguments(shooting).sizes(x0, known).states
    for k in range(problem.intervals):
        nodes = signals[:, k * checks : (k + 1) * checks + 1]
        begin = states[-1][:, -1]
        if ends is not None and sizes is not None:
            violation += float((np.abs(begin - ends[:, k]) / sizes).sum())
            begin = ends[:, k]
        after, spent, broken = interval(begin, controls[:, k], p, nodes)
        states.append(np.array(after))
        cost, violation = cost + float(spent), violation + float(broken)
    end = shooting.terminal(states[-1][:, -1], p, signals[:, -1])
    cost, violation = cost + float(end[0]), violation + float(end[1])
    if not np.isfinite([cost, violation]).all():  # As in a rollout (violation.py).
        violation = np.inf
    return np.hstack(states), cost, violation


def flatten(sequence: Array) -> Array:
    """Return ca.vec of an array (rows, columns): column after column."""
    return np.asarray(sequence, dtype=np.float64).reshape(-1, order="F")


def unflatten(vector: Array, rows: int) -> Array:
    """Return the array (rows, columns) that `flatten` made into a vector; a copy."""
    return np.array(vector, dtype=np.float64).reshape((rows, -1), order="F")


def replayed(
    stated: OptimalControlProblem, controls: Array, x0: ArrayLike, known: Known
) -> Array:
    """Return the states of the core of a stated problem at its nodes, (nx, nodes).

    The states of the stated problem come first.

    Args:
        stated: The problem as the user stated it.
        controls: Controls of the core, shape (nu, N).
        x0: Initial state of the stated problem.
        known: Known data of the stated problem.
    """
    shooting = shooting_of(stated)
    start = shooting.lowered.start(x0, known.previous)
    core = core_known(shooting.lowered, known)
    states, _, _ = replay(shooting, controls, start, core)
    return states
