"""An Opti, or a dictionary for nlpsol, solved from its own start and a searched one."""

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.common.errors import InvalidProblemError, SolveError
from swarmstart.ocp.foreign_nlp.opti import warm_start
from swarmstart.ocp.foreign_nlp.warm_started import WarmStartedSolver

QUIET: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
DISCS = np.array([[2.0, 4.2, 6.2, 8.2], [0.3, -0.6, 0.5, -0.3], [0.9, 1.0, 1.0, 0.9]])
BEST_FOUR_DISCS = 10.818588
"""N = 40: cost of the best of 100 random starts of IPOPT; 27 of them reach it."""
RACE_CAR = 1.904634
"""N = 100: cost of the Opti in CasADi's documentation, from its own start."""

Made = tuple[ca.Opti, ca.MX, ca.MX, ca.MX]


def thrust(x: ca.MX, u: ca.MX) -> ca.MX:
    """Return the rate of a car's position and speed."""
    return ca.vertcat(x[1], u - x[1])


def turn(x: ca.MX, w: ca.MX) -> ca.MX:
    """Return the rate of place, heading and effort."""
    return ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), w, w**2)


def step(rate: Callable[[ca.MX, ca.MX], ca.MX], x: ca.MX, u: ca.MX, h: ca.MX) -> ca.MX:
    """Return the state after a step of the classical Runge-Kutta method."""
    k1 = rate(x, u)
    k2 = rate(x + h / 2 * k1, u)
    k3 = rate(x + h / 2 * k2, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, u))


def race_car(intervals: int) -> Made:
    """Return the race car of CasADi's documentation of Opti."""
    opti = ca.Opti()
    x, u = opti.variable(2, intervals + 1), opti.variable(1, intervals)
    t = opti.variable()
    for k in range(intervals):
        opti.subject_to(x[:, k + 1] == step(thrust, x[:, k], u[k], t / intervals))
    opti.minimize(t)
    opti.subject_to(x[1, :] <= 1 - ca.sin(2 * ca.pi * x[0, :]) / 2)
    opti.subject_to(opti.bounded(0, u, 1))
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[0, -1] == 1)
    opti.subject_to(t >= 0)
    opti.set_initial(x[1, :], 1)
    opti.set_initial(t, 1)
    opti.solver("ipopt", QUIET)
    return opti, x, u, t


def four_discs(intervals: int = 40) -> Made:
    """Return a UAV's path through four discs, with zeros as the states' start."""
    opti = ca.Opti()
    x, w = opti.variable(4, intervals + 1), opti.variable(1, intervals)
    t, discs = opti.variable(), opti.parameter(3, 4)
    for k in range(intervals):
        end = x[:, k]
        for _ in range(2):
            end = step(turn, end, w[k], t / intervals / 2)
        opti.subject_to(x[:, k + 1] == end)
        for j in range(4):
            apart = ca.sumsqr(x[:2, k + 1] - discs[:2, j])
            opti.subject_to(apart >= discs[2, j] ** 2)
    opti.minimize(t + 0.1 * x[3, -1])
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[:2, -1] == ca.vertcat(10, 0))
    opti.subject_to(opti.bounded(-3, w, 3))
    opti.subject_to(opti.bounded(10, t, 20))
    opti.set_initial(t, 15)
    opti.set_value(discs, DISCS)
    opti.solver("ipopt", QUIET)
    return opti, x, w, t


def two_wells(*, lower: bool = False) -> tuple[ca.Opti, ca.MX, ca.MX]:
    """Return min (x(1)^2 - 0.25)^2 + 0.1 x(1); the start is in the upper well.

    Args:
        lower: Whether the start is in the lower, better well instead.
    """
    opti = ca.Opti()
    x, u = opti.variable(1, 6), opti.variable(1, 5)
    for k in range(5):
        opti.subject_to(x[k + 1] == x[k] + 0.2 * u[k])
    opti.subject_to(x[0] == 0)
    opti.subject_to(opti.bounded(-1, u, 1))
    opti.minimize((x[5] ** 2 - 0.25) ** 2 + 0.1 * x[5])
    sign = -1 if lower else 1
    opti.set_initial(u, sign * 0.5)
    opti.set_initial(x, sign * np.linspace(0, 0.5, 6))
    opti.solver("ipopt", QUIET)
    return opti, x, u


