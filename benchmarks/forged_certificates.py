"""Attack on the checker of certificates by forged files.

    python benchmarks/forged_certificates.py --count 1000 --seed 0

Genuine certificates are forged (`forgeries.py`) and given to the checker. It fails if
it raises, exits with 1, takes longer than its `--seconds` and SLACK, or prints
unprintable characters. It is deceived if it says "proven again" and a state of the set,
simulated by DOP853 with the file's own numbers, leaves it, violates a bound or does not
come nearer.
Exit code 3 if any of that was seen.
"""

import argparse
import contextlib
import io
import json
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.benchmarks.forgeries import Content, forgery
from swarmstart.benchmarks.terminal_set_systems import SYSTEMS
from swarmstart.benchmarks.terminal_sets import TOLERANCE, RightHandSide, certified
from swarmstart.terminal_set import certificate_text
from swarmstart.terminal_set.check import main as check

FORGED = (
    "pendulum", "pendulum, held 0.1 s", "tank", "van der Pol, reversed",
    "stirred tank, 350 K", "formation, R = diag(1, 100), bounds",
)  # fmt: skip
SLACK = 3.0
"""Allowed time beyond the limit [s]: to read a file, to end a step, on shared cores."""
HOPELESS = 60.0
"""Time beyond the limit at which a check is stopped [s]."""
STATES = 200
DURATION = 1.0
"""Duration of a simulation with a continuous input [s]."""
ROUNDING = 1e-7
"""Relative tolerance for a simulation, far above the integrator's over one hold."""
PRINTED = frozenset("\n")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of the checker on a file.

    Attributes:
        code: Its exit code; None if it raised or was stopped.
        fault: Description of the failure; "" if there is none.
    """

    code: int | None
    fault: str


class _StoppedError(BaseException):
    """A check that did not end; not an Exception, so that no handler catches it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Forge, check and simulate; print the number of each outcome."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=2.0, help="for each check")
    parser.add_argument("--keep", type=Path, help="a folder for files with a fault")
    options = parser.parse_args(arguments)
    genuine = genuine_certificates(FORGED)
    codes: Counter[int | None] = Counter()
    faults = 0
    for number in range(options.count):
        data = forged(genuine, options.seed, number)
        outcome = checked(data, options.seconds)
        codes[outcome.code] += 1
        if outcome.fault:
            faults += 1
            print(f"{number}: {outcome.fault}", flush=True)
            if options.keep is not None:
                options.keep.mkdir(parents=True, exist_ok=True)
                (options.keep / f"{number}.json").write_bytes(data)
    counted = ", ".join(
        f"{count} with exit code {code}"
        for code, count in sorted(codes.items(), key=lambda pair: str(pair[0]))
    )
    print(f"{options.count} forgeries, seed {options.seed}: {counted}; {faults} faults")
    return 3 if faults else 0


def genuine_certificates(names: Sequence[str]) -> list[Content]:
    """Return the contents of certificates of some of `SYSTEMS`."""
    found = []
    for name in names:
        certificate = certified(SYSTEMS[name](), 60.0).certificate
        if certificate is None:
            raise TypeError("expected a certified set")
        found.append(json.loads(certificate_text(certificate)))
    return found


def forged(genuine: Sequence[Content], seed: int, number: int) -> bytes:
    """Return one forgery; the same for the same numbers."""
    rng = np.random.default_rng([seed, number])
    return forgery(genuine[int(rng.integers(len(genuine)))], rng)


def checked(data: bytes, seconds: float) -> Outcome:
    """Give a file to the checker, and simulate its states if it is accepted.

    Args:
        data: The file.
        seconds: Time for the check [s].
    """
    said = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "forged.json"
        file.write_bytes(data)
        began = time.perf_counter()
        try:
            with (
                _stopped_after(seconds + HOPELESS),
                contextlib.redirect_stdout(said),
                contextlib.redirect_stderr(said),
            ):
                code = check([str(file), "--seconds", str(seconds)])
        except _StoppedError:
            return Outcome(None, "it did not end")
        except Exception as error:  # noqa: BLE001  what is looked for
            return Outcome(None, f"it raised {type(error).__name__}: {error}")
        took = time.perf_counter() - began
    return Outcome(code, _fault(code, took - seconds, said.getvalue(), data))


def _fault(code: int, late: float, said: str, data: bytes) -> str:
    """Return the fault of a check that ended; "" if there is none."""
    if code not in (0, 2, 3, 4):
        return f"exit code {code}"
    if late > SLACK:
        return f"{late:.1f} s beyond its time"
    if not all(char.isprintable() or char in PRINTED for char in said):
        return "it printed what is not printable"
    if code == 0:
        reason = refuted(json.loads(data), np.random.default_rng(0))
        return f"deceived: {reason}" if reason else ""
    return ""


@contextlib.contextmanager
def _stopped_after(seconds: float) -> Iterator[None]:
    """Raise in the block after some seconds, if the system supports it."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def stop(number: int, frame: object) -> None:
        raise _StoppedError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


class _Stated:
    """Statements of a certificate, as arrays."""

    def __init__(self, content: Content) -> None:
        """Take the numbers of the file."""
        dynamics, reference = content["dynamics"], content["reference"]
        self.field = RightHandSide(dynamics["tape"], dynamics["xdot"])
        self.x_ref, self.u_ref = (
            np.array(reference[side], dtype=float) for side in ("x", "u")
        )
        self.K, self.P, self.Q_m = (
            np.array(content[name], dtype=float) for name in ("K", "P", "Q_m")
        )
        self.alpha, self.core = content["alpha"], content["core"]["level"]
        self.dt, self.margins = content["dt"], content["margins"]
        bounds: dict[str, list[float | None]] = content["bounds"]
        self.lower, self.upper, self.u_lower, self.u_upper = (
            np.array(
                [empty if bound is None else bound for bound in bounds[name]], float
            )
            for name, empty in (
                ("x_lower", -np.inf), ("x_upper", np.inf), ("u_lower", -np.inf),
                ("u_upper", np.inf),
            )
        )  # fmt: skip
        self.may_move = ~np.isfinite(self.lower) & ~np.isfinite(self.upper)
        self.may_move[sorted(_felt(dynamics["tape"], dynamics["xdot"]))] = False

    def value(self, e: Array) -> Array:
        """Return e'Pe of columns."""
        return np.asarray(np.einsum("ik,ij,jk->k", e, self.P, e))


