"""A simulator beside a model makes the steps; the model has the names and signals."""

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.loop import SimulatedPlant, flown_again


class Heavy:
    """Steps that add twice the control, and are counted."""

    def __init__(self) -> None:
        self.steps: list[tuple[float, float, float]] = []
        self.begun = 0

    def start_at(self, x: Array) -> Array:
        self.begun += 1
        return x

    def step(self, x: Array, u: Array, dt: float) -> Array:
        self.steps.append((float(x[0]), float(u[0]), dt))
        return x + 2 * dt * u


def one_heavy() -> Heavy:
    return Heavy()


def model() -> ss.Model:
    x, u, p = (ca.SX.sym(n) for n in ("x", "u", "p"))
    return ss.Model(states=x, controls=u, ode=p * u, parameters=p)


def plant(heavy: Heavy, substeps: int = 4) -> SimulatedPlant:
    return SimulatedPlant(
        model(), load=lambda: heavy, dt=1.0, substeps=substeps,
        parameters=lambda times: np.full((1, times.size), 7.0),
    )  # fmt: skip


def test_steps_are_those_of_the_simulator_and_parameters_those_of_the_model() -> None:
    heavy = Heavy()
    one = plant(heavy)
    states = one(np.array([1.0]), np.array([3.0]))
    assert states.tolist() == [[2.5, 4.0, 5.5, 7.0]]
    assert [dt for *_, dt in heavy.steps] == [0.25] * 4
    assert one.parameters(np.array([0.0])).tolist() == [[7.0]]
    pieces = one(np.array([0.0]), np.array([[1.0, -1.0]]))
    assert pieces.tolist() == [[0.5, 1.0, 0.5, 0.0]]
    ramp = one.along(np.array([0.0]), np.array([[0.0, 1.0, 2.0, 3.0, 4.0]]))
    assert ramp.tolist() == [[0.25, 1.0, 2.25, 4.0]]  # Means of the ends.


def test_another_interval_keeps_the_simulator() -> None:
    heavy = Heavy()
    states = plant(heavy).with_interval(2.0)(np.array([0.0]), np.array([1.0]))
    assert states[0, -1] == 4.0 and heavy.steps[0][2] == 0.5


def test_it_is_loaded_for_the_first_step_only() -> None:
    made: list[Heavy] = []

    def load() -> Heavy:
        made.append(Heavy())
        return made[0]

    one = SimulatedPlant(model(), load=load, dt=1.0, substeps=1, parameters=np.sin)
    assert not made
    one.start_at(np.array([0.0]))
    assert made and made[0].begun == 1


def test_a_jump_of_the_model_is_none_of_the_simulator() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    jumping = ss.Model(states=x, controls=u, ode=u, next_state=-x)
    one = SimulatedPlant(jumping, load=one_heavy, dt=1.0, substeps=2)
    assert one(np.array([1.0]), np.array([1.0])).tolist() == [[2.0, 3.0]]


def loop() -> ss.RecedingHorizon:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=3.0, intervals=3,
        stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    return ss.RecedingHorizon(
        planner=ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    )


def test_its_path_is_linear_between_its_steps() -> None:
    """The model's rate is another: p u with p = 7."""
    run = ss.simulate(plant(Heavy()), loop(), [1.0], steps=2, seed=0, progress=False)
    path = ss.interpolate(plant(Heavy()), run)
    inside = 0.8 * run.dense_states[0, 2] + 0.2 * run.dense_states[0, 3]
    assert path(0.55)[0, 0] == pytest.approx(inside, abs=1e-14)
    assert path(0.5)[0, 0] == pytest.approx(run.dense_states[0, 2], abs=1e-14)


class Delayed:
    """A controller whose model receives another control than is commanded."""

    dt = 1.0

    def decide(
        self, time: float, state: Array, previous: object, *, rng: object
    ) -> ss.Decision:
        return ss.Decision(control=np.array([1.0]), plans=(), acting=np.array([-5.0]))


def test_a_simulator_gets_commands_since_a_delay_is_its_own() -> None:
    heavy = Heavy()
    run = ss.simulate(plant(heavy), Delayed(), [0.0], steps=1, seed=0, progress=False)
    assert [u for _, u, _ in heavy.steps] == [1.0] * 4
    assert run.states[0, -1] == 2.0


def test_a_run_is_made_again_or_said_to_be_another() -> None:
    heavy = Heavy()
    steps = [*ss.fly(plant(heavy), loop(), [1.0], steps=3,
                     rng=np.random.default_rng(0))]  # fmt: skip
    assert heavy.begun == 1
    assert flown_again(plant(heavy), steps)
    assert heavy.begun == 2 and len(heavy.steps) == 24
    lighter = Heavy()
    lighter.step = lambda x, u, dt: x + 1.9 * dt * u  # type: ignore[method-assign]
    assert not flown_again(plant(lighter), steps)
    elsewhere = Heavy()
    elsewhere.start_at = lambda x: x + 1e-12  # type: ignore[method-assign]
    assert not flown_again(plant(elsewhere), steps)


def test_a_step_of_another_shape_is_refused() -> None:
    wrong = Heavy()
    wrong.step = lambda x, u, dt: np.zeros(3)  # type: ignore[method-assign]
    with pytest.raises(ss.InvalidProblemError, match=r"must return a state of shape"):
        plant(wrong)(np.array([1.0]), np.array([3.0]))
    with pytest.raises(ss.InvalidProblemError, match="must have 1 and 1 rows"):
        plant(Heavy())(np.array([1.0, 2.0]), np.array([3.0]))
