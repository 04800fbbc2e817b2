"""Model: named states, controls and parameters, and the equations of the states.

    x' = f(t, x, u, p, s)             within a control interval
    x+ = phi(t, x, u, p, s)           at its end, if the model has such an update

x: states (nx,), u: controls (nu,), p: parameters (np,), constant over a horizon, s:
signals (ns,), known over time and linear between the nodes, t: time [s]. A
discrete-time model has an update only: `next_state`. A model with both jumps from
interval to interval: a state that remembers the last control, a rocket stage that is
dropped.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from swarmstart.ocp.algebraic import (
    AlgebraicEquations,
    Elimination,
    eliminate,
    in_model,
    require_algebraic,
)
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.expressions import (
    require_known,
    require_symbols,
    symbol_names,
)
from swarmstart.ocp.model_forms import symbolic_rows
from swarmstart.ocp.symbol_map import SymbolMap

_ROLES = ("states", "controls", "parameters", "signals")
_COLUMNS = (*_ROLES, "time")
CHANGES = ("ode", "next_state")
"""Forms in which the equations of the states may be given."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Model:
    """A differential or difference equation with inputs, as CasADi SX symbols.

    Symbols and expressions may be given as CasADi MX. The model then creates SX symbols
    of the same names and converts the expressions to them.

    Attributes:
        states: Symbols of the states, shape (nx, 1).
        controls: Symbols of the controls, shape (nu, 1).
        ode: Right-hand side, shape (nx, 1), SI units per second: an expression, a list
            of its rows, or a casadi.Function or Python function of (x, u), (x, u, p) or
            (t, x, u, p) (docs/library.md, "Use a model in another form"). If left out,
            it is zero, and there must be a next state.
        next_state: State after a control interval, shape (nx, 1), in the same forms. It
            defines a discrete-time model; with an `ode` as well, it is the state after
            the jump at the interval's end, as a function of the state before. If left
            out, there is no jump.
        parameters: Symbols of quantities that are constant over a horizon, shape
            (np, 1).
        signals: Symbols of known functions of time in the model, shape (ns, 1).
        time: Symbol of the time [s], shape (1, 1); left out if nothing depends on it.
        state_names: A name for each state; if empty, those of the symbols.
        control_names: A name for each control; if empty, those of the symbols.
        algebraic: Equations that determine further variables of the ode
            (docs/library.md, "Algebraic equations"); None: no such equations.
        signature: A letter for each argument of a function given as ode, such as
            "txup"; if empty, the arguments are recognised by their names, else by their
            number.
        symbol_map: The MX symbols and their SX symbols; extended by the model.
        elimination: The algebraic variables as expressions; made by the model. Only the
            core of a problem is given the one of its stated model.

    Raises:
        InvalidProblemError: If shapes do not match, a symbol is expected but an
            expression is given, or the right-hand side has a foreign symbol.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> model = ss.Model(
        ...     states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0])),
        ...     state_names=("angle", "rate"), control_names=("torque",),
        ... )
        >>> model
        Model with states: angle, rate; controls: torque; parameters: none
        >>> model.nx, model.nu
        (2, 1)
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
    algebraic: AlgebraicEquations | None = None
    signature: str = ""
    symbol_map: SymbolMap = field(default_factory=SymbolMap)
    elimination: Elimination = field(default_factory=Elimination)

    def __post_init__(self) -> None:
        """Check the symbols against each other and fill in the names."""
        self._bring_symbols_to_sx()
        for role in _COLUMNS:
            require_symbols(role, getattr(self, role))
        if not self.nx:
            raise InvalidProblemError("states must hold at least one symbol, got none")
        if self.time.numel() > 1:
            raise InvalidProblemError(
                f"time must be one symbol, got {self.time.numel()}"
            )
        if self.algebraic is not None:
            elimination = eliminate(self.algebraic, self.symbols())
            object.__setattr__(self, "elimination", elimination)
        given = {role: self._rows(role) for role in CHANGES}
        if not any(rows.numel() for rows in given.values()):
            raise InvalidProblemError(
                "a model must have an ode or a next_state, got neither"
            )
        for role, rows in given.items():
            object.__setattr__(self, role, self._checked(role, rows))
        self._fill_names()

    def _fill_names(self) -> None:
        """Take names from the symbols if names are not given."""
        for role, symbols in (("state", self.states), ("control", self.controls)):
            names = tuple(getattr(self, f"{role}_names")) or symbol_names(symbols)
            if len(names) != symbols.numel():
                raise InvalidProblemError(
                    f"{role}_names must name {symbols.numel()} {role}s, got {names}"
                )
            object.__setattr__(self, f"{role}_names", names)

    def _bring_symbols_to_sx(self) -> None:
        """Replace MX symbols, and the algebraic equations in them, by SX."""
        columns = {role: getattr(self, role) for role in _COLUMNS}
        if self.algebraic is not None:
            require_algebraic(self.algebraic)
            columns["algebraic symbols"] = self.algebraic.symbols
        symbol_map, columns = self.symbol_map.extended(columns)
        columns.pop("algebraic symbols", None)
        for name, value in {**columns, "symbol_map": symbol_map}.items():
            object.__setattr__(self, name, value)
        if self.algebraic is not None:
            in_sx = in_model(self.algebraic, symbol_map)
            object.__setattr__(self, "algebraic", in_sx)

    def _rows(self, role: str) -> ca.SX:
        """Return an equation, in any form, as a column without algebraic variables."""
        symbols = {**self.symbols(), "algebraic": self.elimination.symbols}
        rows = symbolic_rows(
            role,
            getattr(self, role),
            symbols,
            signature=self.signature,
            symbol_map=self.symbol_map,
        )
        return self.elimination.applied(rows)

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
        """Return the columns of symbols that expressions may use, by role.

        Signals and time are included only if the model has them.
        """
        found = {
            "states": self.states,
            "controls": self.controls,
            "parameters": self.parameters,
        }
        more = {"signals": self.signals, "time": self.time}
        return found | {role: s for role, s in more.items() if s.numel()}

    def sx(self, role: str, expression: ca.SX | ca.MX) -> ca.SX:
        """Return an expression in the model's SX symbols, without algebraic variables.

        Args:
            role: Description of the expression, for a message.
            expression: SX in the model's SX symbols, or MX in its MX symbols.

        Raises:
            InvalidProblemError: If it has MX symbols that are not the model's, or calls
                a function that has no scalar operations.
        """
        return self.elimination.applied(self.symbol_map.sx(role, expression))

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
        """Symbols of the known functions of time: the signals, then the time."""
        return ca.vertcat(self.signals, self.time)

    @property
    def jumps(self) -> bool:
        """True if the end of a control interval changes the state."""
        return bool(self.next_state.numel())

    @property
    def jumping(self) -> ca.SX:
        """States that the end of a control interval changes, a column."""
        changed = [
            self.states[i]
            for i in range(self.nx if self.jumps else 0)
            if not ca.is_equal(self.next_state[i], self.states[i])
        ]
        return ca.vertcat(ca.SX(0, 1), *changed)

    @property
    def is_discrete(self) -> bool:
        """True if nothing changes within a control interval: a discrete-time model."""
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

    For a model with signals or a time it is f(x, u, p, s), s the signals, then the
    time.

    Args:
        model: The model.

    Returns:
        The function f, with x' of shape (nx, 1).
    """
    arguments = [model.states, model.controls, model.parameters]
    arguments += [model.varying] if model.varying.numel() else []
    names = ["x", "u", "p", "s"][: len(arguments)]
    return ca.Function("right_hand_side", arguments, [model.ode], names, ["xdot"])


