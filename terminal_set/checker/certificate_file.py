"""Reader of certificate files, which validates every entry.

Every entry is a number, a list or one of a few known words; nothing is executed. The
statements must be in the only accepted words, of which the checker judges exactly
these. Free text labelled "proven" would look as if it had been checked.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

from swarmstart.terminal_set.checker.file_content import (
    read_content,
    unusable,
)

LONGEST_TAPE = 100_000  # instructions; larger files are not worth minutes of parsing
MOST_SUBSTEPS = 10_000
MOST_STATES = 50
UNARY = frozenset("neg sq twice inv fabs sqrt sin cos tan exp log atan tanh".split())
BINARY = frozenset("add sub mul div pow fmin fmax".split())
_KEYS = frozenset(
    "format version sha256 dynamics reference bounds K P alpha core dt substeps Q_m "
    "margins refuted design proof statements".split()
)

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]
Instruction = tuple[str, tuple[int, ...], float]
T = TypeVar("T")

_PROVEN, _CLOSED_FORM, _MEASURED = "proven", "closed form", "measured"
TAKEN = "proven by the library"  # Not proven again: the checker only samples it.


@dataclass(frozen=True, kw_only=True, slots=True)
class Refuted:
    """A level beyond which the decrease is known to fail.

    Attributes:
        alpha: The level of the point.
        e: The point relative to the reference, shape (nx,).
    """

    alpha: float
    e: Vector


@dataclass(frozen=True, kw_only=True, slots=True)
class Certificate:
    """The statements of a certificate, as plain numbers.

    Attributes:
        tape: Instructions (operation, operands, constant); the number of an instruction
            is the index of its result.
        xdot: Indices into the tape, one for each state.
        x_ref: Reference state, shape (nx,).
        u_ref: Reference input, shape (nu,).
        velocity: Velocity of the reference, shape (nx,); 0 in states that rest.
        bounds: "u_lower", "u_upper", "x_lower", "x_upper"; None if missing.
        K: Gain of u = u_ref - K e, shape (nu, nx).
        P: Matrix of V(e) = e'Pe, shape (nx, nx).
        alpha: Level: the set is V(e) <= alpha.
        core: Level within which the drift of a rounded reference may cancel the
            decrease.
        drift: That drift, relative to the core's radius; in 1/s, or a fraction per hold
            for a held input.
        dt: Time for which an input is held [s]; None if it is continuous.
        substeps: Number of Runge-Kutta steps in a hold; None for a continuous input.
        Q_m: Reserve e'Q_m e of the decrease, shape (nx, nx).
        integrator: Relative error of the Runge-Kutta map; None if not stated.
        integrator_proven: Whether it is labelled proven by the library, whose proof is
            not repeated here.
        growth: Bound of V between samples, relative to V; None if not stated.
        growth_proven: Whether `growth` is labelled proven.
        refuted: Level and point of a counterexample; None if none is known.
    """

    tape: tuple[Instruction, ...]
    xdot: tuple[int, ...]
    x_ref: Vector
    u_ref: Vector
    velocity: Vector
    bounds: dict[str, tuple[float | None, ...]]
    K: Matrix
    P: Matrix
    alpha: float
    core: float
    drift: float
    dt: float | None
    substeps: int | None
    Q_m: Matrix
    integrator: float | None
    integrator_proven: bool = False
    growth: float | None
    growth_proven: bool
    refuted: Refuted | None

    @property
    def nx(self) -> int:
        """Number of states."""
        return len(self.x_ref)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return len(self.u_ref)


def read_certificate(path: Path) -> Certificate:
    """Read a certificate, compare its digest and validate its entries.

    Returns:
        The statements of the certificate.

    Raises:
        OSError: If the file cannot be read.
        CertificateFileError: If it is not a valid certificate.
        DigestError: If it was changed after it was written.
    """
    return _certificate(read_content(path))


def _mapping(value: object, where: str, keys: set[str]) -> dict[str, object]:
    if not isinstance(value, dict):
        raise unusable(where, "an object", value)
    for key in sorted(keys - set(value)):
        raise unusable(where, f'the key "{key}"', "none")
    for key in sorted(set(value) - keys):
        raise unusable(where, "only the keys " + ", ".join(sorted(keys)), key)
    return value


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise unusable(where, "a number", value)
    try:
        number = float(value)
    except OverflowError:
        raise unusable(where, "a finite number", value) from None
    # An integer above 2^53 would be read as another number than the written one.
    if not math.isfinite(number) or number != value:
        raise unusable(where, "a finite number of double precision", value)
    return number


def _at_least(value: object, where: str, least: float, *, strict: bool) -> float:
    number = _number(value, where)
    if number < least or (strict and number == least):
        sign = "above" if strict else "of at least"
        raise unusable(where, f"a number {sign} {least:g}", value)
    return number


def _integer(value: object, where: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise unusable(where, "an integer", value)
    if not least <= value <= most:
        raise unusable(where, f"an integer from {least} to {most}", value)
    return value


def _list(value: object, where: str, length: int | None) -> list[object]:
    if not isinstance(value, list):
        raise unusable(where, "a list", value)
    if length is not None and len(value) != length:
        raise unusable(where, f"a list of {length}", f"{len(value)} entries")
    return value


def _text(value: object, where: str) -> str:
    if not isinstance(value, str):
        raise unusable(where, "a text", value)
    return value


def _optional(value: object, where: str, read: Callable[[object, str], T]) -> T | None:
    return None if value is None else read(value, where)


def _vector(value: object, where: str, length: int) -> Vector:
    return tuple(
        _number(entry, f"{where}[{i}]")
        for i, entry in enumerate(_list(value, where, length))
    )


def _matrix(value: object, where: str, rows: int, columns: int) -> Matrix:
    return tuple(
        _vector(row, f"{where}[{i}]", columns)
        for i, row in enumerate(_list(value, where, rows))
    )


def _instruction(value: object, *, number: int, nx: int, nu: int) -> Instruction:
    where = f"dynamics.tape[{number}]"
    parts = _list(value, where, None)
    operation = _text(parts[0] if parts else None, f"{where}[0]")
    counts = {"const": 1, "x": 1, "u": 1}
    counts |= dict.fromkeys(UNARY, 1) | dict.fromkeys(BINARY, 2)
    if operation not in counts:
        raise unusable(f"{where}[0]", "a known operation", operation)
    _list(parts, where, counts[operation] + 1)
    if operation == "const":
        return operation, (), _number(parts[1], f"{where}[1]")
    # Operands are results of earlier instructions, so that there is no loop.
    most = {"x": nx, "u": nu}.get(operation, number) - 1
    if most < 0:
        raise unusable(where, "an operation on an earlier instruction", operation)
    operands = tuple(
        _integer(part, f"{where}[{i}]", 0, most)
        for i, part in enumerate(parts[1:], start=1)
    )
    return operation, operands, 0.0


def _certificate(content: dict[str, object]) -> Certificate:
    _mapping(content, "the file", set(_KEYS))
    version = _integer(content["version"], "version", 0, 10**9)
    if version not in (1, 2):
        raise unusable("version", "1 or 2", content["version"])
    dynamics = _mapping(content["dynamics"], "dynamics", {"nx", "nu", "tape", "xdot"})
    nx = _integer(dynamics["nx"], "dynamics.nx", 1, MOST_STATES)
    nu = _integer(dynamics["nu"], "dynamics.nu", 1, MOST_STATES)
    tape = _list(dynamics["tape"], "dynamics.tape", None)
    if not 1 <= len(tape) <= LONGEST_TAPE:
        raise unusable("dynamics.tape", f"1 to {LONGEST_TAPE} instructions", len(tape))
    instructions = tuple(
        _instruction(entry, number=i, nx=nx, nu=nu) for i, entry in enumerate(tape)
    )
    xdot = tuple(
        _integer(entry, f"dynamics.xdot[{i}]", 0, len(tape) - 1)
        for i, entry in enumerate(_list(dynamics["xdot"], "dynamics.xdot", nx))
    )
    # Files of version 1 did not say how a reference moves: all states have to rest.
    moving = {"velocity"} if version > 1 else set()
    reference = _mapping(content["reference"], "reference", {"x", "u"} | moving)
    dt = _optional(content["dt"], "dt", lambda v, w: _at_least(v, w, 0.0, strict=True))
    margins = _margins(content["margins"], held=dt is not None)
    core = _mapping(content["core"], "core", {"level", "drift"})
    _check_remarks(content, nx=nx, nu=nu)
    certificate = Certificate(
        tape=instructions,
        xdot=xdot,
        x_ref=_vector(reference["x"], "reference.x", nx),
        u_ref=_vector(reference["u"], "reference.u", nu),
        velocity=_vector(
            reference.get("velocity", [0.0] * nx), "reference.velocity", nx
        ),
        bounds=_bounds(content["bounds"], nx=nx, nu=nu),
        K=_matrix(content["K"], "K", nu, nx),
        P=_matrix(content["P"], "P", nx, nx),
        alpha=_at_least(content["alpha"], "alpha", 0.0, strict=True),
        core=_at_least(core["level"], "core.level", 0.0, strict=False),
        drift=_at_least(core["drift"], "core.drift", 0.0, strict=False),
        dt=dt,
        substeps=_substeps(content["substeps"], held=dt is not None),
        Q_m=_matrix(content["Q_m"], "Q_m", nx, nx),
        integrator=margins.integrator,
        integrator_proven=margins.integrator_proven,
        growth=margins.growth,
        growth_proven=margins.growth_proven,
        refuted=_refuted(content["refuted"], nx=nx),
    )
    _check_statements(content["statements"], certificate=certificate)
    return certificate


def _bounds(value: object, *, nx: int, nu: int) -> dict[str, tuple[float | None, ...]]:
    lengths = {"u_lower": nu, "u_upper": nu, "x_lower": nx, "x_upper": nx}
    bounds = _mapping(value, "bounds", set(lengths))
    return {
        name: tuple(
            _optional(entry, f"bounds.{name}[{i}]", _number)
            for i, entry in enumerate(_list(bounds[name], f"bounds.{name}", length))
        )
        for name, length in lengths.items()
    }


def _substeps(value: object, *, held: bool) -> int | None:
    if held:
        return _integer(value, "substeps", 1, MOST_SUBSTEPS)
    if value is not None:
        raise unusable("substeps", "null if dt is null", value)
    return None


class _Margins(NamedTuple):
    integrator: float | None
    integrator_proven: bool
    growth: float | None
    growth_proven: bool


def _margins(value: object, *, held: bool) -> _Margins:
    margins = _mapping(value, "margins", {"integrator", "between_samples"})
    if not held:
        for name, margin in margins.items():
            if margin is not None:
                raise unusable(f"margins.{name}", "null if dt is null", margin)
    error = growth = None
    taken = proven = False
    if margins["integrator"] is not None:
        error, taken = _integrator(margins["integrator"], "margins.integrator")
    if margins["between_samples"] is not None:
        where = "margins.between_samples"
        margin = _mapping(margins["between_samples"], where, {"growth", "grounds"})
        growth = _at_least(margin["growth"], f"{where}.growth", 0.0, strict=True)
        grounds = ("proven", "measured")
        proven = _one_of(margin["grounds"], f"{where}.grounds", grounds) == "proven"
    return _Margins(error, taken, growth, proven)


def _integrator(value: object, where: str) -> tuple[float, bool]:
    grounds = value.get("grounds") if isinstance(value, dict) else None
    taken = grounds == TAKEN  # The keys depend on the grounds, so these come first.
    count = "boxes" if taken else "samples"
    margin = _mapping(value, where, {"relative_error", "grounds", count})
    _one_of(margin["grounds"], f"{where}.grounds", (TAKEN, "measured"))
    _integer(margin[count], f"{where}.{count}", 0, 10**15)
    name = f"{where}.relative_error"
    return _at_least(margin["relative_error"], name, 0.0, strict=False), taken


def _one_of(value: object, where: str, allowed: tuple[str, ...]) -> str:
    if _text(value, where) not in allowed:
        raise unusable(where, " or ".join(f'"{name}"' for name in allowed), value)
    return str(value)


def _refuted(value: object, *, nx: int) -> Refuted | None:
    if value is None:
        return None
    refuted = _mapping(value, "refuted", {"alpha", "e", "change"})
    _number(refuted["change"], "refuted.change")
    return Refuted(
        alpha=_at_least(refuted["alpha"], "refuted.alpha", 0.0, strict=True),
        e=_vector(refuted["e"], "refuted.e", nx),
    )


def _check_remarks(content: dict[str, object], *, nx: int, nu: int) -> None:
    # Design and proof describe the origin of the numbers; the check ignores them.
    design = _mapping(content["design"], "design", {"name", "Q", "R", "kappa"})
    _text(design["name"], "design.name")
    _optional(design["Q"], "design.Q", lambda v, w: _matrix(v, w, nx, nx))
    _optional(design["R"], "design.R", lambda v, w: _matrix(v, w, nu, nu))
    _optional(design["kappa"], "design.kappa", _number)
    proof = _mapping(content["proof"], "proof", {"boxes", "seconds"})
    _integer(proof["boxes"], "proof.boxes", 0, 10**15)
    _at_least(proof["seconds"], "proof.seconds", 0.0, strict=False)


def _check_statements(value: object, *, certificate: Certificate) -> None:
    # A reader would take the word "proven" in the file for the checker's own verdict.
    known = expected_statements(
        held=certificate.dt is not None,
        integrator_proven=certificate.integrator_proven,
        growth_proven=certificate.growth_proven,
    )
    left = dict(known)
    for i, entry in enumerate(_list(value, "statements", None)):
        where = f"statements[{i}]"
        statement = _mapping(entry, where, {"statement", "grounds"})
        text = _text(statement["statement"], f"{where}.statement")
        grounds = _text(statement["grounds"], f"{where}.grounds")
        if text not in known:
            raise unusable(f"{where}.statement", "a statement of the format", text)
        if text not in left:
            raise unusable(f"{where}.statement", "each statement once", text)
        if grounds != left.pop(text):
            expected = f'"{known[text]}" with the margins stated'
            raise unusable(f"{where}.grounds", expected, grounds)


def expected_statements(
    *, held: bool, integrator_proven: bool, growth_proven: bool
) -> dict[str, str]:
    """Return the statements of a certificate, with their grounds.

    Args:
        held: Whether inputs are held.
        integrator_proven: Whether the integrator's error is labelled proven by the
            library.
        growth_proven: Whether the growth between samples is labelled proven.

    Returns:
        Statement -> grounds.
    """
    falls = "e'Pe falls by more than e'Q_m e"
    outside = " outside the stated core, which is not left"
    inputs = "the inputs stay within their bounds on the set"
    states = "the states stay within their bounds on the set"
    if not held:
        return {
            inputs: _CLOSED_FORM,
            states: _CLOSED_FORM,
            f"{falls} a second{outside}": _PROVEN,
        }
    return {
        inputs: _CLOSED_FORM,
        f"{states}, between samples too": (
            TAKEN if integrator_proven and growth_proven else _MEASURED
        ),
        f"{falls} a hold{outside}, for the Runge-Kutta map and any motion that "
        "differs from it by the stated error": _PROVEN,
        "the integrator's error is at most the stated one": (
            TAKEN if integrator_proven else _MEASURED
        ),
        "e'Pe stays below the stated growth between samples": (
            _PROVEN if growth_proven else _MEASURED
        ),
    }
