"""Several phases, one after another, each with its own model, as one problem.

    phase 1: x' = f1 over T1 in N1 intervals | linkage | phase 2: x' = f2 over T2 ...

All phases share one grid of N1 + N2 + ... intervals. A state counts the intervals and
selects the phase. The jump at the end of a phase's last interval turns its state into
the state of the next phase. States and controls with the same name are the same.
Constraints and costs at the end of a phase are kept in a state until the end of the
last phase.

    ode    T_i N / N_i f_i(x, u)     in phase i, over a horizon of 1
    time   a state with the rate T_i N / N_i: the seconds of an answer

Source: Betts (2010), Practical Methods for Optimal Control and Estimation Using
Nonlinear Programming, section 4.1, for phases and linkages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import NAMES, checked, of_kind, reals, several
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import symbol_names, symbol_of
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.feature import effective
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import Bounds, PathConstraint, TerminalConstraint
from swarmstart.ocp.system.model import Model, shown_units

Linkage = Mapping[str, ca.SX]
"""States of the next phase, by name, as expressions of this phase's end state."""
CLOCK, COUNTER = "time", "intervals done"
"""Names of the states for the time [s] and the number of finished intervals."""


@checked(refused, problem=of_kind(OptimalControlProblem, "a problem"), first=NAMES)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Phases:
    """Several phases joined to one problem; made by `phases`.

    Attributes:
        problem: The joined problem.
        first: Names of the states of the first phase.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> leg = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-4, 4)), terminal=[(x, 1)],
        ... )
        >>> both = ss.phases([leg, leg])
        >>> both.first, both.problem.intervals
        (('x',), 8)
    """

    problem: OptimalControlProblem
    first: tuple[str, ...]

    @checked(refused, x0=reals())
    def start(self, x0: ArrayLike) -> Array:
        """Return the joined problem's initial state from a state of the first phase.

        Args:
            x0: State at the start of the first phase, shape (nx of that phase,).

        Returns:
            Initial state of the joined problem, shape (nx,).

        Raises:
            InvalidProblemError: If the shape is wrong.
        """
        given = np.asarray(x0, dtype=np.float64).ravel()
        if given.size != len(self.first):
            raise InvalidProblemError(
                f"x0 must have a number for each of {', '.join(self.first)}, "
                f"got {given.size}"
            )
        values = dict(zip(self.first, given, strict=True))
        return np.array(
            # Time, counter and exits begin at 0; states of later phases wait for a
            # linkage.
            [values.get(name, 0.0) for name in self.problem.model.state_names]
        )


@checked(
    refused,
    stated=several(
        of_kind(OptimalControlProblem, "a problem"), "a sequence of problems"
    ),
    linkages=of_kind((list, tuple), "a sequence of linkages"),
)
def phases(
    stated: Sequence[OptimalControlProblem], linkages: Sequence[Linkage] = ()
) -> Phases:
    """Join phases, each stated as a problem of its own, to one problem.

    The horizon of a phase may be free; an answer then decides "duration of phase 1" and
    so on. Integrator, quadrature, substeps, checks and tolerances are taken from the
    first phase. Bounds of states and controls hold in their own phase; only the first
    phase may have a free start.

    Args:
        stated: The phases in order, at least one, without signals, periodic states,
            previous controls and soft constraints; all minimised or all maximised.
        linkages: For each phase except the last, the states of the next phase as
            expressions of its end state; states that are not named continue under their
            name.

    Returns:
        The joined problem, with a function for its initial state.

    Raises:
        InvalidProblemError: If a phase has a feature that phases do not support, a
            linkage names an unknown state, or a state of a later phase is neither in
            the linkage to that phase nor a state of the phase before it.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> there = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-4, 4)), terminal=[(x, 1)],
        ... )
        >>> back = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=0.5, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-4, 4)), terminal=[(x, 0)],
        ... )
        >>> both = ss.phases([there, back])
        >>> x0 = both.start([0.0])
        >>> found = ss.solve(both.problem, x0, search=None, lanes=0, seed=0)
        >>> round(found.cost, 3)
        3.0
    """
    _require(stated, linkages)
    union = _Union(stated)
    joined = [_Joined(union, number) for number in range(len(stated))]
    links = [dict(link) for link in linkages] or [{} for _ in stated[1:]]
    first = stated[0]
    exits = _Exits(joined[:-1])
    time, counter = union.time, union.counter
    states = ca.vertcat(*union.states.values(), time, counter, exits.symbols)
    model = Model(
        states=states,
        controls=ca.vertcat(ca.SX(0, 1), *union.controls.values()),
        ode=ca.vertcat(
            union.selected([_rates(one) for one in joined]),
            union.selected([one.speed for one in joined]),
            ca.SX.zeros(1 + exits.symbols.numel()),
        ),
        next_state=ca.vertcat(
            _after(union, joined, links), time, counter + 1, exits.after(union)
        ),
        parameters=ca.vertcat(ca.SX(0, 1), *union.parameters.values()),
        state_names=(*union.states, CLOCK, COUNTER, *symbol_names(exits.symbols)),
        control_names=tuple(union.controls),
        outputs={
            name: union.selected(
                [one.joined(one.phase.model.outputs[name]) for one in joined]
            )
            for name in shared_outputs(stated)
        },
        units=units_of_phases(stated),
    )
    last = joined[-1]
    problem = OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=union.intervals,
        stage_cost=union.selected([one.speed * one.stage_cost for one in joined]),
        step_cost=union.selected([one.step_cost for one in joined]),
        initial_cost=joined[0].initial_cost,
        terminal_cost=last.terminal_cost + exits.cost,
        constraints=[c for one in joined for c in one.constraints],
        terminal=[*exits.terminal, *last.terminal],
        bounds=union.bounds(more=2 + exits.symbols.numel()),
        maximize=first.maximize,
        start=first.start,
        decided=union.decided,
        clock=CLOCK,
        scales=_largest(stated),
        quadrature=first.quadrature,
        integrator=first.integrator,
        substeps=first.substeps,
        transcription=first.transcription,
        integrator_tolerance=first.integrator_tolerance,
        checks=first.checks,
        tolerance=first.tolerance,
        path_tolerance=first.path_tolerance,
    )
    return Phases(problem=problem, first=first.model.state_names)


