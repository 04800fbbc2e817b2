"""The machine code of an interior-point method in lanes.

The method is IPOPT's: Newton's step towards the central path of parameter mu, whose
length a filter chooses. The system of all intervals is solved from the end to the start
by a Riccati recursion (the sweep). The pivots of the recursion are positive if and only
if the step is one of descent; else a number delta is added to all second derivatives,
which is raised until they are positive.

Two groups of kernels take turns. A step: `last`, `backward`, `start`, `along`, `aim`. A
trial of a length: `move`, `trial`, `verdict`, `keep`. Names stand for rows of the
memory of a lane (interior.py). Names that begin with "d." are the step; those that
begin with "next." and "aim." are new values, after a trial and after a sweep.

Source: Wächter and Biegler (2006), On the implementation of an interior-point filter
line-search algorithm for large-scale nonlinear programming; Rao, Wright and Rawlings
(1998), Application of interior-point methods to model predictive control, the
recursion.
"""

from collections.abc import Iterator
from typing import Generic, NamedTuple, TypeVar

import casadi as ca

from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.scan import Role
from swarmstart.ocp.lanes.barrier import inside, largest
from swarmstart.ocp.lanes.interior_newton import (
    SUMS,
    TOPS,
    Lengths,
    folded,
    forces,
    measured,
    of_lane,
    quadratic,
    stepped,
)
from swarmstart.ocp.lanes.interior_parts import Place, Places, SteppedPlace
from swarmstart.ocp.lanes.interior_verdict import aimed, judged
from swarmstart.ocp.lanes.kernels import (
    Kernel,
    Named,
    Written,
    cholesky_solved,
    lower,
    simplified_function,
    symbols,
    symmetric,
    triangle,
    written_flat,
)

OF_LANE = "parameters", "unit"
"""Given numbers that each lane has."""
WILD = 1e3
"""Largest scaled state that a roll-out of a start may lead to."""


OneKernel = TypeVar("OneKernel", Kernel, Written)


class Interior(NamedTuple, Generic[OneKernel]):
    """The kernels of a lane; the first three prepare its start."""

    first: OneKernel
    prepare: OneKernel
    finish: OneKernel
    last: OneKernel
    backward: OneKernel
    start: OneKernel
    along: OneKernel
    aim: OneKernel
    move: OneKernel
    trial: OneKernel
    verdict: OneKernel
    keep: OneKernel


def written_interior(
    places: Places, *, own_signals: bool, tolerance: float, most: int, longest: int
) -> Iterator[Written]:
    """Yield the kernels of a problem in the order of `Interior`, not yet compiled.

    Args:
        places: The parts of the problem.
        own_signals: Whether each lane has its own signals.
        tolerance: Largest scaled error at which a lane ends.
        most: Largest number of steps of a lane.
        longest: Largest number of instructions of an interval's part of a kernel.

    Raises:
        NoCompilerError: If a kernel is too long.
    """
    maker = _Maker(places, own_signals, longest)
    yield maker.first()
    yield maker.prepare()
    yield maker.finish()
    yield maker.last()
    yield maker.backward()
    yield maker.start()
    yield maker.along()
    yield maker.flat(places.end, *aimed(places.end))
    yield maker.move()
    yield maker.trial()
    yield maker.of_ends(*judged(places, tolerance, most))
    yield maker.keep()


def small_interior(
    places: Places, *, tolerance: float, rounding: float, most: int, longest: int
) -> dict[str, Written]:
    """Return the kernels of a lane whose integrator is computed elsewhere.

    The kernels are short, since they do not contain the integrator. Without it they
    cannot compute the states of a start from its controls. So `settle`, which takes
    given states, replaces `prepare`.

    Args:
        places: The parts of the problem; their `interval` is a `SteppedPlace`.
        tolerance: Largest scaled error at which the lane ends.
        rounding: Rounding error of the barrier's value, relative to it.
        most: Largest number of steps of the lane.
        longest: Largest number of instructions of an interval's part of a kernel.

    Raises:
        NoCompilerError: If a kernel is too long.
    """
    maker = _Maker(places, own_signals=False, longest=longest)
    return {
        "first": maker.first(),
        "settle": maker.settle(),
        "finish": maker.finish(),
        "last": maker.last(),
        "backward": maker.backward(),
        "start": maker.start(),
        "along": maker.along(),
        "aim": maker.flat(places.end, *aimed(places.end)),
        "move": maker.move(),
        "trial": maker.trial(),
        "verdict": maker.of_ends(*judged(places, tolerance, most, rounding)),
        "keep": maker.keep(),
    }


