"""What a step was worth, and what a lane does next.

A step that does not help is tried shorter, and then with more regularisation mu. Second
derivatives of the dynamics count (theta is 1) only once a lane takes whole steps that
gain less than a tenth, and not after a failed or a very short one: with them from the
start a quarter of the lanes ends in worse optima, without them some never end.
"""

from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.lanes.schedule import LaneOptions, Schedule, renewed
from swarmstart.ocp.lanes.stages import (
    Augmented,
    Kernel,
    Named,
    Stage,
    augmented,
    flat_kernel,
    known_of,
    lower,
    slope_and_bend,
    triangle,
)

STEPS = (1.0, 0.5, 0.25, 0.1, 0.02, 0.003)
"""Lengths of steps, tried one after the other."""
_LEAST_MU, _MOST_MU = 1e-9, 1e7
_LEAST_VALUE, _NOTHING = 1e-3, 1e-3
_SLOW, _SHORT = 0.1, 0.2
"""Fall below which second derivatives help; length of a step too short for them."""
_FINITE = 1e300


class _Tried(NamedTuple):
    """What became of a step.

    Attributes:
        taken: Whether the lane is now where it led.
        retry: Whether a shorter one is tried.
        converged: Whether there is nothing left to gain inside.
        begun: Whether a lane has been rolled out for the first time.
        length: Of the next step.
        mu: Regularisation of the next step.
        theta: Whether second derivatives count in it.
        over: 1 if the step is done with.
    """

    taken: ca.SX
    converged: ca.SX
    lost: ca.SX
    length: ca.SX
    mu: ca.SX
    theta: ca.SX
    over: ca.SX


def _all(*conditions: ca.SX) -> ca.SX:
    found = conditions[0]
    for one in conditions[1:]:
        found = ca.logic_and(found, one)
    return found


def _any(*conditions: ca.SX) -> ca.SX:
    found = conditions[0]
    for one in conditions[1:]:
        found = ca.logic_or(found, one)
    return found


def _tried(lane: Named, new: ca.SX, finite: ca.SX, options: LaneOptions) -> _Tried:
    """Return what becomes of a step that leads to a value."""
    value, length, mu = lane["value_now"], lane["length"], lane["mu"]
    rolled, whole = length == 0, length == STEPS[0]
    size = ca.fmax(ca.fabs(value), _LEAST_VALUE)
    better = _all(ca.logic_not(rolled), finite, new < value - 1e-13 * ca.fabs(value))
    # A whole step that neither gains nor loses: there is nothing left to gain.
    settled = _all(
        whole, finite, ca.fabs(new - value) <= _NOTHING * lane["tolerance"] * size
    )
    shorter = ca.SX(0)
    for one, following in zip(STEPS, STEPS[1:]):
        shorter = ca.if_else(length == one, following, shorter)
    retry = _all(ca.logic_not(_any(rolled, better, settled)), shorter > 0)
    failed = ca.logic_not(_any(rolled, better, settled, retry))
    over = ca.logic_not(ca.logic_or(rolled, retry))
    fall = ca.if_else(better, (value - new) / size, 0)
    gained, small = ca.logic_and(better, whole), fall < lane["tolerance"]
    mu = ca.if_else(gained, ca.fmax(mu / 10, _LEAST_MU), ca.if_else(better, 2 * mu, mu))
    mu = ca.if_else(failed, ca.fmax(20 * mu, 1e-4), mu)
    theta = ca.if_else(_all(gained, fall < _SLOW), 1, lane["theta"])
    lost = _any(failed, _all(better, length < _SHORT))
    small = _all(better, small, _any(whole, fall < 0.01 * lane["tolerance"]))
    enough = _any(small, settled, mu > _MOST_MU, lane["since"] + 1 >= options.inner)
    return _Tried(
        taken=_any(better, _all(rolled, finite)),
        converged=_all(over, enough),
        lost=_all(rolled, ca.logic_not(finite)),
        length=ca.if_else(retry, shorter, STEPS[0]),
        mu=mu,
        theta=ca.if_else(lost, 0, theta),
        over=over,
    )