def _largest(stated: Sequence[OptimalControlProblem]) -> dict[str, float]:
    """Return the sizes given in the phases, by name; of several the largest."""
    found: dict[str, float] = {}
    for phase in stated:
        for name, size in phase.scales.items():
            found[name] = max(size, found.get(name, 0.0))
    return found


def shared_outputs(stated: Sequence[OptimalControlProblem]) -> list[str]:
    """Return the names of the outputs that the models of all phases have."""
    first, *others = (phase.model.outputs for phase in stated)
    return [name for name in first if all(name in other for other in others)]


def units_of_phases(stated: Sequence[OptimalControlProblem]) -> dict[str, str]:
    """Return the units of states, controls and common outputs, as first stated."""
    units: dict[str, str] = {}
    for phase in reversed(stated):
        units |= shown_units(phase.model)
    own = {name for phase in stated for name in phase.model.outputs}
    unlike = own - set(shared_outputs(stated))
    return {name: unit for name, unit in units.items() if name not in unlike}


class _Union:
    """Symbols of all phases, one for each name, and the selection of the phase."""

    def __init__(self, stated: Sequence[OptimalControlProblem]) -> None:
        self.stated = stated
        self.states = _named(p.model.state_names for p in stated)
        self.controls = _named(p.model.control_names for p in stated)
        self.parameters = _named(symbol_names(p.model.parameters) for p in stated)
        self.state_limits = _widest(
            (p.model.state_names, p.state_limits) for p in stated
        )
        self.control_limits = _widest(
            (p.model.control_names, p.control_limits) for p in stated
        )
        self.time, self.counter = ca.SX.sym(CLOCK), ca.SX.sym(COUNTER)
        self.durations: list[ca.SX] = []
        self.decided: dict[str, Free] = {}
        for number, phase in enumerate(stated):
            self.decided.update(phase.decided)
            duration = ca.SX(0)
            if isinstance(phase.horizon, Free):
                name = f"duration of phase {number + 1}"
                # A decided parameter, so that the core makes it a state.
                duration = self.parameters[name] = ca.SX.sym(name)
                self.decided[name] = phase.horizon
            else:
                duration = ca.SX(phase.horizon)
            self.durations.append(duration)
        self.ends = np.cumsum([phase.intervals for phase in stated]).tolist()
        self.intervals = int(self.ends[-1])

    def selected(self, of_phases: Sequence[ca.SX]) -> ca.SX:
        """Return an expression that has the value of the present phase's entry.

        The number of finished intervals, a state, decides which phase is present.

        Args:
            of_phases: An entry for each phase, in order.
        """
        found = of_phases[-1]
        for end, one in reversed([*zip(self.ends, of_phases, strict=True)][:-1]):
            # The counter is a whole number up to the rounding of an NLP solver.
            found = ca.if_else(self.counter < end - 0.5, one, found)
        return found

    def at_end_of(self, number: int, then: ca.SX, otherwise: ca.SX) -> ca.SX:
        """Return `then` in the last interval of phase `number`, else `otherwise`."""
        last = self.ends[number] - 1
        inside = ca.if_else(self.counter < last + 0.5, then, otherwise)
        return ca.if_else(self.counter > last - 0.5, inside, otherwise)

    def bounds(self, more: int) -> Bounds:
        """Return the widest bounds of all phases; tighter ones become constraints.

        Args:
            more: Number of further states, which have no bounds.
        """
        controls, states = (
            np.array([*limits.values()]).reshape(-1, 2).T
            for limits in (self.control_limits, self.state_limits)
        )
        none = np.full(more, np.inf)
        return Bounds(
            controls=(controls[0], controls[1]),
            states=(np.append(states[0], -none), np.append(states[1], none)),
        )


