"""Computations for claims that no simulation measures.

Two of them concern the linear law of section 5.2.3.1 as printed: its gain is that of
the continuous system, its level that of (5.14). The text does not say whether the
controller holds the input over its time step. Simulations hold it; `continuous_law`
changes it continuously.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.cases.chapter.markov_chain import GridDE, absorption, build_chain
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.formation_flight.problem import (
    dynamics_of,
    reference_of,
    terminal_set_of,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import unicycle
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.integration import integrate
from swarmstart.terminal_set import (
    Reference,
    TerminalSet,
    input_excess,
    level_from_inputs,
)

TRAP = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 0.0])
"""Costs of six points: they decrease away from the optimum, which is the last."""
# Rate eps of random immigrants, see markov_chain.py.
IMMIGRANT = 0.1
# States that are drawn on the edge of the set.
EDGE_STATES = 500
EDGE_SEED = 0
# Step of the integration [s].
STEP_S = 0.02
FLOWN_S = 30.0
"""Simulated time: 26 times the slowest time constant of the loop, 1.15 s [s]."""
SETTLED = 1e-6
"""Part of the level below which a state counts as converged."""
ROUNDING = 1e-9


class NotAFormationError(SwarmstartError, ValueError):
    """The scenario given for the linear law is not a formation flight."""


def de_absorption(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the exact probability that DE/rand/1 ever finds the optimum of a trap.

    The evolution starts from four individuals drawn uniformly. The weight of the
    difference is F = 0.5, and a mutant outside of the grid is moved to the nearest grid
    point. The probability is returned without and with random immigrants.
    """
    del job, folder
    plain = absorption(build_chain(GridDE(costs=TRAP, size=4, F=0.5)))
    aided = absorption(
        build_chain(GridDE(costs=TRAP, size=4, F=0.5, immigrant=IMMIGRANT))
    )
    return {
        "measures": {
            "absorption_probability": plain.uniform,
            "absorption_probability_with_immigrants": aided.uniform,
        }
    }


def input_levels(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the largest ratio of an input to its bound on two terminal sets.

    The law is u = u_ref - K e, and a set is e'Pe <= alpha. The sets differ in the level
    alpha, by two readings of the chapter: equation (5.14) as printed has alpha K P K';
    the line before it, (5.13), bounds K e by K alpha^(1/2) P^(-1/2), that is, the
    square of K e by alpha K P^-1 K'.
    """
    del job, folder
    printed, reference = _printed_law()
    K, P, u_max = printed.K, printed.P, reference.u_max
    meant = level_from_inputs(K, P, u_max)
    return {
        "measures": {
            "input_excess_as_printed": float(
                np.max(input_excess(K, P, printed.alpha, u_max))
            ),
            "input_excess_with_inverse": float(
                np.max(input_excess(K, P, meant, u_max))
            ),
        }
    }


def continuous_law(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return measures of the linear law with a continuous input, not a held one.

    The function simulates x' = f(x, u_ref - K (x - x_ref)) for 30 s. The states at the
    start are drawn with a fixed seed on the edge e'Pe = alpha of the set that the
    chapter prints. As in the printed law, the input is not clipped.
    """
    del job, folder
    printed, _ = _printed_law()
    rng = np.random.default_rng(EDGE_SEED)
    e = printed.ellipsoid.boundary(rng.normal(size=(len(printed.P), EDGE_STATES)))
    # One call of CasADi moves all states.
    step, highest = _closed_loop(printed).map(EDGE_STATES), np.zeros(EDGE_STATES)
    for _ in range(round(FLOWN_S / STEP_S)):
        e = np.array(step(e))
        highest = np.maximum(highest, printed.value(e))
    # All begin on the edge, where rounding alone would count as leaving.
    left = highest > printed.alpha * (1 + ROUNDING)
    converged = printed.value(e) <= SETTLED * printed.alpha
    return {
        "measures": {
            "share_leaving": float(np.mean(left)),
            "share_converging": float(np.mean(converged)),
        }
    }


def _closed_loop(printed: TerminalSet) -> ca.Function:
    """Return the step of the deviation e over STEP_S with a continuous input."""
    f = dynamics_of(unicycle())
    x_ref, u_ref = ca.DM(printed.x_ref), ca.DM(printed.u_ref)
    K = ca.DM(printed.K)

    def rate(_: float, e: ca.SX) -> ca.SX:
        # The reference moves by the same equations, so e moves by the difference.
        return f(x_ref + e, u_ref - K @ e) - f(x_ref, u_ref)

    e = ca.SX.sym("e", len(printed.x_ref))
    after = integrate("rk4", rate, e, start=0.0, duration=STEP_S, steps=1)
    return ca.Function("closed_loop", [e], [after])


def _printed_law() -> tuple[TerminalSet, Reference]:
    """Return the set of `formation_v` as printed, and the reference with its bounds."""
    scenario = resolve(read_document("formation_v"), variant="literal").scenario
    if not isinstance(scenario, FormationScenario):
        raise NotAFormationError(
            f"expected formation_v to be a formation flight, found {scenario.kind}"
        )
    reference = reference_of(scenario)
    return terminal_set_of(scenario, reference), reference
