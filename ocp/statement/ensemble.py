"""Ensemble: one control sequence for several values of uncertain parameters.

    members     x_m' = f(x_m, u, p_m)   of one problem, side by side, m = 0 ... M - 1
    controls    one sequence u for all of them; with a robust horizon of r intervals,
                sequences u_m that are equal over the first r, after which the true
                member is known
    cost        the mean of the members' costs, the worst, or the mean of the worst
                part of them (risk.py)
    constraints those of the problem, of every member

The states of member m have the problem's names with "_m" appended. All members start at
one initial state; a free start is one decision for all members.

A robust horizon of one interval is a scenario tree (multi-stage control) with uncertain
values that stay constant: do-mpc's n_robust = 1. For a longer one do-mpc's tree
branches for each sequence of values; here the values stay constant.

Sources: Bertsekas (2005), Dynamic Programming and Optimal Control, volume 1, for open-
loop control under uncertain parameters. Lucia, Finkler and Engell (2013), Multi-stage
nonlinear model predictive control applied to a semi-batch polymerization reactor under
uncertainty, Journal of Process Control 23, for branches.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import RNG, a_count, checked, of_kind, optional, reals, text
from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened, symbol_names
from swarmstart.ocp.common.limits import require_choice, require_number
from swarmstart.ocp.statement.problem import Costs, OptimalControlProblem
from swarmstart.ocp.statement.risk import Measure, Risk
from swarmstart.ocp.system.algebraic import UNSOLVED, joined
from swarmstart.ocp.system.constraints import Bounds, Constraint
from swarmstart.ocp.system.model import Model, jump_of, rate_of, shown_units

Values = Mapping[str, ArrayLike] | Sequence[Mapping[str, float]] | Array
Sampler = Callable[[np.random.Generator], Mapping[str, float]]


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    weights=optional(reals()),
    risk=text(),
    samples=optional(a_count(least=1)),
    rng=optional(RNG),
    robust_horizon=optional(a_count()),
)
def ensemble(  # noqa: PLR0913 - the members, and how their costs count
    problem: OptimalControlProblem,
    parameters: Values | Sampler,
    *,
    weights: ArrayLike | None = None,
    risk: Measure = "mean",
    level: float = 0.9,
    robust_horizon: int | None = None,
    samples: int | None = None,
    rng: np.random.Generator | None = None,
) -> OptimalControlProblem:
    """Return a problem with one control sequence for several parameter values.

    Args:
        problem: The problem of one member; not changed.
        parameters: The values: a mapping from the name of each uncertain parameter to
            its M values; or a list of M mappings {name: value}; or an array of all
            parameters, shape (np, M); or a function rng -> {name: value} that draws a
            member.
        weights: Weights of the members, shape (M,), positive; scaled to sum one. None:
            equal weights.
        risk: The cost that counts: the "mean" of the members' costs, the "worst", or
            "cvar", the mean of the worst part (1 - level) of them.
        level: Level of "cvar", in [0, 1).
        robust_horizon: Number of intervals, from 0 to N, in which all members have the
            same controls; afterwards each has its own. None: all have the same.
        samples: Number M of members to draw.
        rng: Source of all randomness for a function that draws.

    Returns:
        A problem with M nx states and the parameters that are not uncertain. Its
        initial state may be that of one member, shape (nx,), which all members then
        start at. The constraints hold for every member. `Solution.member_costs` gives
        the members' costs. With a robust horizon it has M nu controls, named with "_m"
        appended for member m; a closed loop applies the controls that all members
        share.

    Raises:
        InvalidProblemError: If the values do not fit the problem's parameters; if
            weights, level or robust horizon are out of range; if the problem has soft
            constraints or is an ensemble; or if `risk` is not "mean" and the problem
            has an initial cost, or a cost at the start of intervals that depends on
            more than the controls.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u, k = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("k")
        >>> one = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=k * u, parameters=k), horizon=1,
        ...     intervals=5, terminal_cost=(x - 1) ** 2,
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> ss.ensemble(one, {"k": [0.5, 1.5]}, risk="worst").model.state_names
        ('x_0', 'x_1')
    """
    if problem.risk is not None:
        raise InvalidProblemError("problem must be that of one member, got an ensemble")
    if problem.soft:
        raise InvalidProblemError(
            "ensemble needs a problem without soft constraints, whose cost "
            "belongs to no single member"
        )
    if callable(parameters):
        parameters = _drawn(parameters, samples, rng)
    names, values = _values(problem, parameters)
    members = values.shape[1]
    require_choice("risk", risk, get_args(Measure))
    level = require_number("level", level)
    if not 0 <= level < 1:
        raise InvalidProblemError(f"level must be in [0, 1), got {level}")
    if robust_horizon is not None:
        _require_branches(problem, robust_horizon)
    apart = robust_horizon is not None
    copies = [
        _Member(problem, names, values[:, m], m, apart=apart) for m in range(members)
    ]
    costs = {
        role: ca.vertcat(*[one.of(getattr(problem, f"{role}_cost")) for one in copies])
        for role in ("stage", "step", "initial", "terminal")
    }
    told = Risk(
        **costs,
        weights=_weights(weights, members),
        measure=risk,
        level=level,
        robust_horizon=robust_horizon,
    )
    if risk != "mean" and members > 1:  # Only then are costs accrued in states.
        _require_accruable(problem)
    return _of(problem, copies, told)


class _Member:
    """A member: its states, and expressions with its parameter values.

    Its controls and previous controls are those of the problem, or its own.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        names: list[str],
        values: Array,
        m: int,
        *,
        apart: bool,
    ) -> None:
        model, self.number = problem.model, m
        own = symbol_names(model.parameters)
        self.states = ca.vertcat(
            *[ca.SX.sym(f"{name}_{m}") for name in model.state_names]
        )
        uncertain = [model.parameters[own.index(name)] for name in names]
        self.controls, self.previous = model.controls, problem.previous
        if apart:
            self.controls, self.previous = (
                ca.vertcat(ca.SX(0, 1), *[ca.SX.sym(f"{name}_{m}") for name in symbols])
                for symbols in (model.control_names, symbol_names(problem.previous))
            )
        self._old = ca.vertcat(
            model.states, *uncertain, model.controls, problem.previous
        )
        self._new = ca.vertcat(self.states, ca.DM(values), self.controls, self.previous)
        self.parameters = self.of(model.parameters)
        known = [self.states, self.controls, self.parameters, model.varying]
        self.ode = rate_of(model)(*known)
        self.next_state = jump_of(model)(*known) if model.jumps else ca.SX(0, 1)

    def of(self, expression: ca.SX) -> ca.SX:
        """Return an expression of the problem in the symbols of this member."""
        return ca.substitute(expression, self._old, self._new)

    def named(self, name: str) -> str:
        """Return a name of the problem with this member's number appended."""
        return f"{name}_{self.number}"

    def constraint(self, constraint: Constraint) -> Constraint:
        """Return a constraint of the problem in the symbols of this member."""
        changed: dict[str, Any] = {
            one.name: self.of(value)
            for one in fields(constraint)  # type: ignore[arg-type]
            # `replace` refuses a field without init.
            if one.init and isinstance(value := getattr(constraint, one.name), ca.SX)
        }
        if constraint.name:
            changed["name"] = self.named(constraint.name)
        return replace(constraint, **changed)  # type: ignore[type-var]


