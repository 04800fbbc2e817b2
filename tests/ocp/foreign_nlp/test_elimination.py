"""Elimination of the states of an Opti: supported forms, and errors."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.foreign_nlp.opti import warm_start

N, H = 10, 0.1
Made = tuple[ca.Opti, list[ca.MX], list[ca.MX]]


def acceleration(x: ca.MX, u: ca.MX) -> ca.MX:
    return ca.vertcat(x[1], u - 0.2 * ca.sin(x[0]))


def problem(
    defects: Callable[[ca.Opti, ca.MX, ca.MX], None],
    ends: Callable[[ca.Opti, ca.MX], None] = lambda o, x: o.subject_to(x[:, 0] == 0),
) -> Made:
    """Return a double integrator with the given defects and ends."""
    opti = ca.Opti()
    x, u = opti.variable(2, N + 1), opti.variable(1, N)
    defects(opti, x, u)
    ends(opti, x)
    opti.subject_to(opti.bounded(-1, u, 1))
    opti.subject_to(opti.bounded(-5, ca.vec(x), 5))
    return finished(opti, [x], [u])


def finished(opti: ca.Opti, x: list[ca.MX], u: list[ca.MX]) -> Made:
    opti.minimize(sum(ca.sumsqr(one) for one in (*x, *u)))
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0})
    return opti, x, u


def euler(form: Callable[[ca.MX, ca.MX, ca.MX], ca.MX]) -> Made:
    """Return a problem whose defects are form(x after, x before, rate)."""

    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(N):
            rate = acceleration(x[:, k], u[k])
            opti.subject_to(form(x[:, k + 1], x[:, k], rate))

    return problem(defects)


def plain(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
    for k in range(N):
        opti.subject_to(x[:, k + 1] == x[:, k] + H * acceleration(x[:, k], u[k]))


def bounded_by_zero() -> Made:
    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(N):
            defect = x[:, k + 1] - x[:, k] - H * acceleration(x[:, k], u[k])
            opti.subject_to(opti.bounded(0, defect, 0))

    return problem(defects)


def mapped() -> Made:
    x, u = ca.MX.sym("x", 2), ca.MX.sym("u")
    step = ca.Function("step", [x, u], [x + H * acceleration(x, u)])

    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        opti.subject_to(x[:, 1:] == step.map(N)(x[:, :-1], u))

    return problem(defects)


def integrated(options: dict[str, bool]) -> Made:
    x, u = ca.MX.sym("x", 2), ca.MX.sym("u")
    dae = {"x": x, "p": u, "ode": acceleration(x, u)}
    step = ca.integrator("step", "rk", dae, 0, H, options)

    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(N):
            opti.subject_to(x[:, k + 1] == step(x0=x[:, k], p=u[k])["xf"])

    return problem(defects)


def semi_implicit() -> Made:
    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(N):
            opti.subject_to(x[1, k + 1] == x[1, k] + H * (u[k] - ca.sin(x[0, k])))
            opti.subject_to(x[0, k + 1] == x[0, k] + H * x[1, k + 1])

    return problem(defects)


def one_variable_a_turn() -> Made:
    opti = ca.Opti()
    states, controls = [opti.variable(2)], []
    opti.subject_to(states[0] == 0)
    for _ in range(N):
        controls.append(opti.variable())
        states.append(opti.variable(2))
        rate = acceleration(states[-2], controls[-1])
        opti.subject_to(states[-1] == states[-2] + H * rate)
        opti.subject_to(opti.bounded(-1, controls[-1], 1))
    return finished(opti, states, controls)


def rows_are_times() -> Made:
    opti = ca.Opti()
    x, u = opti.variable(N + 1, 2), opti.variable(N)
    for k in range(N):
        rate = acceleration(x[k, :].T, u[k])
        opti.subject_to(x[k + 1, :].T == x[k, :].T + H * rate)
    opti.subject_to(x[0, :] == 0)
    opti.subject_to(opti.bounded(-1, u, 1))
    return finished(opti, [x], [u])


def free_time_as_a_rate() -> Made:
    opti = ca.Opti()
    x, u, t = opti.variable(2, N + 1), opti.variable(1, N), opti.variable()
    for k in range(N):
        rate = (x[:, k + 1] - x[:, k]) / (t / N)
        opti.subject_to(rate == acceleration(x[:, k], u[k]))
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(opti.bounded(-1, u, 1))
    opti.subject_to(opti.bounded(0.5, t, 2))
    return finished(opti, [x], [u])


def initial_values_by_parameter() -> Made:
    def ends(opti: ca.Opti, x: ca.MX) -> None:
        p = opti.parameter(2)
        opti.set_value(p, [0.3, -0.2])
        opti.subject_to(x[:, 0] == p)

    return problem(plain, ends)


def last(opti: ca.Opti, x: ca.MX) -> None:
    opti.subject_to(x[:, -1] == 0)


def both(opti: ca.Opti, x: ca.MX) -> None:
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[0, -1] == 0.1)


def periodic(opti: ca.Opti, x: ca.MX) -> None:
    opti.subject_to(x[:, -1] == x[:, 0])


THROUGH: dict[str, tuple[Callable[[], Made], int]] = {
    "plain": (lambda: problem(plain), 0),
    "initial and end": (lambda: problem(plain, both), 0),
    "end only": (lambda: problem(plain, last), 2),
    "periodic": (lambda: problem(plain, periodic), 2),
    "free ends": (lambda: problem(plain, lambda o, x: None), 2),
    "reversed sides": (lambda: euler(lambda b, a, f: a + H * f == b), 0),
    "zero on the right": (lambda: euler(lambda b, a, f: b - a - H * f == 0), 0),
    "scaled rows": (lambda: euler(lambda b, a, f: 1e3 * (b - a - H * f) == 0), 0),
    "rate form": (lambda: euler(lambda b, a, f: (b - a) / H == f), 0),
    "bounded by zero": (bounded_by_zero, 0),
    "one variable a turn": (one_variable_a_turn, 0),
    "mapped": (mapped, 0),
    "free time as a rate": (free_time_as_a_rate, 0),
    "semi-implicit Euler": (semi_implicit, 0),
    "simplified rk": (lambda: integrated({"simplify": True}), 0),
    "rows are times": (rows_are_times, 0),
    "initial values by parameter": (initial_values_by_parameter, 0),
}


@pytest.mark.parametrize("name", THROUGH)
def test_eliminated_rows_are_zero_whatever_the_other_variables_are(name: str) -> None:
    make, torn = THROUGH[name]
    opti, x, u = make()
    found = warm_start(opti, controls=u, states=x)._found
    assert found.torn.size == torn
    rows = ca.Function("rows", [opti.x, opti.p], [opti.g])
    lower = ca.Function("lower", [opti.p], [opti.lbg])
    p = np.atleast_1d(opti.value(opti.p, opti.initial()))[: opti.np]
    bound = np.array(lower(p)).ravel()
    free = np.random.default_rng(3).uniform(0.5, 1.0, found.free.size)
    whole = np.array(found.whole(free, p, bound)).ravel()
    gone = np.setdiff1d(np.arange(opti.ng), found.kept)
    assert gone.size == 2 * (N + 1) - torn
    residual = (np.array(rows(whole, p)).ravel() - bound)[gone]
    assert np.abs(residual).max() < 1e-11
    assert np.array_equal(whole[found.free], free)
    assert gone.size + found.free.size == opti.nx


@pytest.mark.parametrize("ends", [last, both])
def test_what_pins_the_end_stays_a_constraint(
    ends: Callable[[ca.Opti, ca.MX], None],
) -> None:
    opti, x, u = problem(plain, ends)
    found = warm_start(opti, controls=u, states=x)._found
    jacobian = ca.Function("jacobian", [opti.x], [ca.jacobian(opti.g, opti.x)])
    used = np.array(jacobian(np.full(opti.nx, 0.5))) != 0
    places = np.array(ca.Function("places", [opti.x], [x[0][:, -1]])(range(opti.nx)))
    at_end = used[:, places.ravel().astype(int)].any(axis=1)
    pins = np.flatnonzero(at_end & (used.sum(axis=1) == 1))
    assert pins.size and {*pins} <= {*found.kept}


def implicit() -> Made:
    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(N):
            rate = acceleration(x[:, k + 1], u[k])
            opti.subject_to(x[:, k + 1] == x[:, k] + H * rate)

    return problem(defects)


def trapezoid() -> Made:
    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(N):
            rates = acceleration(x[:, k], u[k]) + acceleration(x[:, k + 1], u[k])
            opti.subject_to(x[:, k + 1] == x[:, k] + H / 2 * rates)

    return problem(defects)


def collocated() -> Made:
    def defects(opti: ca.Opti, x: ca.MX, u: ca.MX) -> None:
        for k in range(0, N, 2):
            inner, end = x[:, k + 1], x[:, k + 2]
            slope = (end - x[:, k]) / (2 * H)
            opti.subject_to(slope == acceleration(inner, u[k]))
            bend = 4 * inner - 3 * x[:, k] - end
            opti.subject_to(bend == 2 * H * acceleration(x[:, k], u[k]))

    return problem(defects)


@pytest.mark.parametrize("make", [implicit, trapezoid, collocated])
def test_an_implicit_step_is_refused_with_the_line_it_stands_in(
    make: Callable[[], Made],
) -> None:
    opti, x, u = make()
    with pytest.raises(InvalidProblemError, match="cannot be eliminated") as refused:
        warm_start(opti, controls=u, states=x)
    assert "test_elimination.py:" in str(refused.value)
    assert "opti.subject_to(" in str(refused.value)
    assert "constraint g[" in str(refused.value)


def test_a_state_that_no_constraint_has_is_refused() -> None:
    opti = ca.Opti()
    x, u = opti.variable(1, 4), opti.variable(1, 3)
    opti.subject_to(x[0] == 0)
    opti.subject_to(opti.bounded(-1, u, 1))
    opti, xs, us = finished(opti, [x], [u])
    with pytest.raises(InvalidProblemError, match="no equality constraint has it"):
        warm_start(opti, controls=us, states=xs)


def test_a_nonlinear_row_defines_no_state() -> None:
    """x^2 = u has two solutions."""
    opti, x, u = euler(lambda b, a, f: b**2 == a + H * f)
    with pytest.raises(InvalidProblemError, match="cannot be eliminated"):
        warm_start(opti, controls=u, states=x)
