"""Many initial states of the shipped problems, against multi-start IPOPT in one run.

    python benchmarks/initial_states.py [--write docs/measured/initial_states.md]
        [--instances 200] [--solves 40] [--only pendulum]

Seconds are CPU time of the process, with one thread; the second of two equal calls of
`solve_many` counts, which builds and compiles nothing, as the peer's calls.
"""

import time
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.spatial import KDTree

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.mpc_step import PlainNlp, cold_ipopt, warm_ipopt
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.ocp import (
    Known,
    OptimalControlProblem,
    Planner,
    Solutions,
    Source,
    verified,
)

SAME = 1e-4
"""Relative difference up to which an answer costs as much as the peer's."""
STARTS = 5
"""Number of starts of the peer from each initial state."""
COLD, WARM = 30.0, 8.0
"""Asked: times as fast as plain CasADi from one start, or a neighbour's answer."""


def _between(lower: float, upper: float) -> dict[str, list[float]]:
    return {"uniform": [lower, upper]}


DRAWN: Mapping[str, Mapping[str, Any]] = {
    "pendulum": {"angle": _between(-3, 3), "speed": _between(-2, 2)},
    "pendulum_on_cart": {
        "position": _between(-1, 1), "theta": _between(0, 6.28),
        "velocity": _between(-1, 1), "dtheta": _between(-1, 1),
    },
    "van_der_pol": {"position": _between(-2, 2), "velocity": _between(-2, 2)},
    "hypersensitive": {"x": _between(-2, 2)},
    "lotka_volterra_fishing": {
        "prey": _between(0.3, 1.5), "predators": _between(0.3, 1.5)
    },
    "two_reaction_reactor": {
        "temperature": _between(-0.05, 0.15), "concentration": _between(-0.1, 0.2)
    },
    "batch_reactor": {
        "X_s": _between(0.5, 1.5), "S_s": _between(0.2, 1.0), "V_s": _between(100, 140)
    },
    "brachistochrone": {
        "x": _between(-1, 1), "y": _between(-1, 1), "v": _between(0, 2)
    },
    "goddard_rocket": {
        "h": _between(1, 1.005), "v": _between(0, 0.03), "m": _between(0.9, 1)
    },
    "four_discs": {
        "x": _between(-0.5, 0.8), "y": _between(-1, 1), "heading": _between(-0.8, 0.8)
    },
}  # fmt: skip
"""Distributions of the initial states of ten shipped problems."""
TEXT = f"""# Many initial states of one problem

Made by `python benchmarks/initial_states.py --write docs/measured/initial_states.md`:
`solve_many` on ten shipped problems, each from 200 random initial states. The peer is
plain CasADi: direct multiple shooting with the same Runge-Kutta steps, expanded to
scalar operations, and IPOPT with its defaults. IPOPT is run at 40 of the initial states
of each problem, from {STARTS} starts each: states held at the initial state, controls
first in the middle of their bounds and then at random. An answer counts only if a finer
integration confirms it; the best such answer is compared. "IPOPT solves" is the number
of initial states with such an answer, "as good" the share of these at which
`solve_many` has a confirmed answer whose cost exceeds IPOPT's by at most {SAME:g} of
its absolute value. "Ours" is the CPU time for one initial state, with all starts and
the verification. "Cold" is the time of IPOPT from the first of its starts, "warm" its
time if it starts at the answer, with multipliers, to the nearest other initial state.
On four_discs all answers of IPOPT but one cut the discs between the checks.

"""


class Compared(NamedTuple):
    """Results of one problem.

    Attributes:
        name: Its name.
        ours_ms: CPU time of an instance [ms].
        cold_ms: That of IPOPT from one start [ms].
        warm_ms: That of IPOPT from a neighbour's answer [ms].
        confirmed: Number of confirmed answers.
        solved: Number of initial states that the peer solves, of those compared.
        as_good: Share of these at which an answer is as good.
        better: Share of these at which it costs less by more than SAME.
    """

    name: str
    ours_ms: float
    cold_ms: float
    warm_ms: float
    confirmed: int
    solved: int
    as_good: float
    better: float


