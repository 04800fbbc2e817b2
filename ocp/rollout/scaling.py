"""Natural sizes of states, controls, cost and constraints, from a problem's numbers.

No absolute number enters a decision, so metres and kilometres give the same answer, and
so do positions measured from here and from the middle of the Earth. T is the horizon,
x0 the initial state, and f the right-hand side. The way of a state is the distance by
which it moves, or has to move, from x0. The size of

    a state       the largest of: the width of its bounds; its way to its target; and,
                  unless it has both bounds, its way to the point at which a cost that
                  is quadratic in it is least, and its way along a guess. If all of
                  these are zero: its way by the motion that is linear about x0, with
                  the controls at their lower, middle and upper values; this motion is
                  followed with the absolute values of the derivatives of f, or, if its
                  way becomes absurdly long, with their signs. If that way is zero too:
                  T max |f_i| around x0, over the range of the sizes known so far; else
                  the size that the rates of other states imply, for state j the least
                  s_i / (T |df_i/dx_j|) of the states i whose size s_i is known. A rate
                  acts for 1 / |df_i/dx_i| if that is shorter than T
    a control     the width of its bounds, or the absolute value of a single bound;
                  without bounds the guess, else the least s_i / (T |df_i/du_j|) of the
                  states i whose size s_i is known
    a row         its limit, but at least a thousandth of the size of its expression;
                  for a limit of zero, the size of the expression: its value at x0, or
                  around x0 if the value at x0 is negligible
    the cost      T |stage cost| + |terminal cost|, each the largest at x0 and around it

An expression in which a state stands alone, as x + y^2, moves with the origin of that
state. Its value at x0 is subtracted from its values and limits. The size of such a row
is the range of its values around x0. If x0 keeps the limit, or the row is an equality,
it is the limit instead, as long as that is between a hundredth of the range and the
range.

A size that the problem gives by name (`scales`) replaces that of the state or control.
A way or a guess counts as zero if it is negligible compared with the sizes from the
dynamics. If the rate of state i is a constant multiple of state j alone, as that of a
position is the speed, the way of j also counts as zero if it is much smaller than the
value of j that moves i by the size of i within T. All sizes are homogeneous: values in
units larger by a power of two give sizes that are larger by exactly that power.
"""

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.expressions import rows_that_depend
from swarmstart.ocp.rollout.violation import SoftRows
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.separation import known_scales

