"""Local solves of many starts at once: differential dynamic programming in lanes.

A step is a backward sweep and a roll-out (sweep_kernels.py); verdict.py judges it, and
turns.py repeats steps. Lanes are independent: an answer has the same bits for any lanes
beside it and any number of threads.

Some lanes are solved side by side in one memory (blocks.py). Names of an interval: x,
u, m (multipliers), and the step k, K. Names of the ends: y (the decisions about the
start), end (the state at the end), slope and bend (gradient and Hessian of the
augmented Lagrangian by it). Names of a lane: value (the augmented Lagrangian), mu,
theta, length (of the step to try; 0 if the lane must be rolled out), paid (the cost),
worst (the worst excess), and those of `Schedule`. A name that ends in `_new` is the
value after the step.
"""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.blocks import (
    NEXT,
    Job,
    Layout,
    kernel_sizes,
    placed,
    results_of,
)
from swarmstart.ocp.lanes.posed import Posed
from swarmstart.ocp.lanes.stages import LaneOptions
from swarmstart.ocp.lanes.sweep_kernels import Sweeps
from swarmstart.ocp.lanes.turns import Rows, take_turns

_FIRST = "x0"
"""The state at the start: the first rows of x."""

SIDE_BY_SIDE = 32
"""Number of lanes in one memory, so small that it fits into a core's own cache."""
_TURNS = 256
"""Number of turns between two checks for Ctrl-C."""
_FIRST_MU = 1e-6
_BROUGHT = "u", "y", "r", "r_end"
_KEPT = "u", "y", "x", "end", "paid", "worst", "iterations"


def layout_of(sweeps: Sweeps) -> tuple[Layout, Rows]:
    """Return the rows that kernels need, and those that the loop reads."""
    sizes = kernel_sizes(sweeps)
    following = [name for name in sizes if name.startswith(NEXT)]
    state = [name.removeprefix(NEXT) for name in following]
    others = [name for name in sizes if name not in (*following, *state, _FIRST)]
    # In one order, so that the loop copies the states after a turn as one block.
    layout = placed([*state, *following, *others], sizes)
    places = dict(layout.places)
    if _FIRST in sizes:
        places[_FIRST] = places["x"][0], sizes[_FIRST]
    named = {name: place for name, (place, _) in places.items() if name in Rows._fields}
    size = sum(sizes[name] for name in following)
    rows = Rows(state=0, following=places[following[0]][0], size=size, **named)
    return Layout(places, layout.size), rows


def solve_by_sweeps(  # noqa: PLR0913 - starts and how they are solved
    posed: Posed,
    sweeps: Sweeps,
    controls: Array,
    starts: Array,
    *,
    weights: tuple[Array, Array],
    options: LaneOptions,
    threads: int = 1,
) -> LaneAnswers:
    """Return the local optima that many starts lead to.

    Args:
        posed: The problem from one initial state.
        sweeps: The machine code of a step.
        controls: Shape (nu, N, n), within their bounds.
        starts: Decisions about the start, shape (ny, n), within their bounds.
        weights: First weights of the rows of intervals and of the end, each (n,). The
            lighter those of the end, the fewer and better optima are found.
        options: Conditions at which lanes end.
        threads: Number of threads for the lanes.
    """
    layout, rows = layout_of(sweeps)
    y = starts / posed.start_sizes
    given = np.vstack([posed.scaled(controls), y, *(w[None, :] for w in weights)])
    job = Job(
        kernels=sweeps, layout=layout, rows=rows, shared=posed.shared(),
        blank=_blank(layout, options), given=given, brought=_BROUGHT, kept=_KEPT,
        most=options.most, loop=take_turns, turns=_TURNS, side_by_side=SIDE_BY_SIDE,
    )  # fmt: skip
    u, y, x, end, cost, worst, iterations = results_of(job, threads)
    return LaneAnswers(
        controls=posed.controls(u),
        starts=y * posed.start_sizes,
        states=posed.states(x, end),
        cost=cost[0] * posed.sizes.cost,
        violation=worst[0],
        iterations=iterations[0].astype(np.int64),
    )


def _blank(layout: Layout, options: LaneOptions) -> Array:
    """Return the initial memory of a lane; its length is 0, so it is rolled out."""
    blank = np.zeros(layout.size)
    blank[layout.at("mu")] = _FIRST_MU
    # Multipliers, which are 0 at first, are divided by it.
    blank[layout.at("r_was")] = 1.0
    blank[layout.at("tolerance")] = options.first_tolerance
    # A violation that was infinite before makes no weight grow.
    blank[layout.at("broken", "broken_end", "paid", "worst")] = np.inf
    return blank
