"""Systems of python-control as equations in CasADi symbols, and the way back.

    StateSpace         x' = A x + B u,  y = C x + D u;  x+ = A x + B u if it is sampled
    TransferFunction   the same, by `control.tf2ss`, channel by channel
    NonlinearIOSystem  x' = f(t, x, u), y = h(t, x, u), called once with symbols

    back               A = df/dx, B = df/du, C = dg/dx, D = dg/du at a point

A user who gives a system has imported python-control already; this module imports
python-control only when a system is given, since that takes a second.
"""

from __future__ import annotations

import math
import traceback
import warnings
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.messages import Paragraph

if TYPE_CHECKING:
    import control

_AGREES = 1e-9
"""Largest difference between symbols and numbers, relative to their size."""
_SIZES = (0.1, 0.7, 3.0, 20.0)
"""Sizes of the points at which symbols and numbers are compared."""
_LIBRARIES = ("/control/", "/casadi/", "/numpy/")
"""Folders whose frames are not a user's code."""


class InvalidSystemError(InvalidProblemError):
    """A system of python-control cannot be used as a model or a plant."""


class NonMinimalWarning(UserWarning):
    """A transfer function was converted to more states than it may need."""


class Equations(NamedTuple):
    """A system in symbols.

    Attributes:
        states: Symbols, shape (nx, 1).
        controls: Symbols, shape (nu, 1).
        time: Symbol of the time [s]; shape (0, 1) if nothing depends on it.
        change: x' of a continuous system, x+ of a sampled one, shape (nx, 1).
        outputs: Expression by name.
        dt: Sampling time [s]; None if the system is continuous.
    """

    states: ca.SX
    controls: ca.SX
    time: ca.SX
    change: ca.SX
    outputs: dict[str, ca.SX]
    dt: float | None


def equations_of(system: object) -> Equations:
    """Return the equations of a system of python-control.

    Args:
        system: A `control.StateSpace`, `TransferFunction` or `NonlinearIOSystem`.

    Raises:
        InvalidSystemError: If it has no states, no known time base, numbers that are
            not finite, an improper transfer function, or functions that do not work on
            CasADi symbols.
    """
    import control

    found = in_state_space(system)
    x, u = (_symbols(labels) for labels in (found.state_labels, found.input_labels))
    t = ca.SX.sym("t")
    if isinstance(found, control.StateSpace):
        if not all(np.isfinite(m).all() for m in control.ssdata(found)):
            raise InvalidSystemError(
                f"the matrices of system {found.name!r} must be finite, a number in "
                "them is NaN or infinite"
            )
        change, y = ca.SX(found.A) @ x, ca.SX(found.C) @ x
        change, y = change + ca.SX(found.B) @ u, y + ca.SX(found.D) @ u
    elif isinstance(found, control.InterconnectedSystem):
        raise InvalidSystemError(
            f"system {found.name!r} is an interconnection of nonlinear systems, which "
            "python-control evaluates with numbers only: write it as one "
            "NonlinearIOSystem, or use it as the plant of `simulate`"
        )
    else:
        change, y = _called(found, t, x, u)
    is_timed = ca.depends_on(ca.vertcat(change, y), t)
    return Equations(
        states=x,
        controls=u,
        time=t if is_timed else ca.SX(0, 1),
        change=change,
        outputs={name: y[i] for i, name in enumerate(found.output_labels)},
        dt=found.dt or None,  # 0 of a continuous system.
    )


def in_state_space(system: Any) -> control.NonlinearIOSystem:
    """Return a system with states and a known time base.

    Args:
        system: A system of python-control; a transfer function is realised.

    Raises:
        InvalidSystemError: If it is something else, or lacks states or a known dt.
    """
    import control

    if not isinstance(system, control.InputOutputSystem):
        raise InvalidSystemError(
            "a system must be a control.StateSpace, TransferFunction or "
            f"NonlinearIOSystem, got {shortened(system)}"
        )
    if isinstance(system, control.TransferFunction):
        system = _realised(system)
    if not isinstance(system, control.NonlinearIOSystem) or not system.nstates:
        raise InvalidSystemError(
            f"system {system.name!r} ({type(system).__name__}) has no states: give a "
            "StateSpace or a TransferFunction, such as one fitted to the data"
            if isinstance(system, control.FrequencyResponseData)
            else f"system {system.name!r} ({type(system).__name__}) has no states, so "
            "its outputs follow from its inputs at once: put it into the expressions"
        )
    _require_time_base(system)
    return system


