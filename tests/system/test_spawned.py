"""Every kind of public object, sent to another process and used there."""

import dataclasses
import enum
import pickle
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart import heuristics, ocp, terminal_set
from swarmstart.arrays import Array
from swarmstart.tests.system.walk import made

REFUSED = {"Progress", "WarmStartedSolver"}
"""They belong to one process, and say so."""
OF_PACKAGES = {"FmuPlant", "AircraftPlant", "OnnxPlant"}
"""They need packages that may be missing; their own tests send them."""
INTERFACES = {
    "Algorithm", "CompiledObjective", "Constraint", "Controller", "Integrator",
    "IntervalEvaluation", "Kernels", "Pointers", "Prepared", "Rows", "Simulator",
    "State", "Steps",
}  # fmt: skip
"""Protocols, pointers to memory, and the expressions of a constraint by themselves."""


def straight(times: Array) -> Array:
    return np.zeros((2, times.size))


def resting(time: float) -> Array:
    return np.zeros(2)


def hard_to_solve(x: Array) -> Array:
    cost: Array = ((x**2 - 0.5) ** 2).sum(axis=0) + 0.1 * x[0]
    return cost


def local_team() -> ss.LocalTeam:
    member = ss.LocalAgent(parameters=[0], reference=straight)
    return ss.LocalTeam([member], **made.local_parts(), order=(0,))


def dual_mode() -> ss.DualMode:
    return ss.DualMode(
        made.team(), sets=[made.held_set()], targets=[resting], uncertified=True
    )


def algebraic() -> ss.AlgebraicEquations:
    x, z = ca.SX.sym("x"), ca.SX.sym("z")
    return ss.AlgebraicEquations(symbols=z, residual=z + ca.exp(z) - x)


@cache
def bound() -> ss.LowerBound:
    found = ss.lower_bound(made.problem(), [1.0, 0.0], seed=0, work=0.5)
    assert found.evidence is not None
    return found


@cache
def options() -> list[Any]:
    """Return settings and other small objects, which are compared part by part."""
    x = made.model().states
    return [
        ss.CMAES(), ss.LSHADE(), ss.ChaoticPSO(), ss.DifferentialEvolution(),
        ss.GeneticAlgorithm(), ss.ParticleSwarm(), ss.RandomSearch(),
        ss.SelfAdaptiveDE(), ss.Budget(evaluations=7),
        ss.Initial(points=np.ones((2, 1))),
        ss.Memetic(), ss.Multistart(), ss.IpoptOptions(tolerance=1e-5),
        ss.Autopilot(roll=0.5),
        ss.NlpOptions(plugin="sqpmethod"), ss.Radau(points=2), ss.Free(1.0, 2.0),
        ss.Known(parameters=[1.0]), ss.CountedFrom({"x": 1e9}),
        ss.TransportDelay({"u": 0.5}), ss.HeldSignals(["price"]),
        ss.Bounds(controls=(-1, 1), states=(x[0], 9)),
        ss.PathConstraint(expression=x[0], upper=1.0),
        ss.TerminalConstraint(expression=x),
        ss.Separation(relative=x, distance=2.0),
        ss.Connection(relative=x, distance=2.0),
        ss.SearchSettings(algorithm=ss.LSHADE(), budget=ss.Budget(evaluations=30)),
        ss.Start(controls=made.CONTROLS), made.search_result(), made.generation(),
        heuristics.feasibility_first(), made.search_result().stopped, made.rows()[0],
        made.warm_report(), made.warm_report().own, made.plan().search,
        made.plan().source, made.solution().status, made.plan().polish_status,
        made.decision(), ss.Mode.LINEAR, *ss.BoundKind, made.weights(),
        made.reference(), made.OPTIONS, ss.Agent(controller=made.loop()),
        ss.LocalAgent(parameters=[1.0], reference=straight),
        made.solution().beside(bound()), bound(), ss.OpenLoop(loop=made.loop()),
        ss.phases(made.legs()), made.plan(), ss.load(_saved()), algebraic(),
        made.solution().sensitivity(), made.solutions().sensitivity(),
        made.solution().multipliers, _polished(),
        made.search().best, made.box(),
        made.certified().certificate, made.certified().ellipsoid, made.change(),
        made.obstacle(), made.swarm(), ss.Links(loss=0.1),
        ss.simulate_swarm(made.swarm(), seconds=0.5, seed=0),
        made.swarm_loop(), made.swarm_decision(),
        *proofs(), heuristics.SEARCHES["lshade"],
    ]  # fmt: skip


