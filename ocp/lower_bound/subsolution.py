"""The polynomial of a step: a linear program over points, and proofs that add points.

Each round computes the coefficients by a linear program, then looks for points at which
the inequality of the step (hamiltonian.py) fails: by samples as long as these find
many, after that by a proof. For each such point the round adds a row to the linear
program, with the worst control there. The slack of a proof is subtracted from the
bound, so that every finished proof gives a bound.

A linear program covers the whole set at once. Rows of earlier rounds are kept:
otherwise clusters of new rows would displace binding ones, and the value would
oscillate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import done, now
from swarmstart.ocp.lower_bound.basis import Box, packed
from swarmstart.ocp.lower_bound.hamiltonian import (
    Forms,
    Setting,
)
from swarmstart.ocp.lower_bound.interior_point import maximised
from swarmstart.ocp.lower_bound.proving import Floor, Limits, proven_floor
from swarmstart.ocp.lower_bound.region import Region, value_interval
from swarmstart.ocp.lower_bound.stated.answer import Step
from swarmstart.ocp.lower_bound.stated.statement import Statement

Aim = Literal["start", "come", "go"]
"""Objective of a step: V at the start, or the pruning by C or G; see answer.py."""
MOST_ROWS = 15_000
LARGEST = 1e4
"""Largest coefficient, in units of the cost's size."""
_PER_CALL, _PER_POINT = 8e5, 5.0
"""Work of an evaluation, in operations, and at a point for each coefficient."""
SAMPLES = 15_000
WORST = 400
RADII = (0.05, 0.015, 0.005, 0.0015)
TRIES = 6
LITTLE = 0.05
"""Weight of a point that a pruning excludes already."""
MOST_BOXES = 3_000_000
MOST_END_BOXES = 100_000
PROOF_TIME = 0.2
"""Fraction of the remaining time for a proof."""
PATIENCE = 4
"""Largest number of rounds without a proof, whatever samples say."""
BINDING = 1e-9
"""Least dual variable at which a row is never dropped."""
SHARE_OF_ENDS = 0.1
"""Fraction of the target slack that is for the end."""


@dataclass(frozen=True, eq=False)
class Cuts:
    """Points whose inequalities are rows of the linear program.

    Attributes:
        points: Points (t, x, u), shape (1 + n + m, N).
        ends: Ends (T, x), shape (1 + n, K).
    """

    points: Array
    ends: Array

    def joined(self, points: Array, ends: Array) -> Cuts:
        """Return the own points and ends, followed by the given ones."""
        return Cuts(np.hstack([self.points, points]), np.hstack([self.ends, ends]))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Round:
    """The outcome of a round.

    Attributes:
        step: The proven step; None if a proof was not tried or did not end.
        value: Value of the linear program: the bound of the step if its slacks were 0.
        share: Fraction of the set that a pruning step excludes.
        cuts: All points so far whose inequalities are rows.
        converged: Whether no better step of this degree can be expected.
    """

    step: Step | None
    value: float
    share: float
    cuts: Cuts
    converged: bool


