"""Team of similar agents that plan in priority order and see only nearby agents.

An agent receives these time-varying signals of its problem, in this order:

    the plan that it follows (the first planner's), or a reference of its own
    the positions of the agents it is linked to; each of them plans before it
    the positions of all agents within range: the new plans of those that have planned
        before it, and the shifted last plans of those that plan after it

Another agent is within range if its plan comes within the range of the agent's own
shifted last plan at any node, including the present. Before the first step, an agent's
first candidate, if it has any, takes the place of its last plan.

So a plan keeps clear of what the others will do if they find nothing better. Among
agents that saw each other, the shifted last plan keeps the distances, except at its
appended end. (If an agent saw the new plans only, a late planner could be left without
any feasible plan.) This is no guarantee: two agents that did not see each other may
turn towards each other in one step. They cannot meet within that step if the range is
at least the safe distance plus twice the distance that an agent travels in it. The
range needed beyond that depends on how fast they can turn away. (`CommittedTeam`
has a rule that is safe without such a condition.)

The number of agents within range changes from step to step, but a compiled problem has
a fixed number of signals. So there is one planner for each of a few numbers of
neighbours. An agent uses the one for the smallest number that suffices; unused
neighbour slots get a position FAR away. All agents share the planners, so the cost of a
team's step depends on what its agents see, not on the number of agents.

Source: Richards and How (2007), Robust distributed model predictive control,
International Journal of Control 80, for planning in turn against the others' last
plans.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    INDICES,
    a_count,
    a_number,
    checked,
    function,
    mapping,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.answer.plan import Plan, Source
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.loop.controller import (
    OF_DECISION,
    Decision,
    RecedingHorizon,
    ReferenceSignals,
)
from swarmstart.ocp.loop.team import first_controls
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.statement.guesses import shifted_controls
from swarmstart.ocp.statement.problem import require_held

FAR = 1e6
"""Position [m] given to unused neighbour slots."""


@checked(
    refused,
    parameters=reals(),
    links=INDICES,
    reference=optional(function()),
    candidates=optional(reals()),
    held=optional(reals()),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LocalAgent:
    """Member of a local team.

    Attributes:
        parameters: Parameters of its problem, shape (np,).
        links: Numbers of the agents whose positions it always receives.
        reference: Function of time that gives the reference to follow; None: the plan
            of the first agent in the order.
        candidates: Further controls that its search evaluates, shape (nu, N, k); None:
            no candidates. Copied.
        held: Controls that it applies instead of planning, shape (nu, N), the same in
            every step; None: it plans. Copied.

    Raises:
        InvalidProblemError: If a number is not finite.

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> leader = ss.LocalAgent(parameters=[0], reference=lambda t: 15 * t[None, :])
        >>> follower = ss.LocalAgent(parameters=[1.0], links=(0,))
        >>> follower.links, follower.parameters
        ((0,), array([1.]))
    """

    parameters: ArrayLike
    links: tuple[int, ...] = ()
    reference: ReferenceSignals | None = None
    candidates: Array | None = None
    held: Array | None = None

    def __post_init__(self) -> None:
        """Copy the arrays and set them read-only."""
        for name in ("parameters", "candidates", "held"):
            given = getattr(self, name)
            if given is None:
                continue
            array = np.array(given, dtype=np.float64)
            if not np.isfinite(array).all():
                raise InvalidProblemError(f"{name} must be finite, got {array}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)


@checked(
    refused,
    agents=several(of_kind(LocalAgent, "a LocalAgent"), "a sequence of LocalAgents"),
    planners=mapping(
        values=of_kind(Planner, "a Planner"),
        words="a mapping of numbers of agents to planners",
    ),
    order=INDICES,
    range=a_number(above=0, finite=False),
    position=INDICES,
    links=a_count(),
    within=optional(a_number(above=0)),
)
class LocalTeam(Called):
    """Controller of similar agents, each of which sees those within range.

    Attributes:
        agents: The agents, in the order of their states and controls.
        order: Their numbers in the order in which they plan.
        range: Distance within which an agent sees others' plans [m].
        position: Rows of an agent's states that are its position.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u, gap = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("gap")
        >>> followed, seen = ca.SX.sym("followed"), ca.SX.sym("seen")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u, parameters=gap), horizon=1.0,
        ...     intervals=2, terminal_cost=(x - followed + gap) ** 2,
        ...     bounds=ss.Bounds(controls=(-5, 5)), signals=ca.vertcat(followed, seen),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> agents = [
        ...     ss.LocalAgent(parameters=[0], reference=lambda t: np.ones((1, t.size))),
        ...     ss.LocalAgent(parameters=[0.5]),
        ... ]
        >>> team = ss.LocalTeam(
        ...     agents, planners={1: planner}, order=(0, 1), range=10.0, position=(0,)
        ... )
        >>> decision = team.decide(0.0, np.zeros(2), None, rng=np.random.default_rng(0))
        >>> [round(float(plan.states[0, -1]), 3) for plan in decision.plans]
        [1.0, 0.5]
    """

    def __init__(  # noqa: PLR0913 - a team and the time of a plan
        self,
        agents: Sequence[LocalAgent],
        *,
        planners: Mapping[int, Planner],
        order: Sequence[int],
        range: float,
        position: tuple[int, ...],
        links: int = 0,
        within: float | None = None,
    ) -> None:
        """Set up a team.

        Args:
            agents: At least one agent.
            planners: Number of neighbours -> the planner with signals for this number.
            order: A permutation of 0..len(agents) - 1.
            range: Distance within which an agent sees others' plans [m].
            position: Rows of an agent's states that are its position.
            links: Number of links that the problems have signals for. An agent with
                fewer links gets the position FAR for the missing ones.
            within: Limit of the wall time for the plan of one agent [s], as in
                `RecedingHorizon`; None: no limit.

        Raises:
            InvalidProblemError: If the order is not a permutation, a linked agent plans
                later, there are too many links, no planner has room for all others, or
                the planners' problems do not fit each other.
        """
        self.agents, self.order = tuple(agents), tuple(order)
        self.range, self.position, self._links = range, position, links
        self._rooms = sorted(planners)
        self._check_order()
        self._check_planners(planners)
        self._controllers = [
            {
                room: _controller(agent, planner, within)
                for room, planner in planners.items()
            }
            for agent in self.agents
        ]
        self._nx = planners[self._rooms[0]].stated.model.nx

    def _check_order(self) -> None:
        count = len(self.agents)
        if sorted(self.order) != list(range(count)) or not count:
            raise InvalidProblemError(
                f"order must name each of the {count} agents once, got {self.order}"
            )
        for place, number in enumerate(self.order):
            agent = self.agents[number]
            late = set(agent.links) - set(self.order[:place])
            if late:
                raise InvalidProblemError(
                    f"agent {number} is linked to {sorted(late)}, who plan after it"
                )
            if len(agent.links) > self._links:
                raise InvalidProblemError(
                    f"agent {number} must have at most {self._links} links, "
                    f"got {agent.links}"
                )
        if self.agents[self.order[0]].reference is None:
            raise InvalidProblemError(
                f"agent {self.order[0]}, the first planner, needs a reference"
            )

    def _check_planners(self, planners: Mapping[int, Planner]) -> None:
        grids = {
            (p.problem.intervals, p.problem.checks, p.problem.dt, p.problem.model.np)
            for p in planners.values()
        }
        if len(grids) > 1:
            raise InvalidProblemError(
                "planners must share intervals, checks, dt and the number of "
                f"parameters, got {sorted(grids)}"
            )
        most = len(self.agents) - 1
        if not planners or self._rooms[-1] < most:
            raise InvalidProblemError(
                f"one planner needs room for all {most} others, got {self._rooms}"
            )
        require_held(planner.stated for planner in planners.values())
        for room, planner in planners.items():
            problem = planner.stated
            rows = problem.model.nx + len(self.position) * (self._links + room)
            if problem.ns != rows:
                raise InvalidProblemError(
                    f"the planner for {room} others must have {rows} signals, "
                    f"got {problem.ns}"
                )

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self._controllers[0][self._rooms[0]].dt

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
        shape = len(self.agents), self._nx
        if np.size(state) != shape[0] * shape[1]:
            raise refused("state", state, f"an array of {shape[0] * shape[1]} numbers")
        states = np.reshape(state, shape)
        shown = self._last_plans(states, previous)
        plans: dict[int, Plan] = {}
        for number in self.order:
            held = self.agents[number].held
            others = []
            if held is None:
                others = self.within_range(shown, states, number)
            # The smallest one, since the numbers are sorted.
            room = next(room for room in self._rooms if room >= len(others))
            controller = self._controllers[number][room]
            seen = self._seen(number, time, shown, others, room)
            if held is None:
                last = previous.plans[number] if previous else None
                plan = controller.plan(time, states[number], last, seen=seen, rng=rng)
            else:
                start, known, _ = controller.planner.posed(
                    states[number], controller.known(time, seen)
                )
                plan = controller.planner.evaluated(
                    held, start, known=known, source=Source.GUESS
                )
            # Those that plan later see the new plan.
            plans[number], shown[number] = plan, plan.states
        made = tuple(plans[number] for number in range(len(self.agents)))
        return Decision(control=first_controls(made), plans=made)

    def _last_plans(self, states: Array, previous: Decision | None) -> dict[int, Array]:
        """Return the path of each agent's shifted last plan, each (nx, nodes).

        Before the first step these are the first candidates of the agents that have
        any.
        """
        planner = self._controllers[0][self._rooms[0]].planner
        problem = planner.problem
        unseen = np.zeros((problem.ns, problem.nodes))
        expected: dict[int, Array] = {}
        for number, agent in enumerate(self.agents):
            if previous is not None:
                last = previous.plans[number].controls
                # As the controllers append, see `_controller`.
                expected[number] = shifted_controls(problem, last, "last")
            elif agent.held is not None:
                expected[number] = agent.held
            elif agent.candidates is not None:
                expected[number] = agent.candidates[:, :, 0]
        return {
            number: planner.fitness.states(
                controls, states[number], Known(self.agents[number].parameters, unseen)
            )
            for number, controls in expected.items()
        }

    @checked(
        refused,
        shown=mapping(words="a mapping of numbers to states"),
        states=reals(array=True, axes=2),
        number=a_count(),
    )
    def within_range(
        self, shown: Mapping[int, Array], states: Array, number: int
    ) -> list[int]:
        """Return the agents whose plans come within range of a given agent's last plan.

        Args:
            shown: Plans by the number of their agent, each (nx, nodes).
            states: States of all agents now, shape (agents, nx). Without a plan in
                `shown` the given agent is assumed to keep its present position; any
                other agent is then left out.
            number: Number of the given agent.

        Returns:
            The numbers of the agents within range.
        """
        rows = list(self.position)
        # One column for all nodes: without a plan it stays.
        own = shown[number][rows] if number in shown else states[number, rows][:, None]
        others = [j for j in shown if j != number]
        if not others:
            return []
        plans = np.stack([shown[j][rows] for j in others])
        nearest = np.linalg.norm(plans - own, axis=1).min(axis=1)
        return [
            j
            for j, distance in zip(others, nearest, strict=True)
            if distance <= self.range
        ]

    def _seen(
        self,
        number: int,
        time: float,
        shown: Mapping[int, Array],
        others: Sequence[int],
        room: int,
    ) -> tuple[Array, ...]:
        """Return the rows of an agent's signals, each block (k, nodes)."""
        agent, rows = self.agents[number], list(self.position)
        problem = self._controllers[number][room].planner.problem
        if agent.reference is None:
            followed = shown[self.order[0]]
        else:
            followed = agent.reference(time + problem.times)
        return (
            followed,
            *[shown[j][rows] for j in agent.links],
            *self._unused_slots(self._links - len(agent.links), problem.nodes),
            *[shown[j][rows] for j in others],
            *self._unused_slots(room - len(others), problem.nodes),
        )

    def _unused_slots(self, count: int, nodes: int) -> list[Array]:
        return [np.full((len(self.position), nodes), FAR)] * count


def _controller(
    agent: LocalAgent, planner: Planner, within: float | None
) -> RecedingHorizon:
    candidates = agent.candidates
    return RecedingHorizon(
        planner=planner,
        parameters=lambda time: np.asarray(agent.parameters),
        candidates=None if candidates is None else lambda time: candidates,
        append="last",
        carries=False,  # The signal rows change their meaning.
        within=within,
    )
