"""Attempts to refute a certificate: its own counterexample, and random points.

All is computed in plain floats, except the judgement of a counterexample. A sampled
statement that survives is not proven; the report says "sampled only".
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Sequence

from flint import arb

from swarmstart.terminal_set.checker.certificate_file import Certificate, Vector
from swarmstart.terminal_set.checker.coordinates import (
    Floats,
    root_of_inverse,
    symmetric,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (
    ROUNDING,
    PointwiseChange,
)
from swarmstart.terminal_set.checker.findings import Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.motion import Program

SAMPLES = 200
REFINEMENT = 32  # Runge-Kutta steps of the flow a step of the map
TIMES = 8  # instants within a hold
_FLOAT_ERROR = 1e-10  # relative, of the map and the flow themselves

FLOAT_OPERATIONS: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": math.pow,
    "fmin": min,
    "fmax": max,
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: 2 * a,
    "inv": lambda a: 1 / a,
    "fabs": abs,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
    "log": math.log,
    "atan": math.atan,
    "tanh": math.tanh,
}


class SampledMotion:
    """The motion relative to the reference in floats.

    Attributes:
        certificate: What the file states.
    """

    def __init__(self, certificate: Certificate, deadline: Deadline) -> None:
        """Keep the live part of the tape."""
        self.certificate = certificate
        self._program = Program.of(certificate, deadline)

    def rate(self, x: Sequence[float], u: Sequence[float]) -> list[float]:
        """f(x, u), shape (nx,)."""
        results: dict[int, float] = {}
        for number, (operation, operands, constant) in self._program.timed_steps():
            if operation == "const":
                results[number] = constant
            elif operation in ("x", "u"):
                results[number] = (x if operation == "x" else u)[operands[0]]
            else:
                arguments = [results[i] for i in operands]
                results[number] = FLOAT_OPERATIONS[operation](*arguments)
        return [results[i] for i in self._program.outputs]

    def moved(self, e: Sequence[float], time: float, steps: int) -> Vector:
        """Return e after a time, by Runge-Kutta steps with the input held.

        Args:
            e: State relative to the reference, shape (nx,).
            time: Duration [s].
            steps: Number of steps.

        Returns:
            The state relative to the reference's own, shape (nx,).
        """
        c = self.certificate
        x = [r + entry for r, entry in zip(c.x_ref, e, strict=True)]
        u = [
            r - sum(k * entry for k, entry in zip(row, e, strict=True))
            for r, row in zip(c.u_ref, c.K, strict=True)
        ]
        ours = self._integrate(x, u, time, steps)
        reference = self._integrate(c.x_ref, c.u_ref, time, steps)
        return tuple(a - b for a, b in zip(ours, reference, strict=True))

    def _integrate(
        self, x: Sequence[float], u: Sequence[float], time: float, steps: int
    ) -> list[float]:
        h, state = time / steps, list(x)
        for _ in range(steps):
            k1 = self.rate(state, u)
            k2 = self.rate(_reach(state, k1, h / 2), u)
            k3 = self.rate(_reach(state, k2, h / 2), u)
            k4 = self.rate(_reach(state, k3, h), u)
            state = [
                x + h / 6 * (a + 2 * b + 2 * c + d)
                for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)
            ]
        return state


def _reach(x: Sequence[float], slope: Sequence[float], h: float) -> list[float]:
    return [a + h * b for a, b in zip(x, slope, strict=True)]


def check_refuted(certificate: Certificate, deadline: Deadline) -> Finding:
    """Check that V does not decrease at the refuted point, which lies on its level.

    Args:
        certificate: What the file states; P positive definite.
        deadline: When to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    refuted = certificate.refuted
    if refuted is None:
        return Finding(Verdict.SKIPPED, "no level is stated to be refuted")
    points = PointwiseChange(certificate, deadline)
    level = points.level([arb(entry) for entry in refuted.e])
    name = f"the point at the refuted level {refuted.alpha:.6g}"
    if refuted.alpha <= certificate.alpha:
        text = f"{name} is not beyond the set's level {certificate.alpha:.6g}"
        return Finding(Verdict.REFUSED, text)
    if not abs(level - refuted.alpha) <= ROUNDING * refuted.alpha:
        text = f"{name} has V(e) = {float(level.mid()):.12g}"
        return Finding(Verdict.REFUSED, text)
    change = points.change(refuted.e)
    if not change.upper() >= -ROUNDING * level.upper():
        text = f"{name} decreases: its change is {float(change.mid()):.6g}"
        return Finding(Verdict.REFUSED, text)
    return Finding(Verdict.PROVED, f"{name} does not decrease")


