"""Derivatives carried from step to step are those of the whole interval."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.integrator_steps import IntegratorSteps, integrator_steps
from swarmstart.ocp.loop.controller import RecedingHorizon
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.rollout.shooting import shooting_of
from swarmstart.tests.export.controller.controllers import Case, curved, pendulum


@pytest.mark.parametrize("case", [pendulum, curved])
def test_the_chain_of_steps_is_the_interval(case: Callable[[], Case]) -> None:
    """F, the integral, its gradient, dF/dz and the curvature, at random points.

    The interval is the one that the NLP is made of, differentiated by CasADi.
    """
    controller, _ = case()
    assert isinstance(controller, RecedingHorizon)
    shooting = shooting_of(controller.planner.problem)
    program, rng = multiple_shooting(shooting), np.random.default_rng(0)
    steps, part = integrator_steps(shooting, program), program.parts.interval
    nx, nu = shooting.problem.model.nx, shooting.problem.model.nu
    z, lam = ca.SX.sym("z", nx + nu), ca.SX.sym("lam", nx)
    shared = ca.SX.sym("shared", part.values.numel_in(1))
    cost, after = part.values(z, shared, ca.SX(0, part.values.size2_in(2)))
    after = after[:nx]
    whole = ca.Function("whole", [z, lam, shared], [
        after, cost, ca.gradient(cost, z), ca.jacobian(after, z),
        ca.hessian(cost + ca.dot(lam, after), z)[0],
        ca.gradient(cost + ca.dot(lam, after), z),
    ])  # fmt: skip
    for _ in range(5):
        at, p = rng.normal(size=nx + nu), rng.normal(size=nx)
        sizes = rng.uniform(0.5, 2.0, shared.numel())
        F, spent, g, W, V, slope = map(np.array, whole(at, p, sizes))
        own = _carried(steps, (at[:nx], at[nx:], p), sizes, nx + nu)
        found = (F.ravel(), spent, g.ravel(), W, V, slope.ravel())
        for mine, theirs in zip(own, found, strict=True):
            np.testing.assert_allclose(np.array(mine), theirs, rtol=1e-10, atol=1e-10)


def _carried(
    steps: IntegratorSteps, point: tuple[Array, Array, Array], sizes: Array, nz: int
) -> tuple[Array, float, Array, Array, Array, Array]:
    """Return what the steps of an interval give, as `whole` does."""
    x, u, p = point
    none = np.zeros(0)
    rest = (none, 1.0, sizes, none, none)
    path, total = [x], 0.0
    for _ in range(steps.count):
        after, cost = steps.value(path[-1], u, *rest)
        path.append(np.array(after).ravel())
        total += float(cost)
    g, W, V = np.zeros(nz), np.eye(x.size, nz), np.zeros(nz * (nz + 1) // 2)
    costate, slope = p, np.zeros(nz)
    for y in reversed(path[:-1]):
        pulled = np.array(steps.adjoint(y, u, costate, *rest)).ravel()
        slope[x.size :] += pulled[x.size :]
        before = steps.before(y, u, costate, g, W.ravel(order="F"), V, *rest)
        costate, g, entries, V = (np.array(one).ravel() for one in before)
        W = entries.reshape((x.size, nz), order="F")
        np.testing.assert_allclose(pulled[: x.size], costate, atol=1e-12)
    slope[: x.size] = costate
    full = np.zeros((nz, nz))
    full[np.tril_indices(nz)] = V
    full += np.tril(full, -1).T
    return path[-1], total, g, W, full, slope
