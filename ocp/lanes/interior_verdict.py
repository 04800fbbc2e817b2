"""Judgement of a step of an interior-point method, and what a lane does next.

The measures of a trial point are cost; theta (the sum of the absolute residuals of all
equations); logs (-sum(log(d)), d the distances to bounds); elastic (the sum of elastic
variables); and duals (the sum of the duals z and of all multipliers' absolute values).
Further measures are the largest dual residual, primal residual, gap d z, multiplier of
a row (pressure) and elastic variable (excess). The barrier's value is

    phi = cost + mu logs + rho elastic

with mu the parameter of the central path and rho the price of elastic variables. A step
is accepted by the filter of Wächter and Biegler, of which the last `_FILTER` entries
are kept. Second-order corrections and the restoration of IPOPT are left out: with
elastic variables these made no lane better in the problems tried. mu falls when the
scaled error is below ten mu. rho grows tenfold if a multiplier comes near it.
"""

from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.lanes.barrier import largest
from swarmstart.ocp.lanes.interior_newton import (
    SUMS,
    TOPS,
    Lengths,
    folded,
    forces,
    measured,
    of_lane,
    stepped,
)
from swarmstart.ocp.lanes.interior_parts import Place, Places
from swarmstart.ocp.lanes.kernels import Named, all_of, any_of, symbols

FEASIBLE = 1e-7
"""Largest elastic variable, and gap, at which a lane is done."""
_FILTER = 8
_GAMMA_THETA, _GAMMA_PHI, _ETA = 1e-5, 1e-8, 1e-8
_POWER_THETA, _POWER_PHI = 1.1, 2.3
_LEAST_ALPHA, _SHORTEST = 0.05, 1e-12
ROUNDING = 2e-15
"""Rounding error of the barrier's value, relative to it."""
_KAPPA_ERROR, _KAPPA_MU, _POWER_MU = 10.0, 0.2, 1.5
_FALLS = 3
"""Largest number of times that mu falls after one step."""
_LAST = 1.001
_SCALED = 100.0
_NEAR_PRICE, _GROWS, _MOST_RHO = 0.9, 10.0, 1e8
_FIRST_DELTA, _LEAST_DELTA, _MOST_DELTA = 1e-4, 1e-20, 1e20
_FASTER, _FAST, _EASED = 100.0, 8.0, 3.0
_FAILURES = 8
"""Number of failed line searches after which a lane is given up."""
_FINITE = 1e300

AIMED = (
    "delta", "delta_last", "alpha", "alpha_dual", "tries", "gain", "least_alpha",
    "sweeps",
)  # fmt: skip
"""Numbers of a lane that follow from a sweep."""
JUDGED = (
    *AIMED, "mu", "rho", "y", "x0", "end", "theta", "phi", "cost", "logs", "elastic",
    "theta_most", "theta_least", "begun", "iterations", "failures", "worst", "paid",
    "filter_theta", "filter_phi", "filter_next", "met",
)  # fmt: skip
"""Numbers of a lane that follow from a trial, besides those of its ends."""


