"""Peers of the comparison on hard problems, through their own code.

basin-hopping   `scipy.optimize.basinhopping`, whose local solver is IPOPT on the
                problem's NLP. Hops are in controls scaled to [0, 1], and costs are
                scaled by their natural size
archipelago     four algorithms of pagmo on a ring of islands, with the compiled
                evaluator, then IPOPT
cross-entropy   the cross-entropy method on control sequences, with the compiled
                evaluator, then IPOPT
roadmap         a path of a probabilistic roadmap (PRM) as the start of IPOPT, with new
                maps until the budget is spent; for problems whose states are x and y

Each is a route of a trial: (built, trial, meter, rng) -> answer. The searches get 90 %
of the budget, as those of the library do.

Sources: Wales and Doye (1997), Global optimization by basin-hopping, Journal of
Physical Chemistry A 101; Biscani and Izzo (2020), A parallel global multiobjective
framework for optimization: pagmo, Journal of Open Source Software 5; Rubinstein and
Kroese (2004), The cross-entropy method; Kavraki, Svestka, Latombe and Overmars (1996),
Probabilistic roadmaps for path planning in high-dimensional configuration spaces, IEEE
Transactions on Robotics and Automation 12.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, basinhopping
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.building import Built, Trial
from swarmstart.cases.campaign.trials.history import BudgetSpent, Meter
from swarmstart.cases.campaign.trials.peers import (
    WORTH,
    PeerError,
    PeerTask,
    pagmo_problem,
    penalised,
)
from swarmstart.cases.campaign.trials.trial import (
    Found,
    NotSolvedError,
    Route,
    searched_by,
)
from swarmstart.errors import load_optional
from swarmstart.ocp import OptimalControlProblem, Polisher
from swarmstart.ocp.answer import Source
from swarmstart.ocp.search.state_guesses import straight_states
from swarmstart.ocp.statement.guesses import middle_controls

Flags = NDArray[np.bool_]
PYGMO = "pygmo"
HOP, TEMPERATURE = 0.2, 0.1
"""Largest hop of a control, part of its bounds; temperature, natural sizes of the cost.

SciPy's defaults, 0.5 and 1, would be restarts at random of which most are accepted."""
ENDLESS = 10**9
"""Number of hops that no budget reaches."""
ISLAND, GENERATIONS = 20, 20
"""Individuals of an island, and its generations from one migration to the next."""
SAMPLES, ELITE, KEPT, COLLAPSED = 64, 8, 0.2, 1e-3
"""Of the cross-entropy method: sample, elite, weight of the earlier distribution, and
largest deviation at which it begins again, part of the bounds."""
POINTS, NEIGHBOURS, CHECKED = 200, 12, 40
"""Points of a roadmap, neighbours that each is joined to, and checks along a line."""
NEWTON = 10
"""Steps of Gauss and Newton that find controls for a path."""


def basin_hopping(
    made: Built, trial: Trial, meter: Meter, rng: np.random.Generator
) -> Found:
    """Return the best local optimum of SciPy's basin hopping.

    Raises:
        PeerError: If controls take whole numbers.
    """
    del trial
    polish, space = _polisher(made), made.space
    if space is None:
        raise TypeError("expected a search space")
    x0, known, _ = made.planner.posed(made.posed.x0, made.posed.known)
    box, size = space.box, float(made.planner.fitness.arguments.sizes(x0, known).cost)

    def local(function: object, z: Array, *_: Any, **__: Any) -> OptimizeResult:
        """Return IPOPT's optimum from a point of the unit box."""
        if meter.is_over:
            raise BudgetSpent
        start = space.decoded(box.lower + box.width * np.clip(z, 0, 1), x0, known)
        found = polish(start.controls, x0 if start.x0 is None else start.x0, known)
        value = penalised(
            np.array([found.cost / size]), np.array([found.violation]), WORTH
        )
        at = (space.encoded(found.controls, found.x0) - box.lower) / box.width
        return OptimizeResult(x=at, fun=float(value[0]), success=True)

    try:
        basinhopping(
            lambda z: 0.0,  # The local solver evaluates the cost itself.
            rng.random(box.dim),
            niter=ENDLESS,
            T=TEMPERATURE,
            stepsize=HOP,
            minimizer_kwargs={"method": local},
            rng=rng,
        )
    except BudgetSpent:
        pass
    return _best(made, meter)