def _of(
    problem: OptimalControlProblem, copies: list[_Member], risk: Risk
) -> OptimalControlProblem:
    """Return the problem of all members together."""
    # Number of control sequences: one for all members, or one for each.
    branches = 1 if risk.robust_horizon is None else len(copies)
    costs = _stacked_costs(risk)
    own_names = {
        name: [one.named(name) for one in copies] if branches > 1 else [name]
        for name in problem.model.control_names
    }
    return replace(
        problem,
        model=_stacked_model(problem, copies, branches),
        # All signals belong to the stacked model, whose signals a problem adds.
        signals=ca.SX(0, 1),
        previous=ca.vertcat(ca.SX(0, 1), *[one.previous for one in copies[:branches]]),
        risk=risk,
        stage_cost=costs.stage,
        step_cost=costs.step,
        initial_cost=costs.initial,
        terminal_cost=costs.terminal,
        constraints=[
            one.constraint(c)
            for one in copies
            for c in problem.stated
            if c.name != UNSOLVED  # The stacked model adds it for all members.
        ],
        terminal=[
            replace(
                c,
                expression=one.of(c.expression),
                name=one.named(c.name) if c.name else "",
            )
            for one in copies
            for c in problem.terminal_constraints
        ],
        bounds=_stacked_bounds(problem, len(copies), branches),
        start={
            tuple(one.named(name) for one in copies for name in _together(key)): value
            for key, value in problem.start.items()
        },
        scales=_scales(problem, copies, own_controls=risk.robust_horizon is not None),
        # The time is the same for all members.
        clock=copies[0].named(problem.clock) if problem.clock else "",
        periodic=[one.named(name) for one in copies for name in problem.periodic],
        features=[one.of_members(own_names) for one in problem.features],
    )


