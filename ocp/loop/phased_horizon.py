"""Phases in closed loop: the remaining phases are planned anew every period.

    phase k, after e seconds in it:  decide T, the time left in it, and all later phases
                                     lower <= T + e <= upper of its horizon

One problem is built once for each number of remaining phases. A step applies the plan
for one period. If the phase ends within about that time, the step applies the rest of
the phase, and the linkage gives the state of the next phase. The number of intervals is
constant, so they get shorter towards the end of a phase.

The plant's state also contains the phase and the time spent in it.

Source: the shrinking horizon of controller.py, applied to each phase.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    mapping,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.answer.plan import Plan
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import symbol_names, symbol_of
from swarmstart.ocp.loop.controller import OF_DECISION, Decision, plan_of_step
from swarmstart.ocp.loop.plant import Plant
from swarmstart.ocp.nlp.polish_options import PolishOptions
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.search.settings import SearchGiven
from swarmstart.ocp.statement.control_shape import Profile
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.phases import (
    CLOCK,
    Linkage,
    Phases,
    phases,
    shared_outputs,
    units_of_phases,
)
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import TerminalConstraint
from swarmstart.ocp.system.model import Model

PHASE, SINCE, ENDS = "phase", "time in the phase", "phase ends"
"""Extra states of the plant, and the parameter that ends a phase: 1, else 0."""
NO_PARAMETERS: Mapping[str, float] = MappingProxyType({})
_REST = "duration of phase 1"
"""Name of the duration of the first remaining phase in the joined problem."""
_SHORTEST = 0.01
"""Smallest remaining part of a phase, as a fraction of a period."""
_ROUNDING = 1e-9


_PROBLEMS = several(
    of_kind(OptimalControlProblem, "a problem"), "a sequence of problems"
)
_VALUES = mapping(values=a_number(), words="a mapping of names to finite numbers")


@checked(
    refused,
    stated=_PROBLEMS,
    period=a_number(above=0),
    left=several(of_kind(Phases, "Phases"), "a sequence of Phases"),
    planners=several(of_kind(Planner, "a Planner"), "a sequence of Planners"),
    model=of_kind(Model, "a Model"),
    parameters=_VALUES,
    within=optional(a_number(above=0)),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PhasedHorizon:
    """Controller that plans the remaining phases; made by `phased_horizon`.

    Attributes:
        stated: The phases.
        period: Time from one plan to the next [s].
        left: For each phase, the problem of this phase and all later ones.
        planners: Planners of these problems.
        model: Model of the plant: all states by their names, then time, phase, and time
            in the phase.
        parameters: Values of the known parameters by name.
        within: Limit of the wall time for one plan [s], as in `RecedingHorizon`; None:
            no limit.

    Raises:
        InvalidProblemError: If there is a limit `within`, and the search uses lanes or
            the polish cannot be stopped.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> leg = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=0.5, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-4, 4)), terminal=[(x, 1)],
        ... )
        >>> loop = ss.phased_horizon([leg, leg], period=0.25, polish=ss.IpoptOptions())
        >>> loop.dt, loop.model.state_names
        (0.25, ('x', 'time', 'phase', 'time in the phase'))
    """

    stated: tuple[OptimalControlProblem, ...]
    period: float
    left: tuple[Phases, ...]
    planners: tuple[Planner, ...]
    model: Model
    parameters: Mapping[str, float]
    within: float | None = None

    def __post_init__(self) -> None:
        """Check that plans can be stopped if they have a time."""
        if self.within is not None:
            self.planners[0].in_time()

    @property
    def dt(self) -> float:
        """Time from one plan to the next [s]; a phase's last step may be shorter."""
        return self.period

    @checked(refused, x0=reals())
    def start(self, x0: ArrayLike) -> Array:
        """Return the plant's initial state from an initial state of the first phase.

        Args:
            x0: State of the first phase, shape (nx of that phase,).

        Returns:
            Initial state of the plant, for `simulate`.

        Raises:
            InvalidProblemError: If the shape is wrong or a number is not finite.
        """
        names = self.stated[0].model.state_names
        given = np.asarray(x0, dtype=np.float64).ravel()
        if given.size != len(names) or not np.isfinite(given).all():
            raise InvalidProblemError(
                f"x0 must have a finite number for each of {', '.join(names)}, "
                f"got {x0!r}"
            )
        values = dict(zip(names, given.tolist(), strict=True))
        return np.array([values.get(name, 0.0) for name in self.model.state_names])

    @checked(
        refused,
        substeps=a_count(least=1),
        parameters=_VALUES,
    )
    def plant(
        self, *, substeps: int, parameters: Mapping[str, float] = NO_PARAMETERS
    ) -> Plant:
        """Return the phases as a plant, which ends a phase when the controller says so.

        Args:
            substeps: Number of integrator steps in a period.
            parameters: Values by name that differ from the planned ones.
        """
        given = {**self.parameters, **parameters}
        decided = {n: f.first for one in self.stated for n, f in one.decided.items()}
        known = [n for n in symbol_names(self.model.parameters) if n in given]
        values = np.array([given[name] for name in known])
        return Plant(
            self.model,
            dt=self.period,
            substeps=substeps,
            parameters=(lambda times: np.repeat(values[:, None], times.size, axis=1))
            if known
            else None,
            decided={**{n: v for n, v in decided.items() if n not in given}, ENDS: 0.0},
            clock=CLOCK,
        )

    @checked(refused, state=reals(axes=1), **OF_DECISION)
    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Plan from the state, which contains the time, and return the decision.

        See Controller; the argument `time` is not used.
        """
        del time  # It is a state of the plant.
        if np.size(state) != self.model.nx:
            raise refused("state", state, f"an array of shape ({self.model.nx},)")
        values = dict(zip(self.model.state_names, map(float, state), strict=True))
        # A whole number up to rounding.
        number = min(max(round(values[PHASE]), 0), len(self.stated) - 1)
        planner = self.planners[number]
        plan = self._plan(number, values, previous, rng)
        found = planner.lowered.decided(plan.x0)
        rest, intervals = found[_REST], self.stated[number].intervals
        # Else a rest below the smallest one would be left.
        ends = rest < self.period * (1 + _ROUNDING + _SHORTEST)
        is_last = number == len(self.stated) - 1 and ends
        held = self._in_plant(number, plan.controls[:, :intervals])
        own = {n: v for n, v in found.items() if n in planner.stated.decided}
        return Decision(
            control=held[:, 0],
            plans=(plan,),
            dt=rest if ends else self.period,
            is_last=is_last,
            profile=Profile(controls=held, piece=rest / intervals),
            # No linkage follows the last phase.
            decided={**own, ENDS: float(ends and not is_last)},
        )

    def _plan(
        self,
        number: int,
        values: Mapping[str, float],
        previous: Decision | None,
        rng: np.random.Generator,
    ) -> Plan:
        """Return the plan of the remaining phases."""
        planner, names = self.planners[number], self.stated[number].model.state_names
        x0 = self.left[number].start([values[name] for name in names])
        # The joined problem alone would begin at time 0.
        x0[self.left[number].problem.model.state_names.index(CLOCK)] = values[CLOCK]
        decided = planner.stated.decided
        known = {**self.parameters, SINCE: values[SINCE]}
        told = Known(
            parameters=[
                known[name]
                for name in symbol_names(planner.stated.model.parameters)
                if name not in decided
            ]
        )
        start, core, _ = planner.posed(x0, told)
        state = np.array(start, dtype=np.float64)
        shifted: Array | None = None
        if previous is not None:
            guesses, shifted = self._shifted(number, previous)
            places = planner.lowered.places["decided"]
            for place, name in zip(places, decided, strict=True):
                guess = guesses.get(name, float(state[place]))
                limits = decided[name]
                state[place] = np.clip(guess, limits.lower, limits.upper)
        return plan_of_step(
            planner,
            state,
            core,
            shifted,
            within=self.within,
            guess=shifted,
            near=previous is not None,
            last_cost=None if previous is None else previous.plans[0].cost,
            in_loop=True,
            rng=rng,
        )

    def _shifted(
        self, number: int, previous: Decision
    ) -> tuple[dict[str, float], Array]:
        """Return guesses of the decisions and the controls, from the rest of a plan.

        Args:
            number: Number of the present phase.
            previous: The last decision.
        """
        # The last step ended a phase.
        dropped = int(previous.decided.get(ENDS, 0.0) > 0)
        last, before = previous.plans[0], number - dropped
        found = self.planners[before].lowered.decided(last.x0)
        controls = self._in_plant(before, last.controls)
        intervals = self.stated[before].intervals
        if dropped:
            guesses = {
                _renumbered(name, -1): one
                for name, one in found.items()
                if name != _REST
            }
            return guesses, self._of_plan(number, controls[:, intervals:])
        rest = found[_REST]
        left = max(rest - self.period, _SHORTEST * self.period)
        first = Profile(controls=controls[:, :intervals], piece=rest / intervals)
        moved = first.sampled(self.period, left, intervals)
        every = np.hstack([moved, controls[:, intervals:]])
        return {**found, _REST: left}, self._of_plan(number, every)

    def _in_plant(self, number: int, controls: Array) -> Array:
        """Return a plan's controls in the plant's order, 0 for those that it lacks."""
        names = self.left[number].problem.model.control_names
        found = np.zeros((self.model.nu, controls.shape[1]))
        found[[self.model.control_names.index(name) for name in names]] = controls
        return found

    def _of_plan(self, number: int, controls: Array) -> Array:
        """Return controls in the plant's order as controls of a plan."""
        names = self.left[number].problem.model.control_names
        return controls[[self.model.control_names.index(name) for name in names]]


