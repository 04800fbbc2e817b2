"""Costs of all sequences of modes of a small switched system, and the least of them.

    x' = f(x, s_k) in interval k,   cost = sum_k switch(s_(k-1), s_k) + terminal(x_N)

Each of the m modes is held for one of the N intervals. All m^N sequences are computed:
the states after k intervals are those of m^k sequences, each continued by every mode.
RK4 with many steps in an interval makes the error of a cost some 1e-9; so the optimum
is exact if the second is further away than that. A stage cost is one more state.

`car` is the system of the hard problems on gears: a car with three gears crosses hills
at full throttle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array

MOST = 2_000_000
"""Largest number of sequences: some 100 MB and a minute."""


@dataclass(frozen=True, slots=True, eq=False)
class SwitchedSystem:
    """A system with a mode for each interval.

    Attributes:
        rates: f of states (nx, n) and modes (n,), in the shape of the states.
        start: State at the start, shape (nx,).
        modes: The m modes.
        previous: Mode before the first interval.
        dt: Length of an interval [s].
        switch_cost: Cost of modes before and after a switch, both of shape (n,).
        terminal_cost: Cost of states (nx, n) at the end, shape (n,).
    """

    rates: Callable[[Array, Array], Array]
    start: Array
    modes: Array
    previous: float
    dt: float
    switch_cost: Callable[[Array, Array], Array]
    terminal_cost: Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class Optimum:
    """The best of all sequences.

    Attributes:
        cost: Its cost.
        modes: The sequence, N modes.
        second: Cost of the next best sequence.
        local_optima: Number of sequences that no change of one mode improves.
    """

    cost: float
    modes: tuple[float, ...]
    second: float
    local_optima: int


def optimum(system: SwitchedSystem, intervals: int, *, steps: int = 50) -> Optimum:
    """Return the least cost of all sequences; see `all_costs`."""
    costs = all_costs(system, intervals, steps=steps)
    order = np.argsort(costs, axis=None)[:2]
    best = np.unravel_index(order[0], costs.shape)
    least = np.ones(costs.shape, dtype=bool)
    for axis in range(intervals):
        least &= costs == costs.min(axis=axis, keepdims=True)
    first, second = (float(cost) for cost in costs.ravel()[order])
    modes = tuple(float(system.modes[k]) for k in best)
    return Optimum(first, modes, second, int(least.sum()))


def all_costs(system: SwitchedSystem, intervals: int, *, steps: int = 50) -> Array:
    """Return the cost of every sequence of modes.

    Args:
        system: The system, with at least two modes.
        intervals: N, at least 1.
        steps: Steps of RK4 in an interval.

    Returns:
        Costs, shape (m, ..., m): axis k is the mode of interval k.

    Raises:
        ValueError: If there are more than MOST sequences, or none to compare.
    """
    m = len(system.modes)
    if intervals < 1 or m < 2 or m**intervals > MOST:
        raise ValueError(
            f"expected at least 1 interval, 2 modes and at most {MOST} sequences, got "
            f"{intervals} intervals of {m} modes"
        )
    state = np.array(system.start, dtype=float)[:, None]
    before, cost = np.array([system.previous], dtype=float), np.zeros(1)
    for _ in range(intervals):
        modes = np.tile(np.asarray(system.modes, dtype=float), before.size)
        cost = np.repeat(cost, m) + system.switch_cost(np.repeat(before, m), modes)
        state = _integrated(system, np.repeat(state, m, axis=1), modes, steps)
        before = modes
    return np.asarray((cost + system.terminal_cost(state)).reshape((m,) * intervals))


def _integrated(
    system: SwitchedSystem, state: Array, modes: Array, steps: int
) -> Array:
    h = system.dt / steps
    for _ in range(steps):
        first = system.rates(state, modes)
        second = system.rates(state + h / 2 * first, modes)
        third = system.rates(state + h / 2 * second, modes)
        fourth = system.rates(state + h * third, modes)
        state = state + h / 6 * (first + 2 * second + 2 * third + fourth)
    return state


def car(constants: Mapping[str, float], *, dt: float = 1.0) -> SwitchedSystem:
    """Return a car with three gears on hills, whose cost is to be minimised.

    x' = v, v' = r exp(-((r v - 1)/width)^2) - drag v - hill sin(2 pi x/length + phase)
    with r = 0.6^(gear - 1), from x = 0 and v = 1 in gear 1; a shift costs its square
    times `shift`, and the terminal cost is -(x + v^2/2).

    Args:
        constants: hill, length, phase, drag, width and shift.
        dt: Length of an interval [s].
    """
    hill, length, phase, drag, width, shift = (
        constants[name]
        for name in ("hill", "length", "phase", "drag", "width", "shift")
    )

    def rates(state: Array, gear: Array) -> Array:
        x, v = state
        ratio = 0.6 ** (gear - 1)
        pull = ratio * np.exp(-(((ratio * v - 1) / width) ** 2))
        return np.array(
            [v, pull - drag * v - hill * np.sin(2 * np.pi * x / length + phase)]
        )

    return SwitchedSystem(
        rates=rates,
        start=np.array([0.0, 1.0]),
        modes=np.array([1.0, 2.0, 3.0]),
        previous=1,
        dt=dt,
        switch_cost=lambda before, after: shift * (after - before) ** 2,
        terminal_cost=lambda state: -(state[0] + state[1] ** 2 / 2),
    )