_PARTS = (0.618, -0.382)
"""Moves around the start, relative to the sizes; irregular, to avoid half turns."""
_NEGLIGIBLE = 1e-6
"""Relative size below which a way or a guess is negligible."""
_NEEDED = 0.05
"""Least way that is not negligible of a state that alone drives another one, relative
to the value that moves the other one by its size."""
_ABSURD, _SOON, _TURNS = 1e3, 3, 200
"""Ratio of the way of the linear motion with absolute derivatives to that of its first
_SOON orders, above which the motion is also followed with signs, in _TURNS steps. The
way with signs is taken if it is shorter by the same ratio."""
_LIMIT_SHARE = 1e-3
"""Smallest scale of a nonzero limit, relative to the size of its expression."""
_NEAR_SHARE = 0.01
"""Least limit that is the size of its row, relative to the row's range."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sizes:
    """Natural sizes, all positive.

    Attributes:
        states: Shape (nx,).
        controls: Shape (nu,).
        cost: Size of the whole cost.
        rows: Sizes of the rows of each constraint: path, terminal and soft ones.
        weights: 1 / size of the rows whose scale the problem leaves open, except the
            soft ones.
    """

    states: Array
    controls: Array
    cost: float
    rows: tuple[Array, ...]
    weights: Array


class Sizing:
    """Natural sizes of one problem for any initial state; compiled once."""

    def __init__(self, problem: OptimalControlProblem) -> None:
        """Compile the expressions that are evaluated around the initial state."""
        self._problem = problem
        symbols = [*problem.symbols().values()]
        f = ca.densify(_rate(problem))
        path = [c.rows(c.expression) for c in problem.path_constraints]
        ends = [c.rows(c.expression) for c in problem.terminal_constraints]
        soft = [c.rows(c.expression) for c in problem.soft]
        stage_cost = problem.stage_cost
        if soft:
            stage_cost += SoftRows(problem).rate()
        self._all_rows = (*path, *ends, *soft)
        outputs = [
            f,
            stage_cost + problem.step_cost / problem.dt,
            problem.terminal_cost + problem.initial_cost,
            *[r.values for r in self._all_rows],
        ]
        self._moved = [with_a_state_alone(values, problem) for values in outputs[1:]]
        self._at = ca.Function("at", symbols, [ca.vertcat(*outputs)])
        self._splits = np.cumsum([o.numel() for o in outputs])[:-1]
        self._last: tuple[list[bytes | None], Sizes] | None = None
        slopes = ca.jacobian(f, ca.vertcat(symbols[0], symbols[1]))
        self._slopes = ca.Function("slopes", symbols, [slopes])
        self._drives = _alone(slopes, ca.vertcat(*symbols))
        self._target = _target_function(problem)
        self._ways = _ways_function(problem, np.flatnonzero(self._is_open))
        self._known = [*problem.row_scales(), *map(known_scales, problem.soft)]
        self._hard = len(path) + len(ends)

    def __call__(
        self,
        x0: Array,
        parameters: Array,
        signals: Array,
        guess: ArrayLike | None = None,
        along: Array | None = None,
    ) -> Sizes:
        """Return the sizes for an initial state.

        Args:
            x0: Initial state, shape (nx,).
            parameters: Parameters, shape (np,).
            signals: Signals at the nodes, shape (ns, nodes).
            guess: Controls, shape (nu, N), which give the sizes of unbounded controls.
            along: A guess of the states at the nodes, shape (nx, nodes), which gives
                the sizes of unbounded states.
        """
        if self._first_controls.all():
            guess = None  # Bounds or given sizes suffice.
        given = (x0, parameters, signals, guess, along)
        asked = [v if v is None else np.asarray(v, np.float64).tobytes() for v in given]
        # All polishes from one initial state ask for the same.
        if self._last is None or self._last[0] != asked:
            x0, parameters, signals = (
                np.asarray(one, np.float64)[..., None] for one in given[:3]
            )
            if guess is not None:
                guess = np.asarray(guess, np.float64)[..., None]
            self._last = asked, self.of_all(x0, parameters, signals, guess, along)[0]
        return self._last[1]

    def of_all(
        self,
        x0: Array,
        parameters: Array,
        signals: Array,
        guess: Array | None = None,
        along: Array | None = None,
    ) -> list[Sizes]:
        """Return the sizes for each of M initial states, with data of their own.

        Args:
            x0: Initial states, shape (nx, M).
            parameters: Parameters, shape (np, M).
            signals: Signals at the nodes, shape (ns, nodes, M).
            guess: Controls, shape (nu, N, M), as for one initial state.
            along: As for one initial state, for all of them.
        """
        if self._first_controls.all():
            guess = None  # Bounds or given sizes suffice.
        with np.errstate(over="ignore", invalid="ignore"):  # They give no size.
            return self._found(x0, parameters, signals, guess, along)

    def _found(
        self,
        x0: Array,
        parameters: Array,
        signals: Array,
        guess: Array | None,
        along: Array | None,
    ) -> list[Sizes]:
        first, last = signals[:, 0], signals[:, -1]
        at = self._points(x0, parameters, first)
        states = self._first_states(x0, parameters, first, last)
        if along is not None and np.isfinite(along).all():
            way = np.abs(along - x0).max(axis=1)[:, None]
            states = np.where(self._is_open[:, None], np.maximum(states, way), states)
        controls = np.repeat(self._first_controls[:, None], x0.shape[1], axis=1)
        # A guess of the states shows how large they get; their starts do not.
        share = _NEEDED if along is None else 0.0
        states = self._without_tiny(at, states, controls, None, share)
        if guess is not None:
            _, expected = self._filled(at, states, controls, None)
            guessed = np.abs(guess).max(axis=1, initial=0)
            tiny = guessed < _NEGLIGIBLE * expected
            guess = np.where(tiny[:, None], 0.0, guess)
            controls = np.where((controls > 0) | tiny, controls, guessed)
            states = self._without_tiny(at, states, controls, guess, share)
        filled = self._filled(at, states, controls, guess)
        self._fill_costs(at, *filled, guess)
        states, controls = (np.where(sizes > 0, sizes, 1.0) for sizes in filled)
        for one in self._problem.free_starts:
            together = list(one.states)
            if not self._given[0][together].any():
                # One decision has one size.
                states[together] = states[together].max(axis=0)
        values = self._around(at, states, controls, guess)
        rows, cost = self._rows(values[3:]), self._cost(values)
        weights = [
            1 / size[np.isnan(known)]
            # Soft rows have a price, and no weight in the violation.
            for size, known in zip(rows[: self._hard], self._known, strict=False)
        ]
        every = np.vstack([np.empty((0, x0.shape[1])), *weights])
        return [
            Sizes(
                states=states[:, k],
                controls=controls[:, k],
                cost=float(cost[k]),
                rows=tuple(size[:, k] for size in rows),
                weights=every[:, k],
            )
            for k in range(x0.shape[1])
        ]

    def _points(self, x0: Array, parameters: Array, first: Array) -> "_Points":
        """Return points with their slopes, from arrays with an axis of M."""
        nx, M = x0.shape
        middle = np.repeat(self._middle[:, None], M, axis=1)
        slopes = np.array(self._slopes(x0, middle, parameters, first))
        signed = slopes.reshape(nx, M, -1).transpose(0, 2, 1)
        return _Points(x0, parameters, first, signed)

    def _cost(self, values: list[Array]) -> Array:
        """Return the size of the cost from all outputs around a start, shape (M,)."""
        stage, end = (
            np.nan_to_num(np.abs(v), nan=0, posinf=0).max(axis=(0, 1))
            for v in self._from_the_start(values[1:3])
        )
        cost = self._problem.length * stage + end
        return np.where((cost > 0) & (cost < np.inf), cost, 1.0)

    def _from_the_start(self, costs: list[Array]) -> list[Array]:
        """Return costs, counted from the first value if they move with the origin.

        Args:
            costs: Shape (1, n, M).
        """
        return [
            np.where(
                np.ptp(value, axis=1, keepdims=True) > 0, value - value[:, :1], value
            )
            if moved[0]
            else value
            for value, moved in zip(costs, self._moved[:2], strict=True)
        ]

    def cost_around(
        self, x0: Array, parameters: Array, signals: Array, sizes: Sizes
    ) -> float:
        """Return the size of the cost around an initial state, for given sizes.

        Args:
            x0: Initial state, shape (nx,).
            parameters: Parameters, shape (np,).
            signals: Signals at the start, shape (ns,).
            sizes: Sizes of states and controls.
        """
        given = (x0, parameters, signals, sizes.states, sizes.controls)
        x0, parameters, signals, states, controls = (one[:, None] for one in given)
        at = _Points(x0, parameters, signals, np.empty(0))
        with np.errstate(over="ignore", invalid="ignore"):
            return float(self._cost(self._around(at, states, controls, None))[0])

    def target(self, parameters: Array, signals: Array) -> Array:
        """Return the end value of each state that an equality fixes, else NaN.

        Args:
            parameters: Parameters, shape (np,).
            signals: Signals at the end, shape (ns,).
        """
        return np.array(self._target(parameters, signals)).ravel()

    def _fill_costs(
        self, at: "_Points", states: Array, controls: Array, guess: Array | None
    ) -> None:
        """Give one size to all states that are costs, in place; see risk.py."""
        epigraph = self._problem.epigraph
        if epigraph is None:
            return
        ours = [*epigraph.accrued, *epigraph.states]
        states[ours] = states[ours].max(axis=0)
        known = [np.where(sizes > 0, sizes, 1.0) for sizes in (states, controls)]
        known[0][ours] = states[ours]
        end = np.abs(self._around(at, known[0], known[1], guess)[2])
        largest = np.nan_to_num(end, nan=0, posinf=0).max(axis=(0, 1))
        states[ours] = np.maximum(states[ours], largest)

    def cost_along(
        self, states: Array, controls: Array, parameters: Array, signals: Array
    ) -> float:
        """Return the sum of dt |stage cost| plus |terminal cost| at the nodes.

        If a state stands alone in a cost, as x in x + y^2, the cost's first value is
        subtracted, since it depends on the origin of x.

        Args:
            states: States at the nodes, shape (nx, nodes).
            controls: Controls, shape (nu, N).
            parameters: Parameters, shape (np,).
            signals: Signals at the nodes, shape (ns, nodes).
        """
        problem = self._problem
        x, s = states[:, :: problem.checks], signals[:, :: problem.checks]
        u = np.hstack([controls, controls[:, -1:]])
        p = np.tile(parameters[:, None], (1, u.shape[1]))
        both = np.split(np.array(self._at(x, u, p, s)), self._splits)[1:3]
        both = [cost[:, :, None] for cost in both]
        stage, end = (np.abs(cost[0, :, 0]) for cost in self._from_the_start(both))
        return float(problem.dt * stage[:-1].sum() + end[-1])

    def _first_states(
        self, x0: Array, parameters: Array, first: Array, last: Array
    ) -> Array:
        """Return sizes from bounds and ways to go, (nx, M); 0 if these give none."""
        M = x0.shape[1]
        given, target = (
            self._given[0][:, None],
            np.array(self._target(parameters, last)),
        )
        middle = np.repeat(self._middle[:, None], M, axis=1)
        ways = np.abs(np.array(self._ways(x0, middle, parameters, first, last)))
        ways[~np.isfinite(ways)] = 0.0
        ways = ways.reshape(x0.shape[0], M, -1)
        found = np.maximum(self._widths[:, None], ways.max(axis=2, initial=0))
        found = np.maximum(found, np.abs(np.nan_to_num(target - x0)))
        return np.where(given > 0, given, found)

    @cached_property
    def _given(self) -> list[Array]:
        """Sizes that the problem gives of states and of controls; 0 for the others."""
        problem = self._problem
        return [
            np.array([problem.scales.get(name, 0.0) for name in names])
            for names in (problem.model.state_names, problem.model.control_names)
        ]

    @cached_property
    def _middle(self) -> Array:
        """Middles of the controls' bounds, shape (nu,)."""
        return _middle(*self._problem.control_limits)

    @cached_property
    def _is_open(self) -> NDArray[np.bool_]:
        """Mask of the states that have neither a width nor a given size."""
        return np.asarray((self._widths == 0) & (self._given[0] == 0))

    @cached_property
    def _widths(self) -> Array:
        """Widths of the states' bounds, or of their free start; 0 without bounds."""
        lower, upper = (limits.copy() for limits in self._problem.state_limits)
        for one in self._problem.free_starts:
            for i in one.states:
                if not np.isfinite(upper[i] - lower[i]):
                    lower[i], upper[i] = one.value.lower, one.value.upper
        return np.where(np.isfinite(upper - lower), upper - lower, 0.0)

    @cached_property
    def _first_controls(self) -> Array:
        """Sizes of controls from bounds; 0 if these give none."""
        lower, upper = self._problem.control_limits
        size = np.where(np.isfinite(upper - lower), upper - lower, 0.0)
        bound = np.maximum(
            *(np.where(np.isfinite(b), abs(b), 0) for b in (lower, upper))
        )
        given = self._given[1]
        return np.where(given > 0, given, np.where(size > 0, size, bound))

    def _filled(
        self, at: "_Points", states: Array, controls: Array, guess: Array | None
    ) -> tuple[Array, Array]:
        """Return the sizes, with zeros replaced from the dynamics if possible."""
        key = _key(states, controls, guess)
        if key not in at.filled:
            at.filled[key] = self._newly_filled(at, states, controls, guess)
        return at.filled[key]

    def _newly_filled(
        self, at: "_Points", states: Array, controls: Array, guess: Array | None
    ) -> tuple[Array, Array]:
        nx = len(states)
        # A size passes on to one state a round, so a chain of states needs as many.
        for _ in range(2 * (nx + len(controls))):
            if states.all() and controls.all():
                break
            reach = self._reached(at, states, controls, guess)
            found = np.where(states > 0, states, reach)
            # A column that it leaves as it was takes one step back from known rates.
            both = self._needed(at, np.vstack([states, controls]))
            is_same = (found == states).all(axis=0)
            after = np.where(is_same, both[:nx], found)
            new = np.where(is_same, both[nx:], controls)
            if np.array_equal(after, states) and np.array_equal(new, controls):
                break  # No further size follows.
            states, controls = after, new
        return states, controls

    def _reached(
        self, at: "_Points", states: Array, controls: Array, guess: Array | None
    ) -> Array:
        """Return how far the rates move each state, shape (nx, M).

        By the motion that is linear about the start, over the controls' range: a state
        moves by T |f|, the next one that it drives by T^2 / 2 of it, and so on. What
        that leaves at rest moves by T times the largest rate around the start.
        """
        rates, lasting = self._around(at, states, controls, guess)[0], self._lasting(at)
        far = np.nan_to_num(lasting[:, None] * np.abs(rates), nan=0, posinf=0)
        drives = np.nan_to_num(at.slopes[:, : len(states)], nan=0, posinf=0)
        every = np.arange(len(states))
        drives[every, every] = 0.0
        # The first three are at the start, under three values of the controls.
        soon = step = linear = far[:, :3].max(axis=1)
        for order in range(2, len(states) + 1):
            # One by one: sums in another order for other M would round differently.
            driven = sum(drives[:, j] * step[j] for j in range(len(states)))
            step = lasting / order * driven
            linear = np.maximum(linear, step)
            soon = linear if order <= _SOON else soon
        linear = np.where(np.isfinite(linear), linear, 0.0)
        absurd = (linear > _ABSURD * soon).any(axis=0)
        if absurd.any():
            turned = self._turned(at, rates[:, :3], absurd)
            less = linear[:, absurd] > _ABSURD * turned
            linear[:, absurd] = np.where(less, turned, linear[:, absurd])
        return np.where(linear > 0, linear, far.max(axis=1, initial=0))

    def _turned(self, at: "_Points", rates: Array, chosen: NDArray[np.bool_]) -> Array:
        """Return how far the motion that is linear about the start goes, shape (nx, n).

        Sizes of rates know no signs: they take an oscillation for a growth.

        Args:
            at: The starts.
            rates: f there under three values of the controls, shape (nx, 3, M).
            chosen: Mask of n of the M starts.
        """
        nx = len(at.x0)
        A = np.nan_to_num(at.signed[:, :nx, chosen], nan=0, posinf=0, neginf=0)
        A, f = A.transpose(2, 0, 1), rates[:, :, chosen].transpose(2, 0, 1)
        h, one = self._problem.length / _TURNS, np.eye(nx)
        # The classical Runge-Kutta step of x' = A x + f is x + h M (A x + f).
        M = one + h / 2 * A @ (one + h / 3 * A @ (one + h / 4 * A))
        way = most = np.zeros(f.shape)
        for _ in range(_TURNS):
            way = way + h * M @ (A @ way + f)
            most = np.fmax(most, np.abs(way))
        found, is_number = most.max(axis=2), np.isfinite(way).all(axis=2)
        return np.where(np.isfinite(found) & is_number, found, np.inf).T

    def _without_tiny(
        self,
        at: "_Points",
        direct: Array,
        known: Array,
        guess: Array | None,
        share: float,
    ) -> Array:
        """Return sizes of states, with negligible ones set to 0.

        A way of 1e-300 counts as zero. If state j alone drives state i, the way of j
        also counts as zero if it is far less than the value of j that moves i by its
        size: the speed of a body that turns round is larger in between than the small
        one with which it begins.
        """
        states, controls = self._filled(at, direct, known, guess)
        reach = self._reached(at, states, controls, guess)
        needed, every = (
            self._by_rate(at, states)[:, : len(states)],
            np.arange(len(states)),
        )
        needed[every, every] = np.inf  # Only the other states' needs count.
        need = _least(needed)
        driven = _least(np.where(self._drives[:, :, None], needed, np.inf))
        least = np.maximum(_NEGLIGIBLE * np.maximum(reach, need), share * driven)
        tiny = (direct < least) & self._is_open[:, None]
        return np.where(tiny, 0.0, direct)

    def _lasting(self, at: "_Points") -> Array:
        """Return the time for which a rate moves its state, at most T, shape (nx, M).

        A state that decays soon reaches the point of zero rate, not T |f|.
        """
        T, every = self._problem.length, np.arange(len(at.x0))
        # fmax, so that a slope that is NaN counts as 0.
        return T / np.fmax(1.0, T * at.slopes[every, every])

    def _needed(self, at: "_Points", sizes: Array) -> Array:
        """Return sizes of states and controls, new ones as known rates imply them."""
        needed = self._by_rate(at, sizes[: len(at.x0)])
        least = needed.min(axis=0, initial=np.inf)
        return np.where((sizes > 0) | ~np.isfinite(least), sizes, least)

    def _by_rate(self, at: "_Points", states: Array) -> Array:
        """Return the size of each state and control that each state's rate implies.

        Shape (nx, nx + nu, M), infinity if the rate does not depend on it.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # Zero slopes: inf below.
            needed = states[:, None] / (self._problem.length * at.slopes)
        needed[~((needed > 0) & (needed < np.inf))] = np.inf
        return np.asarray(needed)

    def _around(
        self, at: "_Points", states: Array, controls: Array, guess: Array | None
    ) -> list[Array]:
        """Return all outputs at x0 and around it, each (rows, points, M)."""
        key = _key(states, controls, guess)
        if key not in at.seen:
            at.seen[key] = self._seen_around(at, states, controls, guess)
        return at.seen[key]

    def _seen_around(
        self, at: "_Points", states: Array, controls: Array, guess: Array | None
    ) -> list[Array]:
        M = states.shape[1]
        lower, upper = (one[:, None] for one in self._problem.control_limits)
        middle = np.repeat(self._middle[:, None], M, axis=1)
        if guess is not None:
            free = ~(np.isfinite(lower) & np.isfinite(upper))
            middle = np.where(free, guess[:, 0], middle)
        u = [
            np.where(np.isfinite(bound), bound, middle + sign * controls)
            for bound, sign in ((lower, -1.0), (upper, 1.0))
        ]
        # Moves (nx, points, M): none, one state at a time, all together.
        every, parts = np.arange(len(states)), np.array(_PARTS)
        alone = np.zeros((len(states), len(states), parts.size, M))
        alone[every, every] = states[:, None] * parts[:, None]
        singly = alone.reshape(len(states), -1, M)
        both = np.repeat(states[:, None] * parts[:, None], 3, axis=1)
        moves = [np.zeros((len(states), 3, M)), singly, both]
        x = at.x0[:, None] + np.concatenate(moves, axis=1)
        # A model need not hold beyond its bounds, as the air below the ground.
        least, most = (limits[:, None, None] for limits in self._problem.state_limits)
        start = at.x0[:, None]
        x = np.where((start >= least) & (start <= most), np.clip(x, least, most), x)
        three = np.stack([middle, *u], axis=1)
        still = np.repeat(middle[:, None], singly.shape[1], axis=1)
        v = np.concatenate([three, still, three, three], axis=1)
        n = x.shape[1]
        p, s = (np.repeat(c[:, None], n, axis=1) for c in (at.parameters, at.signals))
        columns = [one.reshape(len(one), n * M) for one in (x, v, p, s)]
        found = np.array(self._at(*columns)).reshape(-1, n, M)
        return np.split(found, self._splits)

    def _rows(self, values: list[Array]) -> tuple[Array, ...]:
        """Return the size of each row, (rows, M), from its expression around starts."""
        rows = []
        for known, row, moved, value in zip(
            self._known, self._all_rows, self._moved[2:], values, strict=True
        ):
            is_moved = moved[:, None]
            origin = np.where(is_moved, value[:, 0], 0.0)
            origin = np.nan_to_num(origin, nan=0, posinf=0, neginf=0)
            # What is not finite counts as the start.
            seen = np.where(np.isfinite(value), value - origin[:, None], 0.0)
            size = np.abs(seen)
            at_start, around = size[:, :3].max(axis=1), size.max(axis=1, initial=0)
            natural = np.where(at_start > _NEGLIGIBLE * around, at_start, around)
            lower, upper = row.lower[:, None] - origin, row.upper[:, None] - origin
            limit, reach = _largest(lower, upper), np.ptp(seen, axis=1)
            way = np.where(reach > 0, np.minimum(limit, reach), limit)
            # From outside a limit, or beside it, the way says nothing of the path.
            counts = (lower <= 0) & (upper >= 0) | (lower == upper)
            counts &= way > _NEAR_SHARE * reach
            found = np.where(
                is_moved,
                np.where(counts, way, reach),
                np.where(limit > 0, np.maximum(limit, _LIMIT_SHARE * natural), natural),
            )
            found = np.where(found > 0, found, 1.0)
            rows.append(np.where(np.isnan(known)[:, None], found, known[:, None]))
        return tuple(rows)


@dataclass(frozen=True, eq=False)
class _Points:
    """M points to evaluate around: state, parameters, signals, and df / d(x, u).

    Each has a last axis of M. Results are kept, since the same is often asked twice.
    """

    x0: Array
    parameters: Array
    signals: Array
    signed: Array
    seen: dict[bytes, list[Array]] = field(default_factory=dict)
    filled: dict[bytes, tuple[Array, Array]] = field(default_factory=dict)

    @cached_property
    def slopes(self) -> Array:
        """|df / d(x, u)|."""
        return np.abs(self.signed)


def _key(states: Array, controls: Array, guess: Array | None) -> bytes:
    """Return what a result depends on, for points and a guess that stay the same."""
    return states.tobytes() + controls.tobytes() + bytes([guess is None])


def _least(needed: Array) -> Array:
    """Return the least of each column; 0 without one."""
    least = needed.min(axis=0, initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)


def _largest(lower: Array, upper: Array) -> Array:
    """Return the larger one of the finite limits of each row; 0 without any."""
    return np.maximum(
        *(np.where(np.isfinite(b), np.abs(b), 0.0) for b in (lower, upper))
    )


def with_a_state_alone(
    column: ca.SX, problem: OptimalControlProblem
) -> NDArray[np.bool_]:
    """Return a mask of the rows in which a state stands alone, with a constant factor.

    Such a row moves with the origin of that state. A state that does not move, such as
    a decided parameter or end time, has no origin of its own.
    """
    x, u = problem.model.states, problem.model.controls
    moving = set(_rate(problem).sparsity().row())
    slopes = ca.sparsify(ca.jacobian(column, x))
    rows, columns = map(
        np.array, (slopes.sparsity().row(), slopes.sparsity().get_col())
    )
    chosen = _constant(slopes.nz[:], ca.vertcat(x, u))
    alone = [rows[place] for place in chosen if columns[place] in moving]
    return np.isin(np.arange(column.numel()), alone)


def _constant(entries: ca.SX, symbols: ca.SX) -> NDArray[np.intp]:
    """Return the numbers of the entries that depend on none of some symbols."""
    varying = rows_that_depend(entries, symbols)
    return np.setdiff1d(np.arange(entries.numel()), varying)


def _alone(slopes: ca.SX, symbols: ca.SX) -> NDArray[np.bool_]:
    """Return a mask of the states that alone drive a rate, by a constant factor.

    Args:
        slopes: Of the rates by states and controls, shape (nx, nx + nu).
        symbols: What they depend on.
    """
    slopes = ca.sparsify(slopes)
    rows = np.array(slopes.sparsity().row(), dtype=int)
    columns = np.array(slopes.sparsity().get_col(), dtype=int)
    mask = np.zeros(slopes.shape, dtype=np.bool_)
    for place in _constant(slopes.nz[:], symbols):
        mask[rows[place], columns[place]] = np.count_nonzero(rows == rows[place]) == 1
    return mask[:, : slopes.shape[0]]


def _rate(problem: OptimalControlProblem) -> ca.SX:
    """Return the rates of the states, with the change at an interval's end added."""
    model = problem.model
    if not model.jumps:
        return ca.sparsify(model.ode)
    return ca.sparsify(model.ode + (model.next_state - model.states) / problem.dt)