def _require_time_base(system: control.InputOutputSystem) -> None:
    """Raise if it is not known whether, or how often, a system is sampled."""
    if system.dt is None or system.dt is True:
        lacks = "a time base" if system.dt is None else "a sampling time"
        raise InvalidSystemError(
            f"system {system.name!r} has dt={system.dt} and so lacks {lacks}: give it "
            "its dt, which is 0 for a continuous system and else the sampling time [s]"
        )


def _symbols(labels: Sequence[str]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *[ca.SX.sym(label) for label in labels])


def _realised(system: control.TransferFunction) -> control.StateSpace:
    """Return a transfer function in state space, one realisation for each channel.

    Warns:
        NonMinimalWarning: If there are several channels.
    """
    import control

    parts = []
    for i, output in enumerate(system.output_labels):
        for j, name in enumerate(system.input_labels):
            num, den = (np.trim_zeros(c[i][j], "f") for c in (system.num, system.den))
            if num.size > den.size:
                raise InvalidSystemError(
                    f"system {system.name!r} is improper from {name} to {output}: its "
                    f"numerator has degree {num.size - 1}, its denominator "
                    f"{den.size - 1}; add poles that are fast enough"
                )
            channel = control.TransferFunction(num if num.size else [0], den, system.dt)
            # SciPy, so that an installed slycot does not change the states.
            one = control.tf2ss(channel, method="scipy")
            parts.append((i, j, one))
    if len(parts) == 1:
        A, B, C, D = (np.asarray(m) for m in control.ssdata(parts[0][2]))
        states = [f"x[{k}]" for k in range(len(A))]
    else:
        A, B, C, D = _side_by_side(parts, system.noutputs, system.ninputs)
        states = [
            f"{system.output_labels[i]} of {system.input_labels[j]}[{k}]"
            for i, j, one in parts
            for k in range(one.nstates)
        ]
        warnings.warn(
            f"system {system.name!r} became {len(A)} states, those of each of its "
            f"{len(parts)} channels, which may be more than it needs; a StateSpace "
            f"has the states that you choose (more: {Paragraph.MORE_STATES})",
            NonMinimalWarning,
            stacklevel=5,  # The user's call of Model.from_system.
        )
    return control.StateSpace(
        A, B, C, D, system.dt, name=system.name, states=states or None,
        inputs=system.input_labels, outputs=system.output_labels,
        remove_useless_states=False,
    )  # fmt: skip


def _side_by_side(
    parts: Sequence[tuple[int, int, control.StateSpace]], outputs: int, inputs: int
) -> tuple[Array, Array, Array, Array]:
    """Return A, B, C and D of the channels of a transfer matrix together."""
    nx = sum(one.nstates for *_, one in parts)
    A, B = np.zeros((nx, nx)), np.zeros((nx, inputs))
    C, D = np.zeros((outputs, nx)), np.zeros((outputs, inputs))
    first = 0
    for i, j, one in parts:
        own = slice(first, first + one.nstates)
        A[own, own], B[own, j], C[i, own] = one.A, one.B[:, 0], one.C[0]
        D[i, j] = one.D[0, 0]
        first = own.stop
    return A, B, C, D


