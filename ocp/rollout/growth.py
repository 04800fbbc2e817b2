"""Growth of deviations along a trajectory: what a roll-out from the start can confirm.

With x' = f(x, u), a small deviation d of the state obeys d' = A(t) d with A = df/dx.
Over some time it is multiplied by a matrix whose largest singular value is the growth,
with each state divided by its size. A roll-out of controls that are right up to 1e-8
says nothing of an end after a growth of 1e8; each interval alone still does.
"""

import math
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp.rollout.fitness import Known, at_nodes, shared_arguments
from swarmstart.ocp.rollout.path import signals_between
from swarmstart.ocp.rollout.shooting import Shooting

MOST = math.log(1e8)
"""Logarithm of the largest growth that a roll-out is trusted with."""
_LONGEST = 300
"""Power of ten above which a factor is no number any more."""
_STEEPEST = 300.0
"""Largest norm of A dt that is exponentiated; more is growth enough."""


class Growth(NamedTuple):
    """The largest growth of a deviation.

    Attributes:
        log: Its natural logarithm.
        begin: When the deviation begins to grow [s].
        end: When it is largest [s].
        rate: The fastest growing mode: the largest real part of an eigenvalue [1/s].
        time: Its time [s].
    """

    log: float
    begin: float
    end: float
    rate: float
    time: float

    @property
    def is_large(self) -> bool:
        """True if a roll-out over this time confirms nothing."""
        return not self.log <= MOST

    def __str__(self) -> str:
        """Return the growth as part of a sentence."""
        power = self.log / math.log(10)
        factor = f"{10**power:.2g}" if power < _LONGEST else f"1e{power:.0f}"
        return (
            f"a deviation grows {factor}-fold from {self.begin:.4g} s to "
            f"{self.end:.4g} s (fastest by {self.rate:.3g} per second at "
            f"{self.time:.4g} s)"
        )


def growth_along(
    shooting: Shooting,
    states: Array,
    controls: Array,
    known: Known,
    sizes: Array,
) -> Growth:
    """Return the growth along states at the beginning of each interval.

    Args:
        shooting: The problem's functions.
        states: Shape (nx, N); what is not finite counts as the end.
        controls: Shape (nu, N).
        known: Parameters and signals.
        sizes: Of the states, shape (nx,).
    """
    problem = shooting.problem
    finite = np.isfinite(states).all(axis=0)
    count = int(np.argmin(finite)) if not finite.all() else finite.size
    times = problem.times[:: problem.checks][:-1]
    nothing = Growth(0.0, 0.0, 0.0, 0.0, 0.0)
    if not count:
        return nothing
    _, parameters, flat = shared_arguments(problem, states[:, 0], known)
    signals = signals_between(problem, at_nodes(problem, flat), times)
    slopes = slopes_of(shooting)
    # With a free end time the core's horizon is 1: its rates are per horizon.
    whole = shooting.lowered.end_time(states[:, 0]) / problem.length
    best, deviation, log, begin = nothing, np.eye(sizes.size), 0.0, 0.0
    fastest = (0.0, 0.0)
    for k in range(count):
        given = states[:, k], controls[:, k], parameters, signals[: problem.model.ns, k]
        A = np.array(slopes(*given)) * sizes / sizes[:, None]
        if not np.isfinite(A).all():
            break
        time = float(times[k]) * whole
        rate = float(np.linalg.eigvals(A).real.max()) / whole
        if rate > (1 + 1e-9) * fastest[0]:  # The first of equal ones.
            fastest = rate, time
        step = A * problem.dt
        norm = float(np.linalg.norm(step))
        deviation = expm(step * min(1.0, _STEEPEST / max(norm, 1e-300))) @ deviation
        size = max(float(np.linalg.norm(deviation, 2)), 1e-300)
        log, deviation = log + math.log(size), deviation / size
        if log > best.log:
            best = Growth(log, begin, time + problem.dt * whole, 0.0, 0.0)
        if log < 0.0:  # A later deviation grows more.
            log, deviation, begin = 0.0, np.eye(sizes.size), time + problem.dt * whole
    return best._replace(rate=fastest[0], time=fastest[1])


def slopes_of(shooting: Shooting) -> ca.Function:
    """Return (x, u, p, s) -> df/dx."""
    f = shooting.dynamics
    arguments = [ca.SX.sym(f.name_in(i), *f.size_in(i)) for i in range(f.n_in())]
    return ca.Function("slopes", arguments, [ca.jacobian(f(*arguments), arguments[0])])
