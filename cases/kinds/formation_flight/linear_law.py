"""The linear law of a formation's dual mode, and its terminal set.

A set with which a law takes over is certified first: its level is the largest one
within the bounds for which the decrease is proven, for inputs held over a control step.
"""

from dataclasses import fields
from functools import cache

import numpy as np

from swarmstart.cases.kinds.formation_flight.as_printed import terminal_set_as_printed
from swarmstart.cases.kinds.formation_flight.problem import dynamics_of
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.models.unicycle import unicycle
from swarmstart.terminal_set import (
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
    sampled_terminal_set,
)

SEED = 0
"""Seed of the samples for a certificate's margins: a set is the same in every run."""


def terminal_set_of(scenario: FormationScenario, reference: Reference) -> TerminalSet:
    """Return the terminal set of the dual mode, certified if its law takes over.

    Args:
        scenario: The scenario.
        reference: The leader's motion and the bounds.

    Raises:
        SwarmstartError: If the law cannot be designed, or its set cannot be proven.
    """
    dual = scenario.dual_mode
    dt = scenario.prediction.dt
    if dual.is_certified:
        return _certified(_entries(reference), tuple(dual.Q), tuple(dual.R), dt)
    dynamics, Q, R = dynamics_of(unicycle()), np.diag(dual.Q), np.diag(dual.R)
    if dual.design == "literal":
        P = np.array(dual.P)
        return terminal_set_as_printed(dynamics, reference, Q=Q, R=R, P=P)
    return sampled_terminal_set(dynamics, reference, dt=dt, Q=Q, R=R)


@cache
def _certified(
    entries: tuple[tuple[str, tuple[float, ...]], ...],
    Q: tuple[float, ...],
    R: tuple[float, ...],
    dt: float,
) -> TerminalSet:
    """Return the certified set, computed once for all flights of a process.

    Args:
        entries: Entries of the reference: name -> numbers.
        Q: Diagonal of the state weight.
        R: Diagonal of the input weight.
        dt: Time for which inputs are held [s].
    """
    reference = Reference(**{name: np.array(values) for name, values in entries})
    return certified_terminal_set(
        dynamics_of(unicycle()),
        reference,
        Weights(Q=np.diag(Q), R=np.diag(R)),
        dt=dt,
        rng=np.random.default_rng(SEED),
    )


def _entries(reference: Reference) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Return a reference in a form that can be a key."""
    values = ((each.name, getattr(reference, each.name)) for each in fields(reference))
    return tuple((name, tuple(v.tolist())) for name, v in values if v is not None)