def _called(
    system: control.NonlinearIOSystem, t: ca.SX, x: ca.SX, u: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the right-hand side and the outputs of a nonlinear system, in symbols.

    Raises:
        InvalidSystemError: If its functions do not work on symbols.
    """
    # Arrays of symbols: a function written for NumPy indexes, adds and multiplies them.
    each = [np.array(ca.vertsplit(s), dtype=object) for s in (x, u)]
    rows = {"states": system.nstates, "outputs": system.noutputs}
    try:
        with warnings.catch_warnings():  # CasADi warns of NumPy functions on symbols.
            warnings.simplefilter("ignore", FutureWarning)
            found = system.dynamics(t, *each), system.output(t, *each)
        columns = [
            ca.vertcat(ca.SX(0, 1), *np.asarray(values, dtype=object).ravel())
            for values in found
        ]
    except Exception as error:  # A user's function may raise anything.
        raise _not_symbolic(system, _place_of(error)) from error
    for (role, size), column in zip(rows.items(), columns, strict=True):
        if column.numel() != size:
            raise _not_symbolic(
                system, f"{column.numel()} values came back for its {size} {role}"
            )
    wrong = _differing(system, ca.Function("both", [t, x, u], columns))
    if wrong:
        raise _not_symbolic(system, wrong)
    return columns[0], columns[1]


def _not_symbolic(system: control.NonlinearIOSystem, why: str) -> InvalidSystemError:
    return InvalidSystemError(
        f"the functions of system {system.name!r} do not work on CasADi symbols: "
        f"{why}; write numpy.sin for math.sin, numpy.clip for min and max, "
        "numpy.where for if, or use the system as the plant of `simulate`, which needs "
        "no symbols"
    )


def _place_of(error: Exception) -> str:
    """Return the last line of a user's code before an error, and the error."""
    said = f"{type(error).__name__}: {' '.join(str(error).split())[-200:]}"
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if frame.line and not any(part in frame.filename for part in _LIBRARIES):
            if frame.filename != __file__:
                return f"line {frame.lineno}, `{frame.line}`, raised {said}"
            break
    return said


def _differing(system: control.NonlinearIOSystem, symbolic: ca.Function) -> str:
    """Return a difference between a system on symbols and on numbers; else empty.

    `float()` makes NaN of a symbol without an error, and Python's min and max may turn
    that into a constant, so the values are compared at a few points.
    """
    numbers, values = [], []
    for t, x, u in _points(system.nstates, system.ninputs):
        with np.errstate(all="ignore"):
            both = system.dynamics(t, x, u), system.output(t, x, u)
        numbers.append(np.concatenate([np.ravel(part) for part in both]))
        parts = symbolic(t, x, u)
        values.append(np.concatenate([np.array(part).ravel() for part in parts]))
    expected, found = np.array(numbers).T, np.array(values).T
    # A point outside of a function's domain says nothing.
    known = np.isfinite(expected)
    size = np.abs(np.where(known, expected, 0.0)).max(axis=1, keepdims=True)
    differs = known & ~(np.abs(expected - found) <= _AGREES * size)
    if not differs.any():
        return ""
    i, k = np.argwhere(differs)[0]
    name = [*system.state_labels, *system.output_labels][i]
    kind = "the change of" if i < system.nstates else "output"
    return (
        f"{kind} {name} is {found[i, k]:.6g} by symbols and {expected[i, k]:.6g} by "
        "numbers, as if float() or an array of floats had received a symbol"
    )


def _points(nx: int, nu: int) -> Iterator[tuple[float, Array, Array]]:
    """Yield times, states and controls of different sizes and signs."""
    for number, size in enumerate(_SIZES, start=1):
        # Multiples of the golden ratio are spread evenly and never repeat.
        part = np.modf(np.arange(1, nx + nu + 1) * number * (math.sqrt(5) - 1) / 2)[0]
        values = size * (2.0 * part - 1.0)
        yield size, values[:nx], values[nx:]


def state_space(
    functions: tuple[ca.Function, ca.Function],
    point: Sequence[Array],
    names: tuple[Sequence[str], Sequence[str], Sequence[str]],
    dt: float | bool,
) -> control.StateSpace:
    """Return the linear system near a point.

    Args:
        functions: (x, u, p, s) -> x' or x+, and (x, u, p, s) -> y.
        point: x, u, p and s at the point.
        names: Names of states, inputs and outputs.
        dt: 0 for a continuous system; else the sampling time [s], or True.

    Raises:
        InvalidSystemError: If a derivative there is not finite.
    """
    import control

    matrices = []
    for function in functions:
        arguments = [ca.MX.sym(f"a{i}", *function.size_in(i)) for i in range(4)]
        value = function(*arguments)
        slopes = [ca.jacobian(value, arguments[i]) for i in (0, 1)]
        found = ca.Function("slopes", arguments, slopes)(*point)
        matrices += [np.array(matrix.full()) for matrix in found]
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        raise InvalidSystemError(
            "the derivatives at the point of a linearisation must be finite, at "
            f"x = {point[0].tolist()}, u = {point[1].tolist()} they are not"
        )
    states, inputs, outputs = map(list, names)
    return control.StateSpace(
        *matrices, dt, states=states, inputs=inputs, outputs=outputs,
        remove_useless_states=False,
    )  # fmt: skip