def aimed(end: Place) -> tuple[Named, Named]:
    """Return the symbols that a lane reads after a sweep, and what it writes.

    A sweep computes Newton's step in all intervals. After it the lane writes the new
    numbers in `AIMED`, and the steps of the variables at the end.

    Args:
        end: The end of the horizon, as a part.
    """
    lane = symbols(
        mu=1, rho=1, delta=1, delta_last=1, gain_end=1, primal_end=1, dual_end=1,
        wrong=1, theta=1, theta_least=1, sweeps=1,
    )  # fmt: skip
    moved = ca.SX.sym("moved", end.x.numel())
    so_far = Lengths(lane["gain_end"], lane["primal_end"], lane["dual_end"])
    part = folded(end, lane["mu"], lane["rho"], lane["delta"])
    steps, lengths = stepped(end, part, moved, end.own, lane["mu"], so_far)
    theta, delta, last = lane["theta"], lane["delta"], lane["delta_last"]
    # NaN counts as wrong, too.
    right = all_of(lane["wrong"] <= 0, ca.fabs(lengths.gain) < _FINITE)
    first = ca.if_else(last > 0, ca.fmax(_LEAST_DELTA, last / _EASED), _FIRST_DELTA)
    fast = any_of(last <= 0, 1e5 * last < delta)
    more = ca.if_else(delta > 0, delta * ca.if_else(fast, _FASTER, _FAST), first)
    fall = ca.fmax(-lengths.gain, 0)
    safe = ca.if_else(fall > 0, fall, 1)
    least = ca.fmin(_GAMMA_THETA, _GAMMA_PHI * theta / safe)
    power = ca.fmax(theta, 1e-300) ** _POWER_THETA / safe**_POWER_PHI
    least = ca.if_else(theta <= lane["theta_least"], ca.fmin(least, power), least)
    least = _LEAST_ALPHA * ca.if_else(fall > 0, least, _GAMMA_THETA)
    # If theta is 0, or nearly, no length is too short: halving would never end.
    least = ca.fmax(least, _SHORTEST)
    given_up = more > _MOST_DELTA
    aim = {
        "delta": ca.if_else(right, delta, more),
        "delta_last": ca.if_else(all_of(right, delta > 0), delta, last),
        # A lane that finds no step fails at the next trial.
        "alpha": ca.if_else(right, lengths.primal, 0),
        "alpha_dual": ca.if_else(right, lengths.dual, 0),
        "tries": any_of(right, given_up),
        "gain": ca.if_else(right, lengths.gain, 0),
        "least_alpha": ca.if_else(right, least, 1),
        "sweeps": lane["sweeps"] + 1,
    }
    writes = {f"d.end.{name}": one for name, one in steps.items()}
    writes |= {f"aim.{name}": aim[name] for name in AIMED}
    return {"end": end.x, **of_lane(end), "d.end": moved, **lane}, writes


def judged(
    places: Places, tolerance: float, most: int, rounding: float = ROUNDING
) -> tuple[Named, Named]:
    """Return the symbols that a lane reads after a trial step, and what it writes.

    It writes the new numbers in `JUDGED`, the new variables at both ends, how much of
    the step is taken, and whether the lane is done.

    Args:
        places: The parts of the problem.
        tolerance: Largest scaled error at which a lane ends.
        most: Largest number of steps of a lane.
        rounding: Rounding error of the barrier's value, relative to it.
    """
    ends = _Ends(places)
    writes = _Judged(ends, tolerance, most, _count(places), rounding).writes()
    return ends.reads, writes


def _count(places: Places) -> int:
    """Return the number of multipliers and duals."""
    each = places.interval.walls
    count = places.N * (places.nx + each.height + each.pairs.count)
    for place in (places.end, places.begin):
        count += place.walls.height + place.walls.pairs.count
    return max(count, 1)


class _Ends:
    """The trial point at both ends, and its measures."""

    def __init__(self, places: Places) -> None:
        """Measure the ends at the trial point."""
        nx = places.nx
        self.places, self.reads = places, dict[str, ca.SX]()
        lane = symbols(
            alpha=1, alpha_dual=1, rho=1, mu=1, end_new=nx, x0_new=nx, pending_end=nx,
            force_start=nx, sums_new=len(SUMS), tops_new=len(TOPS), end=nx, x0=nx,
        )  # fmt: skip
        self.lane = lane
        self.sums, self.tops = lane["sums_new"], lane["tops_new"]
        self.trial, self.old = dict[str, ca.SX](), dict[str, ca.SX]()
        for place in (places.end, places.begin):
            old = dict(of_lane(place))
            if place is places.begin:
                old["y"] = place.own

            steps = symbols(**{f"d.{name}": one.numel() for name, one in old.items()})
            new = {
                name: one
                + lane["alpha_dual" if name.endswith(".z") else "alpha"]
                * steps[f"d.{name}"]
                for name, one in old.items()
            }
            at_start = place is places.begin
            force = forces(place, ca.SX(0))
            force += lane["force_start" if at_start else "pending_end"]
            none = ca.SX(0, 1)
            found = measured(
                place,
                lane["rho"],
                none if at_start else force,
                places.tied.T @ force if at_start else none,
                none,
            )
            x = lane["x0_new" if at_start else "end_new"]
            sums, tops = ca.substitute(
                list(found), [place.x, *old.values()], [x, *new.values()]
            )
            self.sums, self.tops = self.sums + sums, ca.fmax(self.tops, tops)
            self.reads |= {**old, **steps}
            self.old |= old
            self.trial |= new
        self.reads |= lane


class _Path(NamedTuple):
    """The next parameters of the central path.

    Attributes:
        mu: Parameter of the central path.
        rho: Price of broken rows.
        is_new: Whether `mu` or `rho` has changed.
        arrived: Whether the lane is at an optimum.
    """

    mu: ca.SX
    rho: ca.SX
    is_new: ca.SX
    arrived: ca.SX