@dataclass(eq=False)
class Search:
    """Search for a step: a polynomial of one degree, proven on one set, round by round.

    Attributes:
        setting: The problem.
        region: The set.
        forms: Inequalities of the degree.
        aim: Kind of the objective: "start" for a bound; "come" or "go" for the step of
            that name in a `Pruning`.
        hoped: Target of the slack [cost / s].
        rng: Source of randomness of the samples.
        until: Value of `machine_code.now()`, which counts work, at which the search
            ends.
        needed: For a pruning step: function points (1 + n, N) -> value of the objective
            above which a point is excluded from the set.
    """

    setting: Setting
    region: Region
    forms: Forms
    aim: Aim
    hoped: float
    rng: np.random.Generator
    until: float
    needed: Callable[[Array], Array] | None = None
    box: Box = field(init=False)

    def __post_init__(self) -> None:
        """Compute the box that the polynomial is scaled to."""
        self.box = self.region.box
        basis, statement = self.forms.basis, self.setting.statement
        start = np.concatenate([[0.0], statement.x0])[:, None]
        self._at_start: Array = basis.values(self.box, start)[0]
        if self.aim != "start":
            points = self.region.sampled(self.rng, 6000)
            values = basis.values(self.box, points)
            self._aims = values if self.aim == "go" else self._at_start - values
            self._weights = np.ones(len(values))
            self._enough = (
                np.full(len(values), np.inf)
                if self.needed is None
                else self.needed(points)
            )

    def _objective(self) -> Array:
        """Return the coefficients of the objective, shape (size,)."""
        if self.aim == "start":
            return self._at_start
        return np.asarray(self._weights @ self._aims / self._weights.sum())

    def _weigh(self, w: Array) -> None:
        """Reduce the weight in the objective of points that are excluded already."""
        if self.aim != "start":
            value = self._aims @ w
            wanted = np.where(value > self._enough, LITTLE, 1.0)
            self._weights = (self._weights + wanted) / 2

    def _share(self, w: Array, loss: float) -> float:
        """Return the fraction of the points that a step excludes."""
        return float((self._aims @ w - loss > self._enough).mean())

    @property
    def _has_end(self) -> bool:
        return self.aim != "come"

    def first_cuts(self) -> Cuts:
        """Return samples of the set and of its ends."""
        statement, count = self.setting.statement, 25 * self.forms.basis.size
        points = self.region.sampled(self.rng, 2 * count)[:, :count]
        low, high = (limit[:, None] for limit in statement.control_box)
        rows = []
        for share in (0.0, 0.5, 1.0, None):
            drawn = self.rng.random((statement.m, points.shape[1]))
            part = drawn if share is None else share
            # `0 * drawn` gives a constant share the shape of the points.
            u = low + part * (high - low) + 0 * drawn
            rows.append(np.vstack([points, u]))
        return Cuts(np.hstack(rows), self.sampled_ends(4 * self.forms.basis.size))

    def sampled_ends(self, count: int) -> Array:
        """Return points of the boxes that cover the admissible ends."""
        if not self._has_end:
            return np.zeros((1 + self.setting.statement.n, 0))
        lower, upper = self.region.end_boxes()
        if not lower.size:
            return lower
        chosen = self.rng.integers(0, lower.shape[1], size=count)
        part = np.clip(1.2 * self.rng.random((len(lower), count)) - 0.1, 0.0, 1.0)
        points = lower[:, chosen] + part * (upper - lower)[:, chosen]
        # A set of ends of measure zero contains no samples, but its boxes are small.
        within = self.region.inside_ends(points)
        return points[:, within] if within.sum() > count / 20 else points

    def rounds(self, cuts: Cuts | None, useless: float = -np.inf) -> Iterator[Round]:
        """Yield better and better rounds until they do not improve any more.

        Args:
            cuts: Points of earlier searches; None means samples.
            useless: Value of the objective at or below which a proof is useless.
        """
        rows = _Rows(self, cuts or self.first_cuts())
        best = useless
        # The first proof is tried in the second round at the latest.
        last_proof, number = -3, 0
        while now() < self.until:
            objective = self._objective()
            w = rows.solved(objective)
            value = float(objective @ w)
            self._weigh(w)
            found = self._failing(w)
            number += 1
            step, converged = None, False
            latest = self.setting.statement.horizon[1]
            # Pruning steps get new weights in each round, so values do not compare.
            compares = self.aim == "start" and np.isfinite(best)
            room = (value - best) / latest if compares else np.inf
            # A proof pays once the loss that samples show leaves a better bound.
            enough = max(4 * self.hoped, min(0.5 * room, 0.1 * self.setting.size))
            if found.lowest > -enough or number - last_proof > PATIENCE:
                last_proof = number
                step, more, ends, converged = self._proved(w, room)
                found = _Failing(
                    np.hstack([more, found.points]),
                    np.hstack([ends, found.ends]),
                    found.lowest,
                )
                if step is not None:
                    best = max(best, value - loss_of(step, latest))
            rows.add(found.points, found.ends)
            share = 0.0
            if step is not None and self.aim != "start":
                share = self._share(w, loss_of(step, latest))
            yield Round(
                step=step,
                value=value,
                share=share,
                cuts=rows.cuts,
                converged=converged,
            )
            if converged:
                return

    def _failing(self, w: Array) -> _Failing:
        """Return samples at which a polynomial violates the inequality most."""
        points = self.region.sampled(self.rng, SAMPLES)
        h, u = self._h(w, points)
        near = self._descended(w, points[:, np.argsort(h)[: WORST // 2]])
        near_h, near_u = self._h(w, near)
        points = np.hstack([points, near])
        h, u = np.concatenate([h, near_h]), np.hstack([u, near_u])
        order = np.argsort(h)
        # The worst points, and some others, since the worst lie close together.
        chosen = np.concatenate([order[: WORST // 2], order[WORST // 2 : 4000 : 20]])
        chosen = chosen[h[chosen] < 2 * self.hoped]
        ends = self.sampled_ends(3000)
        if ends.size:
            margin = self._end_margin(w, ends)
            ends = ends[:, np.argsort(margin)[:60]]
            ends = ends[:, np.sort(margin)[:60] < self.hoped]
        lowest = float(h.min()) if h.size else 0.0
        return _Failing(np.vstack([points, u])[:, chosen], ends, lowest)

    def _descended(self, w: Array, points: Array) -> Array:
        """Return points moved by random steps to lower h, with all points on the way.

        A row at a minimum of h removes the minimum; a row beside it does not.
        """
        low, high = self.box.middle - self.box.half, self.box.middle + self.box.half
        tracks = []
        h, _ = self._h(w, points)
        for part in RADII:
            for _ in range(TRIES):
                step = self.rng.standard_normal(points.shape)
                tried = points + part * self.box.half[:, None] * step
                tried = np.clip(tried, low[:, None], high[:, None])
                other, _ = self._h(w, tried)
                better = (other < h) & self.region.inside(tried)
                points, h = np.where(better, tried, points), np.where(better, other, h)
            tracks.append(points)
        return np.hstack(tracks)

    def _h(self, w: Array, points: Array) -> tuple[Array, Array]:
        done(_PER_CALL + _PER_POINT * points.shape[1] * self.forms.basis.size)
        slopes = self.forms.basis.slopes(self.box, points) @ w
        h, u = self.setting.stage.hamiltonian(slopes, points)
        return np.where(np.isfinite(h), h, np.inf), u

    def _end_margin(self, w: Array, ends: Array) -> Array:
        V = self.forms.basis.values(self.box, ends) @ w
        return self.setting.stage.end(ends) - V

    def _proved(self, w: Array, room: float) -> tuple[Step | None, Array, Array, bool]:
        """Prove both inequalities of a polynomial.

        Returns:
            The step, if both proofs ended; points and ends at which the polynomial
            violates the inequalities; whether there are no such points.
        """
        polynomial = self.forms.basis.polynomial(self.box, w)
        parameters = packed(polynomial)
        floor = self._proved_inside(parameters, w, room)
        points = self._thinned(floor.points, w)
        ends, end_slack = np.zeros((len(self.box.half), 0)), None
        proven, boxes = floor.proven, floor.boxes
        if self._has_end:
            at_end = self._proved_at_end(parameters, w)
            ends, end_slack = at_end.points[:, :500], at_end.slack
            proven, boxes = proven and at_end.proven, boxes + at_end.boxes
        if not proven:
            return None, points, ends, False
        step = Step(
            polynomial=polynomial,
            slack=floor.slack,
            end_slack=end_slack,
            boxes=boxes,
        )
        return step, points, ends, not points.size and not ends.size

    def _proved_inside(self, parameters: Array, w: Array, room: float) -> Floor:
        inequality, statement = self.forms.inequality, self.setting.statement
        lower, upper = self.region.paving
        low, high = statement.control_box
        with_controls = inequality.with_controls
        if with_controls:
            count = lower.shape[1]
            lower = np.vstack([lower, np.repeat(low[:, None], count, axis=1)])
            upper = np.vstack([upper, np.repeat(high[:, None], count, axis=1)])
        n = statement.n

        def value(points: Array) -> Array:
            slopes = self.forms.basis.slopes(self.box, points[: 1 + n]) @ w
            u = points[1 + n :] if with_controls else None
            h, _ = self.setting.stage.hamiltonian(slopes, points[: 1 + n], u)
            inside = self.region.inside(points[: 1 + n])
            return np.where(inside & np.isfinite(h), h, np.inf)

        return proven_floor(
            lambda lower, upper: inequality.bounds(parameters, lower, upper),
            self.region.outside,
            value,
            (lower, upper),
            self.hoped,
            Limits(until=self._soon(), useless=room, max_boxes=MOST_BOXES),
        )

    def _proved_at_end(self, parameters: Array, w: Array) -> Floor:
        hoped = SHARE_OF_ENDS * self.hoped * self.setting.statement.horizon[1]

        def value(points: Array) -> Array:
            margin = self._end_margin(w, points)
            within = self.region.inside_ends(points)
            return np.where(within & np.isfinite(margin), margin, np.inf)

        return proven_floor(
            lambda lower, upper: self.forms.end.bounds(parameters, lower, upper),
            self.region.outside_ends,
            value,
            self.region.end_boxes(),
            hoped,
            Limits(until=self._soon(), max_boxes=MOST_END_BOXES),
        )

    def _soon(self) -> float:
        """Return the value of `now()` at which a proof ends, to leave work for more."""
        at = now()
        return at + max(1.0, PROOF_TIME * (self.until - at))

    def _thinned(self, points: Array, w: Array) -> Array:
        """Return the lowest and some other counterexamples, with worst controls."""
        n, most = self.setting.statement.n, 1500
        if points.shape[1] > most:
            others = self.rng.permutation(np.arange(most // 3, points.shape[1]))
            chosen = np.concatenate([np.arange(most // 3), others[: most - most // 3]])
            points = points[:, chosen]
        points = points[: 1 + n]
        if not points.size:
            return np.zeros((1 + n + self.setting.statement.m, 0))
        points = np.hstack([points, self._descended(w, points[:, : WORST // 2])])
        h, u = self._h(w, points)
        return np.vstack([points, u])[:, h < self.hoped]


@dataclass(frozen=True, eq=False)
class _Failing:
    """Points and ends at which inequalities fail, and the least h of the samples."""

    points: Array
    ends: Array
    lowest: float


def loss_of(step: Step, latest: float) -> float:
    """Return the cost that a step's slacks subtract; `latest` is the latest end [s]."""
    return step.slack * latest + (step.end_slack or 0.0)


class _Rows:
    """The rows of the linear program, one for each point and end of its `cuts`."""

    def __init__(self, search: Search, cuts: Cuts) -> None:
        self._search = search
        n = search.setting.statement.n
        none = Cuts(
            np.zeros((1 + n + search.setting.statement.m, 0)), np.zeros((1 + n, 0))
        )
        size = search.forms.basis.size
        self.cuts = none
        self._A, self._b = np.zeros((0, size)), np.zeros(0)
        self._E, self._e = np.zeros((0, size)), np.zeros(0)
        self.add(cuts.points, cuts.ends)

    def add(self, points: Array, ends: Array) -> None:
        """Add rows for points and ends, except where the problem is not finite."""
        search = self._search
        basis, box, stage = search.forms.basis, search.box, search.setting.stage
        n = search.setting.statement.n
        y, u = points[: 1 + n], points[1 + n :]
        f, L = stage.rates(y, u)
        slopes = basis.slopes(box, y)
        A = slopes[0] + (slopes[1:] * f[:, :, None]).sum(axis=0)
        good = np.isfinite(L) & np.isfinite(A).all(axis=1)
        self._A, self._b = np.vstack([self._A, A[good]]), np.append(self._b, L[good])
        kept_ends = ends[:, :0]
        if search._has_end and ends.size:
            e = stage.end(ends)
            fine = np.isfinite(e)
            kept_ends = ends[:, fine]
            E = basis.values(box, kept_ends)
            self._E, self._e = np.vstack([self._E, E]), np.append(self._e, e[fine])
        self.cuts = self.cuts.joined(points[:, good], kept_ends)

    def solved(self, objective: Array) -> Array:
        """Return the best coefficients; drop the least binding of too many rows."""
        size, m = self._search.setting.size, self._A.shape[1]
        bounds = np.vstack([np.eye(m), -np.eye(m)])
        # At the end V must lie below phi, so these rows have the other sign.
        A = np.vstack([self._A, -self._E, bounds])
        # Unknowns in units of `size`, so that LARGEST and the tolerance suit any
        # problem.
        b = np.concatenate([self._b / size, self._e / size, np.full(2 * m, LARGEST)])
        found = maximised(objective, A, b)
        rows = len(self._b)
        if rows > MOST_ROWS:
            slack = self._A @ found.w + self._b / size
            last = np.partition(slack, 2 * MOST_ROWS // 3)[2 * MOST_ROWS // 3]
            kept = (found.duals[:rows] > BINDING) | (slack < last)
            self._A, self._b = self._A[kept], self._b[kept]
            self.cuts = replace(self.cuts, points=self.cuts.points[:, kept])
        return np.asarray(size * found.w)


def worth(step: Step, statement: Statement) -> float:
    """Return the bound that a step proves, without the offset, rounded down."""
    start = np.concatenate([[0.0], statement.x0])
    low, _ = value_interval(step.polynomial, start)
    latest, end_slack = statement.horizon[1], step.end_slack or 0.0
    # Far more than the rounding of these sums.
    padding = 1e-14 * (abs(low) + step.slack * latest + end_slack)
    return low - step.slack * latest - end_slack - padding
