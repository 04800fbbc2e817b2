"""Dual mode: plan outside the terminal sets, apply a linear law inside them.

    u_i = u_ref,i - K_i (x_i - x_ref,i(t))   when every agent is inside its set,

clipped to the bounds of the controls. (The chapter writes u = K x; K here has the sign
that python-control returns.) The whole team switches at once: under the linear law an
agent no longer avoids the others, so no agent uses it alone. The terminal set of a
problem, in which such a law may replace planning, is found by `terminal_set_of`.

Source: the chapter, 5.2.3.1 and steps 3 and 10; Michalska and Mayne (1993), Robust
receding horizon control of constrained nonlinear systems.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    RNG,
    a_count,
    a_number,
    checked,
    function,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.answer.plan import Plan, Source
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.integration.integrators import held_step
from swarmstart.ocp.loop.controller import OF_DECISION, Decision, Mode, RecedingHorizon
from swarmstart.ocp.loop.team import Agent, Team, first_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.model import right_hand_side
from swarmstart.terminal_set import (
    ProofOptions,
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
    input_excess,
)

if TYPE_CHECKING:
    import control


Target = Callable[[float], Array]
"""Absolute time [s] -> the reference state of an agent, shape (nx,)."""
ROUNDED = 1e-6
"""Part of the first rates up to which an input is rounded by a last step."""
SLACK = 1e-9
"""Part of a bound by which a law may exceed it; its controls are clipped."""


class UncertifiedSetError(InvalidProblemError):
    """A terminal set is not certified for the inputs of the loop.

    The certificate is missing, not proven in every part, or for inputs that are held
    for another time; or the law exceeds the bounds of the controls.
    """


@checked(
    refused,
    sets=several(of_kind(TerminalSet, "a TerminalSet"), "a sequence of terminal sets"),
    targets=several(function(), "a sequence of functions"),
    uncertified=FLAG,
)
class DualMode(Called):
    """A team that switches to linear laws when all agents are in their terminal sets.

    Attributes:
        team: Controller that plans while any agent is outside its set.
        sets: The terminal set of each agent.
        targets: The moving reference of each agent.
        uncertified: Whether sets that are not proven in every part were accepted.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        ...     intervals=4, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> near = ss.terminal_set_of(
        ...     problem, at=[0, 0], weights=ss.Weights(Q=np.eye(2), R=np.eye(1)),
        ...     rng=np.random.default_rng(0),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> loop = ss.RecedingHorizon(planner=planner)
        >>> dual = ss.DualMode(loop, sets=[near], targets=[lambda time: np.zeros(2)])
        >>> dual.inside(0.0, np.array([0.1, 0])), dual.inside(0.0, np.array([9.0, 0]))
        (True, False)
    """

    def __init__(
        self,
        team: Team | RecedingHorizon,
        *,
        sets: Sequence[TerminalSet],
        targets: Sequence[Target],
        uncertified: bool = False,
    ) -> None:
        """Combine a team of planners with linear laws.

        Args:
            team: The team; a controller alone is a team of one agent.
            sets: One terminal set for each agent, certified for inputs held over
                `team.dt`.
            targets: One target for each agent.
            uncertified: Whether to accept sets without such a certificate, or with
                parts that are not proven.

        Raises:
            InvalidProblemError: If there is not one set and one target for each agent,
                or the team is neither a team nor a controller.
            UncertifiedSetError: If a set is not certified for this dt, if a part of its
                certificate is only measured, or if its inputs exceed the bounds of the
                agent's controls.
        """
        if isinstance(team, RecedingHorizon):
            team = Team([Agent(controller=team)])
        if not isinstance(team, Team):
            raise InvalidProblemError(
                "dual mode needs a Team or a RecedingHorizon, got "
                f"{type(team).__name__}"
            )
        if not len(team.agents) == len(sets) == len(targets):
            raise InvalidProblemError(
                f"dual mode needs a terminal set and a target for each of the "
                f"{len(team.agents)} agents, got {len(sets)} and {len(targets)}"
            )
        if not uncertified:
            problems = [agent.controller.planner.problem for agent in team.agents]
            require_certified(sets, team.dt, problems)
        self.team, self.sets, self.targets = team, tuple(sets), tuple(targets)
        self.uncertified = uncertified
        self._problems = [a.controller.planner.problem for a in team.agents]
        # Agents of one kind share the model of one problem; each keeps its own step.
        self._steps = [_step(a.controller.planner.stated) for a in team.agents]

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.team.dt

    @checked(refused, time=a_number(), state=reals(axes=1))
    def errors(self, time: float, state: Array) -> list[Array]:
        """Return x_i - x_ref,i of each agent, each (nx_i,).

        Args:
            time: Time since the start [s].
            state: Stacked state of all agents, shape (nx,).
        """
        own = self.team.split(state)
        return [x - target(time) for x, target in zip(own, self.targets, strict=True)]

    @checked(refused, time=a_number(), state=reals(axes=1))
    def inside(self, time: float, state: Array) -> bool:
        """Return whether every agent is inside its terminal set.

        Args:
            time: Time since the start [s].
            state: Stacked state of all agents, shape (nx,).
        """
        errors = self.errors(time, state)
        return all(bool(s.contains(e)) for s, e in zip(self.sets, errors, strict=True))

    @checked(refused, agent=a_count())
    def linear_law(self, agent: int = 0) -> control.StateSpace:
        """Return the linear law of an agent as a system of python-control.

        Args:
            agent: Number of the agent.

        Returns:
            du = -K e, with e = x - x_ref and du = u - u_ref, and the names of the
            agent's states and controls; see `TerminalSet.linear_law`.
        """
        model = self.team.agents[agent].controller.planner.stated.model
        return self.sets[agent].linear_law(
            states=model.state_names, controls=model.control_names
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
        """Return the linear laws' controls inside all sets, else the team's decision.

        The arguments are those of a Controller.
        """
        if not self.inside(time, state):
            return self.team.decide(time, state, previous, rng=rng)

        def linear(number: int, own: Array, seen: tuple[Array, ...]) -> Plan:
            controller = self.team.agents[number].controller
            start, known, _ = controller.planner.posed(
                own, controller.known(time, seen)
            )
            return controller.planner.evaluated(
                self._linear_controls(number, time, own),
                start,
                known=known,
                source=Source.LINEAR,
            )

        plans = self.team.plans(state, linear)
        return Decision(control=first_controls(plans), plans=plans, mode=Mode.LINEAR)

    def _linear_controls(self, number: int, time: float, state: Array) -> Array:
        """Return the linear law's controls over the horizon, shape (nu, N)."""
        problem, step = self._problems[number], self._steps[number]
        terminal_set, target = self.sets[number], self.targets[number]
        known = self.team.agents[number].controller.known(time)
        lower, upper = problem.control_limits
        x, controls = state, []
        for k in range(problem.intervals):
            error = x - target(time + k * problem.dt)
            # A proven law keeps the bounds up to SLACK; a set that is not proven may
            # exceed them.
            u = np.clip(terminal_set.u_ref + terminal_set.feedback(error), lower, upper)
            controls.append(u)
            x = np.array(step(x, u, np.asarray(known.parameters))).ravel()
        return np.array(controls).T


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    at=reals(),
    weights=of_kind(Weights, "Weights"),
    velocity=optional(reals()),
    parameters=reals(),
    options=optional(of_kind(ProofOptions, "ProofOptions")),
    rng=RNG,
)
def terminal_set_of(  # noqa: PLR0913 - what a design rests on, by name
    problem: OptimalControlProblem,
    *,
    at: ArrayLike,
    weights: Weights,
    velocity: ArrayLike | None = None,
    parameters: ArrayLike = (),
    options: ProofOptions | None = None,
    rng: np.random.Generator,
) -> TerminalSet:
    """Design a linear law for a problem at a reference, and certify its terminal set.

    Dynamics, bounds of controls and states, and dt are those of the problem. Inputs are
    held over its control intervals. An interval is integrated in as many steps as the
    problem takes, unless `options` says otherwise. The input at the reference is the
    one within the bounds that keeps all states at rest, or gives them the stated
    velocity; if several inputs do so, one near the middle of the bounds is taken. Costs
    and other constraints are ignored: the user must check any constraint that cuts the
    set.

    Args:
        problem: Problem with the dynamics, the bounds and dt.
        at: Reference state, shape (nx,), SI units.
        weights: Weights Q and R per step, and kappa, as `Weights` explains.
        velocity: Velocity of a reference that moves, shape (nx,), per second. Only
            states that have no bounds, and on which the dynamics do not depend, may
            move. None: the reference rests.
        parameters: Values of the model's parameters, shape (np,).
        options: Options of the proof; None: `ProofOptions()` with the problem's number
            of steps. Any decrease of e'Pe is then enough.
        rng: Source of the samples and of the rays that look for counterexamples.

    Returns:
        K, P, the largest level that was proven, and the certificate.

    Raises:
        InvalidProblemError: If a shape is not the problem's.
        NotAnEquilibriumError: If no input keeps the reference at rest, or gives it its
            velocity.
        MovingReferenceError: If the reference cannot move with its velocity.
        SwarmstartError: As in `certified_terminal_set`.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        ...     intervals=4, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> weights = ss.Weights(Q=np.eye(2), R=np.eye(1))
        >>> found = ss.terminal_set_of(
        ...     problem, at=[0, 0], weights=weights, rng=np.random.default_rng(0)
        ... )
        >>> found.K.shape, found.alpha > 0
        ((1, 2), True)
    """
    model = problem.model
    x_ref = _vector("at", at, model.nx)
    moving = None if velocity is None else _vector("velocity", velocity, model.nx)
    p = _vector("parameters", parameters, model.np)
    rate = right_hand_side(model)
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    dynamics = ca.Function("dynamics", [x, u], [rate(x, u, p)], ["x", "u"], ["xdot"])
    lower, upper = problem.control_limits
    x_lower, x_upper = problem.state_limits
    reference = Reference(
        x_ref=x_ref,
        u_ref=_resting_input(dynamics, x_ref, moving, (lower, upper)),
        u_lower=lower,
        u_upper=upper,
        x_lower=x_lower,
        x_upper=x_upper,
        velocity=moving,
    )
    steps = problem.checks * problem.substeps
    return certified_terminal_set(
        dynamics,
        reference,
        weights,
        dt=problem.dt,
        options=ProofOptions(substeps=steps) if options is None else options,
        rng=rng,
    )