def archipelago(task: PeerTask) -> None:
    """Run an archipelago of pagmo, its islands one after another on one thread."""
    pygmo = load_optional(PYGMO, extra="peers", need="archipelago")

    class Here:
        """An island that evolves in this process, where evaluations are counted."""

        def run_evolve(self, algorithm: Any, population: Any) -> tuple[Any, Any]:
            """Return the algorithm and the evolved population."""
            return algorithm, algorithm.evolve(population)

    pygmo.set_global_rng_seed(task.seed)
    kinds = (
        pygmo.sade(gen=GENERATIONS, seed=task.seed),
        pygmo.de1220(gen=GENERATIONS, seed=task.seed),
        pygmo.cmaes(gen=GENERATIONS, force_bounds=True, seed=task.seed),
        pygmo.pso(gen=GENERATIONS, seed=task.seed),
    )
    islands = pygmo.archipelago(t=pygmo.ring())
    for number, kind in enumerate(kinds):
        islands.push_back(
            algo=pygmo.algorithm(kind),
            prob=pagmo_problem(task),
            size=ISLAND,
            seed=task.seed + number,
            udi=Here(),
        )
    while True:  # The objective ends it.
        for island in islands:
            island.evolve()
            island.wait_check()


def cross_entropy(task: PeerTask) -> None:
    """Run the cross-entropy method, again from a random mean when it has collapsed."""
    box, rng = task.box, np.random.default_rng(task.seed)
    mean = np.full((box.dim, 1), 0.5)
    while True:  # The objective ends it.
        deviation = np.full((box.dim, 1), 0.5)
        while deviation.max() > COLLAPSED:
            drawn = mean + deviation * rng.standard_normal((box.dim, SAMPLES))
            points = np.clip(drawn, 0.0, 1.0)
            values = task.objective(box.lower[:, None] + box.width[:, None] * points)
            elite = points[:, np.argsort(values, kind="stable")[:ELITE]]
            mean = KEPT * mean + (1 - KEPT) * elite.mean(axis=1, keepdims=True)
            spread = elite.std(axis=1, keepdims=True)
            deviation = KEPT * deviation + (1 - KEPT) * spread
        mean = rng.random((box.dim, 1))


def roadmap(made: Built, trial: Trial, meter: Meter, rng: np.random.Generator) -> Found:
    """Return the best local optimum from paths of roadmaps.

    Raises:
        PeerError: If the problem has no states x and y, or no fixed end.
    """
    del trial
    polish, fitness = _polisher(made), made.planner.fitness
    x0, known, _ = made.planner.posed(made.posed.x0, made.posed.known)
    problem = fitness.problem
    line = straight_states(fitness, x0, known)
    names = problem.model.state_names
    if line is None or not {"x", "y"} <= {*names}:
        raise PeerError("roadmap needs states x and y with a fixed end")
    rows, free = [names.index("x"), names.index("y")], _free(problem, line, known)
    lower, upper = (side[rows] for side in problem.state_limits)
    while not meter.is_over:
        drawn = lower + (upper - lower) * rng.random((POINTS, 2))
        ends = line[rows][:, [0, -1]].T
        path = shortest_path(np.vstack([ends, drawn]), partial(free, rows))
        if path is None:
            continue
        states = line.copy()
        states[rows] = _along(path, line.shape[1])
        controls = _controls(problem, states, known.parameters)
        polish(controls, x0, known, states=states)
    return _best(made, meter)


def shortest_path(
    points: Array, free: Callable[[Array], Flags], *, neighbours: int = NEIGHBOURS
) -> Array | None:
    """Return the shortest path from the first to the second point in a roadmap.

    Args:
        points: Start, end and drawn points, shape (n, 2).
        free: Points (m, 2) -> whether each is free, shape (m,).
        neighbours: Number of nearest points that each is joined to.

    Returns:
        The corners of the path, shape (corners, 2); None if there is no path.
    """
    points = np.vstack([points[:2], points[2:][free(points[2:])]])
    count = min(neighbours + 1, len(points))
    _, near = cKDTree(points).query(points, k=count)
    a, b = np.repeat(np.arange(len(points)), count), np.ravel(near)
    a, b = a[a != b], b[a != b]
    shares = np.linspace(0.0, 1.0, CHECKED)[:, None, None]
    lines = points[a] + shares * (points[b] - points[a])
    clear = free(lines.reshape(-1, 2)).reshape(CHECKED, -1).all(axis=0)
    a, b = a[clear], b[clear]
    lengths = np.linalg.norm(points[a] - points[b], axis=1)
    graph = coo_array((lengths, (a, b)), shape=(len(points), len(points)))
    _, before = dijkstra(
        graph.tocsr(), directed=False, indices=0, return_predecessors=True
    )
    corners = [1]
    while corners[-1] != 0:
        if before[corners[-1]] < 0:
            return None
        corners.append(int(before[corners[-1]]))
    return points[corners[::-1]]


