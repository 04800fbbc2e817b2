"""Attempts to refute a certificate: the counterexample in it, and random points.

Points are models of no variables: numbers with a bound of their rounding, many at once.
A sampled statement that survives is not proven; the report says "sampled only".
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.coordinates import root_of_inverse, symmetric
from swarmstart.terminal_set.checker.ellipsoid_search import Change
from swarmstart.terminal_set.checker.ellipsoid_statements import ROUNDING, change_of
from swarmstart.terminal_set.checker.file_content import Vector
from swarmstart.terminal_set.checker.findings import Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.models import Array, Model, algebra_of

SAMPLES = 200
REFINEMENT = 32  # Runge-Kutta steps of the flow a step of the map
TIMES = 8  # instants within a hold
_FLOAT_ERROR = 1e-10  # relative, of the map and the flow themselves


def points(entries: Array) -> list[Model]:
    """Return states as numbers with bounds of their rounding.

    Args:
        entries: The states, each a column, shape (nx, N).
    """
    return [algebra_of(0).constant(row) for row in entries]


@np.errstate(all="ignore")
def check_refuted(certificate: Certificate, deadline: Deadline) -> Finding:
    """Check the counterexample in the file: V(e) = e'Pe must not decrease there.

    V must have the stated refuted level there, which must be above that of the set.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    refuted = certificate.refuted
    if refuted is None:
        return Finding(Verdict.SKIPPED, "no level is stated to be refuted")
    change = change_of(certificate, deadline)
    e = points(np.array(refuted.e)[:, None])
    level = change.level(e)
    name = f"the point at the refuted level {refuted.alpha:.6g}"
    if refuted.alpha <= certificate.alpha:
        text = f"{name} is not beyond the set's level {certificate.alpha:.6g}"
        return Finding(Verdict.REFUSED, text)
    apart = level.shifted(-refuted.alpha).absolute()
    if not apart.upper[0] <= ROUNDING * refuted.alpha:
        text = f"{name} has V(e) = {level.middle[0]:.12g}"
        return Finding(Verdict.REFUSED, text)
    rises = change.of(e)
    if not rises.upper[0] >= -ROUNDING * level.upper[0]:
        text = f"{name} decreases: its change is {rises.middle[0]:.6g}"
        return Finding(Verdict.REFUSED, text)
    return Finding(Verdict.PROVED, f"{name} does not decrease")


@np.errstate(all="ignore")
def find_counterexample(certificate: Certificate, deadline: Deadline) -> Finding | None:
    """Look for a state of the set at which V(e) = e'Pe does not decrease.

    Tested are points on the boundaries of a small ellipsoid near e = 0 and of a large
    one near the boundary of the set. Some of the points are random; the others are the
    multiples of the columns of L^-T that lie there, with P = LL'.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which to stop.

    Returns:
        The refusal, or None if no point fails.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    change = change_of(certificate, deadline)
    candidates = _candidates(certificate)
    failed = np.flatnonzero(fails(change, points(candidates), certificate.alpha))
    if not failed.size:
        return None
    e = candidates[:, failed[:1]]
    value, rise = change.level(points(e)), change.of(points(e))
    return Finding(
        Verdict.REFUSED,
        f"V does not decrease at e = ({_listed(e[:, 0])}): V = "
        f"{value.middle[0]:.6g}, change {rise.middle[0]:.6g}",
    )


def fails(change: Change, e: Sequence[Model], alpha: float) -> np.ndarray:
    """Return a mask of the points e != 0 of the set with c(e) >= 0 for certain.

    The set is e'Pe <= alpha, and c(e) is the `change` of e'Pe.
    """
    level = change.level(e)
    inside = (level.lower > 0.0) & (level.upper <= alpha)
    return np.asarray(inside & (change.of(e).lower >= 0.0))


@np.errstate(all="ignore")
def check_integrator(certificate: Certificate, deadline: Deadline) -> Finding:
    """Check at random points that the flow is near the Runge-Kutta map.

    It is also checked that V(e) = e'Pe is less after the flow over a hold than before.

    Args:
        certificate: The statements of the file, for an input that is held; P positive
            definite.
        deadline: Time at which to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    if certificate.integrator is None:
        text = "the error of the Runge-Kutta map: what is proven holds for the map"
        return Finding(Verdict.SKIPPED, text)
    change, dt = change_of(certificate, deadline), certificate.dt or 0.0
    e = _inside(certificate)
    size = _norm(certificate, e)
    steps = certificate.substeps or 1
    flow = _after(change, e, dt, REFINEMENT * steps)
    map_ = _after(change, e, dt, steps)
    off = _norm(certificate, flow - map_) / size
    stated = certificate.integrator
    leaves = ~(off <= stated + _FLOAT_ERROR)
    rises = ~(_norm(certificate, flow) < size)
    failed = np.flatnonzero(leaves | rises)
    if failed.size:
        i = failed[0]
        if not math.isfinite(off[i]):
            return _undefined(e[:, i])
        if rises[i] and not leaves[i]:
            text = f"the flow does not decrease V at e = ({_listed(e[:, i])})"
            return Finding(Verdict.REFUSED, text)
        return Finding(
            Verdict.REFUSED,
            f"the flow leaves the Runge-Kutta map by {off[i]:.3g} of |e| at e = "
            f"({_listed(e[:, i])}), more than {stated:.3g}",
        )
    taken = (
        "; its proof is the library's alone" if certificate.integrator_proven else ""
    )
    return Finding(
        Verdict.SAMPLED,
        f"the flow is within {stated:.3g} of the Runge-Kutta map: "
        f"{off.max():.3g} at {SAMPLES} points{taken}",
        "the integrator's error",
    )