@checked(
    refused,
    polish=optional(of_kind(PolishOptions, "IpoptOptions or NlpOptions")),
    stated=_PROBLEMS,
    period=a_number(above=0),
    linkages=of_kind((list, tuple), "a sequence of linkages"),
    parameters=_VALUES,
    within=optional(a_number(above=0)),
)
def phased_horizon(  # noqa: PLR0913 - phases, and how each plan is made
    stated: Sequence[OptimalControlProblem],
    linkages: Sequence[Linkage] = (),
    *,
    period: float,
    search: SearchGiven = None,
    polish: PolishOptions | None,
    parameters: Mapping[str, float] = NO_PARAMETERS,
    within: float | None = None,
) -> PhasedHorizon:
    """Return a controller that runs phases and plans them anew every period.

    Args:
        stated: The phases, as for `phases`, without jumps at the ends of intervals.
        linkages: As for `phases`.
        period: Time from one plan to the next [s].
        search: The population search of each plan, as for a Planner; None: no search.
        polish: Options of the polish; None: no polish.
        parameters: Values of the parameters that are not decided, by name.
        within: Wall time for one plan [s], as in `RecedingHorizon`; None: no limit.

    Returns:
        The controller; its `plant` and `start` give the plant and the initial state.

    Raises:
        InvalidProblemError: As in `phases`; or if a phase jumps, decides its start or
            has an initial cost, or the parameters are not those of the phases.

    Example:
        >>> import casadi as ca
        >>> from dataclasses import replace
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> leg = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=0.5, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-4, 4)), terminal=[(x, 1)],
        ... )
        >>> back = replace(leg, terminal=[(x, 0)])
        >>> loop = ss.phased_horizon([leg, back], period=0.2, polish=ss.IpoptOptions())
        >>> plant, x0 = loop.plant(substeps=8), loop.start([0.0])
        >>> run = ss.simulate(plant, loop, x0, steps=9, seed=0)
        >>> [round(float(time), 3) for time in run.times]
        [0.0, 0.2, 0.4, 0.5, 0.7, 0.9, 1.0]
    """
    together = phases(stated, linkages)
    _require(stated, parameters)
    links = [dict(link) for link in linkages] or [{} for _ in stated[1:]]
    left = tuple(
        phases([_rest_of(one, period), *stated[k + 1 :]], links[k:])
        for k, one in enumerate(stated)
    )
    return PhasedHorizon(
        stated=tuple(stated),
        period=float(period),
        left=left,
        planners=tuple(
            Planner(one.problem, search=search, polish=polish) for one in left
        ),
        model=_plant_model(stated, links, together),
        parameters=dict(parameters),
        within=within,
    )


