"""Evidence of small problems whose bounds follow by hand."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from swarmstart.ocp.lower_bound.stated.answer import (
    Evidence,
    Polynomial,
    Pruning,
    Step,
    Tube,
)
from swarmstart.ocp.lower_bound.stated.statement import Statement

TINY = 1e-6
Powers = Mapping[tuple[int, int], float] | Mapping[tuple[int, int, int], float]


def polynomial(powers: Powers, half: float = 2.0) -> Polynomial:
    """The sum of coefficients times powers, in Chebyshev products scaled by `half`."""
    d = len(next(iter(powers)))
    terms: dict[tuple[int, ...], float] = {}
    for exponents, coefficient in powers.items():
        rows = [chebyshev.poly2cheb([0.0] * e + [half**e]) for e in exponents]
        for place in itertools.product(*(range(len(row)) for row in rows)):
            factors = [row[k] for row, k in zip(rows, place, strict=True)]
            value = coefficient * float(np.prod(factors))
            if value:
                terms[place] = terms.get(place, 0.0) + value
    return Polynomial(
        middle=np.zeros(d),
        half=np.full(d, half),
        exponents=np.array(list(terms), dtype=np.int64),
        coefficients=np.array(list(terms.values())),
    )


def step(
    powers: Powers,
    slack: float = TINY,
    end_slack: float | None = TINY,
) -> Step:
    return Step(polynomial=polynomial(powers), slack=slack, end_slack=end_slack)


def speeds(x0: list[float], speed: list[float], horizon: float) -> Tube:
    """The box that |x_i'| <= speed_i keep, with a little more speed."""
    n = len(x0)
    directions, first, last = [], [], []
    for i, sign in itertools.product(range(n), (1.0, -1.0)):
        directions.append([sign * float(i == j) for j in range(n)])
        first.append(sign * x0[i] + 1e-3)
        last.append(sign * x0[i] + 1e-3 + (speed[i] + 1e-3) * horizon)
    return Tube(
        directions=np.array(directions),
        times=np.array([0.0, horizon]),
        levels=np.array([first, last]),
    )


def scalar(**changes: object) -> Statement:
    """min of the integral of x^2 + u^2 and x(1)^2, x' = u from 1, |u| <= 2.

    Its cost-to-go is x^2 for |x| <= 2: of u = -x the Hamiltonian is 0.
    """
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("u")
    entries: dict[str, object] = {
        "time": t,
        "states": x,
        "controls": u,
        "rate": u,
        "stage": x**2 + u**2,
        "end": x**2,
        "x0": np.ones(1),
        "sizes": np.ones(1),
        "horizon": (1.0, 1.0),
        "control_box": (np.array([-2.0]), np.array([2.0])),
        "state_box": (np.array([-np.inf]), np.array([np.inf])),
    }
    if "path" in changes:
        changes["path"] = (changes["path"](t, x),)  # type: ignore[operator]
    return Statement(**(entries | changes))  # type: ignore[arg-type]


def quadratic() -> Evidence:
    """The scalar problem, V = x^2: the bound is 1 but for the slacks."""
    return Evidence(
        statement=scalar(),
        tube=speeds([1.0], [2.0], 1.0),
        prunings=(),
        final=step({(0, 2): 1.0}),
        known=np.inf,
        bound=1.0 - 2.001 * TINY,
    )


def slackened() -> Evidence:
    """The scalar problem, V = x^2 - .001 t: the slack makes up for V_t = -.001."""
    evidence = quadratic()
    final = step({(0, 2): 1.0, (1, 0): -1e-3}, slack=1.001e-3)
    return replace(evidence, final=final, bound=1.0 - 1.003e-3)


def riccati() -> Evidence:
    """The scalar problem without end cost: V = .6 (1 - t) x^2 below tanh(1 - t) x^2."""
    return Evidence(
        statement=scalar(end=ca.SX(0)),
        tube=speeds([1.0], [2.0], 1.0),
        prunings=(),
        final=step({(0, 2): 0.6, (1, 2): -0.6}),
        known=np.inf,
        bound=0.6 - 2.001 * TINY,
    )


BENT = {(0, 2): 1.0, (0, 4): -0.8}
"""x^2 - .8 x^4, whose inequality x^2 >= (V_x / 2)^2 holds for x^2 <= 1.25 only."""


def pruned() -> Evidence:
    """C = -x^2, G = x^2: a trajectory through x costs at least 2 x^2 - 1.

    So one cheaper than 1.3 has x^2 <= 1.15, where V = x^2 - .8 x^4 is proven.
    """
    pruning = Pruning(come=step({(0, 2): -1.0}, end_slack=None), go=step({(0, 2): 1.0}))
    return Evidence(
        statement=scalar(),
        tube=speeds([1.0], [2.0], 1.0),
        prunings=(pruning,),
        final=step(BENT),
        known=1.3,
        bound=0.2 - 2.001 * TINY,
    )


def constrained() -> Evidence:
    """The same V where x <= 1.05 is a path constraint, and x >= -1.05 a bound."""
    statement = scalar(
        path=lambda t, x: x - 1.05,
        state_box=(np.array([-1.05]), np.array([np.inf])),
        control_box=(np.array([-2.5]), np.array([2.5])),
    )
    return Evidence(
        statement=statement,
        tube=speeds([1.0], [2.5], 1.0),
        prunings=(),
        final=step(BENT),
        known=np.inf,
        bound=0.2 - 2.001 * TINY,
    )


def least_time() -> Evidence:
    """Double integrator from (1, 0) to 0 in least time, which is 2, |u| <= 1.

    V = .3 x1 + .36 x2: 1 + .3 x2 - .36 >= 0 for x2 >= -2.11. The end is within 1e-3.
    """
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("u")
    ends = tuple(s * x[i] - 1e-3 for i in range(2) for s in (1, -1))
    statement = Statement(
        time=t,
        states=x,
        controls=u,
        rate=ca.vertcat(x[1], u),
        stage=ca.SX(1),
        end=ca.SX(0),
        x0=np.array([1.0, 0.0]),
        sizes=np.ones(2),
        horizon=(0.0, 2.1),
        control_box=(np.array([-1.0]), np.array([1.0])),
        state_box=(np.full(2, -np.inf), np.full(2, np.inf)),
        ends=ends,
    )
    return Evidence(
        statement=statement,
        tube=speeds([1.0, 0.0], [2.12, 1.0], 2.1),
        prunings=(),
        final=step({(0, 1, 0): 0.3, (0, 0, 1): 0.36}, end_slack=1e-3),
        known=np.inf,
        bound=0.299 - 2.2 * TINY,
    )


STEEPEST = -0.232465575158
"""The least of u^2 + sin(u), where 2 u = -cos(u)."""


def steered() -> Evidence:
    """x' = sin(u), integral of u^2, x(1) at the end: V = x + (1 - t) STEEPEST.

    Not affine in u; the optimum is x0 + STEEPEST.
    """
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("u")
    statement = scalar(time=t, states=x, controls=u, rate=ca.sin(u), stage=u**2, end=x)
    return Evidence(
        statement=statement,
        tube=speeds([1.0], [1.0], 1.0),
        prunings=(),
        final=step({(0, 1): 1.0, (0, 0): STEEPEST, (1, 0): -STEEPEST}),
        known=np.inf,
        bound=1.0 + STEEPEST - 2.001 * TINY,
    )


ALL = (quadratic, slackened, riccati, pruned, constrained, least_time, steered)