def _named(columns: Iterable[Sequence[str]]) -> dict[str, ca.SX]:
    """Return a symbol for each name."""
    return {name: symbol_of(name) for names in columns for name in names}


def _widest(
    limits: Iterable[tuple[Sequence[str], tuple[Array, Array]]],
) -> dict[str, tuple[float, float]]:
    """Return the lowest lower and the highest upper bound of each name."""
    found: dict[str, tuple[float, float]] = {}
    for names, (lower, upper) in limits:
        for name, low, high in zip(names, lower.tolist(), upper.tolist(), strict=True):
            before = found.get(name, (low, high))
            found[name] = min(before[0], low), max(before[1], high)
    return found


class _Joined:
    """One phase in the symbols of all."""

    def __init__(self, union: _Union, number: int) -> None:
        phase = union.stated[number]
        self.number, self.phase, self.union = number, phase, union
        model = phase.model
        self.speed = union.durations[number] * union.intervals / phase.intervals
        own = ca.vertcat(model.states, model.controls, model.parameters, model.time)
        new = ca.vertcat(
            *[union.states[name] for name in model.state_names],
            *[union.controls[name] for name in model.control_names],
            *[union.parameters[n] for n in symbol_names(model.parameters)],
            *([union.time] if model.time.numel() else []),
        )

        def joined(expression: ca.SX) -> ca.SX:
            return ca.substitute(expression, own, new)

        self.joined = joined
        self.ode = joined(model.ode)
        self.jump = joined(model.next_state) if model.jumps else joined(model.states)
        self.stage_cost, self.step_cost, self.initial_cost, self.terminal_cost = map(
            joined,
            (
                phase.stage_cost,
                phase.step_cost,
                phase.initial_cost,
                phase.terminal_cost,
            ),
        )
        self.terminal = [
            replace(c, expression=joined(c.expression))
            for c in phase.terminal_constraints
        ]
        self.constraints = [self._active(c) for c in _own_constraints(union, number)]

    def _active(self, constraint: PathConstraint) -> PathConstraint:
        """Return a constraint that is active in its phase only."""
        lower, upper = np.asarray(constraint.lower), np.asarray(constraint.upper)
        # A row with one limit keeps away from it by the size of the limit.
        room = np.maximum(1.0, np.abs(np.where(np.isfinite(lower), lower, upper)))
        # A value within the limits, which the rows have during other phases.
        inside = np.where(
            np.isfinite(lower),
            np.where(np.isfinite(upper), (lower + upper) / 2, lower + room),
            upper - room,
        )
        rows = self.joined(constraint.expression)
        every = [ca.SX(inside)] * len(self.union.stated)
        every[self.number] = rows
        return replace(constraint, expression=self.union.selected(every))


def _own_constraints(union: _Union, number: int) -> list[PathConstraint]:
    """Return a phase's path constraints, and its bounds if others are wider."""
    phase = union.stated[number]
    model, found = phase.model, []
    for what, names, symbols, limits, widest in (
        (
            "states",
            model.state_names,
            model.states,
            phase.state_limits,
            union.state_limits,
        ),
        (
            "controls",
            model.control_names,
            model.controls,
            phase.control_limits,
            union.control_limits,
        ),
    ):
        own = [
            i
            for i, name in enumerate(names)
            if (limits[0][i], limits[1][i]) != widest[name]
        ]
        if own:
            found.append(
                PathConstraint(
                    expression=symbols[own],
                    lower=limits[0][own],
                    upper=limits[1][own],
                    name=f"bounds of the {what} in phase {number + 1}",
                )
            )
    for constraint in phase.stated:
        if not isinstance(constraint, PathConstraint):
            raise InvalidProblemError(
                "phases take path constraints that are limits on expressions, got a "
                f"{type(constraint).__name__}"
            )
        found.append(constraint)
    return found