def verdict_kernel(
    end: Stage, begin: Stage | None, options: LaneOptions, *, starts: int
) -> Kernel:
    """Return the kernel of all that is decided after a step.

    Args:
        end: The end.
        begin: The start; None where nothing is decided about it.
        options: When lanes end.
        starts: Number of decisions about the start.
    """
    nx = end.x.numel()
    lane = _symbols(nx, starts, end, begin)
    spent_new, paid_new, worst_new, broken_new = ca.vertsplit(lane["sums_new"])
    at_new = augmented(end.at(lane["end_new"]), lane["m_end"], lane["r_end"])
    new = spent_new + at_new.value
    if begin is not None:
        there = begin.at(lane["x0_new"])
        new += augmented(there, lane["m_begin"], lane["r"]).value
    finite = ca.fabs(new) < _FINITE
    for i in range(nx):
        finite = ca.logic_and(finite, ca.fabs(lane["end_new"][i]) < _FINITE)
    tried = _tried(lane, new, finite, options)

    def chosen(name: str, old: ca.SX) -> ca.SX:
        return ca.if_else(tried.taken, lane[f"{name}_new"], old)

    place = chosen("end", lane["end"])
    here = augmented(end.at(place), lane["m_end"], lane["r_end"])
    cost, worst = end.at(place).cost, here.worst
    broken = ca.if_else(tried.taken, broken_new, lane["stuck_start"])
    renewal = {}
    known = known_of(end, "end")
    if begin is not None:
        first = begin.at(chosen("x0", lane["x0"]))
        at_begin = augmented(first, lane["m_begin"], lane["r"])
        cost, worst = cost + first.cost, ca.fmax(worst, at_begin.worst)
        broken = ca.fmax(broken, at_begin.broken)
        known |= known_of(begin, "begin")
        renewal["m_begin"] = ca.if_else(tried.converged, at_begin.multipliers, lane["m_begin"])
    schedule = Schedule(*(lane[name] for name in Schedule._fields))
    following, done = renewed(schedule, broken, here.broken, options)
    renewal |= {
        name: ca.if_else(tried.converged, after, before)
        for name, after, before in zip(Schedule._fields, following, schedule, strict=True)
    }
    m_end = ca.if_else(tried.converged, here.multipliers, lane["m_end"])
    again = augmented(end, m_end, renewal["r_end"])
    slope, bend = slope_and_bend(end, again, renewal["r_end"])
    slope, bend, at_end = ca.substitute(
        [slope, lower(bend), again.value], [end.x], [place]
    )
    iterations = lane["iterations"] + tried.over
    since = lane["since"] + tried.over
    done = _any(_all(tried.converged, done), tried.lost, iterations >= options.most)
    after = {
        "end": place, "slope": slope, "bend": bend, "at_end": at_end, "m_end": m_end,
        **renewal, "r_was": lane["r"], "fresh": tried.converged,
        "y": chosen("y", lane["y"]), "value": ca.if_else(tried.taken, new, lane["value_now"]),
        "mu": ca.if_else(tried.converged, ca.fmin(tried.mu, 1), tried.mu),
        "theta": tried.theta, "length": tried.length, "iterations": iterations,
        "since": ca.if_else(tried.converged, 0, since),
        "paid": ca.if_else(tried.taken, paid_new + cost, lane["paid"]),
        "worst": ca.if_else(tried.taken, ca.fmax(worst_new, worst), lane["worst"]),
    }  # fmt: skip
    writes = {f"next.{name}": one for name, one in after.items()}
    writes |= {"taken": tried.taken, "done": done}
    return flat_kernel(lane, known, writes)


def _symbols(
    nx: int, ny: int, end: Stage, begin: Stage | None
) -> dict[str, ca.SX]:
    sizes = {
        "y": ny, "y_new": ny, "end": nx, "end_new": nx, "m_end": end.rows.numel(),
        **dict.fromkeys(Schedule._fields, 1), "value_now": 1, "stuck_start": 1,
        "sums_new": 4,
        **dict.fromkeys(("mu", "theta", "length", "since", "iterations"), 1),
        "paid": 1, "worst": 1,
    }  # fmt: skip
    if begin is not None:
        sizes |= {"x0": nx, "x0_new": nx, "m_begin": begin.rows.numel()}
    symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    return symbols