def proofs() -> list[Any]:
    """Return what the making of a terminal set gives besides."""
    level = terminal_set.proven_level(made.change(), 1.0, rng=made.rng(), work=0.1)
    system = {"A": np.eye(2), "B": np.eye(2), "Q": np.eye(2), "R": np.eye(2)}
    certificate = made.certified().certificate
    assert certificate is not None
    return [
        terminal_set.continuous_lqr(**system), certificate.proof,
        terminal_set.Refutation(alpha=1.0, e=np.zeros(2), change=0.0),
        terminal_set.Candidate(
            scale=1.0, terminal_set=made.continuous(), level=level, size=2.0
        ),
        *[getattr(certificate, one.name) for one in dataclasses.fields(certificate)],
    ]  # fmt: skip


@cache
def _saved() -> str:
    return str(made.solution().save(made.folder() / "solution"))


def _polished() -> Any:
    return ocp.Polisher(made.fitness())(made.CONTROLS, [1.0, 0.0])


def plain(thing: Any) -> Any:
    """Return an object as numbers, texts, lists and mappings."""
    if isinstance(thing, ca.Function):
        return plain(thing.call([0.3] * thing.n_in()))
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        fields = [one.name for one in dataclasses.fields(thing)]
        return [type(thing).__name__, {n: plain(getattr(thing, n)) for n in fields}]
    if isinstance(thing, Mapping):
        return {str(key): plain(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [plain(part) for part in thing]
    if isinstance(thing, ca.SX | ca.MX | ca.DM | enum.Enum):
        return str(thing)
    is_plain = isinstance(thing, np.ndarray | int | float | str)
    return thing if is_plain else type(thing).__name__


def simulated(controller: Any, nx: int = 2) -> Any:
    """Return the first decision of a controller."""
    found = controller.decide(0.0, np.full(nx, 0.1), None, rng=made.rng())
    return [found.control, [plan.cost for plan in found.plans]]


def flown(plant: Any) -> Any:
    return plant(np.array([0.3, -0.2]), np.array([0.5]), 0.1)


def solved(problem: ss.OptimalControlProblem) -> Any:
    found = ss.solve(problem, [1, 0], search=None, lanes=4, seed=0)
    return [found.status.name, found.cost, found.controls]


def told(search: ss.Search) -> Any:
    for _ in range(3):
        cost = hard_to_solve(search.ask())
        search.tell(cost, np.zeros_like(cost))
    return [search.best.x, search.generations]


def answered(found: ss.Solution) -> Any:
    multipliers = found.multipliers
    assert multipliers is not None
    again = ss.solve(found.problem, [1, 0], guess=found.as_guess(), lanes=0, seed=0)
    return [
        repr(found), repr(found.optima), found.sensitivity().controls,
        multipliers.costates, found.linearised(0.5).A, again.controls,
        found.to_dataframe().to_numpy(), found.plot().axes[0].get_title(),
        found.optima[0].solution().controls, found.known, found.decided,
    ]  # fmt: skip


def many(found: ss.Solutions) -> Any:
    return [
        repr(found), found.controls, found.status.tolist(), found[0].controls,
        found.sensitivity().controls,
    ]  # fmt: skip


def ran(run: ss.Run) -> Any:
    return [repr(run), run.summary(), run.linearised(0.1).A, run.flight.x0]


def through(run: ss.Trajectory) -> Any:
    guess = ss.simulate(made.plant(), made.loop(), run.states[:, -1], steps=1, seed=0)
    return [repr(run), run.at(0.1), run.to_time_response().states, guess.states]


def stepped(plant: ss.CommandPlant) -> Any:
    with plant:
        return [plant.state_names, plant.step([1.0], [0.5], 0.1)]


def lawful(found: ss.TerminalSet) -> Any:
    point = np.array([0.01, 0.02])
    return [found.feedback(point), found.value(point), found.contains(point)]


USED: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "options": (options, plain),
    "Model": (made.model, lambda model: ocp.right_hand_side(model)([1, 2], 3, [])),
    "OptimalControlProblem": (made.problem, solved),
    "Solution": (lambda: ss.solve(made.problem(), [1, 0], lanes=4, seed=0), answered),
    "Solutions": (
        lambda: ss.solve_many(made.problem(), [[1, 2], [0, 0]], seed=0), many,
    ),
    "Planner": (
        made.planner,
        lambda planner: planner.plan([1, 0], rng=made.rng()).controls,
    ),
    "Fitness": (
        made.fitness,
        lambda fitness: fitness.value(made.CONTROLS + 0.1, [1, 0]),
    ),
    "Polisher": (
        lambda: ocp.Polisher(made.fitness()),
        lambda polisher: polisher(made.CONTROLS, [1.0, 0.0]).controls,
    ),
    "BatchFunction": (made.batch, lambda batch: batch(np.eye(2), np.ones((1, 2)))),
    "Plant": (made.plant, flown),
    "CExport": (
        lambda: ss.export_c(made.loop(), [0, 0], name="one", starts=0),
        lambda export: [*export.files.values(), export.most_operations],
    ),
    "CommandPlant": (lambda: ss.CommandPlant(made.TANK), stepped),
    "SelectedPlant": (
        lambda: ss.SelectedPlant(
            ss.CommandPlant(made.TANK), states=["level"], controls=["inflow"]
        ),
        lambda part: part.step(part.start_at([1.0]), [0.5], 0.1),
    ),
    "SimulatedPlan": (
        made.simulated_plan, lambda plan: [plan.controls, plan.cost, plan.status]
    ),
    "SurrogateRound": (
        lambda: made.simulated_plan().rounds[0],
        lambda one: [one.predicted, one.found, one.degree],
    ),
    "SteppedPlant": (lambda: ss.SteppedPlant(made.Tank(), dt=0.1), flown),
    "RecedingHorizon": (made.loop, simulated),
    "Team": (made.team, simulated),
    "LocalTeam": (local_team, simulated),
    "DualMode": (dual_mode, simulated),
    "CommittedTeam": (made.committed_team, simulated),
    "PhasedHorizon": (
        made.phased, lambda loop: simulated(loop, loop.start([0.0]).size)
    ),
    "Trajectory": (made.trajectory, through),
    "Step": (
        lambda: next(iter(ss.fly(
            made.plant(), made.loop(), [0.1, 0], steps=1, rng=made.rng()
        ))),
        lambda step: [step.state, step.decision.control],
    ),
    "DenseOutput": (
        lambda: ss.interpolate(made.plant(), made.trajectory()),
        lambda path: path([0.1]),
    ),
    "Run": (made.finished, ran),
    "Record": (lambda: ss.load(_saved()), lambda record: [repr(record), record.arrays]),
    "Table": (made.table, lambda table: table.at(0.5)),
    "TrajectoryFamily": (
        lambda: ss.TrajectoryFamily(
            box=ss.Box(lower=-np.ones(3), upper=np.ones(3)), trajectory=made.family()
        ),
        plain,
    ),
    "Search": (made.search, told),
    "Box": (made.box, lambda box: box.contains(np.full((2, 1), 0.5))),
    "TerminalSet": (made.certified, lawful),
    "functions": (
        lambda: [partial(ss.solve, made.problem(), lanes=0, search=None, seed=0)],
        lambda found: [one([1, 0]).controls for one in found],
    ),
}  # fmt: skip
"""Name -> what makes an object, and what it is used for in either process."""


def there(pickled: bytes) -> dict[str, Any]:
    """Use the objects that another process has sent."""
    things: dict[str, Any] = pickle.loads(pickled)
    return {name: USED[name][1](thing) for name, thing in things.items()}


def require_same(here: Any, there: Any, place: str) -> None:
    """Raise unless two results are the same."""
    assert type(here) is type(there), place
    if isinstance(here, Mapping):
        assert here.keys() == there.keys(), place
        for name, value in here.items():
            require_same(value, there[name], f"{place}.{name}")
    elif isinstance(here, list | tuple):
        assert len(here) == len(there), place
        for number, value in enumerate(here):
            require_same(value, there[number], f"{place}[{number}]")
    elif isinstance(here, np.ndarray | float | ca.DM):
        np.testing.assert_array_equal(np.array(here), np.array(there), place)
    else:
        assert here == there, place


@pytest.fixture(scope="module")
def pool() -> Any:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as one:
        yield one


def test_every_object_does_in_another_process_what_it_does_here(pool: Any) -> None:
    things = {name: make() for name, (make, _) in USED.items()}
    # Pickled now: the pool would do it in a thread, while their use changes a search.
    answer = pool.submit(there, pickle.dumps(things))
    here = {name: use(things[name]) for name, (_, use) in USED.items()}
    for name, found in answer.result().items():
        require_same(here[name], found, name)


@pytest.mark.parametrize("door", [ss, ocp, heuristics, terminal_set])
def test_the_table_has_every_public_class(door: Any) -> None:
    kinds = {
        name
        for name in door.__all__
        if isinstance(found := getattr(door, name), type)
        and not issubclass(found, BaseException)
    }
    assert kinds
    seen: set[str] = set(USED)

    def walk(thing: Any) -> None:
        seen.update(kind.__name__ for kind in type(thing).__mro__)
        if dataclasses.is_dataclass(thing):
            thing = [getattr(thing, one.name) for one in dataclasses.fields(thing)]
        if isinstance(thing, list | tuple):
            for part in thing:
                walk(part)

    walk(options())
    assert kinds - seen - REFUSED - INTERFACES - OF_PACKAGES == set()


@pytest.mark.parametrize("door", [ss, ocp, heuristics, terminal_set])
def test_every_error_is_sent_with_its_message_and_its_parts(door: Any) -> None:
    for name in door.__all__:
        kind = getattr(door, name)
        if not (isinstance(kind, type) and issubclass(kind, BaseException)):
            continue
        # Not by its constructor: each has arguments of its own.
        error = kind.__new__(kind, "what is wrong")
        if not issubclass(kind, Warning):
            vars(error).update(part=made.weights(), shown=lambda: None)
        found = pickle.loads(pickle.dumps(error))
        assert type(found) is kind
        assert found.args == ("what is wrong",)
        if not issubclass(kind, Warning):
            np.testing.assert_array_equal(vars(found)["part"].Q, np.eye(2))
            assert "lambda" in vars(found)["shown"]  # Its text.


def test_an_error_of_a_solve_reaches_the_caller(pool: Any) -> None:
    with pytest.raises(ss.InvalidArgumentError, match="size must be") as caught:
        pool.submit(ss.LSHADE, size=-3).result()
    assert caught.value.value == -3


def test_starts_are_solved_in_parallel(pool: Any) -> None:
    starts = [[1, 0], [0, 1], [-1, 0]]
    solve = partial(ss.solve, made.problem(), search=None, lanes=0, seed=0)
    for x0, found in zip(starts, pool.map(solve, starts), strict=True):
        np.testing.assert_array_equal(found.controls, solve(x0).controls)


def test_what_belongs_to_one_process_says_so() -> None:
    with (
        ss.Progress("a title", quiet=True) as shown,
        pytest.raises(
            ss.InvalidArgumentError, match="progress must be True, False or a function"
        ),
    ):
        pickle.dumps(partial(ss.solve, made.problem(), progress=shown.update))
    opti, x, u = made.nlp()
    warm = ss.warm_start(opti, controls=[u], states=[x], budget=50)
    with pytest.raises(ss.InvalidProblemError, match="call warm_start in the process"):
        pickle.dumps(warm)
