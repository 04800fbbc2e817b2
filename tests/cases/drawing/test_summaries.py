"""Results as a notebook shows them."""

import base64
import re

import casadi as ca

from swarmstart.ocp import Model, Plant, Trajectory
from swarmstart.tests.ocp.flights_by_hand import written


def drift() -> Trajectory:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    plant = Plant(Model(states=x, controls=u, ode=u), dt=1.0, substeps=1)
    return written(plant, [[0.0, 1.0, 2.0]], [[1.0, 1.0]])


def test_a_notebook_shows_the_summary_and_a_figure() -> None:
    shown = drift()._repr_html_()
    assert shown.startswith("<pre>Trajectory of 0 steps over 2 s")
    found = re.search(r'<img alt="[^"]+" src="data:image/png;base64,([^"]+)">$', shown)
    assert found is not None
    assert base64.b64decode(found[1]).startswith(b"\x89PNG")