def require_certified(
    sets: Sequence[TerminalSet], dt: float, problems: Sequence[OptimalControlProblem]
) -> None:
    """Raise if a set is not certified for this dt and these bounds of the controls.

    The caller must make sure that the certificate's model is the agent's own.
    """
    for number, (one, problem) in enumerate(zip(sets, problems, strict=True)):
        _require_hold(number, one, dt)
        unproven = [] if one.certificate is None else one.certificate.unproven()
        if unproven:
            raise UncertifiedSetError(
                f"the terminal set of agent {number} must be proven in every part; "
                f"not proven: {'; '.join(unproven)}. Certify it again "
                "(swarmstart.terminal_set.certify, with growth=True), or pass "
                "uncertified=True"
            )
        lower, upper = problem.control_limits
        at, ones = one.u_ref, np.ones(len(one.u_ref))
        reach = input_excess(one.K, one.P, one.alpha, ones)
        if np.any(at - reach < lower - SLACK) or np.any(at + reach > upper + SLACK):
            raise UncertifiedSetError(
                f"the terminal set of agent {number} must keep its controls between "
                f"{lower.tolist()} and {upper.tolist()}; its law reaches from "
                f"{(at - reach).tolist()} to {(at + reach).tolist()}"
            )


def _require_hold(number: int, one: TerminalSet, dt: float) -> None:
    """Raise if the certificate of a set is missing or for another hold time."""
    held = None if one.certificate is None else one.certificate.dt
    if held is not None and np.isclose(held, dt, rtol=1e-12, atol=0):  # Rounding only.
        return
    found = "no certificate"
    if one.certificate is not None:
        found = "a certificate for "
        found += f"{held:g} s" if held else "a continuously varying input"
    raise UncertifiedSetError(
        f"the terminal set of agent {number} must be certified for inputs held for "
        f"{dt:g} s, it has {found}: certify it (swarmstart.terminal_set.certify), or "
        "pass uncertified=True"
    )