@np.errstate(all="ignore")
def check_growth_by_samples(certificate: Certificate, deadline: Deadline) -> Finding:
    """Check the stated growth of V(e) = e'Pe between samples, at random points.

    At each point e, V is computed at several times of a hold, by the Runge-Kutta map.
    It must be below the stated growth times V(e).

    Args:
        certificate: The statements of the file, for an input that is held; P positive
            definite, growth given.
        deadline: Time at which to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    change, steps = change_of(certificate, deadline), certificate.substeps or 1
    growth, dt = certificate.growth or 1.0, certificate.dt or 0.0
    largest = 1.0  # at t = 0
    if not largest < growth:
        text = f"V(e) is not below {growth:.6g} V(e), and so it is at t = 0"
        return Finding(Verdict.REFUSED, text)
    e = _inside(certificate)
    size = _norm(certificate, e)
    for i in range(1, TIMES + 1):
        time = dt * i / TIMES
        grown = (_norm(certificate, _after(change, e, time, steps)) / size) ** 2
        failed = np.flatnonzero(~(grown < growth))
        if failed.size:
            k = failed[0]
            if not math.isfinite(grown[k]):
                return _undefined(e[:, k])
            return Finding(
                Verdict.REFUSED,
                f"V grows by {grown[k]:.6g} between samples at e = "
                f"({_listed(e[:, k])}), t = {time:.3g} s, more than {growth:.6g}",
            )
        largest = max(largest, float(grown.max()))
    return Finding(
        Verdict.SAMPLED,
        f"V grows by less than {growth:.6g} between samples: {largest:.6g} at "
        f"{SAMPLES} points",
        "the growth between samples",
    )


def _after(change: Change, e: Array, time: float, steps: int) -> Array:
    """Return states relative to the reference's own after a time, rounded, (nx, N)."""
    moved = change.motion.relative(points(e), Fraction(time), steps)
    return np.array([entry.middle for entry in moved])


def _candidates(certificate: Certificate) -> Array:
    T = np.array(root_of_inverse(symmetric(certificate.P)))
    # Small ellipsoids show a linear part that does not contract.
    axes = [
        sign * size * math.sqrt(certificate.alpha) * T
        for size in (1e-4, 0.999)
        for sign in (1.0, -1.0)
    ]
    boundary = _on_spheres(certificate, lambda _: 1 - 1e-12)
    return np.hstack([*axes, boundary, _on_spheres(certificate, lambda _: 1e-4)])


def _inside(certificate: Certificate) -> Array:
    n = certificate.nx
    # Uniform in volume, but not so near 0 that rounding dominates.
    return _on_spheres(
        certificate, lambda chance: max(0.01, chance.random() ** (1 / n))
    )


def _on_spheres(
    certificate: Certificate, share: Callable[[random.Random], float]
) -> Array:
    """Return SAMPLES states on spheres of the ellipsoid, shape (nx, SAMPLES)."""
    chance, found = random.Random(0), []
    for _ in range(SAMPLES):
        z = [chance.gauss(0.0, 1.0) for _ in range(certificate.nx)]
        size = math.sqrt(sum(entry * entry for entry in z))
        rho = share(chance) * math.sqrt(certificate.alpha) / size
        found.append([rho * entry for entry in z])
    T = np.array(root_of_inverse(symmetric(certificate.P)))
    return np.asarray(T @ np.array(found).T)


def _norm(certificate: Certificate, e: Array) -> Array:
    """Return |e|_P of states (nx, N); not a number if floats overflow."""
    value = np.einsum("iN,ij,jN->N", e, np.array(certificate.P), e)
    return np.sqrt(np.where(np.isfinite(value), np.maximum(value, 0.0), np.nan))


def _undefined(e: Array) -> Finding:
    text = f"the dynamics are not defined near e = ({_listed(e)})"
    return Finding(Verdict.REFUSED, text)


def _listed(e: Sequence[float] | Array | Vector) -> str:
    return ", ".join(f"{entry:.6g}" for entry in e)