def _require(
    stated: Sequence[OptimalControlProblem],
    parameters: Mapping[str, float],
) -> None:
    names = {n for one in stated for n in symbol_names(one.model.parameters)}
    needed = names - {name for one in stated for name in one.decided}
    if {*parameters} != needed:
        raise InvalidProblemError(
            f"parameters must be values of {', '.join(sorted(needed)) or 'nothing'}, "
            f"got {', '.join(map(str, parameters)) or 'none'}"
        )
    for number, one in enumerate(stated, 1):
        has = {
            "no jumps at the ends of intervals (next_state)": one.model.jumps,
            "no decided start": bool(one.start),
            "no initial cost": not one.initial_cost.is_zero(),
        }
        wrong = [name for name, found in has.items() if found]
        if wrong:
            raise InvalidProblemError(
                "phases that are run in receding horizon must have "
                f"{' and '.join(wrong)}, phase {number} has"
            )


def _rest_of(phase: OptimalControlProblem, period: float) -> OptimalControlProblem:
    """Return the rest of a phase, given the time already spent in it."""
    horizon, model = phase.horizon, phase.model
    lower, upper = (
        (horizon.lower, horizon.upper)
        if isinstance(horizon, Free)
        else (float(horizon), float(horizon))
    )
    # By its name `rest` becomes the decided duration of the joined problem.
    since, rest = symbol_of(SINCE), symbol_of(_REST)
    guess = horizon.first if isinstance(horizon, Free) else float(horizon)
    shortest = min(_SHORTEST * period, lower)  # A free horizon must be above 0.
    return replace(
        phase,
        model=replace(model, parameters=ca.vertcat(model.parameters, since, rest)),
        horizon=Free(shortest, upper, guess),
        terminal=[
            *phase.terminal,
            TerminalConstraint(
                expression=rest + since,
                lower=lower,
                upper=upper,
                scale=period,
                name="length of the phase",
            ),
        ],
    )


