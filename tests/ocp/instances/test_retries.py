"""Gains that neighbours' answers promise, and costs that count as lower."""

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import Free, Planner, SolutionStatus
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.instances.retries import (
    _CURVED,
    CHEAPER,
    is_cheaper,
    promises,
)
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.tests.ocp.instances.fakes import double_integrator

CORE = Planner(double_integrator(), search=None, polish=None).problem
A, B = (1.0, 0.0), (-1.0, -0.1)
"""Valleys: the cost (x - place)^2 + offset of the first state."""


def promised(
    x: list[float], valleys: list[tuple[float, float]], *, parameters: list[float]
) -> tuple[Array, Array]:
    """Return what all others promise, and the costs."""
    n = len(x)
    answers = Answers.none(CORE, n)
    answers.status[:] = SolutionStatus.CONVERGED
    places, offsets = np.array(valleys).T
    answers.cost[:] = (np.array(x) - places) ** 2 + offsets
    answers.costates[:] = 2 * (np.array(x) - places), np.zeros(n)
    rows = np.array([x, np.zeros(n)])
    instances = Instances(rows, np.array([parameters]), np.zeros((0, n)))
    around = np.array([[k for k in range(n) if k != i] for i in range(n)])
    return promises(CORE, instances, answers, around), answers.cost


def gap(x: float) -> float:
    """Return the gain of valley B at x."""
    return ((x - A[0]) ** 2 + A[1]) - ((x - B[0]) ** 2 + B[1])


def test_across_two_valleys_a_neighbour_promises_the_mean_of_both_gains() -> None:
    gains, _ = promised([-0.1, -0.7], [A, B], parameters=[0, 0])
    bent = (2 * (-0.1 - A[0]) - 2 * (-0.7 - B[0])) * 0.6  # Of second order.
    mean = (gap(-0.1) + gap(-0.7)) / 2
    assert gains[0, 0] == pytest.approx(mean / (_CURVED * abs(bent)))
    assert gains[1, 0] == 0  # Valley A saves nothing there.


def test_in_one_valley_a_cheaper_neighbour_promises_nothing() -> None:
    gains, costs = promised([0.5, 0.9, 3.0], [A, A, A], parameters=[0, 0, 0])
    assert (gains == 0).all() and np.ptp(costs) > 1


def test_an_answer_without_confirmation_is_promised_everything() -> None:
    """Its costates are of no answer."""
    gains, _ = promised([0.5, 0.9], [A, A], parameters=[0, 0])
    assert gains[0, 0] == 0
    answers = Answers.none(CORE, 2)
    answers.status[1], answers.cost[1] = SolutionStatus.FEASIBLE, 5.0
    instances = Instances(np.zeros((2, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
    found = promises(CORE, instances, answers, np.array([[1, -1], [0, -1]]))
    assert found.tolist() == [[np.inf, 0], [0, 0]]


def test_with_other_parameters_the_lower_cost_counts_alone() -> None:
    gains, costs = promised([-0.1, -0.2], [A, A], parameters=[0, 1])
    least = CHEAPER * costs[1]
    assert gains[0, 0] == 0
    assert gains[1, 0] == pytest.approx((costs[1] - costs[0]) / least)


def test_infinite_and_equal_costs_are_not_cheaper() -> None:
    before = np.array([np.inf, np.inf, 1.0, -1.0, 1.0])
    costs = np.array([1.0, np.inf, 1 - 2e-4, -1 - 2e-4, 1 - 5e-5])
    assert is_cheaper(costs, before).tolist() == [True, False, True, True, False]


def test_guesses_of_a_decided_start_are_no_distance() -> None:
    """The cost does not depend on them, whatever the lane's slope there is."""
    free = double_integrator(start={"speed": Free(-1, 1, 0.0)})
    core = Planner(free, search=None, polish=None).problem
    answers = Answers.none(core, 2)
    answers.status[:], answers.cost[:] = SolutionStatus.CONVERGED, [2.0, 2.0]
    answers.costates[:] = [[0.0, 0.0], [5.0, 5.0]]
    rows = np.array([[0.1, 0.1], [-0.9, 0.9]])
    instances = Instances(rows, np.zeros((0, 2)), np.zeros((0, 2)))
    assert not promises(core, instances, answers, np.array([[1], [0]])).any()
