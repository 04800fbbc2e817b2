"""The margins of a held input: error of its map against the flow, growth of e'Pe.

With V(e) = e'Pe for a deviation e, and |e|_P its root, two numbers c and g are found:

    c with |flow - map|_P <= c |e|_P        proven (`flow_error.py`)
    g with V(map at any time) <= g V        proven here; then
                                            V(flow) <= (sqrt(g) + c)^2 V

A level at which the error c would use up the whole decrease is lowered until c does
not. A statement proven for one level holds for every smaller one.

The map F of a hold takes n steps; its curve (`residual.py`) is given step by step,
relative to the reference's own. Measurements on this curve only suggest what to try to
prove.

Growth: with F_t the Runge-Kutta map to the time t, relative to the reference's own
motion,

    V(F_t(e)) < g V(e)   for all t in [0, dt], 0 < V(e) <= alpha

is proven by the same search as a decrease (`proof.py`), for one interval of times after
another: t is an interval in all evaluations. An interval on which the proof fails is
halved.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import now
from swarmstart.terminal_set.certificates.certificate import (
    CoarseHoldError,
    HeldMargins,
    Proof,
    Refutation,
    UnprovenSetError,
)
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.interval_arithmetic.taylor import (
    PADDING,
    TaylorForm,
    TimedCells,
)
from swarmstart.terminal_set.linear.ellipsoid import Ellipsoid
from swarmstart.terminal_set.proving.decrease import ORDER, Change, held_map
from swarmstart.terminal_set.proving.drift import linear_decrease
from swarmstart.terminal_set.proving.enclosure import (
    Undecided,
    beside_diagonal,
    defect,
    quadratic_bound,
    undecided,
)
from swarmstart.terminal_set.proving.flow_error import FlowError, prove_flow_error
from swarmstart.terminal_set.proving.proof import (
    Limits,
    radius_of,
    refuted_level,
    search_ball,
)
from swarmstart.terminal_set.proving.residual import Residual

ENOUGH = 0.005
"""Margin, relative to the linear decrease, that hardly lowers the level."""
AFFORDABLE = 0.5
"""Margin, relative to the linear decrease, that leaves too little of it."""
HALVINGS = 40
"""Largest number of halvings of a level at which the model is undefined, e'Pe does not
decrease, or no affordable margin is proven."""
CLOSE = 1.05
"""The search stops at this ratio of levels without and with an affordable margin."""
SHARE = 0.25
"""Fraction of the remaining time for each attempt at a margin."""
GROWTH_RESERVE = 1.1
LEAST_GROWTH = 1.05
ROOMIER = 2.0
"""Factor by which the growth is stated larger, if bounds allow, to ease its proof."""
SHRUNK = 1 - 1e-9
"""Factor for the growth that the states' bounds allow, for its rounding."""

SAMPLES = 500
RADII = (0.01, 0.3, 0.6, 0.8, 0.9, 1.0)
"""Radii at which every sample is measured, relative to the set's radius."""
TIMES = 50
"""Least number of times in a hold at which the growth is measured."""