def _middle(lower: Array, upper: Array) -> Array:
    """Return the middle of bounds; if one is infinite, the value nearest to zero."""
    with np.errstate(invalid="ignore"):
        middle = lower + (upper - lower) / 2
    nearest = np.clip(np.zeros_like(lower), lower, upper)
    return np.where(np.isfinite(middle), middle, nearest)


def _target_function(problem: OptimalControlProblem) -> ca.Function:
    """Return (p, s) -> the end state wherever an equality fixes it, else NaN."""
    x, p, s = problem.model.states, problem.model.parameters, problem.signals
    target = ca.SX(np.full(problem.model.nx, np.nan))
    for constraint in problem.terminal_constraints:
        rows = constraint.rows(constraint.expression)
        slopes = ca.jacobian(rows.values, x)
        offset = ca.substitute(rows.values, x, ca.SX.zeros(x.numel()))
        for i in np.flatnonzero(rows.lower == rows.upper):
            slope = ca.sparsify(slopes[int(i), :])
            # One state alone and linear: such a row fixes it.
            if slope.nnz() == 1 and slope.nz[0].is_constant():
                j = slope.sparsity().get_col()[0]
                target[j] = (float(rows.lower[i]) - offset[int(i)]) / slope.nz[0]
    return ca.Function("target", [p, s], [ca.densify(target)])