def _step(problem: OptimalControlProblem) -> ca.Function:
    return held_step(
        problem.model,
        problem.dt,
        method=problem.integrator,
        substeps=problem.substeps * problem.checks,
    )


def _vector(name: str, values: ArrayLike, size: int) -> Array:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise InvalidProblemError(
            f"{name} must be {size} finite numbers, got {np.asarray(values).tolist()}"
        )
    return vector


def _resting_input(
    dynamics: ca.Function,
    x_ref: Array,
    velocity: Array | None,
    limits: tuple[Array, Array],
) -> Array:
    """Return the input that gives the states their velocity, or nearly so."""
    from scipy.optimize import least_squares  # Slow to import; only a design needs it.

    lower, upper = limits
    with np.errstate(invalid="ignore"):  # Of a control without bounds.
        middle = (lower + upper) / 2
    middle = np.where(np.isfinite(middle), middle, 0.0)
    # least_squares needs a start within the bounds.
    start = np.clip(middle, lower, upper)
    slopes = dynamics.factory("slopes", ["x", "u"], ["jac:xdot:u"])

    def rates(u: Array) -> Array:
        xdot = np.array(dynamics(x_ref, u)).ravel()
        return xdot if velocity is None else np.asarray(xdot - velocity)

    found = least_squares(
        rates,
        start,
        jac=lambda u: np.array(slopes(x_ref, u)),
        bounds=(lower, upper),
        xtol=1e-15,  # As exact as rounding allows.
        ftol=1e-15,
        gtol=1e-15,
    )
    u = np.asarray(found.x, dtype=np.float64)
    # The method stays a little inside the bounds. One step of Gauss and Newton ends on
    # a bound if the input lies there, and rounds off what is left elsewhere.
    step = np.linalg.lstsq(np.array(slopes(x_ref, u)), rates(u), rcond=None)[0]
    last = np.clip(u - step, lower, upper)
    has_ended = np.abs(rates(last)).max() <= ROUNDED * np.abs(rates(start)).max()
    return last if has_ended else u
