"""A model: named states, controls and parameters, and their right-hand side.

    x' = f(x, u, p)

x: states (nx,), u: controls (nu,), p: parameters (np,), constant over a horizon.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from swarmstart.ocp.errors import InvalidProblemError


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Model:
    """An ordinary differential equation with inputs, as CasADi SX symbols.

    Attributes:
        states: Symbols of the states, shape (nx, 1).
        controls: Symbols of the controls, shape (nu, 1).
        ode: Right-hand side, shape (nx, 1), SI units per second; a list of its rows is
            taken, too.
        parameters: Symbols of what is constant over a horizon, shape (np, 1).
        state_names: A name for each state; taken from the symbols where empty.
        control_names: A name for each control; taken from the symbols where empty.

    Raises:
        InvalidProblemError: Where shapes do not match, something that ought to be a
            symbol is an expression, or the right-hand side has a foreign symbol.
    """

    states: ca.SX
    controls: ca.SX
    ode: ca.SX
    parameters: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    state_names: tuple[str, ...] = ()
    control_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the symbols against each other and fill in the names."""
        for role in ("states", "controls", "parameters"):
            require_symbols(role, getattr(self, role))
        if not self.nx:
            raise InvalidProblemError("states must hold at least one symbol, got none")
        ode = as_column("ode", self.ode)
        if ode.numel() != self.nx:
            raise InvalidProblemError(
                f"ode must have one row for each of the {self.nx} states, "
                f"got {ode.numel()}"
            )
        require_known(
            "ode", ode, {"states": self.states, "controls": self.controls,
                         "parameters": self.parameters}
        )  # fmt: skip
        object.__setattr__(self, "ode", ode)
        for role, symbols in (("state", self.states), ("control", self.controls)):
            names = tuple(getattr(self, f"{role}_names")) or symbol_names(symbols)
            if len(names) != symbols.numel():
                raise InvalidProblemError(
                    f"{role}_names must name {symbols.numel()} {role}s, got {names}"
                )
            object.__setattr__(self, f"{role}_names", names)

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
    """Return f(x, u, p) -> x' of a model as a `casadi.Function`."""
    return ca.Function(
        "right_hand_side",
        [model.states, model.controls, model.parameters],
        [model.ode],
        ["x", "u", "p"],
        ["xdot"],
    )


def stack_models(models: Sequence[Model]) -> Model:
    """Return the models side by side as one model, states and controls in order.

    Args:
        models: At least one model; none is changed, one may occur several times.

    Raises:
        InvalidProblemError: Without any model.
    """
    if not models:
        raise InvalidProblemError("stack_models needs at least one model, got none")
    copies = []
    for number, model in enumerate(models):
        x = ca.SX.sym(f"x{number}", model.nx)
        u = ca.SX.sym(f"u{number}", model.nu)
        p = ca.SX.sym(f"p{number}", model.np)
        copies.append((x, u, p, right_hand_side(model)(x, u, p)))
    states, controls, parameters, ode = (
        ca.vertcat(*c) for c in zip(*copies, strict=True)
    )
    return Model(
        states=states,
        controls=controls,
        ode=ode,
        parameters=ca.reshape(parameters, -1, 1),
        state_names=tuple(
            f"{name}_{i}" for i, m in enumerate(models) for name in m.state_names
        ),
        control_names=tuple(
            f"{name}_{i}" for i, m in enumerate(models) for name in m.control_names
        ),
    )


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
