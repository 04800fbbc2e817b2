"""Search spaces: control sequences, or members of a family of trajectories.

A search knows only a box and an objective. A space gives the box, and converts a point
of it to a start of the polish.

For a differentially flat system whole trajectories follow from a few curves and their
derivatives. A family is such a map

    coefficients c -> states and controls at the nodes,

which satisfies the dynamics and the initial state for all coefficients. So a search in
it does not integrate, and wastes no points on the divergence of single shooting over a
long horizon. Cost and violation of a member are the problem's own at the nodes,

    cost       sum over the checks of dt (L(x_k, u_k) + L(x_k+1, u_k+1)) / 2 + M(x_N)
    violation  path constraints and bounds of the states at every check, terminal
               constraints, bounds of the controls at every node, relative to their
               ranges

The polish starts from a member with its states; its controls are means over the
intervals.

Source: Fliess, Levine, Martin and Rouchon (1995), Flatness and defect of non-linear
systems, International Journal of Control 61.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arguments import checked, of_kind
from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Box,
    Initial,
    SearchResult,
)
from swarmstart.heuristics.laws import first_size_of
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.compiled.backend import CasadiMap
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import (
    BlockObjective,
    Fitness,
    Known,
    Objective,
    started,
)
from swarmstart.ocp.rollout.sampled import check_violation, node_terms
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.rollout.violation import infinite_unless_finite, unless_finite
from swarmstart.ocp.search.settings import SearchSettings, population_of
from swarmstart.ocp.statement.control_shape import control_of, first_of, variables_of
from swarmstart.ocp.statement.decisions import FreeStart, whole, widened
from swarmstart.ocp.statement.problem import OptimalControlProblem

Index = NDArray[np.intp]


def side_by_side(
    problem: OptimalControlProblem, starts: Sequence[Start], x0: Array
) -> tuple[Array, Array]:
    """Return the controls (nu, N, n) and initial decisions (ny, n) of n starts.

    Args:
        problem: A rewritten problem (core).
        starts: Starts, at least one.
        x0: Initial state for starts without one of their own, shape (nx,).
    """
    firsts = [one.states[0] for one in problem.free_starts]
    own = [(x0 if one.x0 is None else one.x0)[firsts] for one in starts]
    return np.dstack([one.controls for one in starts]), np.stack(own, axis=1)


class SearchSpace(Protocol):
    """Search space of a population."""

    @property
    def box(self) -> Box:
        """Box of the points."""

    def objective(self, x0: ArrayLike, known: Known) -> Objective:
        """Return the objective from an initial state: population -> cost, violation."""

    def decoded(self, x: Array, x0: ArrayLike, known: Known) -> Start:
        """Return the start that a point, shape (dim,), represents."""

    def encoded(self, controls: Array, x0: ArrayLike) -> Array:
        """Return the point that represents controls (nu, N) from an initial state.

        Raises:
            InvalidProblemError: If the controls have no point in this space.
        """


class ControlSpace:
    """All control sequences within the bounds; points are ca.vec of (nu, blocks).

    Controls that several members of an ensemble share occur once.

    Attributes:
        box: The box of all control sequences.
    """

    def __init__(self, fitness: Fitness) -> None:
        """Set up the space for the problem's evaluator.

        Raises:
            InvalidProblemError: If a control is unbounded.
        """
        self._fitness = fitness
        self.box = _control_box(fitness)
        problem = fitness.problem
        self._first, self._coordinates = _block_coordinates(problem)

    def objective(self, x0: ArrayLike, known: Known) -> Objective:
        """Return population -> cost and violation; see SearchSpace."""
        if self._fitness.problem.ties_controls:
            return BlockObjective(
                self._fitness.objective(x0, known), self._coordinates, self.box.dim
            )
        return self._fitness.objective(x0, known)

    def decoded(self, x: Array, x0: ArrayLike, known: Known) -> Start:
        """Return the controls, and the start if it is decided; see SearchSpace."""
        del known
        problem = self._fitness.problem
        x = x[self._coordinates]
        inputs = problem.model.nu * problem.intervals
        controls = whole(
            # Not by `unflatten`: there may be no controls.
            x[:inputs].reshape((problem.model.nu, problem.intervals), order="F"),
            problem.integer,
            problem.control_limits,
        )
        if not problem.free_starts:
            return Start(controls)
        return Start(controls, x0=started(problem, x0, x[inputs:]))

    def encoded(self, controls: Array, x0: ArrayLike) -> Array:
        """Return the decision vector of controls; see SearchSpace."""
        decisions = self._fitness.decision(controls, x0)[self._first]
        # The bounds of a search may be narrower than those of the controls.
        return np.clip(decisions, self.box.lower, self.box.upper)


def _block_coordinates(problem: OptimalControlProblem) -> tuple[Index, Index]:
    """Return the decisions of a search, and for each decision the one it follows."""
    labels, more = problem.control_labels, np.arange(len(problem.free_starts))
    first = first_of(labels)
    return (
        np.concatenate([first, labels.size + more]),
        np.concatenate([variables_of(labels), first.size + more]),
    )


def _control_box(fitness: Fitness) -> Box:
    problem = fitness.problem
    if not (problem.model.nu or problem.free_starts):
        raise InvalidProblemError(
            "a population search needs a decision: a control, or a Free start, "
            "parameter or end time; got none"
        )
    lower, upper = problem.search_limits
    starts = [_searched(problem, one) for one in problem.free_starts]
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        raise InvalidProblemError(
            "a population search needs finite bounds on every control, "
            f"got lower {lower} and upper {upper}: "
            "Bounds(search=(lower, upper)) bounds the search alone"
        )
    for one, (least, most) in zip(problem.free_starts, starts, strict=True):
        if not np.isfinite(most - least):
            name = problem.model.state_names[one.states[0]]
            raise InvalidProblemError(
                f"a population search needs finite bounds on what is decided, got "
                f"{name} in [{least:g}, {most:g}]: give its Free both bounds"
            )
    lower, upper = widened((lower, upper), problem.integer)
    first = first_of(problem.control_labels)
    lower, upper = (np.tile(side, problem.intervals)[first] for side in (lower, upper))
    return Box(
        lower=np.append(lower, [least for least, _ in starts]),
        upper=np.append(upper, [most for _, most in starts]),
        # For smooth random sequences, which there are none of without controls.
        per_step=problem.flown_controls or None,
        constant=len(starts) if problem.flown_controls else 0,
    )


def _searched(problem: OptimalControlProblem, one: FreeStart) -> tuple[float, float]:
    """Return the bounds of a decision about the start; a knot has its control's."""
    model = problem.model
    j = control_of(model.state_names[one.states[0]], model.control_names)
    if j is None:
        return one.value.lower, one.value.upper
    lower, upper = problem.search_limits
    return float(lower[j]), float(upper[j])


