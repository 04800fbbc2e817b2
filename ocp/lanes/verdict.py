"""Judgement of a step, and the choice of a lane's next one.

A step that does not help is tried shorter, and then with more regularisation mu. Second
derivatives of the dynamics count (theta is 1) only once full steps of a lane gain less
than a tenth, and not after a failed or very short step. Measured here: with them from
the start a quarter of the lanes ends in worse optima; without them some never end.
"""

from itertools import pairwise
from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.lanes.stages import (
    Augmented,
    Kernel,
    LaneOptions,
    Named,
    Schedule,
    Stage,
    augmented,
    bend_of,
    flat_kernel,
    known_of,
    lower,
    renewed,
    slope_of,
    symbols,
)

STEPS = (1.0, 0.5, 0.25, 0.1, 0.02, 0.003)
"""Lengths of steps, tried one after the other."""
_LEAST_MU, _MOST_MU = 1e-9, 1e7
_LEAST_VALUE, _NOTHING = 1e-3, 1e-3
_SLOW, _SHORT = 0.1, 0.2
"""Relative decrease below which second derivatives help, and step length that is too
short for them."""
_FINITE = 1e300
_WILD = 1e4
"""Largest state or cost at the end, in the NLP's scaled numbers, that a step may lead
to. With light weights, some augmented Lagrangians have no lower bound."""
_ROUNDING = 1e-13


class _Verdict(NamedTuple):
    """The judgement of a step; the first four entries are 0 or 1.

    Attributes:
        taken: Whether the step is accepted.
        over: Whether no shorter step will be tried.
        converged: Whether the lane needs new multipliers to get any better.
        lost: Whether the roll-out of a start is not finite.
        length: Length of the next step.
        mu: Regularisation of the next step.
        theta: Whether second derivatives count in it.
    """

    taken: ca.SX
    over: ca.SX
    converged: ca.SX
    lost: ca.SX
    length: ca.SX
    mu: ca.SX
    theta: ca.SX


def all_of(first: ca.SX, *others: ca.SX) -> ca.SX:
    """Return whether all conditions hold."""
    for one in others:
        first = ca.logic_and(first, one)
    return first


def any_of(first: ca.SX, *others: ca.SX) -> ca.SX:
    """Return whether any condition holds."""
    for one in others:
        first = ca.logic_or(first, one)
    return first


def _judged(lane: Named, new: ca.SX, finite: ca.SX, options: LaneOptions) -> _Verdict:
    """Return the judgement of a step that leads to a new value."""
    value, length, mu = lane["value_now"], lane["length"], lane["mu"]
    # At length 0 the lane is rolled out for the first time: nothing to compare with.
    begins, whole = length == 0, length == STEPS[0]
    size = ca.fmax(ca.fabs(value), _LEAST_VALUE)
    # A decrease within rounding is no progress.
    low = value - _ROUNDING * ca.fabs(value)
    better = all_of(ca.logic_not(begins), finite, new < low)
    # A full step that neither gains nor loses: the lane has converged.
    nothing = ca.fabs(new - value) <= _NOTHING * lane["tolerance"] * size
    settled = all_of(whole, finite, nothing)
    shorter = ca.SX(0)
    for one, following in pairwise(STEPS):
        shorter = ca.if_else(length == one, following, shorter)
    decided = any_of(begins, better, settled)
    again = all_of(ca.logic_not(decided), shorter > 0)
    failed = ca.logic_not(any_of(decided, again))
    over = ca.logic_not(any_of(begins, again))
    fall = ca.if_else(better, (value - new) / size, 0)
    gained = all_of(better, whole)
    eased = ca.if_else(gained, ca.fmax(mu / 10, _LEAST_MU), mu)
    # A step that had to be shortened should have been regularised more.
    eased = ca.if_else(all_of(better, ca.logic_not(whole)), 2 * mu, eased)
    mu = ca.if_else(failed, ca.fmax(20 * mu, 1e-4), eased)
    theta = ca.if_else(all_of(gained, fall < _SLOW), 1, lane["theta"])
    theta = ca.if_else(any_of(failed, all_of(better, length < _SHORT)), 0, theta)
    small = all_of(better, fall < lane["tolerance"])
    # A short step gains little in any case, which does not mean that the lane is done.
    small = all_of(small, any_of(whole, fall < 0.01 * lane["tolerance"]))
    tired = any_of(mu > _MOST_MU, lane["since"] + 1 >= options.inner)
    return _Verdict(
        taken=any_of(better, all_of(begins, finite)),
        over=over,
        converged=all_of(over, any_of(small, settled, tired)),
        lost=all_of(begins, ca.logic_not(finite)),
        length=ca.if_else(again, shorter, STEPS[0]),
        mu=mu,
        theta=theta,
    )


class _Here(NamedTuple):
    """The end or the start of a lane after the step.

    Attributes:
        stage: The end or the start, at the lane's new state.
        al: Its augmented Lagrangian with the multipliers so far.
    """

    stage: Stage
    al: Augmented


