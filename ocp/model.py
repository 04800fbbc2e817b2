"""A model: named states, controls and parameters, and how the states change.

    x' = f(t, x, u, p, s)             within a control interval
    x+ = phi(t, x, u, p, s)           at its end, where the model has such an update

x: states (nx,), u: controls (nu,), p: parameters (np,), constant over a horizon,
s: signals (ns,), known over time and linear between the nodes, t: time [s]. A
discrete-time model has an update only: `next_state`. A model with both jumps from
interval to interval: a state that remembers the last control, a stage that is dropped.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from swarmstart.ocp.errors import InvalidProblemError

_ROLES = ("states", "controls", "parameters", "signals")
CHANGES = ("ode", "next_state")
"""What may say how the states change."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Model:
    """A differential or difference equation with inputs, as CasADi SX symbols.

    Attributes:
        states: Symbols of the states, shape (nx, 1).
        controls: Symbols of the controls, shape (nu, 1).
        ode: Right-hand side, shape (nx, 1), SI units per second; a list of its rows is
            taken, too. Left out, it is zero: then there must be a next state.
        next_state: State after a control interval, shape (nx, 1), of a discrete-time
            model; with an `ode` as well, the state that an interval's end makes of the
            one that the `ode` leads to. Left out, there is no such jump.
        parameters: Symbols of what is constant over a horizon, shape (np, 1).
        signals: Symbols of what is known over time and enters the model, shape (ns, 1).
        time: Symbol of the time [s], shape (1, 1); left out, nothing depends on it.
        state_names: A name for each state; taken from the symbols where empty.
        control_names: A name for each control; taken from the symbols where empty.

    Raises:
        InvalidProblemError: Where shapes do not match, something that ought to be a
            symbol is an expression, or the right-hand side has a foreign symbol.
    """

    states: ca.SX
    controls: ca.SX
    ode: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    next_state: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    parameters: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    signals: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    time: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    state_names: tuple[str, ...] = ()
    control_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the symbols against each other and fill in the names."""
        for role in ("states", "controls", "parameters", "signals", "time"):
            require_symbols(role, getattr(self, role))
        if not self.nx:
            raise InvalidProblemError("states must hold at least one symbol, got none")
        if self.time.numel() > 1:
            raise InvalidProblemError(
                f"time must be one symbol, got {self.time.numel()}"
            )
        given = {role: as_column(role, getattr(self, role)) for role in CHANGES}
        if not any(rows.numel() for rows in given.values()):
            raise InvalidProblemError(
                "a model must have an ode or a next_state, got neither"
            )
        for role, rows in given.items():
            object.__setattr__(self, role, self._checked(role, rows))
        for role, symbols in (("state", self.states), ("control", self.controls)):
            names = tuple(getattr(self, f"{role}_names")) or symbol_names(symbols)
            if len(names) != symbols.numel():
                raise InvalidProblemError(
                    f"{role}_names must name {symbols.numel()} {role}s, got {names}"
                )
            object.__setattr__(self, f"{role}_names", names)

    def _checked(self, role: str, rows: ca.SX) -> ca.SX:
        """Return the rows of an equation; an ode that is left out is zero."""
        if not rows.numel():
            return ca.SX.zeros(self.nx) if role == "ode" else rows
        if rows.numel() != self.nx:
            raise InvalidProblemError(
                f"{role} must have one row for each of the {self.nx} states, "
                f"got {rows.numel()}"
            )
        require_known(role, rows, self.symbols())
        return rows

    def symbols(self) -> dict[str, ca.SX]:
        """Return the columns of symbols that its expressions may use, by role.

        Signals and time only where the model has any.
        """
        found = {
            "states": self.states,
            "controls": self.controls,
            "parameters": self.parameters,
        }
        more = {"signals": self.signals, "time": self.time}
        return found | {role: s for role, s in more.items() if s.numel()}

    @property
    def nx(self) -> int:
        """Number of states."""
        return int(self.states.numel())

    @property
    def nu(self) -> int:
        """Number of controls."""
        return int(self.controls.numel())

    @property
    def np(self) -> int:
        """Number of parameters."""
        return int(self.parameters.numel())

    @property
    def ns(self) -> int:
        """Number of signals."""
        return int(self.signals.numel())

    @property
    def varying(self) -> ca.SX:
        """Symbols of what is known over time: the signals, then the time."""
        return ca.vertcat(self.signals, self.time)

    @property
    def jumps(self) -> bool:
        """Whether the end of a control interval changes the state."""
        return bool(self.next_state.numel())

    @property
    def is_discrete(self) -> bool:
        """Whether nothing changes within a control interval."""
        return self.jumps and bool(self.ode.is_zero())

    def __repr__(self) -> str:
        """Return the names of states, controls and parameters."""
        names = (self.state_names, self.control_names, symbol_names(self.parameters))
        parts = [
            f"{role}: {', '.join(found) or 'none'}"
            for role, found in zip(
                ("states", "controls", "parameters"), names, strict=True
            )
        ]
        return f"Model with {'; '.join(parts)}"


def right_hand_side(model: Model) -> ca.Function:
    """Return f(x, u, p) -> x' of a model as a `casadi.Function`.

    Of a model with signals or a time it is f(x, u, p, s), s the signals, then the time.
    """
    arguments = [model.states, model.controls, model.parameters]
    arguments += [model.varying] if model.varying.numel() else []
    names = ["x", "u", "p", "s"][: len(arguments)]
    return ca.Function("right_hand_side", arguments, [model.ode], names, ["xdot"])


def rate_of(model: Model) -> ca.Function:
    """Return f(x, u, p, s) -> x' of any model, s its signals and then its time."""
    return _function_of(model, "rate", model.ode)


