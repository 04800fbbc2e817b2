"""Differences between the answers of swarmstart and the peer to one problem."""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from swarmstart.arrays import Array
from swarmstart.ocp import Fitness, IpoptOptions, Known, Planner, Start
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.fitness import (
    at_nodes,
    core_known,
    replay,
    shared_arguments,
)
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.tests.ocp.feature_pairs.exact import exact
from swarmstart.tests.ocp.feature_pairs.opti import solved_by_opti
from swarmstart.tests.ocp.feature_pairs.peer import Peer, Point
from swarmstart.tests.ocp.feature_pairs.stated import Stated

BACKENDS = ("llvm", "casadi")
SAME = 1e-9
SAME_OPTIMUM = 1e-6
SAME_PATH = {"linear table": 1e-4, "stiff": 1e-5}
"""Of the finer path: a kink, or a fast mode, costs fixed steps their order."""
NEAR = 1e-3
MANY, SAME_STEPS = 24, 1e-6
"""Equal steps from check to check, and what is the same as they find."""


class Compared(NamedTuple):
    """A problem and what differs.

    Attributes:
        names: Of its features.
        differences: Sentences; empty if nothing differs.
        solved: Whether an optimum was found.
    """

    names: tuple[str, ...]
    differences: list[str]
    solved: bool


class Ours:
    """A stated problem as swarmstart has it."""

    def __init__(self, stated: Stated) -> None:
        """State it."""
        self.stated, self.problem = stated, stated.problem()
        self.planner = Planner(
            self.problem, search=None, polish=IpoptOptions(tolerance=1e-10)
        )
        self.lowered = self.planner.lowered

    def start(self, point: Point) -> Array:
        """Return the core's state at the start."""
        state = self.lowered.start(point.x0, self.stated.previous
                                   if self.stated.before.numel() else None)  # fmt: skip
        places = self.lowered.places
        state[places["decided"]] = point.decided
        state[places["end time"]] = point.length
        return state

    @property
    def known(self) -> Known:
        """Known values, in the form that the core takes."""
        given = self.stated.known
        return core_known(self.lowered, given)

    def solve(self, point: Point) -> tuple[bool, float, Point]:
        """Return whether the polish converged to a feasible point, its cost, and it."""
        x0 = self.start(point)
        plan = self.planner.plan(
            x0, known=self.known, guess=Start(point.controls, x0=x0),
            rng=np.random.default_rng(0),
        )  # fmt: skip
        places, state = self.lowered.places, plan.x0
        found = Point(
            plan.controls,
            state[places["states"]],
            state[places["decided"]],
            self.lowered.end_time(state),
        )
        converged = plan.polish_status is PolishStatus.CONVERGED
        return plan.feasible and converged, plan.cost, found


def drawn_point(stated: Stated, rng: Generator) -> Point:
    """Return random controls, and random values of what is decided."""
    lower, upper = (np.clip(side, -2, 2)[:, None] for side in stated.limits)
    controls = rng.uniform(lower, upper, (lower.size, stated.intervals))
    point = first_point(stated)
    x0 = point.x0.copy()
    for together, limits in stated.start.items():
        every = [limits, *[stated.bounds[i] for i in together if i in stated.bounds]]
        low, high = max(one[0] for one in every), min(one[1] for one in every)
        x0[list(together)] = rng.uniform(low, high)
    return Point(
        controls,
        x0,
        np.array([rng.uniform(low, high) for _, low, high in stated.decided.values()]),
        point.length if stated.end_time is None else rng.uniform(*stated.end_time),
    )


def first_point(stated: Stated) -> Point:
    """Return where both polishes start."""
    middle = [(low + high) / 2 for _, low, high in stated.decided.values()]
    return Point(stated.guess, stated.x0, np.array(middle), stated.horizon)


def compared(stated: Stated, rng: Generator) -> Compared:
    """Return what differs: values of random points, the finer path, the optimum."""
    ours, peer = Ours(stated), Peer(stated)
    told = [
        *_values(ours, peer, [drawn_point(stated, rng) for _ in range(3)]),
        *_path(ours, peer, drawn_point(stated, rng)),
    ]
    optimum, solved = _optimum(ours, peer)
    return Compared(stated.names, told + optimum, solved)