def find_counterexample(certificate: Certificate, deadline: Deadline) -> Finding | None:
    """Test the axes of small and large ellipsoids, and random boundary points.

    Args:
        certificate: What the file states; P positive definite.
        deadline: When to stop.

    Returns:
        The refusal, or None if no point fails.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    points = PointwiseChange(certificate, deadline)
    for e in _candidates(certificate):
        if points.violates_decrease(e, 0.0):
            value = points.level([arb(entry) for entry in e])
            change = points.change(e)
            return Finding(
                Verdict.REFUSED,
                f"V does not decrease at e = ({_listed(e)}): V = "
                f"{float(value.mid()):.6g}, change {float(change.mid()):.6g}",
            )
    return None


def check_integrator(certificate: Certificate, deadline: Deadline) -> Finding:
    """Check at random points that the flow is near the Runge-Kutta map, and V falls.

    Args:
        certificate: What the file states; held, P positive definite.
        deadline: When to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    if certificate.integrator is None:
        text = "the error of the Runge-Kutta map: what is proven holds for the map"
        return Finding(Verdict.SKIPPED, text)
    motion, steps = SampledMotion(certificate, deadline), certificate.substeps or 1
    dt = certificate.dt or 0.0
    largest = 0.0
    for e in _inside(certificate):
        size = _norm(certificate, e)
        try:
            flow = motion.moved(e, dt, REFINEMENT * steps)
            map_ = motion.moved(e, dt, steps)
        except (ValueError, ArithmeticError) as error:
            return _undefined(e, error)
        apart = tuple(a - b for a, b in zip(flow, map_, strict=True))
        off = _norm(certificate, apart) / size
        largest = off if not off <= largest else largest  # NaN is kept.
        if not largest <= certificate.integrator + _FLOAT_ERROR:
            return Finding(
                Verdict.REFUSED,
                f"the flow leaves the Runge-Kutta map by {largest:.3g} of |e| at e = "
                f"({_listed(e)}), more than {certificate.integrator:.3g}",
            )
        if not _norm(certificate, flow) < size:
            text = f"the flow does not decrease V at e = ({_listed(e)})"
            return Finding(Verdict.REFUSED, text)
    taken = (
        "; its proof is the library's alone" if certificate.integrator_proven else ""
    )
    return Finding(
        Verdict.SAMPLED,
        f"the flow is within {certificate.integrator:.3g} of the Runge-Kutta map: "
        f"{largest:.3g} at {SAMPLES} points{taken}",
        "the integrator's error",
    )


def check_growth_by_samples(certificate: Certificate, deadline: Deadline) -> Finding:
    """Check at random points and times that V stays below its bound between samples.

    Args:
        certificate: What the file states; held, P positive definite, growth given.
        deadline: When to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    motion, steps = SampledMotion(certificate, deadline), certificate.substeps or 1
    growth, dt = certificate.growth or 1.0, certificate.dt or 0.0
    largest = 1.0  # at t = 0
    if not largest < growth:
        text = f"V(e) is not below {growth:.6g} V(e), and so it is at t = 0"
        return Finding(Verdict.REFUSED, text)
    for e in _inside(certificate):
        size = _norm(certificate, e)
        for i in range(1, TIMES + 1):
            try:
                moved = motion.moved(e, dt * i / TIMES, steps)
            except (ValueError, ArithmeticError) as error:
                return _undefined(e, error)
            grown = (_norm(certificate, moved) / size) ** 2
            largest = grown if not grown <= largest else largest  # NaN is kept.
            if not largest < growth:
                return Finding(
                    Verdict.REFUSED,
                    f"V grows by {largest:.6g} between samples at e = ({_listed(e)}), "
                    f"t = {dt * i / TIMES:.3g} s, more than {growth:.6g}",
                )
    return Finding(
        Verdict.SAMPLED,
        f"V grows by less than {growth:.6g} between samples: {largest:.6g} at "
        f"{SAMPLES} points",
        "the growth between samples",
    )


def _candidates(certificate: Certificate) -> Iterator[Vector]:
    T = root_of_inverse(symmetric(certificate.P))
    n = range(certificate.nx)
    # Small ellipsoids show a linear part that does not contract.
    for size in (1e-4, 0.999):
        rho = size * math.sqrt(certificate.alpha)
        for j in n:
            yield tuple(rho * T[i][j] for i in n)
            yield tuple(-rho * T[i][j] for i in n)
    yield from _on_spheres(certificate, T, lambda _: 1 - 1e-12)
    yield from _on_spheres(certificate, T, lambda _: 1e-4)


def _inside(certificate: Certificate) -> Iterator[Vector]:
    T = root_of_inverse(symmetric(certificate.P))
    n = certificate.nx
    # Uniform in volume, but not so near 0 that rounding dominates.
    yield from _on_spheres(
        certificate, T, lambda chance: max(0.01, chance.random() ** (1 / n))
    )


def _on_spheres(
    certificate: Certificate, T: Floats, share: Callable[[random.Random], float]
) -> Iterator[Vector]:
    chance = random.Random(0)
    for _ in range(SAMPLES):
        z = [chance.gauss(0.0, 1.0) for _ in range(certificate.nx)]
        size = math.sqrt(sum(entry * entry for entry in z))
        rho = share(chance) * math.sqrt(certificate.alpha) / size
        yield tuple(rho * sum(a * b for a, b in zip(row, z, strict=True)) for row in T)


def _norm(certificate: Certificate, e: Vector) -> float:
    """Return |e|_P; not a number if floats overflow."""
    value = sum(
        a * entry * b
        for a, row in zip(e, certificate.P, strict=True)
        for entry, b in zip(row, e, strict=True)
    )
    return math.sqrt(max(value, 0.0)) if math.isfinite(value) else math.nan


def _undefined(e: Vector, error: Exception) -> Finding:
    text = f"the dynamics are not defined near e = ({_listed(e)}): {error}"
    return Finding(Verdict.REFUSED, text)


def _listed(e: Vector) -> str:
    return ", ".join(f"{entry:.6g}" for entry in e)