def jump_of(model: Model) -> ca.Function:
    """Return phi(x, u, p, s) -> the state that the end of an interval leaves."""
    return _function_of(
        model, "jump", model.next_state if model.jumps else model.states
    )


def _function_of(model: Model, name: str, rows: ca.SX) -> ca.Function:
    arguments = [model.states, model.controls, model.parameters, model.varying]
    return ca.Function(name, arguments, [rows])


def stack_models(models: Sequence[Model]) -> Model:
    """Return the models side by side as one model, states and controls in order.

    Args:
        models: At least one model; none is changed, one may occur several times.

    Raises:
        InvalidProblemError: Without any model.
    """
    if not models:
        raise InvalidProblemError("stack_models needs at least one model, got none")
    return Model(
        **{role: ca.vertcat(*rows) for role, rows in _side_by_side(models).items()},
        time=_one_time(models),
        state_names=tuple(
            f"{name}_{i}" for i, m in enumerate(models) for name in m.state_names
        ),
        control_names=tuple(
            f"{name}_{i}" for i, m in enumerate(models) for name in m.control_names
        ),
    )


def _side_by_side(models: Sequence[Model]) -> dict[str, list[ca.SX]]:
    """Return the symbols and equations of copies of the models, by their roles."""
    found: dict[str, list[ca.SX]] = {}
    jumping = any(model.jumps for model in models)
    time = _one_time(models)
    for number, model in enumerate(models):
        copies = {
            role: ca.SX.sym(f"{letter}{number}", getattr(model, role).numel())
            for role, letter in zip(_ROLES, "xups", strict=True)
        }
        s = ca.vertcat(copies["signals"], time[: model.time.numel()])
        arguments = [*[*copies.values()][:3], s]
        copies["ode"] = rate_of(model)(*arguments)
        if jumping:
            copies["next_state"] = jump_of(model)(*arguments)
        for role, rows in copies.items():
            found.setdefault(role, [ca.SX(0, 1)]).append(rows)
    return found


def _one_time(models: Sequence[Model]) -> ca.SX:
    """Return one symbol of the time for all models; none where they have none."""
    times = [model.time for model in models if model.time.numel()]
    return times[0] if times else ca.SX(0, 1)


LONGEST_SHOWN = 60
"""Characters of a value that a message shows."""


def shortened(value: object) -> str:
    """Return a value as a message shows it: its text in short, with its type."""
    text = " ".join(str(value).split())
    if len(text) > LONGEST_SHOWN:
        text = f"{text[: LONGEST_SHOWN - 3]}..."
    return text if isinstance(value, ca.SX) else f"{text} ({type(value).__name__})"


def as_column(role: str, expression: ca.SX) -> ca.SX:
    """Return an expression, or what SX can be made from, as one column.

    Raises:
        InvalidProblemError: If it is no vector and no number.
    """
    try:
        if isinstance(expression, list | tuple):
            expression = ca.vertcat(ca.SX(0, 1), *expression)
        column = ca.SX(expression)
    except (NotImplementedError, TypeError) as error:
        raise InvalidProblemError(
            f"{role} must be a CasADi SX expression, got {shortened(expression)}"
        ) from error
    if min(column.shape) > 1:
        raise InvalidProblemError(f"{role} must be a vector, got shape {column.shape}")
    return ca.densify(ca.reshape(column, -1, 1))


def require_symbols(role: str, symbols: ca.SX) -> None:
    """Refuse anything but a column of SX symbols.

    Raises:
        InvalidProblemError: If it is none.
    """
    if not isinstance(symbols, ca.SX) or (
        symbols.numel() and not symbols.is_valid_input()
    ):
        raise InvalidProblemError(
            f"{role} must be CasADi SX symbols, got {shortened(symbols)}"
        )
    if symbols.shape[1] != 1:
        raise InvalidProblemError(f"{role} must be a column, got shape {symbols.shape}")


def require_known(role: str, expression: ca.SX, known: dict[str, ca.SX]) -> None:
    """Refuse an expression with symbols that are none of the known ones.

    Args:
        role: What the expression is, for the message.
        expression: The expression.
        known: Columns of symbols by what they are called in the message.

    Raises:
        InvalidProblemError: Naming the foreign symbols, or where two of the known
            symbols are the same.
    """
    try:
        ca.Function("known", list(known.values()), [expression])
    except RuntimeError as error:
        columns = list(known.values())
        foreign = [
            str(symbol)
            for symbol in ca.symvar(expression)
            if not any(ca.depends_on(column, symbol) for column in columns)
        ]
        allowed = ", ".join(known)
        if not foreign:
            raise InvalidProblemError(
                f"{allowed} must be different symbols, found one twice"
            ) from error
        raise InvalidProblemError(
            f"{role} may depend on {allowed} only, found {', '.join(foreign)}"
        ) from error


def symbol_names(symbols: ca.SX) -> tuple[str, ...]:
    """Return the names of a column of symbols."""
    return tuple(str(symbols[i]) for i in range(symbols.numel()))
