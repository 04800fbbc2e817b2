"""The finer path: against an independent integrator, and cuts in closed form."""

from dataclasses import replace
from typing import Literal

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Integrator,
    Model,
    OptimalControlProblem,
    PathConstraint,
    disc,
)
from swarmstart.ocp.integration.integrators import INTEGRATORS
from swarmstart.ocp.rollout.path import Path, Tracer, uneven_lengths
from swarmstart.ocp.rollout.scaling import Sizing

NONE = np.empty(0)
X, U, S = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("s")


def traced(
    problem: OptimalControlProblem,
    controls: Array,
    x0: list[float],
    *,
    parameters: Array = NONE,
    signals: Array | None = None,
    ends: Array | None = None,
) -> Path:
    start = np.array(x0, dtype=np.float64)
    known = np.empty((0, problem.nodes)) if signals is None else signals
    sizes = Sizing(problem)(start, parameters, known)
    return Tracer(problem)(controls, start, parameters, known, sizes, ends=ends)


@pytest.mark.parametrize("quadrature", ["integral", "left", "right"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_path_is_that_of_an_independent_integrator(
    pendulum: Model,
    quadrature: Literal["integral", "left", "right"],
    integrator: Integrator,
) -> None:
    """States and cost, with parameters, and with signals linear between the nodes."""
    x, u, p = pendulum.states, pendulum.controls, ca.SX.sym("p")
    s = ca.SX.sym("s", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, parameters=p, ode=pendulum.ode * p),
        horizon=1.5,
        intervals=3,
        stage_cost=(x[0] - s[0]) * (1 + u**2) + s[1] * x[1],
        terminal_cost=-p * x[1] * s[1],
        signals=s,
        quadrature=quadrature,
        integrator=integrator,
        checks=2,
        substeps=3,
    )
    rng = np.random.default_rng(0)
    controls, signals = rng.normal(size=(1, 3)), rng.normal(size=(2, problem.nodes))
    path = traced(
        problem, controls, [0.4, -0.2], parameters=np.array([0.7]), signals=signals
    )

    def cost_rate(t: float, y: Array, held: float) -> float:
        a, b = (np.interp(t, problem.times, row) for row in signals)
        return float((y[0] - a) * (1 + held**2) + b * y[1])

    y = np.array([0.4, -0.2, 0.0, 0.0])
    # Where y_1 begins is no part of the size of a cost in which it stands alone.
    first = cost_rate(0.0, y, float(controls[0, 0]))
    nodes, summed = [y], []
    for k, (begin, end) in enumerate(
        zip(problem.times, problem.times[1:], strict=False)
    ):
        held = float(controls[0, k // 2])

        def rate(t: float, y: Array, held: float = held) -> list[float]:
            spent = cost_rate(t, y, held)
            turned = 0.7 * (held - 9.81 * np.sin(y[0]))
            return [0.7 * y[1], turned, spent, abs(spent - first)]

        flown = solve_ivp(
            rate, (begin, end), y, method="DOP853", rtol=1e-10, atol=1e-12
        )
        ends = cost_rate(begin, y, held), cost_rate(end, flown.y[:, -1], held)
        summed.append(problem.dt * (ends[0] if quadrature == "left" else ends[1]))
        y = flown.y[:, -1]
        nodes.append(y)
    chosen = summed[0::2] if quadrature == "left" else summed[1::2]
    integral = quadrature == "integral"
    last, least = (-0.7 * v * signals[1, -1] for v in (y[1], -0.2))
    spent = y[2] if integral else sum(chosen)
    size = y[3] if integral else np.abs(np.array(chosen) - chosen[0]).sum()
    # RK4 with steps of 1/120 s: h^4 of the pendulum's fifth derivatives.
    np.testing.assert_allclose(
        path.states[:, ::30], np.array(nodes)[:, :2].T, atol=1e-6
    )
    assert path.cost == pytest.approx(spent + last, abs=1e-6)
    # |cost| has a kink inside a step.
    assert path.magnitude == pytest.approx(size + abs(last - least), rel=1e-4)


@pytest.mark.parametrize("intervals", [1, 3])
@pytest.mark.parametrize("checks", [1, 2])
def test_path_has_ten_points_to_each_step(
    double_integrator: Model, intervals: int, checks: int
) -> None:
    problem = OptimalControlProblem(
        double_integrator, horizon=2.0, intervals=intervals, checks=checks, substeps=3
    )
    controls = np.arange(1.0, intervals + 1)[None]
    path = traced(problem, controls, [0, 0])
    assert path.times.size == path.states.shape[1] == intervals * checks * 30 + 1
    assert path.times[-1] == 2.0
    np.testing.assert_array_equal(path.controls[0, :: checks * 30], controls[0])
    assert path.not_finite is None
    assert not (path.broken or path.outside or path.kinks)


def straight(**stated: object) -> OptimalControlProblem:
    """A point that moves to the right at 1 m/s and up with its control."""
    given = {"horizon": 4.0, "intervals": 4, "substeps": 4, **stated}
    model = Model(states=X, controls=U, ode=ca.vertcat(1, U))
    return OptimalControlProblem(model, **given)  # type: ignore[arg-type]


@given(
    height=st.floats(-0.9, 0.9),
    centre=st.floats(-1.9, 1.9),
    slope=st.floats(-0.3, 0.3),
)
@settings(max_examples=15, deadline=None)
def test_line_past_a_disc_cuts_what_geometry_says(
    height: float, centre: float, slope: float
) -> None:
    """A line at a distance a from the centre of a disc of radius r cuts r - a."""
    at = np.array([2.0 + centre * 0.5, slope * 2.0 + height])
    problem = straight(intervals=1, constraints=[disc(X, centre=at, radius=0.95)])
    if np.linalg.norm(at) <= 0.95:
        return
    path = traced(problem, np.array([[slope]]), [0, 0])
    direction = np.array([1.0, slope])
    t = float(at @ direction / (direction @ direction))
    distance = float(np.linalg.norm(t * direction - at))
    amount = 0.95 - distance
    if amount < 1e-2:
        return
    (found,) = path.broken
    # 40 steps in 4 s: at most half of the longest from the nearest point.
    longest = 4.0 * uneven_lengths(1, 40).max()
    off = 0.5 * longest * np.linalg.norm(direction)
    assert amount - (np.hypot(distance, off) - distance) - 1e-9 <= found.amount
    assert found.amount <= amount + 1e-9
    assert found.time == pytest.approx(t, abs=0.5 * longest + 1e-9)
    assert (found.scale, found.above) == (0.95, False)


def test_constraint_cut_between_checks_only_is_found() -> None:
    """From foot to foot of a bump: the checks see only its feet."""
    bump = PathConstraint(expression=ca.sin(np.pi * X[0]) ** 2 - X[1], upper=1e-9)
    found = traced(straight(constraints=[bump]), np.zeros((1, 4)), [0, 0]).broken
    assert found[0].amount == pytest.approx(1, abs=1e-8)
    assert found[0].time % 1 == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("weight", "controls", "amount", "time"),
    [
        (0.5, [2.0, 0, 0, 0], 1.0, 1.0),  # Worst at the end of the first interval,
        (0.5, [0, 0, 0, 3.0], 2.5, 4.0),  # of the last,
        (-0.5, [0, 0, -1.5, 0], 0.5, 2.0),  # as the third begins,
        (-0.5, [-1.25, 1.25, 0, 0], 0.25, 0.0),  # and as the first begins.
    ],
)
def test_mixed_constraint_counts_at_both_ends_of_an_interval(
    weight: float, controls: list[float], amount: float, time: float
) -> None:
    """-1 <= u + weight y <= 2, with y' = u from 0."""
    both = PathConstraint(expression=U + weight * X[1], lower=-1, upper=2)
    (found,) = traced(straight(constraints=[both]), np.array([controls]), [0, 0]).broken
    assert found.amount == pytest.approx(amount)
    assert found.time == time
    assert found.above == (weight > 0)


def test_rows_of_signals_are_linear_between_nodes() -> None:
    problem = straight(
        signals=S, intervals=2, constraints=[X[1] <= S], terminal=[X[1] - S],
        stage_cost=S,
    )  # fmt: skip
    signals = np.array([[1.0, -1.0, 0.0]])
    path = traced(problem, np.array([[0.0, -1.0]]), [0, 0], signals=signals)
    # y is 0 to 2 s, then falls to -2; the signal is below it from 1 s, by 1 at 2 s.
    at = {e.constraint: (e.amount, e.time) for e in path.broken}
    assert at[0] == pytest.approx((1, 2))
    assert at[1] == pytest.approx((2, 4))
    assert path.cost == pytest.approx(0 - 1)


def test_a_start_is_judged_by_the_signal_as_it_begins() -> None:
    """It falls from 1 by 1 per second: only at the start it is 0.5 above the limit."""
    signals = np.array([[1.0, 0.0, -1.0, -2.0, -3.0]])
    problem = straight(signals=S, constraints=[X[1] <= S])
    (found,) = traced(problem, np.zeros((1, 4)), [0, 1.5], signals=signals).outside
    assert found.amount == pytest.approx(0.5, rel=1e-12)


def test_path_that_leaves_the_numbers_tells_when_and_where() -> None:
    """x' = x^2 from 1 becomes infinite at 1 s."""
    x, u = ca.SX.sym("pole"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=ca.vertcat(ca.SX.sym("calm"), x), controls=u,
              ode=ca.vertcat(u, x**2)),
        horizon=3.0,
        intervals=3,
        stage_cost=ca.fabs(x),
    )  # fmt: skip
    path = traced(problem, np.zeros((1, 3)), [0, 1])
    assert path.not_finite is not None
    time, name = path.not_finite
    assert name == "pole"
    assert 1 <= time < 1.5
    assert path.kinks == ()


def test_ends_of_a_path_are_seen_on_the_side_of_each_interval() -> None:
    """The last point belongs to the last control, each node to both its intervals."""
    upper = PathConstraint(expression=U * X[0], upper=3.5)
    (found,) = traced(
        straight(constraints=[upper]), np.array([[0, 0, 0, 1.0]]), [0, 0]
    ).broken
    assert found.amount == pytest.approx(0.5)
    assert found.time == 4.0


@pytest.mark.parametrize("quadrature", ["integral", "left", "right"])
def test_magnitude_adds_what_the_cost_takes_off(
    quadrature: Literal["integral", "left", "right"],
) -> None:
    """A cost in which a state stands alone counts from its value at the start."""
    problem = straight(
        stage_cost=U, step_cost=2 * U, initial_cost=-3 * X[0], terminal_cost=-5 * X[0],
        quadrature=quadrature,
    )  # fmt: skip
    path = traced(problem, np.array([[2.0, 3.0, 1.0, -3.0]]), [7, 0])
    assert path.cost == pytest.approx(3 + 6 - 21 - 55)
    assert path.magnitude == pytest.approx(9 + 18 + 21 + 20)
    # The stage cost alone moves with the origin: x goes from 7 to 11, u is held.
    other = replace(problem, stage_cost=X[0], terminal_cost=-5 * X[0] ** 2)
    path = traced(other, np.array([[2.0, 3.0, 1.0, -3.0]]), [7, 0])
    moved = {"integral": 8, "left": 6, "right": 6}[quadrature]
    assert path.magnitude == pytest.approx(moved + 18 + 21 + 5 * 11**2, rel=1e-6)


@pytest.mark.parametrize("checks", [1, 3])
def test_step_costs_count_the_state_and_signal_at_the_beginning_of_each_interval(
    checks: int,
) -> None:
    """x = t; the signal is 10 t at the nodes; p is 3."""
    p = ca.SX.sym("p")
    problem = OptimalControlProblem(
        Model(states=X, controls=U, parameters=p, ode=ca.vertcat(1, U)),
        horizon=4.0, intervals=4, checks=checks, signals=S,
        step_cost=X[0] * U + S * p, initial_cost=X[1] * S + p,
        terminal_cost=X[0] * S - p,
    )  # fmt: skip
    controls = np.array([[2.0, 3.0, 1.0, -3.0]])
    path = traced(
        problem, controls, [0, -2], parameters=np.array([3.0]),
        signals=5.0 + 10 * problem.times[None],
    )  # fmt: skip
    steps = np.arange(4) * controls[0] + 3 * (5 + 10 * np.arange(4))
    first, end = -2 * 5 + 3, 4 * 45 - 3
    assert path.cost == pytest.approx(steps.sum() + first + end)
    # The end is counted from its value where x begins, -3.
    size = np.abs(steps).sum() + abs(first) + end + 3
    assert path.magnitude == pytest.approx(size)


def test_worst_constraint_of_its_size_comes_first() -> None:
    rows = [
        PathConstraint(expression=X[1], upper=1, scale=10.0, name="mild"),
        PathConstraint(expression=X[1], upper=3, scale=1.0, name="hard"),
        PathConstraint(expression=X[1], upper=2, scale=5.0, name="middle"),
    ]
    path = traced(straight(constraints=rows), np.ones((1, 4)), [0, 0])
    assert [e.name.strip("'") for e in path.broken] == ["hard", "middle", "mild"]
    assert [e.relative for e in path.broken] == pytest.approx([1.0, 0.4, 0.3])


@pytest.mark.parametrize("checks", [1, 2])
def test_path_of_a_model_that_jumps_at_each_intervals_end(checks: int) -> None:
    """Between the jumps x' = p u in closed form; the jump has every argument."""
    x, p, s, wanted = ca.SX.sym("x", 2), ca.SX.sym("p"), S, ca.SX.sym("wanted")
    jumped = ca.vertcat(x[0] / 2 + s, x[1] / 4 + 3 * x[0] - U * p)
    problem = OptimalControlProblem(
        Model(
            states=x, controls=U, parameters=p, signals=s, ode=ca.vertcat(p * U, 0),
            next_state=jumped, outputs={"y": x[0] + 2 * U + s, "z": x[1] * p},
        ),
        horizon=4.0, intervals=4, checks=checks, substeps=2, signals=wanted,
        stage_cost=x[0] + wanted, constraints=[x[1] <= 1e3],
    )  # fmt: skip
    rng = np.random.default_rng(0)
    controls, signals = rng.normal(size=(1, 4)), rng.normal(size=(2, problem.nodes))
    path = traced(
        problem, controls, [0.5, -1.0], parameters=np.array([1.7]), signals=signals
    )
    m = 20 * checks
    at, cost, before = np.array([0.5, -1.0]), 0.0, []
    for k, u in enumerate(controls[0]):
        since = path.times[k * m : (k + 1) * m] - k
        np.testing.assert_allclose(
            path.states[0, k * m : (k + 1) * m], at[0] + 1.7 * u * since, rtol=1e-12
        )
        np.testing.assert_allclose(path.states[1, k * m : (k + 1) * m], at[1])
        end = np.array([at[0] + 1.7 * u, at[1]])
        before.append(end)
        cost += (at[0] + end[0]) / 2
        there = signals[0, (k + 1) * checks]
        at = np.array([end[0] / 2 + there, end[1] / 4 + 3 * end[0] - u * 1.7])
        np.testing.assert_allclose(path.states[:, (k + 1) * m], at, rtol=1e-12)
    cost += np.trapezoid(signals[1], problem.times)
    assert path.cost == pytest.approx(cost, rel=1e-9)
    # Outputs with the control held from each time on; the last one at the end.
    known, held = (
        np.interp(path.times, problem.times, signals[0]),
        np.append(np.repeat(controls[0], m), controls[0, -1]),
    )
    np.testing.assert_allclose(
        path.outputs, [path.states[0] + 2 * held + known, path.states[1] * 1.7]
    )
    # Of x_1 at least the range of what is written, of slope 3 in x_0.
    own = np.ptp(path.states, axis=1)
    np.testing.assert_allclose(path.reach, [own[0], max(own[1], 3 * own[0])])


def test_reach_of_a_state_that_keeps_zero_is_that_of_what_is_written() -> None:
    """4 |2| + 4 |2|, though it keeps 0; a slope that is not finite says nothing."""
    x = ca.SX.sym("x", 4)
    for kept, reach in ((4 * (x[0] - x[1]), 16.0), (ca.sqrt(x[3]), 0.0)):
        problem = OptimalControlProblem(
            Model(
                states=x, controls=U, ode=ca.vertcat(U, U, 0, 0),
                next_state=ca.vertcat(x[0], x[1], kept, x[3]),
            ),
            horizon=2.0, intervals=2,
        )  # fmt: skip
        path = traced(problem, np.ones((1, 2)), [0, 0, 0, 0])
        np.testing.assert_allclose(path.reach, [2, 2, reach, 0], atol=1e-12)


@pytest.mark.parametrize("intervals", [1, 3])
def test_state_that_only_the_last_jump_leaves_outside_is_found(intervals: int) -> None:
    """x' = 0 and x+ = x + u: the sum of the controls is 5, at the end of 6 s."""
    x = ca.SX.sym("x")
    problem = OptimalControlProblem(
        Model(states=x, controls=U, ode=ca.SX(0), next_state=x + U), horizon=6.0,
        intervals=intervals,
        constraints=[PathConstraint(expression=x, upper=3.0, scale=1.0)],
    )  # fmt: skip
    controls = np.array([[2.0, 1.0, 2.0][-intervals:]])
    controls[0, -1] += 5.0 - controls.sum()
    (found,) = traced(problem, controls, [0.0]).broken
    assert (found.amount, found.time, found.constraint) == (2.0, 6.0, 0)


def test_intervals_that_begin_anew_miss_the_next_ones_begin() -> None:
    """x' = u; each interval starts from a state of its own."""
    x = ca.SX.sym("x")
    problem = OptimalControlProblem(
        Model(states=x, controls=U, ode=U),
        horizon=3.0, intervals=3, substeps=1, terminal_cost=x,
    )  # fmt: skip
    controls, ends = np.array([[1.0, -2.0, 4.0]]), np.array([[5.0, 7.0, 11.0, 17.0]])
    path = traced(problem, controls, [5.0], ends=ends)
    np.testing.assert_allclose(path.states[0, ::10], ends[0])
    np.testing.assert_allclose(path.states[0, 5::10], ends[0, :-1] + controls[0] / 2)
    reached = ends[0, :-1] + controls[0]
    assert path.missed is not None
    np.testing.assert_allclose(path.missed[0], reached - ends[0, 1:])
    assert path.cost == pytest.approx(17.0)
    assert traced(problem, controls, [5.0]).missed is None


def test_soft_constraint_adds_its_price_to_the_cost_of_a_path() -> None:
    """2 y - s <= 1/2 with y' = u, linear over an interval: its larger end counts.

    The weights are those of the interval's beginning.
    """
    p = ca.SX.sym("p")
    soft = PathConstraint(
        expression=X[1] * p - S, upper=0.5, weight=2.0 + S + X[0], quadratic_weight=3.0
    )
    problem = OptimalControlProblem(
        Model(states=X, controls=U, parameters=p, ode=ca.vertcat(1, U)),
        horizon=4.0, intervals=4, substeps=2, signals=S, constraints=[soft],
    )  # fmt: skip
    s = np.array([0.0, 1.0, 0.5, -1.0, -4.0])
    y = np.array([0.0, 1.0, 2.0, -1.0, -0.75])
    path = traced(
        problem, np.diff(y)[None], [0, 0], parameters=np.array([2.0]), signals=s[None]
    )
    beyond = np.maximum(2 * y - s - 0.5, 0.0)
    e = np.maximum(beyond[:-1], beyond[1:])
    expected = ((2.0 + s[:-1] + np.arange(4)) * e + 3.0 * e**2).sum()
    assert path.cost == pytest.approx(expected, rel=1e-9)
    assert path.magnitude == pytest.approx(expected, rel=1e-9)


def test_path_of_three_states_and_its_kinks() -> None:
    """A switch that depends on a state, a control, a parameter and a signal."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p")
    side = x[2] - S - p * U
    problem = OptimalControlProblem(
        Model(states=x, controls=U, parameters=p, ode=ca.vertcat(1, 0, U)),
        horizon=4.0,
        intervals=4,
        stage_cost=ca.fabs(side),
        signals=S,
        checks=2,
    )
    signals = np.linspace(0, 4, 9)[None]  # The signal is the time.

    def touches(controls: list[float], start: float, parameter: float) -> bool:
        path = traced(
            problem, np.array([controls]), [0, 7, start],
            parameters=np.array([parameter]), signals=signals,
        )  # fmt: skip
        np.testing.assert_allclose(path.states[0], path.times, atol=1e-12)
        np.testing.assert_array_equal(path.states[1], 7)
        nodes = start + np.concatenate([[0], np.cumsum(controls)])
        steps = (path.times.size - 1) // 4
        np.testing.assert_allclose(path.states[2, ::steps], nodes, atol=1e-12)
        return bool(path.kinks)

    # At the start of an interval the side is start + sum of u - t - p u; it moves by u
    # - 1.
    assert touches([1, 1, 1, 1], 0.5, 0.5)  # It is 0 all along,
    assert not touches([1, 1, 1, 1], 0.7, 0.5)  # or 0.2.
    assert touches([1, 1, 1, -1], 0.7, 0.5)  # It falls from 1.2 to -0.8 in the last
    assert touches([-1, 1, 1, 1], 0.7, 0.5)  # or first interval,
    assert not touches([1, 1, 1, 0.5], 1.9, 2.0)  # or jumps from -0.1 to 0.9.
    assert touches([1, -1, 1, 1], 0.7, 1.0)  # From 1.7 to -0.3, beside -0.3 and -2.3.


def test_states_that_are_lost_touch_nothing_that_can_be_told() -> None:
    problem = straight(stage_cost=ca.fabs(X[1]))
    assert traced(problem, np.zeros((1, 4)), [0, 0]).kinks == ("fabs(x_1)",)
    # Beside it, a billionth of the state's size from it, and a part in 1e4.
    near, far = (traced(problem, np.zeros((1, 4)), [0, off]) for off in (1e-9, 1e-4))
    assert near.kinks == ("fabs(x_1)",) and far.kinks == ()
    lost = traced(problem, np.zeros((1, 4)), [np.nan, 0])
    assert lost.kinks == ()
    assert lost.not_finite == (0.0, "x_0")


@pytest.mark.parametrize(("checks", "substeps"), [(1, 1), (1, 4), (3, 2)])
def test_fine_steps_end_at_the_checks_and_in_the_middle_between_them(
    checks: int, substeps: int
) -> None:
    lengths = uneven_lengths(checks, 10 * checks * substeps)
    each = lengths.reshape(checks, -1)
    np.testing.assert_allclose(each.sum(axis=1), 1 / checks, rtol=1e-14)
    np.testing.assert_allclose(each[:, : 5 * substeps].sum(axis=1), 0.5 / checks)
    mean = 0.1 / (checks * substeps)
    assert 0.7 * mean < lengths.min() < 0.9 * mean < 1.1 * mean < lengths.max()
    assert lengths.max() < 1.3 * mean