def _felt(tape: list[list[Any]], xdot: list[int]) -> set[int]:
    """Return the states that reach a rate."""
    waiting, seen, felt = list(xdot), set(), set()
    while waiting:
        number = waiting.pop()
        if number in seen:
            continue
        seen.add(number)
        operation, *operands = tape[number]
        if operation == "x":
            felt.add(int(operands[0]))
        elif operation not in ("u", "const"):
            waiting += [int(k) for k in operands]
    return felt


def refuted(content: Content, rng: np.random.Generator) -> str:
    """Return a violation by states of a certified set; "" if there is none.

    Args:
        content: The file.
        rng: Source of randomness of the states, half of them on the set's edge.
    """
    stated = _Stated(content)
    nx = len(stated.P)
    z = rng.normal(size=(nx, STATES))
    z /= np.linalg.norm(z, axis=0)
    z *= np.where(np.arange(STATES) % 2 == 0, 1.0, rng.random(STATES) ** (1 / nx))
    root = np.linalg.cholesky((stated.P + stated.P.T) / 2).T
    e: Array = np.sqrt(stated.alpha) * np.asarray(np.linalg.solve(root, z), dtype=float)
    u = stated.u_ref[:, None] - stated.K @ e
    slack = ROUNDING * np.abs(u).max(initial=0.0)
    if _outside(u, stated.u_lower, stated.u_upper, slack):
        return "an input breaks its bound"
    times = np.linspace(0.0, DURATION if stated.dt is None else stated.dt, 9)
    path = _flown(stated, e, times)
    grows_known = stated.dt is None or stated.margins["between_samples"] is not None
    for x in path if grows_known else path[[0, -1]]:
        slack = ROUNDING * np.abs(x).max()
        if _outside(x, stated.lower, stated.upper, slack):
            return "a state breaks its bound"
    return _without_decrease(stated, e, path)


def _without_decrease(stated: _Stated, e: Array, path: Array) -> str:
    """Return a message if e'Pe of a simulation does not decrease as stated."""
    deviations = (path - _reference(stated, path))[:, :, :-1]
    values = [stated.value(part) for part in deviations]
    before, after = values[0], values[-1]
    reserve = np.einsum("ik,ij,jk->k", e, stated.Q_m, e)
    counts = before > 4 * stated.core
    change = after - before
    if stated.dt is None:
        change = _rate(stated, e)
    if np.any(counts & ~(change + reserve < ROUNDING * (before + reserve))):
        return "e'Pe does not fall"
    between = stated.margins["between_samples"]
    if between is not None and between["grounds"] == "proven":
        most = between["growth"] * (1 + ROUNDING)
        if any(np.any(counts & ~(value <= most * before)) for value in values):
            return "e'Pe grows by more than is stated"
    return ""


def _rate(stated: _Stated, e: Array) -> Array:
    """Return the rate of e'Pe under the law [1/s]."""
    x = stated.x_ref[:, None] + np.hstack([e, np.zeros((len(e), 1))])
    u = stated.u_ref[:, None] - stated.K @ (x - stated.x_ref[:, None])
    with np.errstate(all="ignore"):
        rates = stated.field(x, u)
    drift = np.where(stated.may_move, rates[:, -1], 0.0)
    moved = rates[:, :-1] - drift[:, None]
    return np.asarray(2 * np.einsum("ik,ij,jk->k", e, stated.P, moved))


def _reference(stated: _Stated, path: Array) -> Array:
    """Return the reference at each time, at rest except for states that may move."""
    along = stated.may_move[:, None]
    return np.where(along, path[:, :, -1:], stated.x_ref[:, None])


def _flown(stated: _Stated, e: Array, times: Array) -> Array:
    """Return states at some times, (times, nx, states + 1), last the reference."""
    e = np.hstack([e, np.zeros((len(e), 1))])
    start = stated.x_ref[:, None] + e
    held = stated.u_ref[:, None] - stated.K @ e

    def rates(time: float, flat: Array) -> Array:
        del time
        x = flat.reshape(start.shape)
        u = held
        if stated.dt is None:
            u = stated.u_ref[:, None] - stated.K @ (x - _reference(stated, x[None])[0])
        with np.errstate(all="ignore"):
            return stated.field(x, u).ravel()

    flown = solve_ivp(
        rates, (times[0], times[-1]), start.ravel(), method="DOP853", t_eval=times,
        rtol=TOLERANCE, atol=1e-300 + TOLERANCE * float(np.abs(e).max()),
    )  # fmt: skip
    if not flown.success:
        return np.full((times.size, *start.shape), np.nan)
    return np.asarray(flown.y.T.reshape(times.size, *start.shape))


def _outside(values: Array, lower: Array, upper: Array, slack: float) -> bool:
    """Return whether a column is outside, or no number."""
    within = (values >= lower[:, None] - slack) & (values <= upper[:, None] + slack)
    return not bool(within.all())


if __name__ == "__main__":
    sys.exit(main())
