"""Steps applied interval after interval, against the same in Python."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.scan import Role, compile_scan

N, SIZE = 5, 37


@pytest.fixture
def step() -> ca.Function:
    """(x, u of each, a of an individual, s of an interval, p) -> (x after, kept)."""
    x, u, a = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("a", 2)
    s, p = ca.SX.sym("s", 2), ca.SX.sym("p")
    after = ca.vertcat(x[1] + u * s[0], ca.sin(x[0]) * p + a[1] * s[1])
    return ca.Function("step", [x, u, a, s, p], [after, ca.vertcat(x[0] * u, a[0], x)])


ROLES: list[Role] = ["carried", "both", "individual", "interval", "shared"]


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("threads", [1, 3])
def test_scan_is_the_step_turn_by_turn(
    step: ca.Function, backward: bool, threads: int
) -> None:
    rng, size = np.random.default_rng(0), SIZE * 40
    x, u = rng.normal(size=(2, size)), rng.normal(size=(N, size))
    a, s = rng.normal(size=(2, size)), rng.normal(size=2 * N)
    x[0, 5] = 1e11  # Served by the C library.
    kernel = compile_scan(step, ROLES, turns=N, backward=backward, threads=threads)
    end, kept = kernel.evaluate([x, u, a, s, np.array([0.7])])
    by_hand, want = step.map(size), np.empty((N, 4, size))
    for k in reversed(range(N)) if backward else range(N):
        known = [u[k : k + 1], a, np.repeat(s[2 * k : 2 * k + 2, None], size, 1)]
        x, rows = map(np.array, by_hand(x, *known, np.full((1, size), 0.7)))
        want[k] = rows
    np.testing.assert_allclose(end, x, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(kept.reshape(want.shape), want, rtol=1e-11, atol=1e-11)


@pytest.mark.usefixtures("compiler")
def test_one_turn_is_a_call() -> None:
    x = ca.SX.sym("x")
    twice = ca.Function("twice", [x], [2 * x])
    (end,) = compile_scan(twice, ["carried"], turns=1).evaluate([np.ones((1, 3))])
    np.testing.assert_array_equal(end, [[2.0, 2.0, 2.0]])


@pytest.mark.usefixtures("compiler")
def test_backward_and_forward_are_not_taken_for_each_other(step: ca.Function) -> None:
    """The cache tells them apart, and numbers of turns, too."""
    rng = np.random.default_rng(0)
    given = [rng.normal(size=shape) for shape in ((2, 9), (N, 9), (2, 9), (2 * N,))]
    ends = [
        compile_scan(step, ROLES, turns=N, backward=backward).evaluate(
            [*given, np.ones(1)]
        )[0]
        for backward in (False, True)
    ]
    assert not np.allclose(ends[0], ends[1])


@pytest.mark.parametrize("roles", [ROLES[:3], [*ROLES[:4], "known"]])
def test_roles_that_do_not_fit_are_refused(
    step: ca.Function, roles: list[Role]
) -> None:
    with pytest.raises(InvalidProblemError, match="roles must be 5 of carried"):
        compile_scan(step, roles, turns=N)


def test_what_is_carried_keeps_its_size(step: ca.Function) -> None:
    roles: list[Role] = ["shared", "carried", "individual", "interval", "shared"]
    with pytest.raises(InvalidProblemError, match=r"sizes \[1\] of what is carried"):
        compile_scan(step, roles, turns=N)
