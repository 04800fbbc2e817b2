"""Newton's step of an interior-point method, part by part, and measures of a point.

The Riccati recursion computes the step of an interval's state and controls. This module
has the second derivatives that the recursion needs, and the steps of slacks, elastic
variables, multipliers and duals that follow from that step (barrier.py).
"""

from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.lanes.barrier import Eliminated, largest, most_of, picked
from swarmstart.ocp.lanes.interior_parts import Place

SUMS = ("cost", "theta", "logs", "elastic", "duals")
TOPS = ("dual", "primal", "gap", "pressure", "excess")
"""Measures of a point: sums, and largest absolute values (interior_verdict.py)."""


class Folded(NamedTuple):
    """An interval, the end or the start, without its slacks and elastic variables.

    These are eliminated from Newton's step.

    Attributes:
        S: Of each variable with bounds, the sum of z / d over its bounds (z: dual, d:
            distance to the bound), plus delta.
        slope: Gradient of barrier and price by these variables.
        rows: The rows, after the elimination.
        C: Derivatives of the rows by state and controls.
    """

    S: ca.SX
    slope: ca.SX
    rows: Eliminated
    C: ca.SX


def folded(place: Place, mu: ca.SX, rho: ca.SX, delta: ca.SX) -> Folded:
    """Eliminate the slacks and elastic variables of a part from Newton's step.

    Args:
        place: The part.
        mu: Parameter of the central path.
        rho: Price of broken rows.
        delta: Number that is added to the diagonal of the second derivatives.
    """
    walls, v = place.walls, place.v
    S = walls.pairs.curvature(v, place.kept["z"]) + delta
    slope = walls.pairs.slope(v, mu) + walls.price(rho)
    rows = walls.eliminated(S, slope, place.excess)
    return Folded(S, slope, rows, place.slopes(walls.rows))


def quadratic(place: Place, part: Folded, more: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return second derivatives and gradient of a part, by state and controls.

    Args:
        place: The part.
        part: The same part without slacks and elastic variables, from `folded`.
        more: Further terms of the Lagrangian.
    """
    rows, z = place.walls.rows, place.z
    Q = place.bend(place.cost + ca.dot(place.kept["m"], rows) + more)
    q = place.cost_slope
    if rows.numel():
        Q += part.C.T @ (part.C * ca.repmat(part.rows.weight, 1, z.numel()))
        q += part.C.T @ part.rows.force
    return Q, q


class Lengths(NamedTuple):
    """Change of the barrier's value along Newton's step, and the allowed step lengths.

    Attributes:
        gain: Directional derivative of the barrier's value.
        primal: Largest fraction of the step after which every distance to a bound still
            has a certain part of its value.
        dual: Largest fraction of the step after which every dual still has that part of
            its value.
    """

    gain: ca.SX
    primal: ca.SX
    dual: ca.SX


def stepped(
    place: Place, part: Folded, moved: ca.SX, own: ca.SX, mu: ca.SX, so_far: Lengths
) -> tuple[dict[str, ca.SX], Lengths]:
    """Return the steps of a part's slacks, elastic variables, multipliers and duals.

    Returned too is `so_far` with this part added.

    Args:
        place: The part.
        part: The same part without slacks and elastic variables, from `folded`.
        moved: Step of state and controls.
        own: Step of the part's own variables with bounds.
        mu: Parameter of the central path.
        so_far: Directional derivative and longest steps of the parts before this one.
    """
    walls, kept, v = place.walls, place.kept, place.v
    after = part.rows.weight * (part.C @ moved) + part.rows.force
    inner = walls.steps(part.S, part.slope, after)
    step = ca.vertcat(own, inner)
    z = walls.pairs.dual_step(v, kept["z"], mu, step)
    left = ca.fmax(0.99, 1 - mu)
    gain = so_far.gain + ca.dot(place.cost_slope, moved)
    lengths = Lengths(
        gain + ca.dot(part.slope, step),
        most_of(
            walls.pairs.distances(v), walls.pairs.of_pairs(step), left, so_far.primal
        ),
        most_of(kept["z"], z, left, so_far.dual),
    )
    return {"w": inner, "m": after - kept["m"], "z": z}, lengths


class Measures(NamedTuple):
    """Measures of a point.

    Attributes:
        sums: The sums that SUMS names, in that order.
        tops: The largest absolute values that TOPS names, in that order.
    """

    sums: ca.SX
    tops: ca.SX


def measured(place: Place, rho: ca.SX, dual: ca.SX, own: ca.SX, gap: ca.SX) -> Measures:
    """Return the sums and largest values of a part.

    Args:
        place: The part.
        rho: Price of broken rows.
        dual: Residual of stationarity by the part's state and further variables.
        own: Residual of stationarity by the part's own variables, without rows and
            barriers.
        gap: The gap to the next state.
    """
    walls, v, kept = place.walls, place.v, place.kept
    z, m = kept["z"], kept["m"]
    force = walls.pressure(m) + walls.price(rho) - walls.pairs.pushed(z)
    force += ca.vertcat(own, ca.SX.zeros(walls.inner, 1))
    excess = place.excess
    elastic = picked(v, walls.elastic)
    absolute = {
        "dual": ca.vertcat(dual, force),
        "primal": ca.vertcat(gap, excess),
        "gap": z * walls.pairs.distances(v),
        "pressure": m,
        "excess": elastic,
    }
    sums = {
        "cost": place.cost,
        "theta": ca.sum1(ca.fabs(gap)) + ca.sum1(ca.fabs(excess)),
        "logs": walls.pairs.logs(v),
        "elastic": ca.sum1(elastic),
        "duals": ca.sum1(ca.fabs(m)) + ca.sum1(z),
    }
    return Measures(
        ca.vertcat(*(sums[name] for name in SUMS)),
        ca.vertcat(*(
            largest(map(ca.fabs, ca.vertsplit(absolute[name])), ca.SX(0))
            if absolute[name].numel() else ca.SX(0)
            for name in TOPS
        )),
    )  # fmt: skip


def forces(place: Place, more: ca.SX) -> ca.SX:
    """Return the gradient of a part's Lagrangian by state and controls.

    The Lagrangian is the cost, plus the rows times their multipliers, plus `more`.
    """
    return ca.gradient(
        place.cost + ca.dot(place.kept["m"], place.walls.rows) + more, place.z
    )


def of_lane(place: Place) -> dict[str, ca.SX]:
    """Return the variables that a part keeps, by their names in a lane's memory."""
    return {f"{place.name}.{name}": one for name, one in place.kept.items()}