def _stacked_model(
    problem: OptimalControlProblem, copies: list[_Member], branches: int
) -> Model:
    """Return the members' models side by side, with common controls or own ones."""
    model = problem.model
    # A parameter that the members' values have replaced is no symbol any more.
    left = [
        model.parameters[i]
        for i in range(model.np)
        if ca.is_equal(copies[0].parameters[i], model.parameters[i])
    ]
    names = model.control_names
    if branches > 1:
        names = tuple(one.named(name) for one in copies for name in names)
    return Model(
        states=ca.vertcat(*[one.states for one in copies]),
        controls=ca.vertcat(ca.SX(0, 1), *[one.controls for one in copies[:branches]]),
        ode=ca.vertcat(*[one.ode for one in copies]),
        next_state=ca.vertcat(ca.SX(0, 1), *[one.next_state for one in copies]),
        parameters=ca.vertcat(ca.SX(0, 1), *left),
        signals=problem.signals,
        time=model.time,
        control_names=names,
        outputs={
            one.named(name): one.of(output)
            for one in copies
            for name, output in model.outputs.items()
        },
        units=_units(model, copies, branches),
        elimination=joined(
            [model.elimination.rewritten(one.of, one.number) for one in copies]
        ),
    )


def _units(model: Model, copies: list[_Member], branches: int) -> dict[str, str]:
    """Return the units of the members' states, controls and outputs."""
    shown = shown_units(model)
    common = set(model.control_names) if branches == 1 else set()
    return {name: shown[name] for name in common if name in shown} | {
        one.named(name): unit
        for one in copies
        for name, unit in shown.items()
        if name not in common
    }


def _stacked_costs(risk: Risk) -> Costs:
    """Return the costs; zero if the members' costs are accrued as states."""
    members = Costs(risk.stage, risk.step, risk.initial, risk.terminal)
    if risk.measure == "mean" or risk.members == 1:
        return Costs(*map(risk.of, members))
    return Costs(*[ca.SX(0)] * len(members))


def _stacked_bounds(
    problem: OptimalControlProblem, members: int, branches: int
) -> Bounds:
    """Return the bounds of all members' states, and of the controls there are."""
    lower, upper = (np.tile(side, members) for side in problem.state_limits)
    least, most = (np.tile(side, branches) for side in problem.control_limits)
    search, scale = problem.bounds.search, problem.bounds.state_scale
    if search is not None:
        first, last = (np.tile(side, branches) for side in problem.search_limits)
        search = (first, last)
    return replace(
        problem.bounds,
        states=(lower, upper),
        controls=(least, most),
        search=search,
        state_scale=None if scale is None else np.tile(np.asarray(scale), members),
    )


def _scales(
    problem: OptimalControlProblem, copies: list[_Member], *, own_controls: bool
) -> dict[str, float]:
    """Return the given sizes for every member."""
    model, found = problem.model, {}
    for name, size in problem.scales.items():
        if name in model.state_names:
            found.update({one.named(name): size for one in copies})
        if name in model.control_names:
            several = [one.named(name) for one in copies] if own_controls else [name]
            found.update(dict.fromkeys(several, size))
    return found


def _together(key: str | tuple[str, ...]) -> tuple[str, ...]:
    return (key,) if isinstance(key, str) else tuple(key)