class _Exits:
    """Constraints and costs at the ends of all phases except the last, as states."""

    def __init__(self, joined: Sequence[_Joined]) -> None:
        rows: list[tuple[int, ca.SX]] = []
        self.terminal: list[TerminalConstraint] = []
        self.cost = ca.SX(0)
        names = []
        for one in joined:
            name = f"cost of phase {one.number + 1}"
            symbol = ca.SX.sym(name)
            rows.append((one.number, one.terminal_cost))
            names.append(symbol)
            self.cost += symbol
            for c in one.terminal:
                size = c.expression.numel()
                label = f"{c.name or 'terminal constraint'} of phase {one.number + 1}"
                kept = ca.vertcat(
                    *[symbol_of(f"{label}, row {i}") for i in range(size)]
                )
                names.append(kept)
                rows += [(one.number, c.expression[i]) for i in range(size)]
                self.terminal.append(replace(c, expression=kept))
        self._rows = rows
        self.symbols = ca.vertcat(ca.SX(0, 1), *names)

    def after(self, union: _Union) -> ca.SX:
        """Return the values of the states of this object after an interval."""
        return ca.vertcat(
            ca.SX(0, 1),
            *[
                union.at_end_of(number, value, self.symbols[i])
                for i, (number, value) in enumerate(self._rows)
            ],
        )


def _rates(one: _Joined) -> ca.SX:
    """Return the rates of all states in a phase; other states stay constant."""
    rates = dict(zip(one.phase.model.state_names, ca.vertsplit(one.ode), strict=True))
    return one.speed * ca.vertcat(
        *[rates.get(name, ca.SX(0)) for name in one.union.states]
    )


def _after(union: _Union, joined: Sequence[_Joined], links: Sequence[Linkage]) -> ca.SX:
    """Return all states after an interval, linkages included."""
    found = []
    for name, state in union.states.items():
        in_phases = []
        for one in joined:
            names = one.phase.model.state_names
            own = one.jump[names.index(name)] if name in names else state
            if one.number < len(links) and name in links[one.number]:
                linked = one.joined(ca.SX(links[one.number][name]))
                own = union.at_end_of(one.number, linked, own)
            in_phases.append(own)
        # Left as it is, a state does not count as one that jumps.
        same = all(ca.is_equal(own, state) for own in in_phases)
        found.append(state if same else union.selected(in_phases))
    return ca.vertcat(*found)


def _require(
    stated: Sequence[OptimalControlProblem], linkages: Sequence[Linkage]
) -> None:
    if not stated or not all(isinstance(p, OptimalControlProblem) for p in stated):
        raise InvalidProblemError(
            f"phases must be OptimalControlProblems, at least one, got {stated!r}"
        )
    if linkages and len(linkages) != len(stated) - 1:
        raise InvalidProblemError(
            f"linkages must be one for each of the {len(stated) - 1} ends between "
            f"phases, got {len(linkages)}"
        )
    for number, phase in enumerate(stated):
        has = {
            "signals": phase.ns,
            "periodic states": len(phase.periodic),
            "previous controls": phase.previous.numel(),
            "soft constraints": len(phase.soft),
            "other maximize than phase 1": phase.maximize != stated[0].maximize,
            "a discrete-time model": phase.model.is_discrete,
            "controls of whole numbers": len(phase.integer),
            "blocks of intervals": len(phase.blocks),
            "linear controls": phase.has_knots,
            "delays or other features": len(effective(phase)),
            "several members": phase.risk is not None,
            # Only the first phase begins at the start of the horizon.
            "initial cost": number > 0 and not phase.initial_cost.is_zero(),
            "a state named time": CLOCK in phase.model.state_names,
        }
        wrong = [name for name, count in has.items() if count]
        if wrong:
            raise InvalidProblemError(
                f"a phase must have no {' and no '.join(wrong)}, phase {number + 1} has"
            )
    _require_links(stated, linkages)


def _require_links(
    stated: Sequence[OptimalControlProblem], linkages: Sequence[Linkage]
) -> None:
    """Raise if a state has no source, or a linkage names an unknown state."""
    for number, phase in enumerate(stated[1:]):
        before = stated[number].model.state_names
        given = linkages[number] if linkages else {}
        for name in phase.model.state_names:
            if name not in before and name not in given:
                raise InvalidProblemError(
                    f"state {name} of phase {number + 2} must come from phase "
                    f"{number + 1}, which has {', '.join(before)}: give a linkage"
                )
        foreign = [name for name in given if name not in phase.model.state_names]
        if foreign:
            raise InvalidProblemError(
                f"linkages must name states of phase {number + 2}, "
                f"got {', '.join(foreign)}"
            )