def _values(ours: Ours, peer: Peer, points: list[Point]) -> list[str]:
    """Return where cost or violation of random points differ, on each backend."""
    told = []
    for backend in BACKENDS:
        fitness = Fitness(ours.planner.tracer.shooting, backend=backend)
        if fitness.backend != backend:
            told.append(f"backend {fitness.backend} instead of {backend}")
        for point in points:
            x0 = ours.start(point)
            shared = fitness.arguments(x0, ours.known)
            weights = shared[1][ours.planner.problem.model.np :]
            both = (float(weights[0]), float(weights[-1])) if weights.size else (0, 0)
            cost, broken, _ = peer.value(point, both)
            found = fitness.value(point.controls, x0, ours.known)
            if not np.allclose(found, (cost, broken), rtol=SAME, atol=SAME):
                told.append(
                    f"{backend}: cost and violation {found}, ({cost}, {broken})"
                )
    return told


def differing_steps(stated: Stated, rng: Generator) -> list[str]:
    """Return where steps of their own lengths differ from many equal ones, or SciPy."""
    point, told = drawn_point(stated, rng), []
    stated.integrator_tolerance, stated.substeps = None, MANY
    equal = Shooting(stated.problem())
    stated.integrator_tolerance, stated.substeps = 1e-8, 2
    ours = Ours(stated)
    wanted = replay(equal, point.controls, ours.start(point), ours.known)[1:]
    for backend in BACKENDS:
        fitness = Fitness(ours.planner.tracer.shooting, backend=backend)
        found = fitness.value(point.controls, ours.start(point), ours.known)
        if not np.allclose(found, wanted, rtol=SAME_STEPS, atol=SAME_STEPS):
            told.append(f"{backend}: cost and violation {found}, {wanted}")
    return told + _path(ours, Peer(stated), point)


def _path(ours: Ours, peer: Peer, point: Point) -> list[str]:
    """Return how the finer path differs from SciPy's."""
    trace = ours.planner.tracer
    state, p, flat = shared_arguments(trace.problem, ours.start(point), ours.known)
    signals = at_nodes(trace.problem, flat)
    sizes = trace.shooting.sizing(state, p, signals, point.controls)
    path = trace(point.controls, state, p, signals, sizes)
    end, cost = exact(peer, point)
    told = []
    allowed = max([1e-6, *[SAME_PATH.get(name, 0) for name in peer.stated.names]])
    if not np.allclose(path.states[: end.size, -1], end, rtol=allowed, atol=allowed):
        told.append(f"the path ends at {path.states[: end.size, -1]}, SciPy's at {end}")
    soft = any(one.prices for one in peer.stated.path)  # Of the finer path's excess.
    if not (soft or np.isclose(path.cost, cost, rtol=allowed, atol=allowed)):
        told.append(f"the path costs {path.cost}, SciPy's {cost}")
    if not np.isclose(path.times[-1], point.length, rtol=SAME):
        told.append(f"the path takes {path.times[-1]} s instead of {point.length} s")
    return told


def _optimum(ours: Ours, peer: Peer) -> tuple[list[str], bool]:
    """Return how the optima differ, and whether there is one.

    Where local optima differ, or one side finds none, each is started near the answer
    of the other.
    """
    first = first_point(peer.stated)
    found, cost, point = ours.solve(first)
    other = solved_by_opti(peer, first)
    if found and not (other.success and _same(cost, other.cost)):
        again = solved_by_opti(peer, _near(point))
        if again.success and (not other.success or again.cost < other.cost):
            other = again
    if other.success and not (found and _same(cost, other.cost)):
        found_too, cost_too, _ = ours.solve(_near(other.point))
        if found_too and (not found or cost_too < cost):
            found, cost = found_too, cost_too
    if not (found or other.success):
        return [], False
    if found and other.success and _same(cost, other.cost):
        return [], True
    return [
        f"the optimum is {cost} ({'found' if found else 'not found'}), "
        f"Opti's {other.cost} ({'found' if other.success else 'not found'})"
    ], True


def _near(point: Point) -> Point:
    """Return a point whose controls differ a little, which no polish may keep."""
    moved = NEAR * np.cos(np.arange(point.controls.size))
    return point._replace(controls=point.controls + moved.reshape(point.controls.shape))


def _same(cost: float, other: float) -> bool:
    return bool(np.isclose(cost, other, rtol=SAME_OPTIMUM, atol=SAME_OPTIMUM))