def lower_well() -> float:
    """Return the lower minimum, from the stationary points 4 z^3 - z + 0.1 = 0."""
    z = np.roots([4.0, 0.0, -1.0, 0.1]).real
    return float(((z**2 - 0.25) ** 2 + 0.1 * z).min())


def test_a_better_basin_than_that_of_the_own_start_is_found() -> None:
    opti, x, u = two_wells()
    assert opti.solve().value(opti.f) > lower_well() + 0.05
    warm = warm_start(opti, controls=[u], states=[x], budget=2000)
    solution = warm.solve()
    assert warm.report is not None
    assert warm.report.winner == "searched start"
    assert solution.value(opti.f) == pytest.approx(lower_well(), abs=1e-7)
    assert "the searched start won" in repr(warm)


def test_the_opti_has_the_winners_solution_and_initial_values() -> None:
    opti, x, u = two_wells()
    solution = warm_start(opti, controls=[u], states=[x], budget=2000).solve()
    assert np.array_equal(opti.value(x), solution.value(x))
    assert np.ravel(opti.value(x, opti.initial()))[-1] < 0
    assert "two_wells" in opti.debug.g_describe(0)
    again = opti.solve()
    assert again.value(opti.f) == pytest.approx(solution.value(opti.f), abs=1e-9)


def test_an_opti_whose_own_start_wins_stays_as_it_was() -> None:
    opti, x, u = two_wells(lower=True)
    before = opti.value(opti.x, opti.initial())
    warm = warm_start(opti, controls=[u], states=[x], budget=2000)
    solution = warm.solve()
    assert warm.report is not None and warm.report.winner == "own start"
    assert warm.report.searched.cost == pytest.approx(lower_well(), abs=1e-7)
    assert np.array_equal(before, opti.value(opti.x, opti.initial()))
    assert np.array_equal(opti.value(x), solution.value(x))
    alone, y, _ = two_wells(lower=True)
    assert np.array_equal(alone.solve().value(y), solution.value(x))