def compile_interior(
    places: Places, *, own_signals: bool, tolerance: float, most: int, longest: int
) -> Interior[Kernel]:
    """Return the machine code of a problem's kernels; see `written_interior`.

    Raises:
        UnknownOperationError: If a function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here, or would be too long.
    """
    written = written_interior(
        places, own_signals=own_signals, tolerance=tolerance, most=most, longest=longest
    )
    # One is compiled, in a thread, while the next one is written.
    return Interior(*(one.compiled() for one in written))


class _Maker:
    """Kernels of the parts of a problem."""

    def __init__(self, places: Places, own_signals: bool, longest: int) -> None:
        """Remember the parts."""
        self._places, self._own, self._longest = places, own_signals, longest
        self._nx = places.nx
        interval = places.interval
        self._xa, self._u = ca.vertsplit(
            interval.own, [0, self._nx, interval.own.numel()]
        )
        self._each = {
            "xa": self._xa, "u": self._u, "w": interval.kept["w"],
            "m": interval.kept["m"], "z": interval.kept["z"],
            "lam": ca.SX.sym("lam", self._nx),
        }  # fmt: skip
        self._step = symbols(**{f"d.{n}": s.numel() for n, s in self._each.items()})
        self._gap = interval.after - self._xa

    def of_ends(self, lane: Named, writes: Named) -> Written:
        """Return a kernel without intervals, with the given numbers of both ends."""
        return self._flat(
            {**self._places.end.known, **self._places.begin.known}, lane, writes
        )

    def flat(self, place: Place, lane: Named, writes: Named) -> Written:
        """Return a kernel without intervals that uses the given numbers of an end."""
        return self._flat(place.known, lane, writes)

    def _flat(self, known: Named, lane: Named, writes: Named) -> Written:
        own, shared = dict(lane), dict[str, ca.SX]()
        for name, one in known.items():
            kind = name.split(".")[1]
            is_own = kind in OF_LANE or (kind == "signals" and self._own)
            (own if is_own else shared)[name] = one
        return written_flat(own, shared, writes)

    def _scan(
        self,
        carried: Named,
        each: Named,
        lane: Named,
        writes: Named,
        *,
        backward: bool = False,
    ) -> Written:
        """Return a kernel of all intervals."""
        known = self._places.interval.known
        roles: dict[str, Role] = dict.fromkeys(OF_LANE, "individual")
        roles["signals"] = "both" if self._own else "interval"
        named = {**carried, **each, **lane, **known}
        given: list[Role] = ["carried"] * len(carried)
        given += ["both"] * len(each)
        given += ["individual"] * len(lane)
        given += [roles.get(name.split(".")[1], "shared") for name in known]
        function = simplified_function(named, writes)
        require_short(function.n_instructions(), self._longest)
        return Written(
            function, tuple(given), self._places.N, backward, tuple(named),
            tuple(writes),
        )  # fmt: skip

    def first(self) -> Written:
        """Return the kernel that moves the decided initial states inside bounds."""
        begin = self._places.begin
        lane = symbols(fixed=self._nx, mu=1, rho=1)
        y = _pushed(begin, begin.own)
        x0 = lane["fixed"] + self._places.tied @ y
        writes = {"y": y, "x0": x0, "home": x0} | self._begun(
            begin, y, lane["mu"], lane["rho"]
        )
        writes = _at(begin, writes, x0)
        return self.flat(begin, {"y": begin.own, **lane}, writes)

    def _begun(
        self, place: Place, own: ca.SX, mu: ca.SX, rho: ca.SX
    ) -> dict[str, ca.SX]:
        w = place.walls.begun(place.walls.rows, mu, rho)
        pairs = place.walls.pairs
        z = mu / pairs.distances(ca.vertcat(own, w))
        return {f"{place.name}.w": w, f"{place.name}.z": z}

    def prepare(self) -> Written:
        """Return the kernel that makes a start's states and controls, inside bounds.

        A lane whose `rolled` is set takes the states that its controls lead to; a state
        is replaced by x0 (`home`) if it, or the state one interval later, has an entry
        of size WILD or more. Any other lane takes the given states.
        """
        interval = self._places.interval
        lane = symbols(rolled=1, mu=1, rho=1, home=self._nx)
        xa, u = self._xa, _pushed(interval, interval.own)[self._nx :]
        after = ca.substitute(interval.after, self._u, u)
        # From a state just below WILD, the next interval may overflow.
        following = ca.substitute(interval.after, interval.z, ca.vertcat(after, u))
        tame = ca.SX(1)
        for one in ca.vertsplit(ca.vertcat(after, following)):
            tame = ca.logic_and(tame, ca.fabs(one) < WILD)
        led = ca.if_else(tame, after, lane["home"])
        start = ca.vertcat(ca.if_else(lane["rolled"], led, xa), u)
        start = ca.substitute(_pushed(interval, interval.own), interval.own, start)
        begun = self._begun(interval, start, lane["mu"], lane["rho"])
        begun |= {"cost": interval.cost, "steep": _steepness(interval)}
        begun = _at(interval, begun, ca.vertcat(interval.x, start[self._nx :]))
        spent, steep = symbols(spent=1, steep=1).values()
        writes = {
            "end": start[: self._nx], "spent": spent + begun["cost"],
            "steep": ca.fmax(steep, begun["steep"]), "x": interval.x,
            "xa": start[: self._nx], "u": start[self._nx :], "w": begun["interval.w"],
            "z": begun["interval.z"],
        }  # fmt: skip
        each = {"xa": xa, "u": self._u}
        carried = {"x0": interval.x, "no_cost": spent, "no_slope": steep}
        return self._scan(carried, each, lane, writes)

    def settle(self) -> Written:
        """Return the kernel that moves given states and controls inside bounds."""
        interval = self._places.interval
        lane = symbols(mu=1, rho=1)
        start = _pushed(interval, interval.own)
        begun = self._begun(interval, start, lane["mu"], lane["rho"])
        begun = _at(interval, begun, ca.vertcat(interval.x, start[self._nx :]))
        writes = {
            "end": start[: self._nx], "x": interval.x, "xa": start[: self._nx],
            "u": start[self._nx :], "w": begun["interval.w"],
            "z": begun["interval.z"],
        }  # fmt: skip
        each = {"xa": self._xa, "u": self._u, **self._given("F_new")}
        return self._scan({"x0": interval.x}, each, lane, self._at_trial(writes))

    def finish(self) -> Written:
        """Return the kernel of first slacks and duals at the end, and of cost size."""
        end, lane = self._places.end, symbols(mu=1, rho=1)
        writes = self._begun(end, end.own, lane["mu"], lane["rho"])
        so_far = symbols(spent=1, steep=1)
        size = ca.fmax(ca.fabs(so_far["spent"] + end.cost), _steepness(end))
        writes["size"] = ca.fmax(size, so_far["steep"])
        return self.flat(end, {"end": end.x, **so_far, **lane}, writes)

    def last(self) -> Written:
        """Return the kernel of derivatives at the end, from which `backward` begins.

        They are the gradient and the second derivatives of the end's cost, with rows
        and barriers, by the state.
        """
        end, lane = self._places.end, symbols(mu=1, rho=1, delta=1)
        Q, q = quadratic(end, folded(end, *lane.values()), ca.SX(0))
        writes = {"slope": q, "bend": lower(Q)}
        return self.flat(end, {"end": end.x, **of_lane(end), **lane}, writes)

    def backward(self) -> Written:
        """Return the kernel of the Riccati recursion, from the end to the start."""
        interval, nx = self._places.interval, self._nx
        nu = interval.u.numel()
        carried = symbols(slope=nx, bend=len(triangle(nx)), nothing=1)
        lane = symbols(mu=1, rho=1, delta=1)
        slope, bend, wrong = carried.values()
        part = folded(interval, *lane.values())
        Q, q = quadratic(interval, part, ca.dot(self._each["lam"], interval.after))
        given = self._given("F", "Gc", "J", "H")
        if given:
            Q += symmetric(given["H"], nx + nu)
        J = interval.slopes(interval.after)
        V = symmetric(bend, nx) + ca.diag(part.S[:nx])
        v = slope + part.slope[:nx]
        Q += J.T @ V @ J
        q += J.T @ (v + V @ self._gap)
        Quu = Q[nx:, nx:] + ca.diag(part.S[nx : nx + nu])
        qu, Qux = q[nx:] + part.slope[nx : nx + nu], Q[nx:, :nx]
        step, least = cholesky_solved(Quu, ca.horzcat(qu, Qux))
        k, K = -step[:, 0], -step[:, 1:]
        writes = {
            "slope_start": q[:nx] + Qux.T @ k,
            "bend_start": lower(Q[:nx, :nx] + Qux.T @ K),
            "wrong_start": ca.fmax(wrong, least <= 0),
            "k": k, "K": ca.vec(K), "V": lower(V), "v": v,
        }  # fmt: skip
        each = {"x": interval.x, **self._each, **given}
        return self._scan(carried, each, lane, writes, backward=True)

    def start(self) -> Written:
        """Return the kernel that computes the step of the decisions about the start."""
        begin, nx, tied = self._places.begin, self._nx, self._places.tied
        lane = symbols(mu=1, rho=1, delta=1)
        carried = symbols(
            slope_start=nx, bend_start=len(triangle(nx)), wrong_start=1, x0=nx
        )
        slope, bend, wrong, x0 = carried.values()
        part = folded(begin, *lane.values())
        Q, q = quadratic(begin, part, ca.SX(0))
        ny = begin.own.numel()
        H = tied.T @ (symmetric(bend, nx) + Q) @ tied + ca.diag(part.S[:ny])
        g = tied.T @ (slope + q) + part.slope[:ny]
        step, least = cholesky_solved(H, g)
        moved = tied @ -step
        none = Lengths(ca.SX(0), ca.SX(1), ca.SX(1))
        steps, lengths = stepped(begin, part, moved, -step, lane["mu"], none)
        writes = {"d.y": -step, "d.x0": moved, "wrong": ca.fmax(wrong, least <= 0)}
        writes |= {f"d.begin.{name}": one for name, one in steps.items()}
        writes |= {f"{name}_start": one for name, one in lengths._asdict().items()}
        reads = {"y": begin.own, **of_lane(begin), **lane, **carried}
        return self.flat(begin, reads, _at(begin, writes, x0))

    def along(self) -> Written:
        """Return the kernel that computes the steps of all intervals, in order."""
        interval, nx = self._places.interval, self._nx
        nu = interval.u.numel()
        carried = symbols(**{
            "d.x0": nx, "gain_start": 1, "primal_start": 1, "dual_start": 1,
        })  # fmt: skip
        dx, *so_far = carried.values()
        lane = symbols(mu=1, rho=1, delta=1)
        found = symbols(k=nu, K=nu * nx, V=len(triangle(nx)), v=nx)
        du = found["k"] + ca.reshape(found["K"], nu, nx) @ dx
        moved = ca.vertcat(dx, du)
        given = self._given("F", "Gc", "J")
        if given:
            after = interval.slopes(interval.after) @ moved + self._gap
        else:
            after = ca.jtimes(interval.after, interval.z, moved) + self._gap
        part = folded(interval, *lane.values())
        steps, lengths = stepped(
            interval, part, moved, ca.vertcat(after, du), lane["mu"], Lengths(*so_far)
        )
        lam = symmetric(found["V"], nx) @ after + found["v"] - self._each["lam"]
        writes = {"d.end": after}
        writes |= {f"{name}_end": one for name, one in lengths._asdict().items()}
        writes |= {"d.xa": after, "d.u": du, "d.lam": lam}
        writes |= {f"d.{name}": one for name, one in steps.items()}
        each = {"x": interval.x, **self._each, **found, **given}
        return self._scan(carried, each, lane, writes)

    def move(self) -> Written:
        """Return the kernel that computes the initial state of a trial point."""
        y = self._places.begin.own
        lane = symbols(**{
            "y": y.numel(), "d.y": y.numel(), "fixed": self._nx, "alpha": 1,
        })  # fmt: skip
        moved = lane["y"] + lane["alpha"] * lane["d.y"]
        writes = {"x0_new": lane["fixed"] + self._places.tied @ moved}
        return written_flat(lane, {}, writes)

    def trial(self) -> Written:
        """Return the kernel that computes the measures of a trial point."""
        interval, nx = self._places.interval, self._nx
        pending, before, sums, tops, begun = symbols(
            pending=nx, before=nx, sums=len(SUMS), tops=len(TOPS), begun=1
        ).values()
        lane = symbols(alpha=1, alpha_dual=1, rho=1)
        lam, given = self._each["lam"], self._given("F_new", "L_new", "G_new")
        force = forces(interval, ca.dot(lam, interval.after))
        if given:
            force += given["G_new"]
        of_x = force[:nx] + pending
        pushed = interval.walls.pairs.pushed(interval.kept["z"])[:nx]
        found = measured(
            interval,
            lane["rho"],
            # The state at the start is not free.
            ca.if_else(begun, of_x, 0 * of_x),
            # That of xa is complete in the next interval only: 0 here.
            ca.vertcat(pushed, force[nx:]),
            self._gap,
        )
        more = ca.vertcat(ca.SX.zeros(len(SUMS) - 1, 1), ca.sum1(ca.fabs(lam)))
        if given:
            more[SUMS.index("cost")] = given["L_new"]
        writes = {
            "end_new": self._xa,
            "pending_end": -lam - pushed,
            "force_start": ca.if_else(begun, before, of_x),
            "sums_new": sums + found.sums + more,
            "tops_new": ca.fmax(tops, found.tops),
            "begun_end": ca.SX(1),
        }
        writes = self._moved(writes, lane["alpha"], lane["alpha_dual"])
        writes = self._at_trial(writes)
        named = {
            "x0_new": interval.x, "nothing.x": pending, "nothing.force": before,
            "nothing.sums": sums, "nothing.tops": tops, "nothing": begun,
        }  # fmt: skip
        reads = {**self._each, **self._step, **given}
        return self._scan(named, reads, lane, writes)

    def _given(self, *names: str) -> dict[str, ca.SX]:
        """Return numbers that are computed elsewhere; none if the integrator is not."""
        interval = self._places.interval
        if not isinstance(interval, SteppedPlace):
            return {}
        return {name: interval.stepped[name] for name in names}

    def _at_trial(self, writes: Named) -> dict[str, ca.SX]:
        """Return expressions with the state after the interval at a trial point."""
        given = self._given("F", "F_new")
        if not given:
            return dict(writes)
        found = ca.substitute(list(writes.values()), [given["F"]], [given["F_new"]])
        return dict(zip(writes, found, strict=True))

    def _moved(
        self, writes: Named, alpha: ca.SX, alpha_dual: ca.SX
    ) -> dict[str, ca.SX]:
        """Return expressions at the point after a step."""
        old = list(self._each.values())
        new = [
            one + (alpha_dual if name == "z" else alpha) * self._step[f"d.{name}"]
            for name, one in self._each.items()
        ]
        found = ca.substitute(list(writes.values()), old, new)
        return dict(zip(writes, found, strict=True))

    def keep(self) -> Written:
        """Return the kernel that takes an accepted step; it writes in place."""
        interval = self._places.interval
        x, walls = ca.SX.sym("x_before", self._nx), interval.walls
        lane = symbols(taken=1, step=1, step_dual=1, mu=1)
        new = self._moved(self._each, lane["step"], lane["step_dual"])
        v = ca.vertcat(new["xa"], new["u"], new["w"])
        new["z"] = walls.pairs.limited(v, new["z"], lane["mu"])
        after = {
            name: ca.if_else(lane["taken"], one, self._each[name])
            for name, one in new.items()
        }
        writes = {"end_kept": after["xa"], "x": x, **after}
        reads = {**self._each, **self._step}
        return self._scan({"x0": x}, reads, lane, writes)