class Peer:
    """Multi-start IPOPT on the core of a problem, built at its first call.

    Attributes:
        core: The core.
        free: Mask of the states whose start is decided.
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        """State the NLP; decided starts are free within their limits.

        Args:
            problem: The problem.
        """
        self._planner = Planner(problem, search=None, polish=None)
        core = self.core = self._planner.problem
        decided = [i for one in core.free_starts for i in one.states]
        self.free = np.isin(np.arange(core.model.nx), decided)
        self._limits = tuple(one[:, None] for one in core.control_limits)
        limits = [core.control_limits, core.search_limits]
        self._drawn = next(one for one in limits[::-1] if np.isfinite(one).all())

    @cached_property
    def _nlp(self) -> PlainNlp:
        return PlainNlp(self.core)

    @cached_property
    def _cold(self) -> ca.Function:
        return cold_ipopt(self._nlp)

    @cached_property
    def _warm(self) -> ca.Function:
        return warm_ipopt(self._nlp)

    def build(self) -> None:
        """Build both solvers now."""
        _ = self._cold, self._warm

    def starts(self, x0: Array, rng: np.random.Generator) -> list[Array]:
        """Return starts of the NLP from an initial state.

        Args:
            x0: Initial state of the core, shape (nx,).
            rng: Source of the drawn controls.
        """
        lower, upper = self._drawn
        controls = [(lower + upper) / 2]
        controls += [rng.uniform(lower, upper) for _ in range(STARTS - 1)]
        N = self.core.intervals
        return [np.r_[np.tile(np.r_[x0, u], N), x0] for u in controls]

    def confirms(self, x0: Array, found: Mapping[str, ca.DM], known: Known) -> bool:
        """Return whether the finer path confirms an answer, as it must ours.

        Args:
            x0: Initial state of the core, shape (nx,).
            found: The answer of the NLP.
            known: Known data of the core.
        """
        model, w = self.core.model, np.array(found["x"]).ravel()
        columns = w[model.nx :].reshape(self.core.intervals, model.nu + model.nx)
        start = np.where(self.free, w[: model.nx], x0)
        controls = np.clip(columns[:, : model.nu].T, *self._limits)
        plan = self._planner.evaluated(
            controls, start, known=known, source=Source.POLISH
        )
        answer = verified(self._planner.tracer, plan, start, known, advised=False)
        return answer.status.is_confirmed

    def __call__(
        self, x0: Array, start: Array, last: Mapping[str, ca.DM] | None = None
    ) -> tuple[float, Mapping[str, ca.DM]]:
        """Return the cost, infinite without an answer, and the answer of the NLP.

        Args:
            x0: Initial state of the core, shape (nx,).
            start: Start of the NLP.
            last: A neighbour's answer to start from.
        """
        solver = self._cold if last is None else self._warm
        more = {} if last is None else {
            "lam_g0": last["lam_g"], "lam_x0": last["lam_x"]
        }  # fmt: skip
        bounds = {name: one.copy() for name, one in self._nlp.bounds.items()}
        nx = x0.size
        for side, sign in (("lbg", -1.0), ("ubg", 1.0)):
            first = bounds[side][nx : 2 * nx]  # The rows x - x0, after the first gap.
            first[self.free] = sign * np.inf
        for one in self.core.free_starts:
            for i in one.states:
                bounds["lbx"][i], bounds["ubx"][i] = one.value.lower, one.value.upper
        found = solver(x0=start, p=x0, **bounds, **more)
        is_solved = solver.stats()["success"]
        return (float(found["f"]) if is_solved else np.inf), found


def compared(name: str, instances: int, solves: int) -> Compared:
    """Return the results of `solve_many` and of the peer on a problem.

    Args:
        name: Name of the shipped problem.
        instances: Number of initial states.
        solves: Number of those that the peer solves.
    """
    drawn = {"instances": {"drawn": DRAWN[name], "samples": instances, "seed": 1}}

    first = ss.sweep(name, seed=0, settings=drawn, threads=1, progress=False)
    data = first.data
    known = Known(data.parameters, data.signals, time=data.time, previous=data.previous)

    def ours() -> Solutions:
        return ss.solve_many(
            first.problem, data.x0, known=known, guesses=data.guesses, seed=0,
            threads=1, progress=False,
        )  # fmt: skip

    ours()  # Builds and compiles; the peer's NLP is built before as well.
    begin = time.process_time()
    many = ours()
    ours_ms = 1e3 * (time.process_time() - begin) / instances
    peer = Peer(many.problem)
    planner = Planner(many.problem, search=None, polish=None)
    posed = [
        planner.posed(many.data.x0[:, k], many.data.known(k))[:2]
        for k in range(instances)
    ]
    x0s = [np.asarray(x0, dtype=float) for x0, _ in posed]
    chosen = np.unique(np.linspace(0, instances - 1, solves).astype(int)).tolist()
    rng = np.random.default_rng(0)
    best, spent = np.full(instances, np.inf), np.zeros(2)
    peer.build()
    answers: dict[int, Mapping[str, ca.DM]] = {}
    for k in chosen:
        for number, start in enumerate(peer.starts(x0s[k], rng)):
            begin = time.process_time()
            cost, found = peer(x0s[k], start)
            spent[0] += (time.process_time() - begin) * (number == 0)
            if np.isfinite(cost):
                answers.setdefault(k, found)
            if cost < best[k] and peer.confirms(x0s[k], found, posed[k][1]):
                best[k] = cost
    numbers = np.array([*answers])
    tree = KDTree(many.data.x0[:, numbers].T)
    for k in chosen:
        _, near = tree.query(many.data.x0[:, k], k=[1, 2])
        last = next(answers[n] for n in numbers[near] if n != k)
        start = np.array(last["x"]).ravel()
        start[: x0s[k].size] = np.where(peer.free, start[: x0s[k].size], x0s[k])
        begin = time.process_time()
        peer(x0s[k], start, last)
        spent[1] += time.process_time() - begin
    cold_ms, warm_ms = 1e3 * spent / len(chosen)
    solved = np.flatnonzero(np.isfinite(best))
    costs = np.where(many.is_confirmed, many.core_answers.cost, np.inf)[solved]
    allowed = SAME * np.maximum(np.abs(best[solved]), 1e-6)
    return Compared(
        name=name,
        ours_ms=ours_ms,
        cold_ms=cold_ms,
        warm_ms=warm_ms,
        confirmed=int(many.is_confirmed.sum()),
        solved=solved.size,
        as_good=float(np.mean(costs <= best[solved] + allowed)),
        better=float(np.mean(costs < best[solved] - allowed)),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--instances", type=int, default=200, help="initial states")
    parser.add_argument("--solves", type=int, default=40, help="those of the peer")
    parser.add_argument("--only", choices=[*DRAWN], help="one problem only")
    options = parser.parse_args(arguments)
    found = []
    for name in [options.only] if options.only else DRAWN:
        one = compared(name, options.instances, options.solves)
        found.append(one)
        print(one, flush=True)
    lines = head("problem", "ours [ms]", "IPOPT, cold [ms]", "warm [ms]", "times",
                 "times warm", "confirmed", "IPOPT solves", "as good",
                 "better")  # fmt: skip
    lines += [
        row(one.name, *(f"{ms:.2g}" for ms in (one.ours_ms, one.cold_ms, one.warm_ms)),
            f"{one.cold_ms / one.ours_ms:.1f}", f"{one.warm_ms / one.ours_ms:.1f}",
            str(one.confirmed), str(one.solved), f"{one.as_good:.3f}",
            f"{one.better:.3f}")
        for one in found
    ]  # fmt: skip
    cold, warm = (
        float(np.median([getattr(one, f"{name}_ms") / one.ours_ms for one in found]))
        for name in ("cold", "warm")
    )
    bars = [
        Bar("least share that is as good", ">=", 0.99, min(o.as_good for o in found)),
        Bar("median ratio, cold", ">=", COLD, cold),
        Bar("median ratio, warm", ">=", WARM, warm),
    ]
    publish([*lines, "", *bar_table(bars)], options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
