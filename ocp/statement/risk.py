"""Costs of the members of an ensemble, combined into one cost.

With the costs J_m of the members and weights w_m that sum to one,

    "mean"   sum w_m J_m
    "worst"  max J_m
    "cvar"   min over t of  t + sum w_m max(J_m - t, 0) / (1 - level)

The last is the mean of the worst part, 1 - level, of the distribution. One of the J_m
is an optimal t, so the minimum is over finitely many values. For an NLP the same cost
is written without kinks, by numbers that are decided with the controls,

    minimise  t + sum w_m e_m / (1 - level)
    subject to  J_m - t = e_m - r_m,  e_m >= 0,  r_m >= 0

and "worst" is the same with e_m = 0 and without the sum.

Source: Rockafellar and Uryasev (2000), Optimization of conditional value-at-risk,
Journal of Risk 2, theorem 1.
"""

import functools
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.pickling import Expressed
from swarmstart.ocp.statement.decisions import Free, FreeStart

Measure = Literal["mean", "worst", "cvar"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Risk(Expressed):
    """Costs of the members as expressions, and their combination.

    Attributes:
        stage: Stage cost of each member, shape (M, 1).
        step: Step cost of each member, shape (M, 1).
        initial: Initial cost of each member, shape (M, 1).
        terminal: Terminal cost of each member, shape (M, 1).
        weights: Weights of the members, positive, with the sum one, shape (M,).
        measure: "mean", "worst" or "cvar".
        level: Level of "cvar", which averages the worst part, 1 - level; in [0, 1).
        robust_horizon: Number of intervals after which each member has controls of its
            own; None: all have the same ones.
    """

    stage: ca.SX
    step: ca.SX
    initial: ca.SX
    terminal: ca.SX
    weights: Array
    measure: Measure
    level: float
    robust_horizon: int | None = None

    @property
    def members(self) -> int:
        """Number M of members of the ensemble."""
        return int(self.weights.size)

    def start(self, x0: Array, nx: int) -> Array:
        """Return the initial state of all members; one member's is repeated for all.

        Args:
            x0: Initial state of a member, or of all of them one after another.
            nx: Number of states of all members.
        """
        return np.tile(x0, self.members) if x0.size * self.members == nx else x0

    def negated(self) -> "Risk":
        """Return the same risk of negated costs: each member's cost times -1."""
        return replace(
            self,
            stage=-self.stage,
            step=-self.step,
            initial=-self.initial,
            terminal=-self.terminal,
        )

    def of(self, costs: ca.SX) -> ca.SX:
        """Return the combined cost of the members' costs, shape (M, 1)."""
        each = ca.vertsplit(costs)
        if len(each) == 1:
            return costs
        if self.measure == "mean":
            return ca.dot(ca.DM(self.weights), costs)
        if self.measure == "worst":
            return functools.reduce(ca.fmax, each)
        # One of the costs is an optimal t (theorem 1).
        return functools.reduce(ca.fmin, [self._above(costs, t) for t in each])

    def _above(self, costs: ca.SX, threshold: ca.SX) -> ca.SX:
        excess = ca.fmax(costs - threshold, 0)
        return threshold + ca.dot(ca.DM(self.weights), excess) / (1 - self.level)

    def threshold(self, costs: Array) -> float:
        """Return the threshold t that belongs to the combined cost.

        For "worst" it is the largest cost, for "cvar" the quantile of the costs at
        `level`: costs above it make up the worst part.

        Args:
            costs: Costs of the members, shape (M,).
        """
        if self.measure == "worst":
            return float(costs.max())
        order = np.argsort(costs)
        below = np.cumsum(self.weights[order])
        place = int(np.searchsorted(below, self.level))
        # The sum of the weights may round to less than the level.
        return float(costs[order[min(place, costs.size - 1)]])


class Epigraph(NamedTuple):
    """Smooth form of a cost with kinks, for an NLP: extra decisions and equations.

    Attributes:
        risk: The combination of the members' costs.
        costs: Cost of each member at the end of the horizon, shape (M, 1).
        decided: Symbols of the states that the NLP decides, in this order: a threshold
            t; only for "cvar", the excess e of each member's cost over t; the room r,
            by which each member's cost is below t.
        first: Index of the first of these states.
        accrued: Indices of the states that accrue the members' costs.
    """

    risk: Risk
    costs: ca.SX
    decided: ca.SX
    first: int
    accrued: tuple[int, ...]

    @property
    def states(self) -> list[int]:
        """Indices of the decided states."""
        return [self.first + i for i in range(self.decided.numel())]

    @property
    def starts(self) -> tuple[FreeStart, ...]:
        """Decisions that only the NLP has."""
        bounds = [Free(), *[Free(0.0)] * (self.decided.numel() - 1)]
        return tuple(
            FreeStart(states=(i,), value=value)
            for i, value in zip(self.states, bounds, strict=True)
        )

    @property
    def cost(self) -> ca.SX:
        """The smooth cost."""
        t, e, _ = self._parts()
        if not e.numel():
            return t
        return t + ca.dot(ca.DM(self.risk.weights), e) / (1 - self.risk.level)

    @property
    def equations(self) -> ca.SX:
        """Expressions that must be zero at the end, shape (M, 1)."""
        t, e, r = self._parts()
        return self.costs - t + r - (e if e.numel() else 0)

    def _parts(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        M, size = self.risk.members, self.decided.numel()
        t, e, r = ca.vertsplit(self.decided, [0, 1, size - M, size])
        return t, e, r

    def values(self, costs: Array) -> Array:
        """Return the values of `decided` that fit given costs of the members.

        Args:
            costs: Costs of the members, shape (M,).
        """
        # A start of the NLP must be finite, even from a rollout that is not.
        costs = np.nan_to_num(costs, nan=0.0, posinf=0.0, neginf=0.0)
        over = costs - self.risk.threshold(costs)
        e = np.maximum(over, 0.0) if self.risk.measure == "cvar" else np.empty(0)
        return np.concatenate([[costs[0] - over[0]], e, np.maximum(-over, 0.0)])


def epigraph_symbols(risk: Risk) -> ca.SX:
    """Return the symbols `Epigraph.decided`; empty if the cost is smooth anyway."""
    M, several = risk.members, range(risk.members)
    if risk.measure == "mean" or M == 1:
        return ca.SX(0, 1)
    e = [ca.SX.sym(f"excess {m}") for m in several if risk.measure == "cvar"]
    return ca.vertcat(
        ca.SX.sym("threshold"), *e, *[ca.SX.sym(f"room {m}") for m in several]
    )