def require_short(instructions: int, most: int) -> None:
    """Raise NoCompilerError if a step over an interval has too many instructions."""
    if instructions > most:
        raise NoCompilerError(
            f"its steps are too long: expected at most {most} instructions in an "
            f"interval, found {instructions}"
        )


def _steepness(place: Place) -> ca.SX:
    """Return the largest derivative of a part's cost."""
    slope = ca.gradient(place.cost, place.z)
    return largest(map(ca.fabs, ca.vertsplit(slope)), ca.SX(0))


def _pushed(place: Place, own: ca.SX) -> ca.SX:
    """Return a part's own variables moved inside their bounds."""
    pairs, found = place.walls.own, ca.SX(own)
    limits = {
        (entry, sign): pairs.limit[number]
        for number, (entry, sign) in enumerate(zip(pairs.of, pairs.sign, strict=True))
    }
    for entry in set(pairs.of):
        low, high = limits.get((entry, 1.0)), limits.get((entry, -1.0))
        found[entry] = inside(found[entry], low, high)
    return found


def _at(place: Place, writes: Named, z: ca.SX) -> dict[str, ca.SX]:
    """Return expressions with another state, and controls, in a part's place."""
    found = ca.substitute(list(writes.values()), [place.z], [z])
    return dict(zip(writes, found, strict=True))
