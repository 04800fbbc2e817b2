"""Judgement of a step, case by case."""

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.solver import LaneSolver
from swarmstart.ocp.lanes.stages import Kernel, LaneOptions, stages
from swarmstart.ocp.lanes.verdict import STEPS, verdict_kernel
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.rollout.shooting import shooting_of
from swarmstart.tests.ocp.lanes.problems import cart

pytestmark = pytest.mark.usefixtures("compiler")

LANE = {
    "r": 1.0, "r_end": 1e-12, "tolerance": 1e-2, "broken": np.inf, "broken_end": np.inf,
    "value_now": 2.0, "mu": 1e-3, "length": 1.0, "paid": 1.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    """Return the verdict on lanes of a problem whose end knows no rows but two."""
    _, end, begin = stages(multiple_shooting(shooting_of(cart())))
    assert begin is None
    return verdict_kernel(end, None, LaneOptions(), starts=0)


def verdict(
    kernel: Kernel, new: list[float], **lane: float | Array
) -> dict[str, Array]:
    """Return the verdict on a lane whose intervals' value would be as given."""
    shape, n = kernel.code.shape, len(new)
    shared = LaneSolver(cart()).posed([0.0, 1.0]).shared()
    given = {name: np.asarray(value) for name, value in (LANE | shared | lane).items()}
    arguments: list[Array] = []
    sizes = zip(kernel.reads, shape.inputs, shape.per_individual, strict=True)
    for name, rows, own in sizes:
        value = np.broadcast_to(
            given.get(name, np.zeros(1)), (rows, n) if own else rows
        )
        arguments.append(np.array(value, dtype=np.float64))
    arguments[kernel.reads.index("sums_new")][0] = new
    return dict(zip(kernel.writes, kernel.code.evaluate(arguments), strict=True))


def test_step_that_helps_is_taken_and_eases_the_next(kernel: Kernel) -> None:
    found = verdict(kernel, [1.0, 3.0])
    np.testing.assert_array_equal(found["taken"][0], [1, 0])
    np.testing.assert_allclose(found["next.value"][0], [1.0, 2.0])
    np.testing.assert_allclose(found["next.mu"][0], [1e-4, 1e-3])
    np.testing.assert_allclose(found["next.length"][0], STEPS[:2])
    np.testing.assert_array_equal(found["next.iterations"][0], [1, 0])


def test_lane_is_regularised_where_the_shortest_step_does_not_help(
    kernel: Kernel,
) -> None:
    found = verdict(kernel, [3.0], length=STEPS[-1], theta=1.0)
    assert found["next.mu"] == pytest.approx(2e-2)
    assert found["next.length"] == 1
    assert found["next.theta"] == 0
    assert found["next.iterations"] == 1


def test_no_step_runs_wild(kernel: Kernel) -> None:
    """However low its value is; where lanes begin is as it is."""
    far = np.array([[1e3, 2e4, 2e4], [0, 0, 0]])
    deep = [-1e6, -1e9, -1e9]
    np.testing.assert_array_equal(
        verdict(kernel, deep, end_new=far)["taken"][0], [1, 0, 0]
    )
    begins = verdict(kernel, deep, end_new=far, length=0.0)
    np.testing.assert_array_equal(begins["taken"][0], [1, 1, 1])
    out = verdict(kernel, deep, end_new=far, end=np.full((2, 3), 3e4))
    np.testing.assert_array_equal(out["taken"][0], [1, 1, 1])


def test_lane_that_begins_outside_the_numbers_is_done(kernel: Kernel) -> None:
    found = verdict(kernel, [np.nan, np.inf, 1.0], length=0.0)
    np.testing.assert_array_equal(found["done"][0], [1, 1, 0])
    np.testing.assert_array_equal(found["taken"][0], [0, 0, 1])


def test_lane_that_gains_nothing_renews_its_multipliers(kernel: Kernel) -> None:
    """To r times what its rows are beyond their limits."""
    there = np.array([[0.3], [0.0]])
    found = verdict(kernel, [2.0], end=there, end_new=there)
    assert found["next.fresh"] == 1
    assert found["next.tolerance"] == pytest.approx(1e-4)
    beyond = np.abs(found["next.m_end"]).max() / 1e-12
    assert beyond == pytest.approx(found["next.broken_end"].item())
    assert beyond > 0.1


def test_lane_ends_after_its_most_steps(kernel: Kernel) -> None:
    most = LaneOptions().most
    found = verdict(kernel, [1.0, 1.0], iterations=np.array([most - 2, most - 1]))
    np.testing.assert_array_equal(found["done"][0], [0, 1])
