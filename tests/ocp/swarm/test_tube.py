"""A vehicle stays in the tube of its plan, and at last in its ball, for ever."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.integrate import solve_ivp

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.swarm.tube import Body, joined
from swarmstart.tests.ocp.swarm.bodies import body, vehicle

GOAL = [1.0, -0.5]
CONTROLS = hnp.arrays(np.float64, (2, 16), elements=st.floats(-1.5, 1.5))


def body_of(model: ss.Model, near: ss.TerminalSet, agent: ss.Agent) -> Body:
    problem = agent.controller.planner.problem
    return Body(problem, agent.shows, near, np.zeros(model.np))


@pytest.fixture(scope="module")
def flyer() -> Body:
    made = vehicle(GOAL, 0)
    return body_of(made.model, made.near, made.agent)


def truly(model: ss.Model, x: Array, u: Array, seconds: float, points: int) -> Array:
    """Return positions of an independent integrator, shape (2, points)."""
    rate = ca.Function("rate", [model.states, model.controls], [model.ode])
    found = solve_ivp(
        lambda t, y: rate(y, u).full().ravel(), (0.0, seconds), x,
        t_eval=np.linspace(0.0, seconds, points), rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    return np.asarray(found.y[:2])


def stopping(body: Body, start: Array) -> Array:
    """Return controls that bring a vehicle to rest."""
    controls, x = [], start
    for _ in range(16):
        u = np.clip(-2.0 * x[2:], -1.5, 1.5)
        controls.append(u)
        x, _ = body._moved(x, u)
    return np.array(controls).T


@pytest.fixture(scope="module", params=[1, 4], ids=["one step", "four steps"])
def integrated(request: pytest.FixtureRequest) -> Body:
    made = vehicle(GOAL, 0, substeps=request.param)
    return body_of(made.model, made.near, made.agent)


@settings(max_examples=15)
@given(CONTROLS)
def test_the_path_is_in_the_tube_between_steps(
    integrated: Body, controls: Array
) -> None:
    model, dt, flyer = body(2), 0.25, integrated
    x = np.array([0.3, 0.1, 1.0, -0.5])
    for u in controls.T[:6]:
        end, bulge = flyer._moved(x, u)
        share = np.linspace(0.0, 1.0, 41)
        path = truly(model, x, u, dt, 41)
        chord = np.outer(path[:, 0], 1 - share) + np.outer(path[:, -1], share)
        off = np.linalg.norm(path - chord, axis=0).max()
        assert off <= bulge + 1e-9
        assert bulge <= 3.0 * off + 2e-3
        x = end


def test_a_rest_elsewhere_has_the_least_value_and_is_where_it_comes_to_rest(
    flyer: Body,
) -> None:
    start = np.array([9.0, 3.0, 0.02, -0.03])
    rest = flyer.rest_of(start)
    assert not rest.is_goal
    for axis in (0, 1):
        for step in (-1e-3, 1e-3):
            moved = rest.centre.copy()
            moved[axis] += step
            other = type(rest)(centre=moved, is_goal=False)
            assert flyer.value(start, other) > flyer.value(start, rest)
    path = flyer.path(0, start, stopping(flyer, start))
    flyer.grow(path, 200)
    np.testing.assert_allclose(path.states[-1], path.rest.centre, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_from_the_end_on_it_stays_in_the_ball_of_the_rest(
    flyer: Body, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    start = np.concatenate([rng.uniform(-9, 9, 2), rng.normal(size=2)])
    path = flyer.path(0, start, stopping(flyer, start))
    samples, bulges = flyer.tube(path, 0, 16)
    centre, radius = samples[-1, :2], bulges[-1]
    flyer.grow(path, 60)
    model = body(2)
    for x, u in zip(path.states[15:60], path.controls[15:60], strict=True):
        off = np.linalg.norm(truly(model, x, u, 0.25, 21) - centre[:, None], axis=0)
        assert (off <= radius + 1e-9).all()


def test_the_last_piece_of_a_tube_is_the_ball_about_its_rest(flyer: Body) -> None:
    start = np.array([0.0, 0.0, 0.4, 0.0])
    path = flyer.path(3, start, stopping(flyer, start))
    samples, bulges = flyer.tube(path, 3, 20)
    assert samples.shape == (21, 3) and bulges.shape == (21,)
    assert not samples[:, 2].any()
    np.testing.assert_array_equal(samples[0, :2], start[:2])
    np.testing.assert_array_equal(samples[-1, :2], path.rest.centre[:2])
    value = flyer.value(path.states[19], path.rest)
    assert bulges[-1] == flyer.radius(value)
    assert bulges[-2] == 2 * bulges[-1]


def test_the_ball_has_room_for_the_growth_between_samples() -> None:
    made = vehicle(GOAL, 0)
    certificate = made.near.certificate
    assert certificate is not None and certificate.held is not None
    held = certificate.held
    root = held.growth**0.5 + held.integrator_error + certificate.drift
    assert root > 1 and certificate.growth == pytest.approx(root**2, rel=1e-12)
    value = made.near.alpha / 2
    # The farthest position of e'Pe = g V.
    reach = np.linalg.eigvalsh(np.linalg.inv(made.near.P)[:2, :2])[-1]
    farthest = np.sqrt(root**2 * value * reach)
    found = body_of(made.model, made.near, made.agent).radius(value)
    assert farthest <= found <= farthest * (1 + 1e-8)


def test_a_plan_that_ends_too_fast_has_no_rest(flyer: Body) -> None:
    with pytest.raises(ss.NoRestError, match="above the proven level"):
        flyer.rest_of(np.array([9.0, 0.0, 3.0, 0.0]))


def test_a_plan_that_ends_near_its_goal_rests_there(flyer: Body) -> None:
    rest = flyer.rest_of(np.array([1.1, -0.5, 0.0, 0.1]))
    assert rest.is_goal
    np.testing.assert_array_equal(rest.centre, [*GOAL, 0.0, 0.0])


def test_a_set_moves_along_no_position_on_which_a_rate_depends() -> None:
    made = vehicle(GOAL, 0, body(2, wind=0.3))
    windy = body_of(made.model, made.near, made.agent)
    assert windy.rest_of(np.array([*GOAL, 0.0, 0.0])).is_goal
    with pytest.raises(ss.NoRestError, match="above the proven level"):
        windy.rest_of(np.array([9.0, 3.0, 0.0, 0.0]))


def test_a_set_elsewhere_keeps_the_bounds_of_positions() -> None:
    bounds = ss.Bounds(controls=(-1.5, 1.5), states=([-20, -20, -9, -9], [9, 20, 9, 9]))
    made = vehicle(GOAL, 0, bounds=bounds)
    walled = body_of(made.model, made.near, made.agent)
    inside = walled.rest_of(np.array([8.5, 3.0, 0.01, 0.0]))
    assert inside.centre[0] < 9
    with pytest.raises(ss.NoRestError, match=r"within the bounds of x_0, \[-20, 9\]"):
        walled.rest_of(np.array([8.9999, 3.0, 0.05, 0.0]))


def test_gains_lead_a_pushed_vehicle_back_to_its_plan(flyer: Body) -> None:
    start = np.array([0.0, 0.0, 0.4, 0.0])
    path = flyer.path(0, start, stopping(flyer, start))
    off = {}
    for law in ("followed", "held"):
        x = start + np.array([0.1, -0.1, 0.05, 0.0])
        for step in range(30):
            u = path.controls[step] if law == "held" and step < 16 else None
            x, _ = flyer._moved(x, flyer.control(path, step, x) if u is None else u)
            if step == 15:
                off[law] = float(np.linalg.norm(x[:2] - path.states[16][:2]))
    assert off["followed"] < 0.02
    assert off["held"] > 0.1


def test_a_path_that_joins_another_has_its_steps_first(flyer: Body) -> None:
    start = np.array([0.0, 0.0, 0.4, 0.0])
    before = flyer.path(0, start, stopping(flyer, start))
    flyer.grow(before, 30)
    begin = before.states[20]
    made = joined(before, flyer.path(20, begin, stopping(flyer, begin)), 5)
    assert made.first == 5 and made.ends == 36
    np.testing.assert_array_equal(made.states[:15], before.states[5:20])
    np.testing.assert_array_equal(made.states[15], begin)
    samples, _ = flyer.tube(made, 5, 30)
    kept, _ = flyer.tube(before, 5, 15)
    np.testing.assert_array_equal(samples[:15], kept[:15])


def test_sets_of_another_design_are_refused() -> None:
    made = vehicle(GOAL, 0)
    bare = ss.TerminalSet(
        K=made.near.K, P=made.near.P, alpha=made.near.alpha, x_ref=made.near.x_ref,
        u_ref=made.near.u_ref, dt=made.near.dt, design="user",
    )  # fmt: skip
    with pytest.raises(ss.InvalidProblemError, match="weights of its design"):
        body_of(made.model, bare, made.agent)