PIECES = 16
"""Number of intervals of a hold at the beginning."""
BOXES_OF_A_PIECE = 4000
"""Number of boxes after which an interval is halved, unless it is the shortest."""
SHORTEST = 1 / 1024
"""Shortest interval, as a fraction of the hold."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Hold:
    """A motion with its input held.

    Attributes:
        motion: (e, t) -> the deviation after t; e for t = 0.
        P: Shape of the ellipsoids, (nx, nx), symmetric positive definite.
        dt: Duration [s].
        pieces: Number of intervals of time with which the search begins.
    """

    motion: ca.Function
    P: Array
    dt: float
    pieces: int = PIECES


class HeldMotion:
    """The motion over one hold, by the Runge-Kutta map.

    Attributes:
        law: The design, with the law and P.
        dt: Time for which the input is held [s].
        step: F(x, u) -> x after dt.
        holds: A `Hold` for each step; its motion is (e, t) -> the deviation at t after
            the beginning of the step.
        residual: Residual of the map's curve.
    """

    def __init__(
        self, dynamics: ca.Function, law: TerminalSet, *, dt: float, substeps: int
    ) -> None:
        """Build the maps."""
        h, one = dt / substeps, ca.simpleRK(dynamics, 1, ORDER).expand()
        self.step = held_map(dynamics, dt, substeps)
        e, t = ca.SX.sym("e", dynamics.size1_in(0)), ca.SX.sym("t")
        held, pieces = ca.DM(law.u_ref) - ca.DM(law.K) @ e, -(-PIECES // substeps)
        now, holds = ca.DM(law.x_ref) + e, []
        for _ in range(substeps):
            after = one(now, held, t)
            # The same operations on the same numbers: exactly 0 at 0.
            after -= ca.substitute(after, e, ca.DM.zeros(e.shape))
            motion = ca.Function("motion", [e, t], [after])
            holds.append(Hold(motion=motion, P=law.P, dt=h, pieces=pieces))
            now = one(now, held, h)
        self.law, self.dt, self.holds = law, dt, tuple(holds)
        self.residual = Residual(dynamics, law, dt=dt, substeps=substeps)

    def measured(self, alpha: float, rng: np.random.Generator) -> tuple[float, bool]:
        """Measure how far e'Pe grows between samples, from states of an ellipsoid.

        Args:
            alpha: Level of the ellipsoid.
            rng: Source of randomness of the directions.

        Returns:
            The largest ratio of e'Pe during a hold to e'Pe at its beginning, NaN if the
            motion is undefined; whether e'Pe decreases over the hold from every state.
        """
        directions = rng.normal(size=(len(self.law.P), SAMPLES))
        boundary = Ellipsoid(P=self.law.P, alpha=alpha).boundary(directions)
        e = np.hstack([radius * boundary for radius in RADII])
        size = later = self.law.value(e)
        growth = 1.0
        for hold in self.holds:
            motion = hold.motion.map(e.shape[1])
            for time in np.linspace(0.0, hold.dt, -(-TIMES // len(self.holds)) + 1)[1:]:
                later = self.law.value(np.array(motion(e, time)))
                growth = float(np.maximum(growth, (later / size).max()))  # Keeps NaN.
        return growth, bool(np.all(later < size))


@dataclass(frozen=True, kw_only=True, slots=True)
class HoldBounds:
    """Upper limits of a level that follow from bounds and drift.

    The decrease of e'Pe, which limits a level too, is not among them.

    Attributes:
        inputs: Largest level at which the inputs keep their bounds.
        states: Level up to which the states keep their bounds; it limits e'Pe at all
            times of a hold.
        drift: Relative drift of the reference, a fraction of |e|_P (`drift.py`).
    """

    inputs: float
    states: float
    drift: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProvableHold:
    """A decrease to be proven for a held input, with its margins.

    Attributes:
        motion: The motion.
        change: The change c(e) of e'Pe, with the margins of integrator and drift added.
        top: The largest level at which all bounds hold, also between samples, and the
            integrator's error is proven; the refuted level if that is lower.
        margins: The proven error and the measured growth.
        refutation: Counterexample of the map without a margin, within the bounds; None
            if none is known.
    """

    motion: HeldMotion
    change: Change
    top: float
    margins: HeldMargins
    refutation: Refutation | None


def provable_hold(
    motion: HeldMotion,
    change: Change,
    bounds: HoldBounds,
    *,
    rng: np.random.Generator,
    until: float,
) -> ProvableHold:
    """Return the margins, and the largest level at which they leave some decrease.

    Args:
        motion: The motion.
        change: The change of e'Pe by the map of the motion, without the margins of
            integrator and drift.
        bounds: Levels up to which inputs and states keep their bounds, and the drift.
        rng: Source of randomness of samples and rays.
        until: Value of `now()` (machine_code/clocks.py) at which proofs of the
            integrator's error stop.

    Raises:
        UnprovenSetError: If no level can be proven.
    """
    top = min(bounds.inputs, bounds.states)
    growth, falls = motion.measured(top, rng)
    refutation = None
    if not falls:
        refutation = refuted_level(change, alpha_max=top, rng=rng)
        top = top if refutation is None else refutation.alpha
        growth, falls = motion.measured(top, rng)
    for _ in range(HALVINGS):
        if np.isfinite(growth) and (falls or refutation is not None):
            break
        # The model may be undefined, or V grow, at states of this level.
        top /= 2
        growth, falls = motion.measured(top, rng)
    top, error = _affordable_error(motion, top, linear_decrease(change), until)
    c = error.relative + bounds.drift
    least = max(LEAST_GROWTH, GROWTH_RESERVE * growth)
    top = min(top, bounds.states / (least**0.5 + c) ** 2)
    room = SHRUNK * max((bounds.states / top) ** 0.5 - c, 0.0) ** 2
    margins = HeldMargins(
        substeps=len(motion.holds),
        integrator_error=error.relative,
        boxes=error.boxes,
        growth=max(least, min(ROOMIER * least, room)),
        growth_is_proven=False,
    )
    return ProvableHold(
        motion=motion,
        change=replace(change, Q_m=change.Q_m + (2 * c + c**2) * change.P),
        top=top,
        margins=margins,
        refutation=refutation,
    )


def with_proven_growth(hold: ProvableHold, alpha: float, *, work: float) -> HeldMargins:
    """Return the margins of a hold, with their growth proven if `work` is enough.

    The level `alpha` must not be above the level up to which the integrator's error is
    proven.
    """
    until = now() + work
    for one in hold.motion.holds:
        left = until - now()
        proof = prove_growth(one, alpha, hold.margins.growth, work=left)
        if not proof.proven:
            return hold.margins
    return replace(hold.margins, growth_is_proven=True)


def _affordable_error(
    motion: HeldMotion, top: float, decrease: float, until: float
) -> tuple[float, FlowError]:
    """Prove the integrator's error up to the largest level at which it is affordable.

    Returns:
        The level and the error there.

    Raises:
        UnprovenSetError: If there is no decrease at all.
        CoarseHoldError: If the error is not affordable at any level that was tried.
    """
    if not decrease > 0:
        raise UnprovenSetError(top, None, until - now())

    def error_at(alpha: float) -> tuple[FlowError, bool]:
        at = now()
        error = prove_flow_error(
            motion.residual,
            alpha,
            enough=ENOUGH * decrease / 2,
            useless=AFFORDABLE * decrease / 2,
            until=at + SHARE * (until - at),
        )
        c = error.relative
        return error, bool(2 * c + c**2 <= AFFORDABLE * decrease)

    low, began = top, now()
    error, is_affordable = error_at(low)
    for _ in range(HALVINGS):
        if is_affordable or not now() < until:
            break
        low /= 2
        error, is_affordable = error_at(low)
    if not is_affordable:
        raise CoarseHoldError(low, None, now() - began, len(motion.holds))
    high = min(2 * low, top)
    while high > CLOSE * low and now() < until:
        middle = (low * high) ** 0.5  # Levels matter by their ratios.
        found, is_affordable = error_at(middle)
        if is_affordable:
            low, error = middle, found
        else:
            high = middle
    return low, error


def prove_growth(
    hold: Hold,
    alpha: float,
    growth: float,
    *,
    work: float = 60.0,
) -> Proof:
    """Try to prove that e'Pe stays below g times its first value during a hold.

    Args:
        hold: The motion over a hold, and P.
        alpha: Level of the ellipsoid, > 0.
        growth: g, above 1.
        work: Budget [s]; in a `working` block (`machine_code/clocks.py`), in units of
            work, each of about a second.

    Raises:
        UnknownIntervalOperationError: If the motion has an operation without interval
            form.
    """
    began = clock.perf_counter()
    P, nx, boxes = hold.P, len(hold.P), 0
    v = ca.SX.sym("v", nx + 1)
    e, t = v[:nx], v[nx]
    after = hold.motion(e, t)
    change = ca.bilin(ca.DM(P), after, after) - growth * ca.bilin(ca.DM(P), e, e)
    form = TaylorForm(ca.Function("growth", [v], [change]), np.eye(nx + 1))
    pieces = list(pairwise(np.linspace(0.0, hold.dt, hold.pieces + 1).tolist()))
    until = now() + work
    centre = np.zeros((nx + 1, 1))
    at_end = centre.copy()
    at_end[-1] = hold.dt
    # Near the centre, only smooth motions can be bounded.
    proven = not np.any(form.kinks(centre, at_end))
    while pieces and proven:
        low, high = pieces.pop()
        shortest = high - low <= SHORTEST * hold.dt
        bounds = _GrowthBounds(form, P, (low, high))
        limits = Limits(
            max_boxes=100 * BOXES_OF_A_PIECE if shortest else BOXES_OF_A_PIECE,
            until=until,
        )
        radius = radius_of(alpha, bounds.defect)
        if not np.isfinite(radius):
            proven = False
            break
        search = search_ball(bounds, nx, radius, limits=limits)
        boxes += search.boxes
        if search.finished:
            continue
        proven = not shortest and now() < until
        middle = (low + high) / 2
        pieces += [(low, middle), (middle, high)]
    seconds = clock.perf_counter() - began
    return Proof(proven=proven, alpha=alpha, boxes=boxes, seconds=seconds)


class _GrowthBounds:
    """Proofs that V(F_t(e)) < g V(e) on boxes of (rho, w), for an interval of times.

    Attributes:
        defect: A bound of |T'PT - I|.
    """

    def __init__(self, form: TaylorForm, P: Array, times: tuple[float, float]) -> None:
        """Rotate the coordinates so that the quadratic part is diagonal."""
        nx = len(P)
        root = np.linalg.inv(np.linalg.cholesky(P)).T
        first, last = (np.append(np.zeros(nx), time)[:, None] for time in times)
        middle, _ = form.hessians((first + last) / 2, (first + last) / 2)
        T = np.asarray(root @ np.linalg.eigh(root.T @ middle[0, :nx, :nx] @ root)[1])
        with_time = np.eye(nx + 1)
        with_time[:nx, :nx] = T
        self._form, self._times = form.turned(with_time), times
        middle, radius = self._form.hessians((first + last) / 2, (first + last) / 2)
        # From the middle of the interval to all of it.
        changed = self._form.hessian_slopes(first, last) * (times[1] - times[0]) / 2
        radius += changed * (1 + PADDING)
        self._M = beside_diagonal(middle[0, :nx, :nx], radius[0, :nx, :nx])
        self.defect = defect(T, P, np.eye(nx))

    def __call__(self, lower: Array, upper: Array) -> Undecided:
        """Return the undecided boxes; see `DecreaseBounds`."""
        quadratic = quadratic_bound(*self._M, lower[1:], upper[1:])
        from_zero = lower.copy()
        from_zero[0] = 0.0
        cells = TimedCells(from_zero, upper, self._times)
        d = np.abs(cells.z_middle) + cells.z_reach
        d[-1] = 0.0  # The series is in e, a separate one for each t.
        remainder = self._form.beyond_second_order(cells, d) / upper[0] ** 2

        def away_from_centre(lower: Array, upper: Array) -> tuple[Array, Array]:
            return self._form(TimedCells(lower, upper, self._times))

        return undecided(away_from_centre, lower, upper, quadratic, remainder)
