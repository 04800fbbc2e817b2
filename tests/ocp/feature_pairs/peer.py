"""The same problem by multiple shooting in CasADi's Opti, written a second time.

Nothing is shared with the library but the coefficients of RODAS4: time is in seconds,
a free end time stretches the steps, decided parameters are variables of Opti, tables
are CasADi's interpolants, and linear equations are solved by `casadi.solve`.
"""

from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.integration.rodas import GAMMA, IN_TIME, TIMES, A, C
from swarmstart.tests.ocp.feature_pairs.stated import Limited, Stated

FAST = 4.0 ** np.arange(5)
"""Parts of the first stiff step of an interval."""


class Point(NamedTuple):
    """A decided point: controls, start, parameters and end time.

    Attributes:
        controls: Shape (nu, N).
        x0: State at the start, shape (nx,).
        decided: Values of the decided parameters.
        length: End time [s].
    """

    controls: Array
    x0: Array
    decided: Array
    length: float


class _Held:
    """Rows that hold at points, with their limits."""

    def __init__(self, peer: "Peer") -> None:
        self._peer = peer
        self.values: list[Any] = []
        self.limits: list[Limited] = []

    def add(self, chosen: list[Limited], at: tuple[Any, ...]) -> None:
        """Hold some rows at a point."""
        for one in chosen:
            self.limits.append(one)
            self.values.append(self._peer.function(one.expression)(*at))


