"""Statements of a certificate of a terminal set, and their reader.

A statement must have one of the texts of `expected_statements`, which are exactly those
that the checker judges. Free text labelled "proven" would look as if it had been
checked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from swarmstart.terminal_set.checker.file_content import (
    Entries,
    Instruction,
    Limits,
    Matrix,
    Vector,
    integer,
    mapping,
    one_of,
    optional,
    text,
    unusable,
)

LONGEST_TAPE = 100_000  # instructions; larger files are not worth minutes of parsing
MOST_SUBSTEPS = 10_000
MOST_STATES = 50
_READ = Entries(longest_tape=LONGEST_TAPE)
_KEYS = (
    "format version sha256 dynamics reference bounds K P alpha core dt substeps Q_m "
    "margins refuted design proof statements"
)

_PROVEN, _CLOSED_FORM, _MEASURED = "proven", "closed form", "measured"
TAKEN = "proven by the library"  # Not proven again: the checker only samples it.


@dataclass(frozen=True, kw_only=True, slots=True)
class Refuted:
    """A level beyond which the decrease is known to fail.

    Attributes:
        alpha: Level e'Pe of the point e.
        e: The point as a deviation from the reference, shape (nx,).
    """

    alpha: float
    e: Vector


@dataclass(frozen=True, kw_only=True, slots=True)
class Certificate:
    """The statements of a certificate, as plain numbers.

    Attributes:
        tape: Instructions (operation, operands, constant); the number of an instruction
            is the index of its result.
        xdot: Indices of the instructions whose results are f(x, u), one for each state.
        x_ref: Reference state, shape (nx,).
        u_ref: Reference input, shape (nu,).
        velocity: Velocity of the reference, shape (nx,); 0 in states that rest.
        bounds: "u_lower", "u_upper", "x_lower" or "x_upper" -> the bounds; None for a
            missing one.
        K: Gain of u = u_ref - K e with e = x - x_ref, shape (nu, nx).
        P: Matrix of V(e) = e'Pe, shape (nx, nx).
        alpha: Level: the set is V(e) <= alpha.
        core: Level within which the drift of a rounded reference may cancel the
            decrease.
        drift: Upper bound of that drift, divided by sqrt(core); in 1/s, or a fraction
            per hold for a held input.
        dt: Time for which an input is held [s]; None if it is continuous.
        substeps: Number of Runge-Kutta steps in a hold; None for a continuous input.
        Q_m: Matrix of the margin: V decreases by at least e'Q_m e, shape (nx, nx).
        integrator: Bound of the Runge-Kutta map's error over a hold, relative to the
            root of V(e); None if not stated.
        integrator_proven: Whether that bound is labelled proven by the library. The
            checker does not repeat this proof.
        growth: Bound of V between two samples, divided by V at the first of the two;
            None if not stated.
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


def certificate_of(content: dict[str, object]) -> Certificate:
    """Return the statements of a file of `TERMINAL_SET`, with its entries validated.

    Raises:
        CertificateFileError: If it is not a valid certificate.
    """
    mapping(content, "the file", _KEYS)
    version = integer(content["version"], "version", 0, 10**9)
    if version not in (1, 2):
        raise unusable("version", "1 or 2", content["version"])
    dynamics = mapping(content["dynamics"], "dynamics", "nx nu tape xdot")
    nx = integer(dynamics["nx"], "dynamics.nx", 1, MOST_STATES)
    nu = integer(dynamics["nu"], "dynamics.nu", 1, MOST_STATES)
    tape = _READ.tape(dynamics["tape"], "dynamics.tape", {"x": nx, "u": nu})
    # Files of version 1 did not say how a reference moves: all states have to rest.
    moving = " velocity" if version > 1 else ""
    reference = mapping(content["reference"], "reference", "x u" + moving)
    velocity = reference.get("velocity", [0.0] * nx)
    dt = optional(content["dt"], "dt", _READ.positive)
    margins = _margins(content["margins"], held=dt is not None)
    core = mapping(content["core"], "core", "level drift")
    _check_remarks(content, nx=nx, nu=nu)
    certificate = Certificate(
        tape=tape,
        xdot=_READ.numbers(dynamics["xdot"], "dynamics.xdot", len(tape), nx),
        x_ref=_READ.vector(reference["x"], "reference.x", nx),
        u_ref=_READ.vector(reference["u"], "reference.u", nu),
        velocity=_READ.vector(velocity, "reference.velocity", nx),
        bounds=_bounds(content["bounds"], nx=nx, nu=nu),
        K=_READ.matrix(content["K"], "K", nu, nx),
        P=_READ.matrix(content["P"], "P", nx, nx),
        alpha=_READ.positive(content["alpha"], "alpha"),
        core=_READ.at_least_zero(core["level"], "core.level"),
        drift=_READ.at_least_zero(core["drift"], "core.drift"),
        dt=dt,
        substeps=_substeps(content["substeps"], held=dt is not None),
        Q_m=_READ.matrix(content["Q_m"], "Q_m", nx, nx),
        integrator=margins.integrator,
        integrator_proven=margins.integrator_proven,
        growth=margins.growth,
        growth_proven=margins.growth_proven,
        refuted=_refuted(content["refuted"], nx=nx),
    )
    _check_statements(content["statements"], certificate=certificate)
    return certificate