def rate_of(model: Model) -> ca.Function:
    """Return f(x, u, p, s) -> x' of any model, s its signals and then its time."""
    return _function_of(model, "rate", model.ode)


def jump_of(model: Model) -> ca.Function:
    """Return phi(x, u, p, s) -> the state after the end of an interval."""
    return _function_of(
        model, "jump", model.next_state if model.jumps else model.states
    )


def unsolved_of(model: Model) -> ca.Function:
    """Return r(x, u, p, s), the residual of nonlinear algebraic equations."""
    return _function_of(model, "unsolved", model.elimination.unsolved)


def _function_of(model: Model, name: str, rows: ca.SX) -> ca.Function:
    arguments = [model.states, model.controls, model.parameters, model.varying]
    return ca.Function(name, arguments, [rows])


def stack_models(models: Sequence[Model]) -> Model:
    """Stack models side by side into one model, states and controls in order.

    Args:
        models: At least one model; none is changed, one may occur several times.

    Returns:
        The combined model; parameters and signals are stacked as well.

    Raises:
        InvalidProblemError: If there is no model, or one has nonlinear algebraic
            equations.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> cart = ss.Model(states=x, controls=u, ode=u)
        >>> two = ss.stack_models([cart, cart])
        >>> two.nx, two.nu
        (2, 2)
    """
    if not models:
        raise InvalidProblemError("stack_models needs at least one model, got none")
    if any(model.elimination.unsolved.numel() for model in models):
        raise InvalidProblemError(
            "stack_models needs models without nonlinear algebraic equations: the path "
            "constraint that these are solved would be lost"
        )
    columns = {role: ca.vertcat(*c) for role, c in _side_by_side(models).items()}
    return Model(
        states=columns["states"],
        controls=columns["controls"],
        ode=columns["ode"],
        next_state=columns.get("next_state", ca.SX(0, 1)),
        parameters=columns["parameters"],
        signals=columns["signals"],
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
        s = ca.vertcat(copies["signals"], time if model.time.numel() else ca.SX(0, 1))
        arguments = [*[*copies.values()][:3], s]
        copies["ode"] = rate_of(model)(*arguments)
        if jumping:
            copies["next_state"] = jump_of(model)(*arguments)
        for role, rows in copies.items():
            found.setdefault(role, [ca.SX(0, 1)]).append(rows)
    return found


def _one_time(models: Sequence[Model]) -> ca.SX:
    """Return one symbol of the time for all models; empty if they have none."""
    times = [model.time for model in models if model.time.numel()]
    return times[0] if times else ca.SX(0, 1)