def _free(problem: OptimalControlProblem, line: Array, known: Any) -> Any:
    """Return (rows of the states, points (m, 2)) -> whether the path rows hold."""
    worst = largest_excess(problem)

    def free(rows: list[int], points: Array) -> Flags:
        if not len(points):
            return np.zeros(0, dtype=bool)
        states = np.repeat(line[:, :1], len(points), axis=1)
        states[rows] = points.T
        return np.asarray(worst(states, known.parameters) <= 0.0)

    return free


def largest_excess(problem: OptimalControlProblem) -> Callable[[Array, Any], Array]:
    """Return (states (nx, m), parameters) -> the largest excess of the path rows, (m,).

    Controls and signals are zero. Without path rows it is -infinity.
    """
    symbols = [*problem.symbols().values()]
    excess = [ca.SX(-np.inf)]
    for constraint in problem.path_constraints:
        rows = constraint.smooth(constraint.expression)
        values = ca.vertsplit(rows.values)
        for value, low, high in zip(values, rows.lower, rows.upper, strict=True):
            excess += [low - value, value - high]
    worst = ca.Function("worst", symbols, [ca.mmax(ca.vertcat(*excess))])
    u, s = np.zeros(problem.model.nu), np.zeros(problem.ns)

    def found(states: Array, parameters: Any) -> Array:
        others = (np.reshape(one, (-1, 1)) for one in (u, parameters, s))
        m = states.shape[1]
        values = worst.map(m)(states, *(np.tile(one, m) for one in others))
        return np.asarray(np.ravel(values.full()))

    return found


def _along(path: Array, nodes: int) -> Array:
    """Return points in equal distances along a path, shape (2, nodes)."""
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    at = np.linspace(0.0, way[-1], nodes)
    return np.stack([np.interp(at, way, side) for side in path.T])


def _controls(problem: OptimalControlProblem, states: Array, parameters: Any) -> Array:
    """Return controls whose rates fit a path best, (nu, N), within their bounds."""
    model = problem.model
    symbols = [*problem.symbols().values()]
    rates = ca.Function(
        "rates", symbols, [model.ode, ca.jacobian(model.ode, symbols[1])]
    )
    ends = states[:, :: problem.checks]
    wanted = np.diff(ends, axis=1) / problem.dt
    lower, upper = problem.control_limits
    controls = middle_controls(problem).copy()
    for k in range(problem.intervals):
        for _ in range(NEWTON):
            rate, slope = rates(
                ends[:, k], controls[:, k], parameters, np.zeros(problem.ns)
            )
            rest = wanted[:, k] - np.ravel(rate.full())
            step = np.linalg.lstsq(slope.full(), rest, rcond=None)[0]
            controls[:, k] = np.clip(controls[:, k] + step, lower, upper)
    return controls


def _polisher(made: Built) -> Polisher:
    planner = made.planner
    if planner.polisher is None or planner.problem.integer:
        raise PeerError("expected controls that IPOPT decides, found whole numbers")
    return planner.polisher


def _best(made: Built, meter: Meter) -> Found:
    """Return the best answer that a meter has met."""
    if meter.best is None:
        raise NotSolvedError("the budget ended it before it had found anything")
    controls, start = meter.best
    _, known, _ = made.planner.posed(made.posed.x0, made.posed.known)
    plan = made.planner.evaluated(
        controls,
        start,
        known=known,
        source=Source.POLISH,
        evaluations=round(meter.evaluations),
    )
    return Found(plan, has_ended=False)


class Peer(NamedTuple):
    """A peer.

    Attributes:
        title: Description in a few words.
        route: Function that runs it.
        package: Package that it needs.
    """

    title: str
    route: Route
    package: str = "scipy"


PEERS = {
    "basin-hopping": Peer("SciPy's basin hopping, with IPOPT", basin_hopping),
    "archipelago+ipopt": Peer(
        "an archipelago of pagmo, then IPOPT",
        partial(searched_by, archipelago, options={}),
        PYGMO,
    ),
    "cross-entropy+ipopt": Peer(
        "the cross-entropy method, then IPOPT",
        partial(searched_by, cross_entropy, options={}),
    ),
    "roadmap": Peer("IPOPT from paths of probabilistic roadmaps", roadmap),
}
"""Peers by name."""