def _renumbered(name: str, by: int) -> str:
    """Return the name of a duration with the number of its phase changed."""
    head, _, number = name.rpartition(" ")
    is_duration = f"{head} 1" == _REST and number.isdigit()
    return f"{head} {int(number) + by}" if is_duration else name


def _plant_model(
    stated: Sequence[OptimalControlProblem],
    links: Sequence[Mapping[str, ca.SX]],
    together: Phases,
) -> Model:
    """Return all phases as one model in seconds, with the phase as a state."""
    controls = {name: symbol_of(name) for name in together.problem.model.control_names}
    states = {n: symbol_of(n) for one in stated for n in one.model.state_names}
    parameters = {
        n: symbol_of(n) for one in stated for n in symbol_names(one.model.parameters)
    }
    time, phase, since, ends = map(symbol_of, (CLOCK, PHASE, SINCE, ENDS))
    rates, after = [], []
    for one, link in zip(stated, [*links, {}], strict=True):
        joined = _joined(one.model, (states, controls, parameters), time)
        own = dict(
            zip(one.model.state_names, ca.vertsplit(joined(one.model.ode)), strict=True)
        )
        rates.append(ca.vertcat(*[own.get(name, ca.SX(0)) for name in states]))
        after.append(
            ca.vertcat(
                *[
                    joined(ca.SX(link[name])) if name in link else state
                    for name, state in states.items()
                ]
            )
        )
    every = ca.vertcat(*states.values())
    linked = ca.if_else(ends > 0.5, _selected(phase, after), every)  # noqa: PLR2004
    return Model(
        states=ca.vertcat(every, time, phase, since),
        controls=ca.vertcat(*controls.values()),
        ode=ca.vertcat(_selected(phase, rates), 1, 0, 1),
        # With `ends` at 0 nothing jumps; at 1 the next phase begins.
        next_state=ca.vertcat(linked, time, phase + ends, since * (1 - ends)),
        parameters=ca.vertcat(*parameters.values(), ends),
        state_names=(*states, CLOCK, PHASE, SINCE),
        control_names=tuple(controls),
        outputs={
            name: _selected(
                phase,
                [
                    _joined(one.model, (states, controls, parameters), time)(
                        one.model.outputs[name]
                    )
                    for one in stated
                ],
            )
            for name in shared_outputs(stated)
        },
        units=units_of_phases(stated),
    )


def _joined(
    model: Model, every: tuple[Mapping[str, ca.SX], ...], time: ca.SX
) -> Callable[[ca.SX], ca.SX]:
    """Return a function that writes a phase's expression in the common symbols."""
    states, controls, parameters = every
    own = ca.vertcat(model.states, model.controls, model.parameters, model.time)
    new = ca.vertcat(
        *[states[name] for name in model.state_names],
        *[controls[name] for name in model.control_names],
        *[parameters[name] for name in symbol_names(model.parameters)],
        *([time] if model.time.numel() else []),
    )
    return lambda expression: ca.substitute(expression, own, new)


def _selected(phase: ca.SX, of_phases: Sequence[ca.SX]) -> ca.SX:
    """Return the entry of the present phase."""
    found = of_phases[-1]
    for number, one in reversed([*enumerate(of_phases)][:-1]):
        # The phase is a whole number up to rounding.
        found = ca.if_else(phase < number + 0.5, one, found)
    return found