class Peer:
    """A stated problem, in Opti and in numbers."""

    def __init__(self, stated: Stated) -> None:
        """Take the problem."""
        self.stated = stated
        self.nx, self.nu = stated.states.numel(), stated.controls.numel()
        self._symbols = [
            stated.states, stated.controls, stated.all_parameters, stated.signals,
            stated.time, stated.before,
        ]  # fmt: skip
        self.kind = ca.MX if stated.tables else ca.SX

    def function(self, expression: ca.SX) -> ca.Function:
        """Return (x, u, p, s, t, before) -> an expression, tables and z put in."""
        stated = self.stated
        if stated.solved is not None:
            expression = ca.substitute(expression, stated.solved[0], stated.solved[2])
        if not stated.tables:
            return ca.Function("f", self._symbols, [expression])
        entries = ca.vertcat(*[one.symbol for one in stated.tables])
        inner = ca.Function("f", [*self._symbols, entries], [expression])
        at = [ca.MX.sym("a", *s.shape) for s in self._symbols]
        values = []
        for one in stated.tables:
            argument = ca.Function("a", self._symbols, [ca.vertcat(*one.arguments)])
            look_up = ca.interpolant(
                "table", one.method, [list(g) for g in one.grid],
                one.values.ravel(order="F"),
            )  # fmt: skip
            values.append(look_up(argument(*at)))
        return ca.Function("f", at, [inner(*at, ca.vertcat(*values))])

    @cached_property
    def rates(self) -> tuple[ca.Function, ca.Function]:
        """(x, u, p, s, t, before) -> x', and -> stage cost."""
        stated = self.stated
        ode = stated.ode if stated.ode.numel() else ca.SX.zeros(self.nx)
        return self.function(ode), self.function(stated.stage)

    def late(self, controls: Any, k: int) -> Any:
        """Return the controls that act in interval k: the last one may be delayed."""
        then, d = controls[:, k], self.stated.delay
        if not d:
            return then
        last = controls[-1, k - d] if k >= d else float(self.stated.previous[-1])
        return ca.vertcat(*[then[j] for j in range(self.nu - 1)], last)

    def _advanced(self, x: Any, known: tuple[Any, ...], h: Any, first: bool) -> Any:
        """Return (x, integrated cost) after one check of length h."""
        (u, late), p, before, s0, s1, t0 = known
        ode, stage = self.rates
        m, y = self.stated.substeps, ca.vertcat(x, 0)

        def rate(part: Any, at: Any) -> Any:
            s = s0 + part * (s1 - s0)
            t = t0 + part * h if self.stated.time.numel() else t0
            there = p, s, t, before
            return ca.vertcat(ode(at[:-1], late, *there), stage(at[:-1], u, *there))

        spans = [(k / m, 1 / m) for k in range(m)]
        if self.stated.integrator == "stiff" and first:
            lengths = FAST / FAST.sum() / m
            begins = np.concatenate([[0], np.cumsum(lengths)[:-1]])
            spans = [*zip(begins, lengths, strict=True), *spans[1:]]
        step = getattr(self, f"_{self.stated.integrator}")
        for begin, length in spans:
            y = step(rate, y, float(begin), float(length), h)
        return y

    @staticmethod
    def _euler(rate: Any, y: Any, begin: float, length: float, h: Any) -> Any:
        return y + length * h * rate(begin, y)

    @staticmethod
    def _rk4(rate: Any, y: Any, begin: float, length: float, h: Any) -> Any:
        k1 = rate(begin, y)
        k2 = rate(begin + length / 2, y + length * h / 2 * k1)
        k3 = rate(begin + length / 2, y + length * h / 2 * k2)
        k4 = rate(begin + length, y + length * h * k3)
        return y + length * h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def _stiff(self, rate: Any, y: Any, begin: float, length: float, h: Any) -> Any:
        """Return y after a step of RODAS4 (Hairer and Wanner, rodas.f)."""
        at, part = self.kind.sym("at", y.numel()), self.kind.sym("part")
        value = rate(part, at)
        slopes: Any = [ca.jacobian(value, at), ca.jacobian(value, part)]
        # The derivative by time, of a time in parts of the check.
        put: tuple[Any, Any] = [at, part], [y, self.kind(begin)]
        J, in_part = ca.substitute(slopes, *put)
        step = length * h
        W = ca.DM.eye(y.numel()) - GAMMA * step * J
        k: list[Any] = []
        for stage in range(6):
            here = y + sum(
                (a * b for a, b in zip(A[min(stage, 4)], k, strict=False)), 0 * y
            )
            here += k[4] if stage == 5 else 0
            right = GAMMA * step * rate(begin + TIMES[stage] * length, here)
            right += GAMMA * sum(
                (c * b for c, b in zip(C[stage], k, strict=False)), 0 * y
            )
            right += GAMMA * IN_TIME[stage] * step * length * in_part
            k.append(ca.solve(ca.densify(W), ca.densify(right)))
        return here + k[5]

    def depends(self, one: Limited, on: ca.SX) -> bool:
        return bool(on.numel()) and any(ca.which_depends(one.expression, on, 1, True))

    def is_settled(self, one: Limited) -> bool:
        """Return whether an equality stays as it is during an interval."""
        changing = ca.vertcat(self.stated.states, self.stated.signals, self.stated.time)
        return one.lower == one.upper and not self.depends(one, changing)

    @cached_property
    def limits(self) -> list[Limited]:
        """Path constraints and bounds of states."""
        x = self.stated.states
        return [
            *self.stated.path,
            *[Limited(x[i], *pair) for i, pair in self.stated.bounds.items()],
            *self._ceiling(),
        ]

    def _ceiling(self) -> list[Limited]:
        if self.stated.ceiling is None:
            return []
        above = self.stated.controls[0] - self.stated.ceiling
        return [Limited(above, -np.inf, 0.0, moves=True)]

    @cached_property
    def interval(self) -> tuple[ca.Function, list[Limited], list[Limited]]:
        """(x, u, p, S, t, before, dt, u that acts) -> (x, cost, rows, soft), limits.

        A row with a control holds as the interval begins and at every check; one
        without at every check, and again after a jump of what it depends on. A soft
        row is looked at as the interval begins in any case.
        """
        stated, kind = self.stated, self.kind
        x, u, p = kind.sym("x", self.nx), kind.sym("u", self.nu), self._like("p", 2)
        S = kind.sym("S", stated.signals.numel(), stated.checks + 2)
        t, before, dt = self._like("t", 4), self._like("v", 5), kind.sym("dt")
        late = kind.sym("late", self.nu)

        def at(state: Any, k: int) -> tuple[Any, ...]:
            part = min(k, stated.checks) / stated.checks
            now = t + part * dt if stated.time.numel() else t
            return state, u, p, S[:, k], now, before

        hard, soft = (
            [c for c in self.limits if (c.prices is not None) == is_soft]
            for is_soft in (False, True)
        )
        moved = self._moved()
        controlled = [c for c in hard if self.depends(c, stated.controls)]
        held = _Held(self), _Held(self)
        held[0].add(controlled, at(x, 0))
        held[1].add(soft, at(x, 0))
        cost = self.function(stated.step)(*at(x, 0))
        stage = self.function(stated.stage)
        if stated.quadrature == "left":
            cost += dt * stage(*at(x, 0))
        state = x
        for k in range(stated.checks):
            known = (u, late), p, before, S[:, k], S[:, k + 1], at(x, k)[4]
            both = self._advanced(state, known, dt / stated.checks, k == 0)
            state = both[:-1]
            cost += both[-1] if stated.quadrature == "integral" else 0
            for rows, those in zip(held, (hard, soft), strict=True):
                rows.add([] if stated.is_discrete else those, at(state, k + 1))
        after = stated.checks + 1  # The signals from the end of the interval on.
        if stated.next_state.numel():
            state, _, *there = at(state, after)
            state = self.function(stated.next_state)(state, late, *there)
        for rows, those in zip(held, (hard, soft), strict=True):
            left = [c for c in those if self.depends(c, moved)]
            left = [c for c in left if not self.depends(c, stated.controls)]
            rows.add(left, at(state, after))
        if stated.quadrature == "right":
            cost += dt * stage(*at(state, after))
        columns = [ca.vertcat(kind(0, 1), *rows.values) for rows in held]
        arguments, outputs = [x, u, p, S, t, before, dt, late], [state, cost, *columns]
        whole = ca.Function("interval", arguments, outputs)
        return whole, held[0].limits, held[1].limits

    @property
    def is_held(self) -> bool:
        """True if signals jump at the ends of intervals."""
        return self.stated.held and not self.stated.is_discrete

    def _moved(self) -> ca.SX:
        """Return the states and signals that the end of an interval changes."""
        x, after = self.stated.states, self.stated.next_state
        moved = [self.stated.signals] if self.is_held else []
        if after.numel():
            moved += [x[i] for i in range(self.nx) if not ca.is_equal(after[i], x[i])]
        return ca.vertcat(ca.SX(0, 1), *moved)

    def _like(self, name: str, number: int) -> Any:
        return self.kind.sym(name, self._symbols[number].numel())

    @cached_property
    def at_start(self) -> list[Limited]:
        """Rows without controls that depend on what is decided about the start."""
        stated = self.stated
        decided = ca.vertcat(
            *[stated.states[i] for together in stated.start for i in together],
            *[symbol for symbol, _, _ in stated.decided.values()],
            *([stated.time] if stated.end_time else []),
        )
        return [
            c
            for c in self.limits
            if c.prices is None
            and self.depends(c, decided)
            and not self.depends(c, stated.controls)
        ]

    def at_ends(
        self, x0: Any, x_end: Any, p: Any, length: Any
    ) -> tuple[Any, list[Any]]:
        """Return the costs of start and end, and the rows held there."""
        stated, S = self.stated, self.stated.signal_values
        t0, nothing = self.time_after(0.0), np.zeros(self.stated.before.numel())
        begin = x0, np.zeros(self.nu), p, S[:, 0], t0, nothing
        end = x_end, np.zeros(self.nu), p, S[:, -1], self.time_after(length), nothing
        cost = self.function(stated.initial)(*begin)
        cost += self.function(stated.terminal)(*end)
        rows = [
            *[self.function(c.expression)(*begin) for c in self.at_start],
            *[self.function(c.expression)(*end) for c in stated.ends],
        ]
        return cost, rows

    def time_after(self, after: Any) -> Any:
        return self.stated.clock + after if self.stated.time.numel() else ca.DM(0, 1)

    def begun(self, k: int, length: Any) -> Any:
        return self.time_after(k * length / self.stated.intervals)

    def nodes(self, k: int) -> Array:
        """Return the signals at the checks of an interval, and from its end on."""
        m, values = self.stated.checks, self.stated.signal_values
        columns = np.minimum(np.arange(m + 2), m) + k * m
        if self.is_held:
            columns[:-1] = k * m
        return values[:, columns]

    def parameters_with(self, decided: Any) -> Any:
        known = [value for _, value in self.stated.parameters.values()]
        return ca.vertcat(ca.DM(known) if known else ca.DM(0, 1), decided)

    def value(
        self, point: Point, weights: tuple[float, float]
    ) -> tuple[float, float, Array]:
        """Return cost, summed violation, and the states between intervals.

        Args:
            point: What is decided.
            weights: 1 / scale of a moving bound, and of a periodic state.
        """
        stated = self.stated
        F, limits, soft = self.interval
        x, p = point.x0, self.parameters_with(ca.DM(point.decided))
        cost, violation, before, states = 0.0, 0.0, stated.previous, [point.x0]
        for k in range(stated.intervals):
            u = point.controls[:, k]
            x, spent, rows, above = (
                np.array(o).ravel()
                for o in F(
                    x, u, p, self.nodes(k), self.begun(k, point.length), before,
                    point.length / stated.intervals, self.late(point.controls, k),
                )
            )  # fmt: skip
            before = u if stated.before.numel() else before
            states.append(x)
            cost += float(spent[0])
            cost += point.length / stated.intervals * priced(above, soft)
            violation += beyond(rows, limits, weights[0])
        ends, last = self.at_ends(point.x0, x, p, point.length)
        held = [*self.at_start, *stated.ends]
        violation += beyond(np.array([float(r) for r in last]), held, weights[0])
        for i in stated.periodic:
            violation += weights[1] * abs(x[i] - point.x0[i])
        return cost + float(ends), violation, np.array(states).T


def beyond(rows: Array, limits: list[Limited], moving_weight: float) -> float:
    """Return the sum of the positive excesses, in parts of the scales."""
    return sum(
        max(float(value) - one.upper, one.lower - float(value), 0.0)
        * (moving_weight if one.moves else 1.0)
        for value, one in zip(rows, limits, strict=True)
    )


def priced(rows: Array, limits: list[Limited]) -> float:
    """Return the price of the largest excess of each soft constraint, per second."""
    most: dict[int, float] = {}
    for value, one in zip(rows, limits, strict=True):
        excess = max(value - one.upper, one.lower - value, 0.0)
        most[id(one)] = max(excess, most.get(id(one), 0.0))
    prices = {id(one): one.prices or (0.0, 0.0) for one in limits}
    return sum(prices[i][0] * e + prices[i][1] * e**2 for i, e in most.items())