@checked(
    refused,
    box=of_kind(Box, "a Box"),
    trajectory=of_kind(ca.Function, "a casadi.Function"),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TrajectoryFamily:
    """Family of trajectories given by a few coefficients.

    Attributes:
        box: The box of the coefficients.
        trajectory: (coefficients (dim,), x0 (nx,), parameters (np,)) -> states
            (nx, nodes) and controls (nu, nodes) at the problem's nodes.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u, c, x0 = (ca.SX.sym(name) for name in ("x", "u", "c", "x0"))
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=(x - 1) ** 2 + u**2, bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> t = ca.DM(problem.times).T
        >>> lines = ca.Function("lines", [c, x0, ca.SX(0, 1)], [x0 + c * t, c + 0 * t])
        >>> box = ss.Box(lower=np.array([-2.0]), upper=np.array([2.0]))
        >>> family = ss.TrajectoryFamily(box=box, trajectory=lines)
        >>> [tuple(part.shape) for part in family.trajectory(0.5, 0.0, [])]
        [(1, 5), (1, 5)]
    """

    box: Box
    trajectory: ca.Function


class FamilySpace:
    """Search space of the members of a family; see SearchSpace.

    CasADi evaluates the members. A member contains all its nodes at once, which is too
    much code to compile for the few thousand members that a search evaluates.

    Attributes:
        box: The box of the coefficients.
    """

    def __init__(self, fitness: Fitness, family: TrajectoryFamily) -> None:
        """Combine a problem and a family.

        Args:
            fitness: The problem's evaluator.
            family: The family, on the problem's nodes.

        Raises:
            InvalidProblemError: If the family's shapes are not the problem's.
        """
        problem = fitness.problem
        _require_fit(problem, family)
        self.box = family.box
        self._problem, self._family, self._fitness = problem, family, fitness

    @cached_property
    def _evaluate(self) -> CasadiMap:
        """Cost and violation of members, made at its first use."""
        return CasadiMap(_member_value(self._fitness.shooting, self._family))

    def objective(self, x0: ArrayLike, known: Known) -> Objective:
        """Return population -> cost and violation; see SearchSpace."""
        shared = self._fitness.arguments(x0, known)
        return Objective(self._evaluate.bind(shared), self.box.dim)

    def decoded(self, x: Array, x0: ArrayLike, known: Known) -> Start:
        """Return controls and states of a member; see SearchSpace."""
        states, controls = (
            np.array(part)
            for part in self._family.trajectory(
                x, np.asarray(x0), np.asarray(known.parameters)
            )
        )
        checks, last = self._problem.checks, self._problem.nodes - 1
        # The nodes of each interval, both of its ends included.
        parts = [controls[:, k : k + last : checks] for k in range(checks + 1)]
        lower, upper = (limit[:, None] for limit in self._problem.control_limits)
        return Start(np.clip(np.mean(parts, axis=0), lower, upper), states)

    def encoded(self, controls: Array, x0: ArrayLike) -> Array:
        """Raise: controls need not be those of a member; see SearchSpace."""
        del controls, x0
        raise InvalidProblemError(
            "a search in a family of trajectories takes no guess of controls"
        )


def _member_value(shooting: Shooting, family: TrajectoryFamily) -> ca.Function:
    """Return (coefficients, x0, parameters, signals) -> (cost, violation)."""
    problem = shooting.problem
    model, nodes = problem.model, problem.nodes
    c = ca.SX.sym("c", family.box.dim)
    x0, p = ca.SX.sym("x0", model.nx), ca.SX.sym("p", model.np + problem.automatic)
    flat = ca.SX.sym("signals", problem.ns * nodes)
    signals = ca.reshape(flat, problem.ns, nodes)
    parameters = ca.vertsplit(p, [0, model.np, p.numel()])[0]
    x, u = family.trajectory(c, x0, parameters)
    at_node, at_check = node_terms(problem), check_violation(shooting)
    cost, violation = shooting.terminal(x[:, -1], p, signals[:, -1])
    weights = np.full(nodes, problem.dt / problem.checks)
    weights[[0, -1]] /= 2  # Trapezoidal rule.
    for k in range(nodes):
        spent, broken = at_node(x[:, k], u[:, k], parameters, signals[:, k])
        cost, violation = cost + weights[k] * spent, violation + broken
    for k in range(nodes - 1):
        start, end = ((x[:, j], u[:, j], p, signals[:, j]) for j in (k, k + 1))
        violation += at_check(*start, *end)
    violation += infinite_unless_finite(ca.sum1(ca.vec(x)))
    violation = unless_finite(cost, violation)
    return ca.Function("member", [c, x0, p, flat], ca.cse([cost, violation]))


def _require_fit(problem: OptimalControlProblem, family: TrajectoryFamily) -> None:
    model, nodes = problem.model, problem.nodes
    if problem.free_starts or model.jumps or model.ns:
        raise InvalidProblemError(
            "a family of trajectories needs a start that is given, and a model without "
            "jumps and signals"
        )
    wanted = [family.box.dim, model.nx, model.np, model.nx * nodes, model.nu * nodes]
    f = family.trajectory
    found = [f.numel_in(i) for i in range(f.n_in())]
    found += [f.numel_out(i) for i in range(f.n_out())]
    if found != wanted:
        raise InvalidProblemError(
            "a family must map coefficients, initial state and parameters to states "
            f"and controls at the {nodes} nodes, of {wanted} numbers; got {found}"
        )


def space_of(fitness: Fitness, family: TrajectoryFamily | None) -> SearchSpace:
    """Return the search space of a problem.

    Args:
        fitness: The problem's evaluator.
        family: The family to search; None means control sequences.

    Raises:
        InvalidProblemError: If a control is unbounded and there is no family, or the
            family does not fit the problem.
    """
    if family is None:
        return ControlSpace(fitness)
    return FamilySpace(fitness, family)


def first_population(
    search: SearchSettings,
    space: SearchSpace,
    guess: Array | None,
    first: Sequence[Array],
    x0: ArrayLike,
) -> Initial:
    """Return the first population: candidates, guesses, the rest drawn at random."""
    evaluations = search.budget.evaluations
    population = population_of(search.algorithm, evaluations)
    if population is None:
        raise TypeError("expected a search that has a population")
    size = first_size_of(population, space.box, evaluations)
    given = [space.encoded(controls, x0) for controls in first]
    if guess is not None and search.warm_start != "none":
        # May be negative, which is no copy.
        copies = {"all": size - len(given), "half": size // 2, "one": 1}
        given += [space.encoded(guess, x0)] * copies[search.warm_start]
    if not given:
        return Initial(sampling=search.sampling)
    return Initial(sampling=search.sampling, points=np.stack(given[:size], axis=1))


def points(result: SearchResult) -> list[Array]:
    """Return a search's best point and other basins, each (dim,), the best first."""
    others = [
        basin.x for basin in result.basins if not np.array_equal(basin.x, result.x)
    ]
    return [result.x, *others]
