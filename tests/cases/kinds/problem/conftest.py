"""Problems as text, resolved and simulated without a record."""

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.format.scenario import Resolved, resolve
from swarmstart.cases.format.yaml_reader import parse_yaml
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.ocp import Trajectory, simulate

PENDULUM = """\
kind: problem
constants: {g: 9.81}
states:
  angle: {start: 0, rate: speed, unit: rad}
  speed: {start: 0, rate: torque - g*sin(angle), unit: rad/s}
controls:
  torque: {bounds: [-8, 8]}
stage_cost: torque**2
terminal: [{expression: angle - pi}, {expression: speed}]
prediction: {horizon_s: 3, intervals: 50}
"""


def stated(text: str, *assignments: str) -> Resolved:
    """Return a text as a resolved scenario."""
    document = parse_yaml(text.encode(), name="stated.yaml")
    return resolve(document, assignments=assignments)


def scenario_of(text: str) -> ProblemScenario:
    """Return a text as a problem scenario."""
    scenario = stated(text).scenario
    assert isinstance(scenario, ProblemScenario)
    return scenario


def simulated(text: str, seed: int = 0) -> tuple[Trajectory, Mapping[str, Measure]]:
    """Return the path of a problem and its measures."""
    resolved = stated(text)
    flight = flight_of(resolved.kind.pose(resolved.scenario), resolved.scenario)
    rng = np.random.default_rng(seed)
    steps = resolved.scenario.steps
    path = simulate(flight.plant, flight.controller, flight.x0, steps=steps, rng=rng)
    return path, resolved.kind.measure(resolved.scenario, flight, path)


@pytest.fixture
def refused() -> Callable[[str, str], str]:
    """Return the message for the pendulum with one part of its text replaced."""

    def message(part: str, other: str) -> str:
        assert part in PENDULUM
        with pytest.raises(InvalidScenarioError) as caught:
            stated(PENDULUM.replace(part, other, 1))
        return str(caught.value)

    return message