def _ways_function(
    problem: OptimalControlProblem, chosen: NDArray[np.intp]
) -> ca.Function:
    """Return (x, u, p, s first, s last) -> ways to where quadratic costs are least.

    Shape (nx, costs), 0 where a cost is not quadratic in that state, all others being
    constant. A row that is limited at the end counts as a cost.

    Args:
        problem: The problem.
        chosen: States that are asked for.
    """
    model = problem.model
    x, u, p, first = problem.symbols().values()
    last = ca.SX.sym("s", problem.ns)
    own = x[chosen.tolist()] if chosen.size else ca.SX(0, 1)
    ends = [problem.terminal_cost]
    for constraint in problem.terminal_constraints:
        ends += ca.vertsplit(constraint.rows(constraint.expression).values)
    ends = [ca.substitute(end, first, last) for end in ends] if problem.ns else ends
    ways = ca.SX(model.nx, 1 + len(ends))
    for column, cost in enumerate([problem.stage_cost, *ends]):
        hessian, slope = ca.hessian(cost, own)
        curved = ca.sparsify(ca.diag(hessian))
        rows, factors = curved.sparsity().row(), curved.nz[:]
        for place in _constant(factors, ca.vertcat(x, u)).tolist():
            row = rows[place]
            ways[int(chosen[row]), column] = slope[row] / factors[place]
    return ca.Function("ways", [x, u, p, first, last], [ca.densify(ways)])