def verdict_kernel(
    end: Stage, begin: Stage | None, options: LaneOptions, *, starts: int
) -> Kernel:
    """Return the kernel of all that is decided after a step.

    Args:
        end: The end.
        begin: The start; None if it has no decisions.
        options: Conditions at which lanes end.
        starts: Number of decisions about the start.
    """
    lane = _lane(end, begin, starts)
    new = lane["sums_new"][0] + _at(end, lane, "end_new", "end").al.value
    if begin is not None:
        new += _at(begin, lane, "x0_new", "begin").al.value
    # False for NaN too.
    finite = all_of(
        ca.fabs(new) < _FINITE, _below(lane["end_new"], _FINITE), _tame(lane)
    )
    verdict = _judged(lane, new, finite, options)
    now = _taken_over(verdict, lane, new)
    ends = [_at(end, now, "end", "end")]
    if begin is not None:
        ends.append(_at(begin, now, "x0", "begin"))
    writes = _after(verdict, now, ends, options)
    writes |= _ahead(end, writes)
    named = {f"next.{name}": one for name, one in writes.items() if name in _STATE}
    named |= {"taken": verdict.taken, "done": writes["done"]}
    known = known_of(end, "end") | ({} if begin is None else known_of(begin, "begin"))
    return flat_kernel(lane, known, named)


_STATE = (
    *Schedule._fields, "end", "slope", "bend", "at_end", "m_end", "m_begin", "r_was",
    "fresh", "y", "value", "mu", "theta", "length", "iterations", "since", "paid",
    "worst",
)  # fmt: skip


def _lane(end: Stage, begin: Stage | None, starts: int) -> dict[str, ca.SX]:
    """Return the numbers of a lane that the verdict reads."""
    nx, ny = end.x.numel(), starts
    sizes = {
        "y": ny, "y_new": ny, "end": nx, "end_new": nx, "m_end": end.rows.numel(),
        **dict.fromkeys(Schedule._fields, 1), "value_now": 1, "stuck_start": 1,
        "sums_new": 4, "mu": 1, "theta": 1, "length": 1, "since": 1, "iterations": 1,
        "paid": 1, "worst": 1,
    }  # fmt: skip
    if begin is not None:
        sizes |= {"x0": nx, "x0_new": nx, "m_begin": begin.rows.numel()}
    return symbols(**sizes)


def _at(stage: Stage, lane: Named, state: str, place: str) -> _Here:
    """Return an end at a state of a lane."""
    there = stage.at(lane[state])
    weight = lane["r_end" if place == "end" else "r"]
    return _Here(there, augmented(there, lane[f"m_{place}"], weight))


def _tame(lane: Named) -> ca.SX:
    """Return whether a step stays below `_WILD`; a lane's start is always accepted."""
    before = _below(ca.vertcat(lane["end"], lane["paid"]), _WILD)
    after = _below(ca.vertcat(lane["end_new"], lane["sums_new"][1]), _WILD)
    return any_of(after, lane["length"] == 0, ca.logic_not(before))


def _below(x: ca.SX, limit: float) -> ca.SX:
    return all_of(*(ca.fabs(one) < limit for one in ca.vertsplit(x)))


def _taken_over(verdict: _Verdict, lane: Named, new: ca.SX) -> dict[str, ca.SX]:
    """Return the lane after the step."""
    _, paid, worst, broken = ca.vertsplit(lane["sums_new"])
    pairs = {
        name: (lane[f"{name}_new"], lane[name])
        for name in ("y", "end", "x0")
        if name in lane
    }
    pairs |= {
        "value": (new, lane["value_now"]),
        "paid_before": (paid, lane["paid"]),
        "worst_before": (worst, lane["worst"]),
        "stuck": (broken, lane["stuck_start"]),
    }
    chosen = {name: ca.if_else(verdict.taken, *pair) for name, pair in pairs.items()}
    return {**lane, **chosen}


def _after(
    verdict: _Verdict, now: Named, ends: list[_Here], options: LaneOptions
) -> dict[str, ca.SX]:
    """Return the lane with its next step's settings, and new multipliers if due."""
    broken, paid, worst = now["stuck"], now["paid_before"], now["worst_before"]
    for here in ends[1:]:
        broken = ca.fmax(broken, here.al.broken)
    for here in ends:
        paid, worst = paid + here.stage.cost, ca.fmax(worst, here.al.worst)
    schedule = Schedule(*(now[name] for name in Schedule._fields))
    following, done = renewed(schedule, broken, ends[0].al.broken, options)
    fresh = following._asdict() | {"since": ca.SX(0), "mu": ca.fmin(verdict.mu, 1)}
    names = ("m_end", "m_begin")[: len(ends)]
    fresh |= {n: here.al.multipliers for n, here in zip(names, ends, strict=True)}
    iterations = now["iterations"] + verdict.over
    other = {**now, "since": now["since"] + verdict.over, "mu": verdict.mu}
    after = {
        name: ca.if_else(verdict.converged, one, other[name])
        for name, one in fresh.items()
    }
    tired = iterations >= options.most
    return {
        **now, **after, "r_was": now["r"], "fresh": verdict.converged,
        "theta": verdict.theta, "length": verdict.length, "iterations": iterations,
        "paid": ca.if_else(verdict.taken, paid, now["paid"]),
        "worst": ca.if_else(verdict.taken, worst, now["worst"]),
        "done": any_of(all_of(verdict.converged, done), verdict.lost, tired),
    }  # fmt: skip


def _ahead(end: Stage, after: Named) -> dict[str, ca.SX]:
    """Return the augmented Lagrangian of the end, where the next sweep begins."""
    al = augmented(end, after["m_end"], after["r_end"])
    bend = lower(bend_of(end, al, after["r_end"]))
    parts = [al.value, slope_of(end, al), bend]
    at_end, slope, bend = ca.substitute(parts, [end.x], [after["end"]])
    return {"at_end": at_end, "slope": slope, "bend": bend}
