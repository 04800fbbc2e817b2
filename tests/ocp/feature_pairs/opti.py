"""A stated problem solved by CasADi's Opti, by multiple shooting and IPOPT."""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.ocp.feature_pairs.peer import Peer, Point
from swarmstart.tests.ocp.feature_pairs.stated import Limited, Stated

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-10,
    "ipopt.max_iter": 500,
}


class Solved(NamedTuple):
    """An answer of Opti: whether IPOPT converged, the cost, and what is decided."""

    success: bool
    cost: float
    point: Point


def solved_by_opti(peer: Peer, point: Point) -> Solved:
    """Return what IPOPT finds from controls and the states they lead to."""
    stated, N = peer.stated, peer.stated.intervals
    opti = ca.Opti()
    x, u = opti.variable(peer.nx, N + 1), opti.variable(peer.nu, N)
    opti.set_initial(x, peer.value(point, (0.0, 0.0))[2])
    opti.set_initial(u, point.controls)
    chosen, length = _decisions(opti, stated, point)
    p = peer.parameters_with(chosen)
    for i, (low, high) in enumerate(zip(*stated.limits, strict=True)):
        opti.subject_to(opti.bounded(low, u[i, :], high))
    _start(opti, stated, x, point.x0)
    F, limits, soft = peer.interval
    # An equality that stays is held once: again, it would count as another equation.
    new = [i for i, c in enumerate(limits)
           if c not in limits[:i] or not peer.is_settled(c)]  # fmt: skip
    cost, before = ca.MX(0), ca.MX(ca.DM(stated.previous))
    for k in range(N):
        after, spent, rows, above = F(
            x[:, k], u[:, k], p, peer.nodes(k), peer.begun(k, length), before,
            length / N, peer.late(u, k),
        )  # fmt: skip
        before = u[:, k] if stated.before.numel() else before
        opti.subject_to(x[:, k + 1] == after)
        cost += spent + length / N * _price(opti, above, soft)
        _hold(opti, [rows[i] for i in new], [limits[i] for i in new])
    ends, last = peer.at_ends(x[:, 0], x[:, N], p, length)
    _hold(opti, last, [*peer.at_start, *stated.ends])
    for i in stated.periodic:
        opti.subject_to(x[i, N] == x[i, 0])
    opti.minimize(cost + ends)
    opti.solver("ipopt", OPTIONS)
    try:
        opti.solve()
    except RuntimeError:
        pass  # Whether it converged is asked below.
    found = Point(
        np.array(opti.debug.value(u)).reshape(peer.nu, N),
        np.array(opti.debug.value(x[:, 0])).ravel(),
        np.array(opti.debug.value(chosen)).ravel(),
        float(opti.debug.value(length)),
    )
    success = bool(opti.stats()["success"])
    return Solved(success, float(opti.debug.value(cost + ends)), found)


def _decisions(opti: ca.Opti, stated: Stated, point: Point) -> tuple[Any, Any]:
    """Return the variables of decided parameters and of the end time."""
    chosen: list[Any] = []
    for (_, low, high), first in zip(
        stated.decided.values(), point.decided, strict=True
    ):
        chosen.append(opti.variable())
        opti.subject_to(opti.bounded(low, chosen[-1], high))
        opti.set_initial(chosen[-1], first)
    column = ca.vertcat(ca.MX(0, 1), *chosen)
    if stated.end_time is None:
        return column, ca.MX(point.length)
    length = opti.variable()
    opti.set_initial(length, point.length)
    opti.subject_to(opti.bounded(stated.end_time[0], length, stated.end_time[1]))
    return column, length


def _start(opti: ca.Opti, stated: Stated, x: Any, x0: Array) -> None:
    """Fix the state at the start, but what is decided of it."""
    free = {i for together in stated.start for i in together}
    for i in range(x0.size):
        if i not in free:
            opti.subject_to(x[i, 0] == x0[i])
    for together, (low, high) in stated.start.items():
        for i in together:
            least, most = stated.bounds.get(i, (-np.inf, np.inf))
            opti.subject_to(opti.bounded(max(low, least), x[i, 0], min(high, most)))
        for i in together[1:]:
            opti.subject_to(x[i, 0] == x[together[0], 0])


def _hold(opti: ca.Opti, rows: list[Any], limits: list[Limited]) -> None:
    for row, one in zip(rows, limits, strict=True):
        if not isinstance(row, ca.MX) or row.is_constant():
            continue  # The start that is given.
        if one.lower == one.upper:
            opti.subject_to(row == one.upper)
        else:
            opti.subject_to(opti.bounded(one.lower, row, one.upper))


def _price(opti: ca.Opti, rows: Any, limits: list[Limited]) -> Any:
    """Return the price per second of the slacks of soft rows, in an interval."""
    slacks: dict[int, Any] = {}
    cost = ca.MX(0)
    for i, one in enumerate(limits):
        linear, quadratic = one.prices or (0.0, 0.0)
        if id(one) not in slacks:
            e = slacks[id(one)] = opti.variable()
            opti.subject_to(e >= 0)
            cost += linear * e + quadratic * e**2
        opti.subject_to(rows[i] - slacks[id(one)] <= one.upper)
        if np.isfinite(one.lower):
            opti.subject_to(rows[i] + slacks[id(one)] >= one.lower)
    return cost
