"""Agents that plan in priority order; each sees the plans of those before it.

All plan at the same instant, one after the other. An agent receives the new plans of
the agents that it watches as time-varying signals, after the rows of its own reference
(5.2.3.2: the agent with the higher index plans first, the lower one avoids it).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arguments import (
    INDICES,
    checked,
    function,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.answer.plan import Plan
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.loop.controller import OF_DECISION, Decision, RecedingHorizon
from swarmstart.ocp.statement.problem import require_held

MakePlan = Callable[[int, Array, tuple[Array, ...]], Plan]
"""(agent's number, its state, signal rows that it sees) -> its plan."""


@checked(
    refused,
    controller=of_kind(RecedingHorizon, "a RecedingHorizon"),
    watches=INDICES,
    shows=INDICES,
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Agent:
    """Member of a team.

    Attributes:
        controller: Controller with its planner and reference.
        watches: Numbers of the agents whose plans it sees; each of them plans before
            it.
        shows: Rows of its own states that others see, such as its position.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u, other = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("other")
        >>> model = ss.Model(states=x, controls=u, ode=u)
        >>> problem = ss.OptimalControlProblem(
        ...     model, horizon=1.0, intervals=2, terminal_cost=(x - other - 1) ** 2,
        ...     bounds=ss.Bounds(controls=(-5, 5)), signals=other,
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> controller = ss.RecedingHorizon(planner=planner)
        >>> follower = ss.Agent(controller=controller, watches=(1,), shows=(0,))
        >>> follower.watches
        (1,)
    """

    controller: RecedingHorizon
    watches: tuple[int, ...] = ()
    shows: tuple[int, ...] = ()


@checked(
    refused,
    agents=several(of_kind(Agent, "an Agent"), "a sequence of Agents"),
    order=optional(INDICES),
)
class Team(Called):
    """Controller of agents whose states and controls are stacked.

    Attributes:
        agents: The agents, in the order of their states and controls.
        order: Their numbers in the order in which they plan.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u, other = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("other")
        >>> def agent(cost, signals, watches):
        ...     problem = ss.OptimalControlProblem(
        ...         ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        ...         terminal_cost=cost, signals=signals,
        ...         bounds=ss.Bounds(controls=(-5, 5)),
        ...     )
        ...     planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        ...     controller = ss.RecedingHorizon(planner=planner)
        ...     return ss.Agent(controller=controller, watches=watches, shows=(0,))
        >>> leader = agent((x - 2) ** 2, ca.SX(0, 1), ())
        >>> follower = agent((x - other + 1) ** 2, other, (0,))
        >>> team = ss.Team([leader, follower], order=(0, 1))
        >>> decision = team.decide(0.0, np.zeros(2), None, rng=np.random.default_rng(0))
        >>> [round(float(plan.states[0, -1]), 3) for plan in decision.plans]
        [2.0, 1.0]
    """

    def __init__(
        self, agents: Sequence[Agent], *, order: Sequence[int] | None = None
    ) -> None:
        """Set up a team.

        Args:
            agents: At least one agent.
            order: A permutation of 0..len(agents) - 1; None means that they plan in
                this order.

        Raises:
            InvalidProblemError: If the order is not a permutation, an agent watches one
                that plans later or whose plans have other nodes, or control intervals
                differ, or plans of an agent become shorter.
        """
        self.agents = tuple(agents)
        self.order = tuple(range(len(self.agents)) if order is None else order)
        if sorted(self.order) != list(range(len(self.agents))) or not self.agents:
            raise InvalidProblemError(
                f"order must name each of the {len(self.agents)} agents once, "
                f"got {self.order}"
            )
        for place, number in enumerate(self.order):
            late = set(self.agents[number].watches) - set(self.order[:place])
            if late:
                raise InvalidProblemError(
                    f"agent {number} watches {sorted(late)}, who plan after it"
                )
        _require_one_length(self.agents)
        require_held(a.controller.planner.stated for a in self.agents)
        problems = [a.controller.planner.problem for a in self.agents]
        lengths = [problem.dt for problem in problems]
        if not np.allclose(lengths, lengths[0], rtol=1e-9, atol=0.0):  # Rounding only.
            raise InvalidProblemError(
                f"agents must share one control interval, got {sorted(lengths)} s"
            )
        for number, agent in enumerate(self.agents):
            for other in agent.watches:
                if problems[other].nodes != problems[number].nodes:
                    raise InvalidProblemError(
                        f"agent {number} watches {other}, whose plans have "
                        f"{problems[other].nodes} nodes; its own have "
                        f"{problems[number].nodes}"
                    )
        models = [a.controller.planner.stated.model for a in self.agents]
        *self._splits, self._nx = np.cumsum([m.nx for m in models])

    def __repr__(self) -> str:
        """Return the number of agents and the order in which they plan."""
        order = ", ".join(str(number) for number in self.order)
        return (
            f"Team of {len(self.agents)} agents that plan every {self.dt:g} s, "
            f"in the order {order}"
        )

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.agents[0].controller.dt

    @checked(refused, state=reals(axes=1))
    def split(self, state: Array) -> list[Array]:
        """Return the state of each agent, as views of the stacked state (nx,)."""
        if np.size(state) != self._nx:
            raise refused("state", state, f"an array of shape ({self._nx},)")
        return np.split(state, self._splits)

    @checked(refused, state=reals(axes=1), **OF_DECISION)
    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Let every agent plan in order; see Controller."""

        def replan(number: int, own: Array, seen: tuple[Array, ...]) -> Plan:
            last = previous.plans[number] if previous else None
            controller = self.agents[number].controller
            return controller.plan(time, own, last, seen=seen, rng=rng)

        plans = self.plans(state, replan)
        return Decision(control=first_controls(plans), plans=plans)

    @checked(refused, state=reals(axes=1), make=function())
    def plans(self, state: Array, make: MakePlan) -> tuple[Plan, ...]:
        """Return the agents' plans, made in planning order, returned in agents' order.

        Args:
            state: Stacked state, shape (nx,).
            make: Function that makes the plan of one agent; called once for each.
        """
        states = self.split(state)
        made: dict[int, Plan] = {}
        for number in self.order:
            seen = tuple(
                made[j].states[list(self.agents[j].shows)]  # Made in this step already.
                for j in self.agents[number].watches
            )
            made[number] = make(number, states[number], seen)
        return tuple(made[number] for number in range(len(self.agents)))


def first_controls(plans: Sequence[Plan]) -> Array:
    """Return the first control of each plan, stacked, shape (nu,)."""
    return np.concatenate([plan.controls[:, 0] for plan in plans])


def _require_one_length(agents: Sequence[Agent]) -> None:
    """Raise if plans of an agent become shorter, which those of others do not."""
    if any(agent.controller.until is not None for agent in agents):
        raise InvalidProblemError(
            "plans of a team have one length: expected controllers without until"
        )
