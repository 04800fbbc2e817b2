"""Model: named states, controls and parameters, and the equations of the states.

    x' = f(t, x, u, p, s)             within a control interval
    x+ = phi(t, x, u, p, s)           at its end, if the model has such an update

x: states (nx,), u: controls (nu,), p: parameters (np,), constant over a horizon, s:
signals (ns,), known over time and linear between the nodes, t: time [s]. A
discrete-time model has an update only: `next_state`. A model with an ode and an update
jumps at the ends of intervals: a state that remembers the last control, a rocket stage
that is dropped.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    NAMES,
    UNITS,
    a_number,
    checked,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import (
    ROWS,
    SymbolMap,
    as_column,
    require_known,
    require_symbols,
    shortened,
    symbol_names,
)
from swarmstart.ocp.common.limits import numbers_of, require_seconds
from swarmstart.ocp.common.pickling import Expressed
from swarmstart.ocp.system.algebraic import (
    AlgebraicEquations,
    Elimination,
    eliminate,
    in_model,
    require_algebraic,
)
from swarmstart.ocp.system.control_systems import (
    InvalidSystemError,
    equations_of,
    state_space,
)
from swarmstart.ocp.system.model_forms import symbolic_rows
from swarmstart.ocp.system.units import Equations, conflicts_of

if TYPE_CHECKING:
    import control

_COLUMNS = ("states", "controls", "parameters", "signals", "time")
CHANGES = ("ode", "next_state")
"""Forms in which the equations of the states may be given."""


@checked(
    refused,
    state_names=NAMES,
    control_names=NAMES,
    units=UNITS,
    signature=text(),
    dt=optional(a_number(above=0)),
    symbol_map=of_kind(SymbolMap, "a SymbolMap"),
    elimination=of_kind(Elimination, "an Elimination"),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Model(Expressed):
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
        outputs: Quantities of interest by name, such as {"height": x[1]}: expressions
            of the same symbols as the ode. Solutions, runs, records and figures have
            their values; `linearised` has them as the outputs.
        units: Units of states, controls, outputs, parameters and signals by name, such
            as {"height": "m"}: solutions, records and figures show them, and
            `unit_conflicts` compares them. A name may be left out.
        dt: Length of a step [s] of a discrete-time model that is known for one sampling
            time only; a problem with other intervals is refused. None: any length.
        algebraic: Equations that determine further variables of the ode
            (docs/library.md, "Algebraic equations"); None: no such equations.
        signature: A letter for each argument of a function given as ode, such as
            "txup"; if empty, the arguments are recognised by their names, else by their
            number.
        symbol_map: The MX symbols and their SX symbols; extended by the model.
        elimination: The algebraic variables as expressions. The model makes them from
            `algebraic`, so do not give them; only the internal rewrites of a problem
            pass on those of the stated model.

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
    outputs: Mapping[str, ca.SX] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    dt: float | None = None
    algebraic: AlgebraicEquations | None = None
    signature: str = ""
    symbol_map: SymbolMap = field(default_factory=SymbolMap)
    elimination: Elimination = field(default_factory=Elimination)

    def __post_init__(self) -> None:
        """Check the symbols against each other and fill in the names."""
        self._bring_symbols_to_sx()  # First: all that follows expects SX.
        for role in _COLUMNS:
            require_symbols(role, getattr(self, role))
        if not self.nx:
            raise InvalidProblemError("states must hold at least one symbol, got none")
        if self.time.numel() > 1:
            raise InvalidProblemError(
                f"time must be one symbol, got {self.time.numel()}"
            )
        if self.algebraic is not None:
            # Before the other equations, in which z is replaced by its solution.
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
        object.__setattr__(self, "outputs", MappingProxyType(self._sx_outputs()))
        object.__setattr__(self, "units", MappingProxyType(self._known_units()))
        self._check_dt()

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
        # No field of the model: only the map had to know these symbols.
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

    def _sx_outputs(self) -> dict[str, ca.SX]:
        """Return the outputs by name, each a scalar in the model's SX symbols."""
        if not isinstance(self.outputs, Mapping):
            raise InvalidProblemError(
                "outputs must be a mapping from names to expressions, such as "
                f'{{"height": x[0]}}, got {shortened(self.outputs)}'
            )
        found = {}
        named = dict(zip(self.state_names, ca.vertsplit(self.states), strict=True))
        if self.nu:
            controls = ca.vertsplit(self.controls)
            named |= dict(zip(self.control_names, controls, strict=True))
        for name, given in self.outputs.items():
            if not (isinstance(name, str) and name):
                raise InvalidProblemError(
                    f"names of outputs must be texts that are not empty, got {name!r}"
                )
            role = f"output {name!r}"
            rows = as_column(role, self.sx(role, given))
            if rows.numel() != 1:
                raise InvalidProblemError(
                    f"{role} must be one expression, got {rows.numel()} rows"
                )
            require_known(role, rows, self.symbols())
            # A state or a control may be an output under its own name.
            if name in named and not ca.is_equal(rows, named[name], 1):
                raise InvalidProblemError(
                    f"{role} has the name of a state or a control and another value: "
                    "give it another name"
                )
            found[name] = rows
        return found

    def _known_units(self) -> dict[str, str]:
        """Return the units by name, each of a quantity of the model."""
        inputs = ca.vertcat(self.parameters, self.signals)
        names = {
            *self.state_names, *self.control_names, *self.outputs,
            *symbol_names(inputs),
        }  # fmt: skip
        for name in self.units:
            if name not in names:
                near = difflib.get_close_matches(name, sorted(names), n=1)
                meant = f": did you mean {near[0]!r}?" if near else ""
                raise InvalidProblemError(
                    "units must be those of states, controls, outputs, parameters or "
                    f"signals, got {shortened(name)}{meant}"
                )
        return {name: unit for name, unit in self.units.items() if unit}

    def _check_dt(self) -> None:
        """Raise if the sampling time is no length of a step of a discrete model."""
        require_seconds("dt", self.dt)
        if self.dt is not None and not self.is_discrete:
            raise InvalidProblemError(
                "dt is the step of a discrete-time model: leave it out of a model with "
                "an ode"
            )

    @checked(refused, dt=a_number())
    def require_step(self, dt: float) -> None:
        """Raise if intervals have another length than the model's steps.

        Args:
            dt: Length of the intervals [s].

        Raises:
            InvalidProblemError: If the model is sampled with another time.
        """
        # Rounding only: the length is a horizon divided by a number of intervals.
        if self.dt is not None and not np.isclose(dt, self.dt, rtol=1e-9, atol=0.0):
            raise InvalidProblemError(
                f"the model is sampled with dt = {self.dt:g} s, the intervals are "
                f"{dt:g} s long: make them equal, or sample the continuous system with "
                f"dt = {dt:g} s"
            )

    @classmethod
    def from_system(cls, system: object) -> Model:
        """Return the model of a system of python-control.

        Args:
            system: A `control.StateSpace`, a `TransferFunction` (realised by `tf2ss`;
                with several channels one by one, which may give more states than are
                needed), or a `NonlinearIOSystem` whose functions work on CasADi
                symbols; its `params` are used as numbers.

        Returns:
            A model with the names of the states, inputs and outputs of the system;
            discrete-time with its dt if it is sampled.

        Raises:
            InvalidSystemError: If it has no states, no known dt, numbers that are not
                finite, an improper transfer function, or functions that do not work on
                symbols.

        Example:
            >>> import control, swarmstart as ss
            >>> system = control.ss(
            ...     [[0, 1], [0, -0.5]], [[0], [2]], [[1, 0]], 0,
            ...     states=["position", "speed"], inputs=["force"], outputs=["place"],
            ... )
            >>> model = ss.Model.from_system(system)
            >>> model.state_names, model.control_names, model.output_names
            (('position', 'speed'), ('force',), ('place',))
        """
        found = equations_of(system)
        none = ca.SX(0, 1)
        return cls(
            states=found.states,
            controls=found.controls,
            time=found.time,
            outputs=found.outputs,
            dt=found.dt,
            ode=none if found.dt else found.change,
            next_state=found.change if found.dt else none,
        )

    @checked(
        refused,
        x=reals(),
        u=reals(),
        parameters=reals(),
        signals=reals(),
        time=a_number(),
    )
    def linearised(
        self,
        x: ArrayLike,
        u: ArrayLike,
        *,
        parameters: ArrayLike = (),
        signals: ArrayLike = (),
        time: float = 0.0,
    ) -> control.StateSpace:
        """Return the linear system near a point, for python-control.

        Its states, inputs and outputs are deviations from the point. If the model has
        no outputs, those of the system are the states.

        Args:
            x: States, shape (nx,).
            u: Controls, shape (nu,).
            parameters: Parameters, shape (np,).
            signals: Signals, shape (ns,).
            time: Time [s].

        Returns:
            A system with the names of the model: continuous, or sampled with its dt
            (dt=True if that is not given).

        Raises:
            InvalidProblemError: If a shape is not the model's.
            InvalidSystemError: If the model has no controls, or both an ode and jumps,
                or a derivative is not finite.

        Example:
            >>> import casadi as ca
            >>> import swarmstart as ss
            >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
            >>> pendulum = ss.Model(states=x, controls=u, ode=[x[1], u - ca.sin(x[0])])
            >>> pendulum.linearised([0, 0], [0]).A.tolist()
            [[0.0, 1.0], [-1.0, 0.0]]
        """
        if self.jumps and not self.is_discrete:
            raise InvalidSystemError(
                "a model with an ode and jumps is neither continuous nor sampled, so "
                "it has no StateSpace"
            )
        if not self.nu:
            raise InvalidSystemError(
                "a model without controls has no StateSpace: python-control wants at "
                "least one input"
            )
        sizes = {"x": self.nx, "u": self.nu, "parameters": self.np, "signals": self.ns}
        point = []
        for (name, size), values in zip(
            sizes.items(), (x, u, parameters, signals), strict=True
        ):
            numbers = numbers_of(name, values).ravel()
            if numbers.size != size:
                raise InvalidProblemError(
                    f"{name} must be {size} numbers, got {numbers.size}"
                )
            point.append(numbers)
        if self.time.numel():
            # Signals, then the time, as in `varying`.
            point[3] = np.append(point[3], time)
        change = jump_of(self) if self.is_discrete else rate_of(self)
        outputs = outputs_of(self) if self.outputs else _states_of(self)
        return state_space(
            (change, outputs),
            point,
            (
                self.state_names,
                self.control_names,
                self.output_names or self.state_names,
            ),
            # python-control's True: sampled, with a time that is not given.
            (self.dt or True) if self.is_discrete else 0,
        )

    def unit_conflicts(self) -> tuple[str, ...]:
        """Return a sentence for each equation whose units contradict each other.

        `solve`, `solve_many` and `simulate` warn of them.

        The terms of sums are compared, the arguments of functions such as the sine, and
        each rate with its state. Plain numbers, and parameters without a unit, may have
        any unit. `swarmstart check` warns of the same in a file.

        Example:
            >>> import casadi as ca
            >>> import swarmstart as ss
            >>> place, speed, push = (ca.SX.sym(n) for n in ("place", "speed", "push"))
            >>> cart = ss.Model(
            ...     states=ca.vertcat(place, speed), controls=push, ode=[push, push],
            ...     units={"place": "m", "speed": "m/s", "push": "m/s^2"},
            ... )
            >>> cart.unit_conflicts()
            ('the rate of place is in m/s^2, expected m/s: place is in m',)
        """
        if not self.units:  # Asked for at every solve.
            return ()
        inputs = ca.vertcat(self.parameters, self.signals)
        outputs = ca.vertcat(ca.SX(0, 1), *self.outputs.values())
        return conflicts_of(
            Equations(
                symbols=ca.vertcat(self.states, self.controls, inputs, self.time),
                names=(*self.state_names, *self.control_names, *symbol_names(inputs)),
                units=self.units,
                kinds={
                    "rate": (self.state_names, self.ode),
                    "next value": (self.state_names, self.next_state),
                    "value": (self.output_names, outputs),
                },
            )
        )

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

    @checked(refused, role=text(), expression=ROWS)
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
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.outputs)

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
        # An ode that is left out is zero, and so is one that was written as zero.
        return self.jumps and bool(self.ode.is_zero())

    def __repr__(self) -> str:
        """Return the names of states, controls, parameters and, if any, outputs."""
        named = {
            "states": self.state_names,
            "controls": self.control_names,
            "parameters": symbol_names(self.parameters),
        }
        if self.outputs:
            named["outputs"] = self.output_names
        parts = [f"{role}: {', '.join(n) or 'none'}" for role, n in named.items()]
        return f"Model with {'; '.join(parts)}"


