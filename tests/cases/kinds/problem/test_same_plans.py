"""Two of the chapter's scenarios, written as problems, are planned the same.

The plans are compared with those of the special kinds: `kind: problem` states the same
model, costs and constraints in another form.
"""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.format.yaml_reader import parse_yaml
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.formation_flight.problem import (
    dynamics_of,
    reference_of,
    terminal_cost_of,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.models.horseshoe_vortex import Aircraft, derivatives
from swarmstart.cases.kinds.planar import unicycle
from swarmstart.ocp import simulate

SAME = 1e-10

PASSING_SIDE = """
kind: problem
name: passing_side_as_problem
constants: {{{P}}}
states:
  v: {{start: 15, rate: a}}
  psi: {{start: 0, rate: w}}
  x: {{start: -60, rate: v*cos(psi)}}
  y: {{start: 0, rate: v*sin(psi)}}
controls:
  a: {{bounds: [-5, 5]}}
  w: {{bounds: [-pi/18, pi/18]}}
signals: {{slot_v: 15, slot_psi: 0, slot_x: -50 + 15*time, slot_y: 8}}
definitions: {{e1: v - slot_v, e2: psi - slot_psi, e3: x - slot_x, e4: y - slot_y}}
stage_cost: (e1*e1 + e2*e2 + e3*e3 + e4*e4) + (a*a + w*w)
terminal_cost: {terminal}
path:
  - {{distance: [x, y - 1], at_least: 12, scale: 1}}
prediction: {{horizon_s: 8, intervals: 8, checks: 4, substeps: 1, quadrature: left}}
feedback: receding_horizon
steps: 1
lanes: 0
{search}
"""
CLOSE_FORMATION = """
kind: problem
name: close_formation_as_problem
constants: {{{C}, slot_x: 60, slot_y: 23.6, tau_v: 5, tau_psi: 0.75, {heights}}}
parameters:
  V_L: {{times: [0, 5], values: [200, 250], between: hold}}
  psi_L: {{times: [0, 5], values: [0, radians(20)], between: hold}}
  h_L: 0
states:
  x: {{start: 60, rate: V_L*cos(psi_L - psi) - V + centre_y*r}}
  y: {{start: 23.6, rate: V_L*sin(psi_L - psi) - centre_x*r}}
  psi: {{start: 0, rate: r}}
  V: {{start: 200, rate: (V_c - V)/tau_v - q*dC_D}}
  z: {{start: 0, rate: zeta}}
  zeta: {{start: 0, rate: -(1/t_a + 1/t_b)*zeta + (h_c - h_L - z)/(t_a*t_b) + q*dC_L}}
controls:
  V_c: {{bounds: [150, 350]}}
  psi_c: {{bounds: [-pi/4, pi/4]}}
  h_c: {{bounds: [-20, 20]}}
definitions:
  dC_L: C_Ly*(y - centre_y) + C_Lz*z
  dC_D: C_Dy*(y - centre_y) + C_Dz*z
  dC_Y: C_Yy*(y - centre_y) + C_Yz*z
  r: (psi_c - psi)/tau_psi + q/V*dC_Y
stage_cost: >-
  (100*(x - slot_x)**2 + 100*(y - slot_y)**2 + 100*z**2 + (V - V_L)**2
  + (psi - psi_L)**2)/0.1
prediction: {{horizon_s: 0.1, intervals: 1, substeps: 1, quadrature: right}}
candidates: [{{V_c: V_L, psi_c: psi_L, h_c: h_L}}]
feedback: {{law: receding_horizon, append: last}}
plant: {{substeps: 10}}
steps: 60
{search}
polish: none
"""


def test_passing_side_is_planned_as_its_own_kind_plans_it() -> None:
    kind = resolve(read_document("passing_side"))
    assert isinstance(kind.scenario, FormationScenario)
    P = terminal_cost_of(
        kind.scenario, dynamics_of(unicycle()), reference_of(kind.scenario)
    )
    names = {f"P{i}{j}": P[i, j] for i in range(4) for j in range(4)}
    text = PASSING_SIDE.format(
        P=_mapping(names),
        terminal=" + ".join(f"P{i}{j}*e{i + 1}*e{j + 1}" for i, j in np.ndindex(4, 4)),
        search=_search("passing_side"),
    )
    stated = resolve(parse_yaml(text.encode(), name="stated"))
    for own, other in zip(_plans(stated, 1), _plans(kind, 1), strict=True):
        np.testing.assert_allclose(own, other, rtol=0, atol=SAME)


@pytest.mark.parametrize("seed", [0, 1])
def test_close_formation_is_planned_as_its_own_kind_plans_it(seed: int) -> None:
    kind = resolve(read_document("close_formation"))
    aircraft = Aircraft()
    centre_x, centre_y = 2 * aircraft.span_ft, np.pi * aircraft.span_ft / 4
    slopes = derivatives(aircraft, centre_y, 0.0)._asdict()
    names = {**slopes, "q": aircraft.acceleration_ft_s2}
    names |= {"centre_x": centre_x, "centre_y": centre_y}
    text = CLOSE_FORMATION.format(
        heights="t_a: 0.3075, t_b: 3.85",
        C=_mapping(names),
        search=_search("close_formation"),
    )
    stated = resolve(parse_yaml(text.encode(), name="stated"))
    for own, other in zip(
        _plans(stated, 60, seed), _plans(kind, 60, seed), strict=True
    ):
        np.testing.assert_allclose(own, other, rtol=SAME, atol=SAME)


def _mapping(names: dict[str, float]) -> str:
    return ", ".join(f"{name}: {float(value)!r}" for name, value in names.items())


def _search(name: str) -> str:
    """Return the search, budget, order and polish of a shipped scenario, as YAML."""
    data = resolve(read_document(name)).settings
    return "\n".join(
        f"{key}: {json.dumps(data[key])}" for key in ("search", "budget", "order")
    )


def _plans(resolved: Resolved, steps: int, seed: int = 0) -> Iterator[Array]:
    """Yield the plans of the first steps with the states after them."""
    flight = flight_of(resolved.kind.pose(resolved.scenario), resolved.scenario)
    rng = np.random.default_rng(seed)
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=steps, rng=rng)
    yield from (decision.plans[0].controls for decision in flown.decisions)
    yield flown.states