def _bounds(value: object, *, nx: int, nu: int) -> dict[str, Limits]:
    lengths = {"u_lower": nu, "u_upper": nu, "x_lower": nx, "x_upper": nx}
    bounds = mapping(value, "bounds", " ".join(lengths))
    return {
        name: _READ.limits(bounds[name], f"bounds.{name}", length)
        for name, length in lengths.items()
    }


def _substeps(value: object, *, held: bool) -> int | None:
    if held:
        return integer(value, "substeps", 1, MOST_SUBSTEPS)
    if value is not None:
        raise unusable("substeps", "null if dt is null", value)
    return None


class _Margins(NamedTuple):
    integrator: float | None
    integrator_proven: bool
    growth: float | None
    growth_proven: bool


def _margins(value: object, *, held: bool) -> _Margins:
    margins = mapping(value, "margins", "integrator between_samples")
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
        margin = mapping(margins["between_samples"], where, "growth grounds")
        growth = _READ.positive(margin["growth"], f"{where}.growth")
        grounds = ("proven", "measured")
        proven = one_of(margin["grounds"], f"{where}.grounds", grounds) == "proven"
    return _Margins(error, taken, growth, proven)


def _integrator(value: object, where: str) -> tuple[float, bool]:
    grounds = value.get("grounds") if isinstance(value, dict) else None
    taken = grounds == TAKEN  # The keys depend on the grounds, so these come first.
    count = "boxes" if taken else "samples"
    margin = mapping(value, where, f"relative_error grounds {count}")
    one_of(margin["grounds"], f"{where}.grounds", (TAKEN, "measured"))
    integer(margin[count], f"{where}.{count}", 0, 10**15)
    name = f"{where}.relative_error"
    return _READ.at_least_zero(margin["relative_error"], name), taken


def _refuted(value: object, *, nx: int) -> Refuted | None:
    if value is None:
        return None
    refuted = mapping(value, "refuted", "alpha e change")
    _READ.number(refuted["change"], "refuted.change")
    return Refuted(
        alpha=_READ.positive(refuted["alpha"], "refuted.alpha"),
        e=_READ.vector(refuted["e"], "refuted.e", nx),
    )


def _check_remarks(content: dict[str, object], *, nx: int, nu: int) -> None:
    # Design and proof describe the origin of the numbers; the check ignores them.
    design = mapping(content["design"], "design", "name Q R kappa")
    text(design["name"], "design.name")
    optional(design["Q"], "design.Q", lambda v, w: _READ.matrix(v, w, nx, nx))
    optional(design["R"], "design.R", lambda v, w: _READ.matrix(v, w, nu, nu))
    optional(design["kappa"], "design.kappa", _READ.number)
    proof = mapping(content["proof"], "proof", "boxes seconds")
    integer(proof["boxes"], "proof.boxes", 0, 10**15)
    _READ.at_least_zero(proof["seconds"], "proof.seconds")


def _check_statements(value: object, *, certificate: Certificate) -> None:
    # A reader would take the word "proven" in the file for the checker's own verdict.
    known = expected_statements(
        held=certificate.dt is not None,
        integrator_proven=certificate.integrator_proven,
        growth_proven=certificate.growth_proven,
    )
    left = dict(known)

    def check(entry: object, where: str) -> None:
        statement = mapping(entry, where, "statement grounds")
        words = text(statement["statement"], f"{where}.statement")
        grounds = text(statement["grounds"], f"{where}.grounds")
        if words not in known:
            raise unusable(f"{where}.statement", "a statement of the format", words)
        if words not in left:
            raise unusable(f"{where}.statement", "each statement once", words)
        if grounds != left.pop(words):
            expected = f'"{known[words]}" with the margins stated'
            raise unusable(f"{where}.grounds", expected, grounds)

    _READ.list_of(value, "statements", None, check)


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
        Text of each statement -> its grounds, such as "proven" or "measured".
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