def shown_units(model: Model) -> dict[str, str]:
    """Return the units of a model's states, controls and outputs."""
    names = {*model.state_names, *model.control_names, *model.outputs}
    return {name: unit for name, unit in model.units.items() if name in names}


@checked(refused, model=of_kind(Model, "a Model"))
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
    """Return phi(x, u, p, s) -> the state after the jump at an interval's end.

    s are the signals, then the time. Without a jump the function returns x.
    """
    return _function_of(
        model, "jump", model.next_state if model.jumps else model.states
    )


def unsolved_of(model: Model) -> ca.Function:
    """Return r(x, u, p, s), the scaled residual of nonlinear algebraic equations.

    s are the signals, then the time.
    """
    return _function_of(model, "unsolved", model.elimination.unsolved)


def outputs_of(model: Model) -> ca.Function:
    """Return g(x, u, p, s) -> the outputs, shape (ny, 1); s: signals, then the time."""
    rows = ca.vertcat(ca.SX(0, 1), *model.outputs.values())
    return _function_of(model, "outputs", rows)


def _states_of(model: Model) -> ca.Function:
    return _function_of(model, "states", model.states)


def _function_of(model: Model, name: str, rows: ca.SX) -> ca.Function:
    arguments = [model.states, model.controls, model.parameters, model.varying]
    return ca.Function(name, arguments, [rows])