def test_an_own_solution_is_brought_back_if_the_second_run_is_worse(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    always = lambda *arguments: True  # noqa: E731
    monkeypatch.setattr(WarmStartedSolver, "_may_win", always)
    opti, x, u = two_wells(lower=True)
    before = opti.value(opti.x, opti.initial())
    warm = warm_start(opti, controls=[u], states=[x], budget=2000)
    solution = warm.solve()
    assert warm.report is not None and warm.report.winner == "own start"
    assert warm.report.searched.iterations > 0
    assert np.array_equal(opti.value(x), solution.value(x))
    assert np.array_equal(before, opti.value(opti.x, opti.initial()))


def test_the_race_car_stays_at_its_published_answer() -> None:
    opti, x, u, _ = race_car(100)
    solution = warm_start(opti, controls=[u], states=[x], budget=2000).solve()
    assert solution.value(opti.f) == pytest.approx(RACE_CAR, abs=1e-5)


def test_four_discs_are_passed_that_the_opti_alone_calls_infeasible() -> None:
    opti, x, w, _ = four_discs()
    warm = warm_start(opti, controls=[w], states=[x])
    solution = warm.solve()
    assert warm.report is not None
    assert warm.report.own.status == "Infeasible_Problem_Detected"
    assert not warm.report.own.feasible
    assert warm.report.winner == "searched start"
    assert solution.value(opti.f) == pytest.approx(BEST_FOUR_DISCS, abs=2e-6)
    way = solution.value(x)[:2]
    for cx, cy, r in DISCS.T:
        apart = np.hypot(way[0, 1:] - cx, way[1, 1:] - cy)
        assert apart.min() > r - 1e-6
    assert way[:, -1] == pytest.approx([10, 0], abs=1e-6)


def test_the_same_seed_gives_the_same_bits() -> None:
    answers = []
    for _ in range(2):
        opti, x, u = two_wells()
        warm = warm_start(opti, controls=[u], states=[x], budget=1000, seed=4)
        answers.append(warm.solve().value(opti.x))
    assert np.array_equal(*answers)


def test_a_solver_is_used_again_when_a_parameter_changes() -> None:
    opti = ca.Opti()
    x, u, p = opti.variable(1, 6), opti.variable(1, 5), opti.parameter()
    for k in range(5):
        opti.subject_to(x[k + 1] == x[k] + 0.2 * u[k])
    opti.subject_to(x[0] == p)
    opti.subject_to(opti.bounded(-1, u, 1))
    opti.minimize((x[5] ** 2 - 0.25) ** 2 + 0.1 * x[5])
    opti.solver("ipopt", QUIET)
    opti.set_value(p, 0.1)
    warm = warm_start(opti, controls=[u], states=[x], budget=1000)
    for value in (0.1, -0.3):
        opti.set_value(p, value)
        solution = warm.solve()
        assert solution.value(x)[0] == pytest.approx(value, abs=1e-8)
        assert solution.value(opti.f) == pytest.approx(lower_well(), abs=1e-7)


def dictionary() -> tuple[dict[str, Any], dict[str, Any], ca.MX, ca.MX]:
    """Return the two wells for nlpsol, the first state pinned by its bounds."""
    x, u = ca.MX.sym("x", 6), ca.MX.sym("u", 5)
    cost = (x[5] ** 2 - 0.25) ** 2 + 0.1 * x[5]
    g = x[1:] - x[:-1] - 0.2 * u
    nlp = {"x": ca.vertcat(x, u), "f": cost, "g": g}
    numbers = {
        "lbx": np.array([0.0, *[-np.inf] * 5, *[-1.0] * 5]),
        "ubx": np.array([0.0, *[np.inf] * 5, *[1.0] * 5]),
        "x0": np.array([*np.linspace(0, 0.5, 6), *[0.5] * 5]),
    }
    return nlp, numbers, x, u


@pytest.mark.parametrize("named", ["expressions", "indices"])
def test_a_dictionary_for_nlpsol_is_solved_likewise(named: str) -> None:
    nlp, numbers, x, u = dictionary()
    alone = ca.nlpsol("alone", "ipopt", nlp, QUIET)(lbg=0, ubg=0, **numbers)
    assert float(alone["f"]) > lower_well() + 0.05
    by_name: Any = named == "expressions"
    warm = warm_start(
        nlp,
        controls=[u if by_name else [[*range(6, 11)]]],
        states=[x if by_name else [[*range(6)]]],
        lbg=0,
        ubg=0,
        options=QUIET,
        budget=1000,
        **numbers,
    )
    answer = warm.solve()
    assert float(answer["f"]) == pytest.approx(lower_well(), abs=1e-7)
    assert warm.report is not None and warm.report.winner == "searched start"


def test_both_reasons_are_given_if_neither_start_leads_anywhere() -> None:
    opti, x, u = two_wells()
    opti.subject_to(x[5] >= 3)
    warm = warm_start(opti, controls=[u], states=[x], budget=500)
    with pytest.raises(SolveError, match="neither start") as failed:
        warm.solve()
    assert str(failed.value).count("Infeasible_Problem_Detected") == 2


def test_what_the_solver_calls_solved_but_is_not_feasible_does_not_win() -> None:
    """With a tolerance of 1, IPOPT calls almost any point solved."""
    opti, x, u = two_wells()
    opti.subject_to(x[5] == 0.4)
    opti.solver("ipopt", {**QUIET, "ipopt.tol": 10, "ipopt.constr_viol_tol": 10})
    opti.set_initial(opti.x, 0)
    warm = warm_start(opti, controls=[u], states=[x], budget=500)
    warm.solve()
    report = warm.report
    assert report is not None
    assert not report.own.feasible or report.own.violation <= 1e-6
    if not report.own.feasible and report.searched.feasible:
        assert report.winner == "searched start"


CRASHES = """
import casadi as ca
import numpy as np
import swarmstart as ss
x, u = ca.MX.sym("x", 2), ca.MX.sym("u")
ode = ca.vertcat(x[1], u - x[0])
grid = np.linspace(-9, 9, 21)
if "{kind}" in ("linear", "bspline"):
    table = ca.interpolant("table", "{kind}", [grid], np.sin(grid))
    step = ca.Function("step", [x, u], [x + 0.1 * ca.vertcat(x[1], u - table(x[0]))])
else:
    made = ca.integrator("step", "{kind}", dict(x=x, p=u, ode=ode), 0, 0.1)
    step = lambda x, u: made(x0=x, p=u)["xf"]
opti = ca.Opti()
X, U = opti.variable(2, 6), opti.variable(1, 5)
for k in range(5):
    opti.subject_to(X[:, k + 1] == step(X[:, k], U[k]))
opti.subject_to(X[:, 0] == 1)
opti.subject_to(opti.bounded(-1, U, 1))
opti.minimize(ca.sumsqr(X))
opti.solver("ipopt")
try:
    ss.warm_start(opti, controls=[U], states=[X])
except ss.InvalidProblemError as error:
    print("refused:", error)
"""


@pytest.mark.parametrize("kind", ["cvodes", "rk", "linear", "bspline"])
def test_what_would_end_the_process_is_refused(kind: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CRASHES.format(kind=kind)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    name = "table" if kind in ("linear", "bspline") else "step"
    assert "refused: the NLP cannot be written in scalar SX" in done.stdout
    assert f"it calls {name} (" in done.stdout


def test_a_control_without_bounds_is_asked_for_by_its_keyword() -> None:
    opti = ca.Opti()
    x, u = opti.variable(1, 6), opti.variable(1, 5)
    for k in range(5):
        opti.subject_to(x[k + 1] == x[k] + 0.2 * u[k])
    opti.subject_to(x[0] == 0)
    opti.minimize((x[5] ** 2 - 0.25) ** 2 + 0.1 * x[5])
    opti.set_initial(x, np.linspace(0, 0.5, 6))
    opti.solver("ipopt", QUIET)
    with pytest.raises(InvalidProblemError, match=r"bounds=\{variable: \(lower, upper"):
        warm_start(opti, controls=[u], states=[x])
    for bounds in ({u: (-1, 1)}, [(u, (-1, 1))]):
        warm = warm_start(opti, controls=[u], states=[x], bounds=bounds, budget=1000)
        assert warm.solve().value(opti.f) == pytest.approx(lower_well(), abs=1e-7)
    with pytest.raises(InvalidProblemError, match="lower <= upper, got"):
        warm_start(opti, controls=[u], states=[x], bounds={u: (1, -1)})
    with pytest.raises(InvalidProblemError, match="bounds must be pairs"):
        warm_start(opti, controls=[u], states=[x], bounds={u: 3})


def test_bounds_that_leave_nothing_are_refused() -> None:
    opti, x, u = two_wells()
    with pytest.raises(InvalidProblemError, match="are empty: expected lower <= upper"):
        warm_start(opti, controls=[u], states=[x], bounds={u: (2, 3)})


def test_a_parameter_without_value_is_refused_by_its_line() -> None:
    opti, x, u = two_wells()
    p = opti.parameter()
    opti.subject_to(x[3] <= p)
    with pytest.raises(InvalidProblemError, match="found none of Opti parameter"):
        warm_start(opti, controls=[u], states=[x])


def test_a_discrete_variable_is_refused() -> None:
    opti, x, u = two_wells()
    if not hasattr(opti, "set_domain"):
        pytest.skip("this CasADi's Opti has no discrete variables")
    opti.set_domain(u, "integer")
    with pytest.raises(InvalidProblemError, match="found a discrete one"):
        warm_start(opti, controls=[u], states=[x])
    nlp, numbers, x, u = dictionary()
    with pytest.raises(InvalidProblemError, match="found the option 'discrete'"):
        warm_start(
            nlp, controls=[u], states=[x], options={"discrete": [True] * 11}, **numbers
        )


def test_names_of_states_and_controls_must_be_variables() -> None:
    opti, x, u = two_wells()
    foreign = ca.Opti().variable(1, 6)
    for states, said in (
        ([], "states must be a list of variables, at least one"),
        ([foreign], "states must be variables of this Opti"),
        ([2 * x], "states must be variables of this Opti"),
        (["x"], "states must be variables of this Opti"),
        ([x[0]], "states must have one number of times, at least 2"),
        ([x, x], "states must name each variable once"),
        ([u], "is named as a state and as a control"),
    ):
        with pytest.raises(InvalidProblemError, match=said):
            warm_start(opti, controls=[u], states=states)
    with pytest.raises(InvalidProblemError, match="controls must be a list"):
        warm_start(opti, controls=[], states=[x])


def test_what_is_no_nlp_is_refused() -> None:
    opti, x, u = two_wells()
    with pytest.raises(InvalidProblemError, match="takes an Opti or a dictionary"):
        warm_start(ca.SX.sym("x"), controls=[u], states=[x])  # type: ignore[arg-type]
    with pytest.raises(InvalidProblemError, match="expected no lbg"):
        warm_start(opti, controls=[u], states=[x], lbg=0)
    with pytest.raises(InvalidProblemError, match="needs a search"):
        warm_start(opti, controls=[u], states=[x], search=None)
    with pytest.raises(InvalidProblemError, match="an NLP has no lanes; got Memetic"):
        warm_start(opti, controls=[u], states=[x], search="memetic")
    nlp, numbers, x, u = dictionary()
    with pytest.raises(InvalidProblemError, match="lbg must be a number or 5 numbers"):
        warm_start(nlp, controls=[u], states=[x], lbg=[0, 0], **numbers)
    with pytest.raises(InvalidProblemError, match="indices from 0 to 10"):
        warm_start(nlp, controls=[u], states=[np.array([[0, 99]])], **numbers)


def test_an_opti_that_was_changed_is_refused() -> None:
    opti, x, u = two_wells()
    warm = warm_start(opti, controls=[u], states=[x], budget=500)
    opti.subject_to(x[3] <= 0.2)
    with pytest.raises(InvalidProblemError, match="changed after warm_start"):
        warm.solve()


def test_a_search_without_a_finite_roll_out_is_said() -> None:
    opti, x, u = two_wells()
    opti.minimize(ca.log(-1 - x[5] ** 2))
    warm = warm_start(opti, controls=[u], states=[x], budget=500)
    with pytest.raises(SolveError, match="no roll-out of the search was finite"):
        warm.solve()


def test_a_constraint_that_is_not_a_number_is_no_kept_one() -> None:
    """In the lower well the logarithm is NaN; fmax(0, NaN) is 0."""
    opti, x, u = two_wells()
    opti.subject_to(ca.log(x[5] + 0.3) <= 5)
    warm = warm_start(opti, controls=[u], states=[x], budget=1000)
    starts = warm._candidates(warm._nlp.source.numbers())
    assert starts and all(x[5] > -0.3 for x in starts)


def test_scaled_variables_are_read_in_their_own_units() -> None:
    opti, x, u = two_wells()
    opti.set_linear_scale(x, 10, 3)
    opti.set_linear_scale(u, 0.1)
    solution = warm_start(opti, controls=[u], states=[x], budget=1000).solve()
    assert solution.value(opti.f) == pytest.approx(lower_well(), abs=1e-7)
    assert solution.value(x)[0] == pytest.approx(0, abs=1e-7)