class _Judged:
    """The judgement of a trial."""

    def __init__(
        self, ends: _Ends, tolerance: float, most: int, count: int, rounding: float
    ) -> None:
        """Judge the trial."""
        self._ends, self._tolerance, self._most, self._count, self._rounding = (
            ends, tolerance, most, count, rounding,
        )  # fmt: skip
        sizes = {
            "delta": 1, "delta_last": 1, "tries": 1, "gain": 1, "least_alpha": 1,
            "sweeps": 1, "theta": 1, "phi": 1, "cost": 1, "logs": 1, "elastic": 1,
            "theta_most": 1, "theta_least": 1, "begun": 1, "iterations": 1,
            "failures": 1, "worst": 1, "paid": 1, "filter_theta": _FILTER,
            "filter_phi": _FILTER, "filter_next": 1, "met": 1,
        }  # fmt: skip
        self._now = symbols(**sizes) | ends.lane
        ends.reads |= self._now

    def _accepted(self, theta: ca.SX, phi: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return whether a trial is accepted, and whether the filter is extended."""
        now = self._now
        # Largest values ignore NaN, sums do not.
        duals = self._ends.sums[SUMS.index("duals")]
        finite = all_of(ca.fabs(phi) < _FINITE, theta < _FINITE, duals < _FINITE)
        fall, rounding = -now["gain"], self._rounding * ca.fabs(now["phi"])
        safe = ca.if_else(fall > 0, fall, 1)
        old = ca.fmax(now["theta"], 1e-300)
        steep = all_of(fall > 0, now["alpha"] * safe**_POWER_PHI > old**_POWER_THETA)
        descends = phi - now["phi"] - rounding <= -_ETA * now["alpha"] * fall
        better = any_of(
            theta <= (1 - _GAMMA_THETA) * now["theta"],
            phi - now["phi"] - rounding <= -_GAMMA_PHI * now["theta"],
        )
        by_cost = all_of(steep, now["theta"] <= now["theta_least"])
        good = ca.if_else(by_cost, descends, better)
        for i in range(_FILTER):
            good = all_of(
                good,
                any_of(theta < now["filter_theta"][i], phi < now["filter_phi"][i]),
            )
        good = all_of(good, theta <= now["theta_most"], now["alpha"] > 0)
        begins = now["begun"] <= 0
        accepted = all_of(finite, any_of(begins, good))
        return accepted, all_of(
            accepted, ca.logic_not(begins), ca.logic_not(all_of(steep, descends))
        )

    def _path(self, taken: ca.SX) -> _Path:
        """Return the next parameters, and whether the lane is at an optimum."""
        mu, rho = self._now["mu"], self._now["rho"]
        duals = self._ends.sums[SUMS.index("duals")]
        dual, primal, gap, pressure, excess = ca.vertsplit(self._ends.tops)
        scale = ca.fmax(_SCALED, duals / self._count) / _SCALED

        def error(mu: ca.SX | float) -> ca.SX:
            # The least d z is at least 0.
            return largest([primal, ca.fmax(gap - mu, 0) / scale], dual / scale)

        least = self._tolerance / 10
        # With the last mu only, so that the cost is as exact as the rest.
        solved = all_of(taken, error(0) <= self._tolerance, mu <= _LAST * least)
        near = all_of(taken, error(mu) <= _KAPPA_ERROR * mu)
        dear = all_of(any_of(near, solved), rho < _MOST_RHO)
        dear = all_of(dear, any_of(
            pressure > _NEAR_PRICE * rho, all_of(solved, excess > FEASIBLE),
        ))  # fmt: skip
        new_mu = mu
        for _ in range(_FALLS):
            falls = all_of(
                taken, error(new_mu) <= _KAPPA_ERROR * new_mu, new_mu > _LAST * least
            )
            lower = ca.fmin(_KAPPA_MU * new_mu, new_mu**_POWER_MU)
            new_mu = ca.if_else(falls, ca.fmax(least, lower), new_mu)
        return _Path(
            mu=new_mu,
            rho=ca.if_else(dear, rho * _GROWS, rho),
            is_new=any_of(new_mu < mu, dear),
            arrived=all_of(solved, ca.logic_not(dear)),
        )

    def writes(self) -> Named:
        """Return all values that the judgement writes."""
        now, ends = self._now, self._ends
        cost, theta, logs, elastic, _ = ca.vertsplit(ends.sums)
        _, primal, _, _, excess = ca.vertsplit(ends.tops)
        begins = now["begun"] <= 0
        phi = cost + now["mu"] * logs + now["rho"] * elastic
        taken, extends = self._accepted(theta, phi)
        path = self._path(taken)
        shorter = 0.5 * now["alpha"]
        failed = all_of(
            ca.logic_not(taken),
            any_of(ca.logic_not(shorter >= now["least_alpha"]), begins),
        )
        failures = now["failures"] + failed
        fresh = any_of(path.is_new, failed)
        chosen = {
            name: ca.if_else(taken, value, now[name])
            for name, value in (
                ("theta", theta), ("cost", cost), ("logs", logs), ("elastic", elastic),
            )
        }  # fmt: skip
        new_phi = chosen["cost"] + path.mu * chosen["logs"]
        new_phi += path.rho * chosen["elastic"]
        harder = ca.fmax(_GROWS * now["delta_last"], _FIRST_DELTA)
        harder = ca.fmax(harder, _GROWS * now["delta"])
        iterations = now["iterations"] + all_of(taken, ca.logic_not(begins))
        begun_theta = ca.fmax(1, theta)
        over = any_of(
            path.arrived,
            all_of(failed, begins),
            failures >= _FAILURES,
            iterations >= self._most,
        )
        start = all_of(begins, taken)
        after = {
            **chosen,
            "mu": path.mu,
            "rho": path.rho,
            "phi": new_phi,
            "begun": any_of(taken, now["begun"]),
            "theta_most": ca.if_else(start, 1e4 * begun_theta, now["theta_most"]),
            "theta_least": ca.if_else(start, 1e-4 * begun_theta, now["theta_least"]),
            "iterations": iterations,
            "failures": failures,
            "tries": ca.logic_not(any_of(taken, failed)),
            "alpha": shorter,
            "alpha_dual": now["alpha_dual"],
            "delta": ca.if_else(failed, harder, ca.if_else(taken, 0, now["delta"])),
            "delta_last": now["delta_last"],
            "gain": now["gain"],
            "least_alpha": now["least_alpha"],
            "sweeps": now["sweeps"],
            "paid": ca.if_else(taken, cost, now["paid"]),
            "worst": ca.if_else(taken, primal + excess, now["worst"]),
            # Without a delta the second derivatives of the last step show a minimum.
            "met": all_of(path.arrived, now["delta"] <= 0),
            "x0": ca.if_else(taken, now["x0_new"], now["x0"]),
            "end": ca.if_else(taken, now["end_new"], now["end"]),
            **self._filter(extends, fresh),
        }
        writes = {f"next.{name}": after[name] for name in JUDGED if name != "y"}
        writes |= {f"next.{name}": one for name, one in self._kept(taken).items()}
        return writes | {
            "taken": taken,
            "step": ca.if_else(taken, now["alpha"], 0),
            "step_dual": ca.if_else(taken, now["alpha_dual"], 0),
            "done": over,
        }

    def _filter(self, extends: ca.SX, fresh: ca.SX) -> Named:
        """Return the filter after a step."""
        now, infinite = self._now, 1e300
        place, limits = now["filter_next"], {
            "filter_theta": (1 - _GAMMA_THETA) * now["theta"],
            "filter_phi": now["phi"] - _GAMMA_PHI * now["theta"],
        }  # fmt: skip
        found = {}
        for name, limit in limits.items():
            entries = [
                ca.if_else(all_of(extends, place == i), limit, now[name][i])
                for i in range(_FILTER)
            ]
            found[name] = ca.vertcat(
                *(ca.if_else(fresh, infinite, one) for one in entries)
            )
        following = ca.if_else(place >= _FILTER - 1, 0, place + 1)
        moved = ca.if_else(extends, following, place)
        return {**found, "filter_next": ca.if_else(fresh, 0, moved)}

    def _kept(self, taken: ca.SX) -> Named:
        """Return the new values of the variables at both ends."""
        ends, mu = self._ends, self._now["mu"]
        new = dict(ends.trial)
        for place in (ends.places.end, ends.places.begin):
            own = new["y"] if place is ends.places.begin else ca.SX(0, 1)
            name = f"{place.name}.z"
            v = ca.vertcat(own, new[f"{place.name}.w"])
            new[name] = place.walls.pairs.limited(v, new[name], mu)
        return {
            name: ca.if_else(taken, one, ends.old[name]) for name, one in new.items()
        }
