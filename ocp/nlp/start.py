"""Start of a polish: controls, and what else is known of an answer beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.carried import Carried


class Start(NamedTuple):
    """Start of a polish.

    Attributes:
        controls: Controls, shape (nu, N).
        states: States at the nodes, shape (nx, nodes); None: those that the controls
            lead to.
        x0: Initial state, including the decisions about it, shape (nx,); None: as
            given.
        is_guess: Whether the states give the sizes of unbounded states, by which
            the NLP is scaled.
        carried: Multipliers of an earlier answer, from which a polish starts; None
            without them.
        decided: Decisions of an earlier answer about the start of the core's states, by
            their names: a free end time, parameters.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u - x**3), horizon=1.0, intervals=5,
        ...     stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> line = np.linspace(2.0, 0.0, 6)[None, :]
        >>> guess = ss.Start(controls=np.zeros((1, 5)), states=line)
        >>> found = ss.solve(problem, [2.0], guess=guess, search=None, lanes=0, seed=0)
        >>> found.status.name
        'CONVERGED'
    """

    controls: Array
    states: Array | None = None
    x0: Array | None = None
    is_guess: bool = False
    carried: Carried | None = None
    decided: Mapping[str, float] = MappingProxyType({})
