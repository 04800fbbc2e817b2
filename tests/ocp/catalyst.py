"""The bifunctional catalyst: a stiff problem with many local optima.

Methylcyclopentane is turned into benzene over a blend of two catalysts. The fraction u
of one is held over each of ten parts of the reactor: x' = A(u) x. The yield is 1000 x_7
at the end.

Source: Luus, Dittrich and Keil (1992), Multiplicity of solutions in the optimization of
a bifunctional catalyst blend in a tubular reactor; best known 10.0942.
"""

import casadi as ca
import numpy as np
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp import Bounds, Model, OptimalControlProblem

BEST = 10.0941644
BEST_CONTROLS = np.array([[0.666081, 0.673501, 0.676270, *[0.9] * 7]])
X0 = np.eye(7)[0]
_RATES = (
    (0.2918487e-2, -0.8045787e-2, 0.6749947e-2, -0.1416647e-2),
    (0.9509977e1, -0.3500994e2, 0.4283329e2, -0.1733333e2),
    (0.2682093e2, -0.9556079e2, 0.1130398e3, -0.4429997e2),
    (0.2087241e3, -0.7198052e3, 0.8277466e3, -0.3166655e3),
    (0.1350005e1, -0.6850027e1, 0.1216671e2, -0.6666689e1),
    (0.1921995e-1, -0.7945320e-1, 0.1105666e0, -0.5033333e-1),
    (0.1323596e0, -0.4696255e0, 0.5539323e0, -0.2166664e0),
    (0.7339981e1, -0.2527328e2, 0.2993329e2, -0.1199999e2),
    (-0.3950534e0, 0.1679353e1, -0.1777829e1, 0.4974987e0),
    (-0.2504665e-4, 0.1005854e-1, -0.1986696e-1, 0.9833470e-2),
)
"""Coefficients of 1, u, u^2, u^3 in each rate."""


def model() -> Model:
    """Return x' = A(u) x."""
    x, u = ca.SX.sym("x", 7), ca.SX.sym("u")
    k1, k2, k3, k4, k5, k6, k7, k8, k9, k10 = (
        c[0] + u * (c[1] + u * (c[2] + u * c[3])) for c in _RATES
    )
    a, b, _, d, e, f, g = ca.vertsplit(x)
    return Model(
        states=x,
        controls=u,
        ode=[
            -k1 * a,
            k1 * a - (k2 + k3) * b + k4 * e,
            k2 * b,
            -k6 * d + k5 * e,
            k3 * b + k6 * d - (k4 + k5 + k8 + k9) * e + k7 * f + k10 * g,
            k8 * e - k7 * f,
            k9 * e - k10 * g,
        ],  # type: ignore[arg-type]
    )


def problem(*, integrator: str, substeps: int) -> OptimalControlProblem:
    """Return the maximisation of the yield, as a minimisation."""
    catalyst = model()
    return OptimalControlProblem(
        catalyst,
        horizon=2000.0,
        intervals=10,
        terminal_cost=-1000 * catalyst.states[6],
        bounds=Bounds(controls=(0.6, 0.9)),
        integrator=integrator,
        substeps=substeps,
    )


def exact_end(controls: Array) -> Array:
    """Return the states at the end of controls (1, 10), by matrix exponentials."""
    catalyst = model()
    slope = ca.jacobian(catalyst.ode, catalyst.states)
    A = ca.Function("A", [catalyst.controls], [slope])
    x = X0
    for u in controls[0]:
        x = expm(200 * np.array(A(u))) @ x
    return np.asarray(x)