def _require_branches(problem: OptimalControlProblem, robust_horizon: int) -> None:
    """Raise if the robust horizon is not a valid number of the problem's intervals."""
    is_count = isinstance(robust_horizon, int | np.integer)
    if (
        not is_count
        or isinstance(robust_horizon, bool)
        or not (0 <= robust_horizon <= problem.intervals)
    ):
        raise InvalidProblemError(
            "robust_horizon must be a number of intervals, from 0 to "
            f"{problem.intervals}, got {robust_horizon!r}"
        )
    if problem.integer:
        raise InvalidProblemError(
            "robust_horizon needs controls that need not be whole numbers, got "
            f"{', '.join(problem.model.control_names[j] for j in problem.integer)}"
        )


def _drawn(
    sampler: Sampler, samples: int | None, rng: np.random.Generator | None
) -> list[Mapping[str, float]]:
    if not isinstance(samples, int) or samples < 1 or rng is None:
        raise InvalidProblemError(
            "members that are drawn need samples, at least 1, and rng, got "
            f"samples={samples!r} and rng={rng!r}"
        )
    return [sampler(rng) for _ in range(samples)]


def _values(problem: OptimalControlProblem, given: Values) -> tuple[list[str], Array]:
    """Return the names of the uncertain parameters, and their values, (names, M)."""
    own = symbol_names(problem.model.parameters)
    free = [name for name in own if name not in problem.decided]
    names, rows = _named_rows(own, given)
    if not names or len(rows) != len(names) or any(name not in free for name in names):
        raise InvalidProblemError(
            f"parameters must be values of some of {', '.join(free) or 'nothing'}, "
            f"got {len(rows)} row(s) for {', '.join(map(str, names)) or 'nothing'}"
        )
    if not reals().accepts(rows):
        raise InvalidProblemError(
            "parameters must have as many values, numbers, of each, got "
            f"{shortened(given)}"
        )
    values = np.array(rows, dtype=np.float64)
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():  # noqa: PLR2004
        raise InvalidProblemError(
            f"parameters must have finite values for each member, got {values}"
        )
    return names, values


def _named_rows(own: Sequence[str], given: Values) -> tuple[list[str], list[Any]]:
    """Return names and their rows of values, in any of the forms they may be given in.

    Raises:
        InvalidProblemError: If members have values of different parameters.
    """
    if isinstance(given, Mapping):
        return list(given), list(given.values())
    if not (isinstance(given, Sequence) and all(isinstance(m, Mapping) for m in given)):
        # Values of a single parameter may be given as one row.
        if not reals().accepts(given):
            raise refused("parameters", given, "values by name, or an array of them")
        return list(own), list(np.atleast_2d(np.asarray(given)))
    members: list[Mapping[str, float]] = [dict(m) for m in given]
    names = list(members[0]) if members else []
    if any(set(member) != set(names) for member in members):
        raise InvalidProblemError(
            "every member must have a value of the same parameters, got "
            f"{shortened(given)}"
        )
    return names, [[member[name] for member in members] for name in names]


def _weights(given: ArrayLike | None, members: int) -> Array:
    """Return the weights, scaled to sum one."""
    weights = np.ones(members) if given is None else np.array(given, np.float64)
    good = weights.shape == (members,) and np.isfinite(weights).all()
    if not (good and (weights > 0).all()):
        raise InvalidProblemError(
            f"weights must be {members} positive numbers, one for each member, "
            f"got {brief(given)}"
        )
    scaled: Array = weights / weights.sum()
    scaled.flags.writeable = False
    return scaled


def _require_accruable(problem: OptimalControlProblem) -> None:
    """Raise if a cost cannot be accrued in a state of its member."""
    model = problem.model
    told = "risk must be 'mean' for a problem with"
    if not problem.initial_cost.is_zero():
        raise InvalidProblemError(f"{told} an initial cost")
    step = [problem.step_cost]
    if problem.quadrature == "left":
        step.append(problem.stage_cost)
    moving = ca.vertcat(
        # These have changed at the interval's end, where the cost is accrued.
        problem.signals,
        model.time,
        ca.SX(0, 1) if model.is_discrete else model.states,
    )
    if moving.numel() and any(ca.depends_on(cost, moving) for cost in step):
        raise InvalidProblemError(
            f"{told} a cost at the beginning of each interval (step_cost, or "
            "quadrature='left') that depends on "
            f"{'signals or time' if model.is_discrete else 'more than the controls'}: "
            "write it as a stage cost with quadrature='integral' or 'right'"
        )
