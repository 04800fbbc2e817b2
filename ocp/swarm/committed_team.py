"""Team of vehicles of any model that never collide, by committed plans.

Each vehicle follows a plan that it has committed to, and that ends in a certified set.
It plans anew from the state that this plan reaches after the lead, some steps later. It
sees the plans that it knows of the others, and proposes a plan that is cheaper than its
committed one; the rule of `rule.py` decides when it commits to the proposal. So delays
and losses of messages cost time only.

The planning problem of a vehicle has these signals, each of k rows of a position:

    its reference, if it has one
    the committed plans that it knows of the others, in the order of their numbers
    the candidates of the others; for one without a known candidate, its committed plan
    one row: the distance to keep from others in addition to the least distance

The rule proves more than the problem demands: it also looks between the nodes. If a
plan comes too near to others by some part of the distance, the vehicle plans again with
that distance in addition.

A plan that ends in the set of its goal is the last one of its vehicle. Constraints
other than the distances hold as the planner checks them, up to a plan's end.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.answer.plan import Plan, Source
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.loop.controller import (
    OF_DECISION,
    Decision,
    Mode,
    RecedingHorizon,
)
from swarmstart.ocp.loop.dual_mode import require_certified
from swarmstart.ocp.loop.local_team import FAR
from swarmstart.ocp.loop.team import Team
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.swarm.agreement import Agreement
from swarmstart.ocp.swarm.certificate import Log, certificate_text
from swarmstart.ocp.swarm.plans import Plans, least_gap, no_plans
from swarmstart.ocp.swarm.rule import Flags, is_clear
from swarmstart.ocp.swarm.simulation import most_hops
from swarmstart.ocp.swarm.swarm import (
    AXES,
    Links,
    pairwise_distances,
    require_silences,
)
from swarmstart.ocp.swarm.team import branch, lead_steps
from swarmstart.ocp.swarm.tube import Body, NoRestError, Path, joined
from swarmstart.terminal_set import TerminalSet

MORE_DECIDED = {
    "copies": "periodic states",
    "decided": "decided parameters",
    "delayed": "delayed controls",
    "end time": "a free end time",
    "knots": "linear controls",
    "previous": "previous controls",
    "risk": "uncertain parameters",
    "sense": "a maximum",
    "time": "a time",
}
"""Role of a rewrite -> what it is for, in words."""
TRIES = 4
"""Number of plans that a vehicle makes at most until one is clear."""
MORE, LEAST = 1.2, 0.005
"""Reserve that is added: a multiple of what was missing, and a part of the distance."""
WORTH = 1e-3
"""Relative saving for which a plan is proposed."""
DOUBT = 10
"""Most ticks until a vehicle plans again that has found nothing to propose."""


@checked(
    refused,
    team=of_kind(Team, "a Team"),
    sets=several(of_kind(TerminalSet, "a TerminalSet"), "a sequence of terminal sets"),
    distance=a_number(above=0),
    links=of_kind(Links, "Links"),
    tracking_error=a_number(least=0),
    lead=optional(a_count(least=1, most=10_000)),
)
class CommittedTeam(Called):
    """Controller of vehicles that plan by optimal control and never collide.

    Attributes:
        team: The vehicles, in the order in which they make their first plans. No
            `Agent` of it has others in `watches`; `shows` has the one to three rows of
            the state that are its position.
        sets: Certified terminal set of each vehicle; the set's reference is the
            vehicle's goal.
        plan_distance: Least distance of two plans [m].
        links: Links between the vehicles; a step of the rule is a control interval.
        lead: Number of steps from the proposal of a plan to its parting from the
            committed one.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, v, u = ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("u", 2)
        >>> committed, candidate, more = (
        ...     ca.SX.sym("p", 2), ca.SX.sym("q", 2), ca.SX.sym("more")
        ... )
        >>> def vehicle(goal):
        ...     problem = ss.OptimalControlProblem(
        ...         ss.Model(
        ...             states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, u)
        ...         ),
        ...         horizon=4.0, intervals=8, stage_cost=ca.sumsqr(x - goal),
        ...         bounds=ss.Bounds(controls=(-1, 1)),
        ...         constraints=[
        ...             ss.PathConstraint(
        ...                 expression=ca.sumsqr(x - other) - (1 + more) ** 2, lower=0
        ...             )
        ...             for other in (committed, candidate)
        ...         ],
        ...         terminal=[(v, 0)], signals=ca.vertcat(committed, candidate, more),
        ...     )
        ...     planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        ...     loop = ss.RecedingHorizon(planner=planner)
        ...     near = ss.terminal_set_of(
        ...         problem, at=[*goal, 0, 0],
        ...         weights=ss.Weights(Q=np.eye(4), R=np.eye(2)),
        ...         rng=np.random.default_rng(0),
        ...     )
        ...     return ss.Agent(controller=loop, shows=(0, 1)), near
        >>> agents, sets = zip(vehicle([4.0, 0.2]), vehicle([0.0, 0.0]))
        >>> team = ss.CommittedTeam(
        ...     ss.Team(agents), sets=sets, distance=1.0, links=ss.Links(loss=0.3)
        ... )
        >>> team.plan_distance, team.lead
        (1.0, 6)
    """

    def __init__(
        self,
        team: Team,
        *,
        sets: Sequence[TerminalSet],
        distance: float,
        links: Links = Links(),  # noqa: B008 - frozen
        tracking_error: float = 0.0,
        lead: int | None = None,
    ) -> None:
        """Check that vehicles, sets and links fit together.

        Args:
            team: The vehicles.
            sets: One terminal set for each vehicle, certified for inputs held over
                `team.dt`, with the weights of its design.
            distance: Least distance of two vehicles [m].
            links: Links between the vehicles.
            tracking_error: Largest distance of a vehicle from its plan [m]; 0 if the
                plant is the model. Two plans keep `distance` plus twice this.
            lead: Number of steps from a proposal to its parting from the committed
                plan; None: a round trip to all others over the links.

        Raises:
            InvalidProblemError: If there is not one set for each vehicle, a vehicle
                watches another or shows no position, its problem has a feature that
                committed plans do not support, its dynamics depend on signals or time,
                its problem has too few signals for the plans of the others, a silent
                vehicle is unknown, or two goals are too near.
            UncertifiedSetError: As in `DualMode`.
        """
        n = len(team.agents)
        if len(sets) != n:
            raise InvalidProblemError(
                f"committed plans need a terminal set for each of the {n} vehicles, "
                f"got {len(sets)}"
            )
        problems = [agent.controller.planner.problem for agent in team.agents]
        _require_fit(team)
        require_certified(sets, team.dt, problems)
        require_silences(links, n)
        self.team, self.sets, self.links = team, tuple(sets), links
        self.tracking_error = float(tracking_error)
        self.plan_distance = distance + 2.0 * tracking_error
        # Messages may have to be passed on by all others.
        hops = 1 if links.radio_range == np.inf else max(1, n - 1)
        self.lead = lead_steps(n, links, hops) if lead is None else lead
        self.bodies = tuple(
            Body(
                agent.controller.planner.problem, agent.shows, one,
                _parameters(agent.controller),
            )
            for agent, one in zip(team.agents, sets, strict=True)
        )  # fmt: skip

        self._require_apart("goals", [one.x_ref for one in sets])

    def _require_apart(self, name: str, states: Sequence[Array]) -> None:
        """Raise if two vehicles are nearer than plans; they are named."""
        pairs = zip(self.bodies, states, strict=True)
        apart = pairwise_distances(np.array([b.position(x) for b, x in pairs]))
        near = np.argwhere(np.triu(apart < self.plan_distance, 1))
        for i, j in near.tolist():
            raise InvalidProblemError(
                f"{name} of vehicles {i} and {j} must be {self.plan_distance:g} m "
                f"apart, they are {apart[i, j]:.4g} m apart"
            )

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.team.dt

    @checked(refused, state=reals(axes=1), **OF_DECISION)
    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> CommittedDecision:
        """Return the controls that follow the committed plans; see Controller.

        Raises:
            InvalidProblemError: If the state is not finite, two vehicles start too
                near, or a first plan is not feasible, ends in no certified set, or is
                not clear of the others; or if the previous decision is not the last one
                of its vehicles.
        """
        if not np.isfinite(state).all():
            raise InvalidProblemError(f"state must be finite, got {np.asarray(state)}")
        if previous is None:
            self._require_apart("starts", self.team.split(state))
            vehicles = CommittedVehicles(self, time, self.team.split(state), rng)
        elif not isinstance(previous, CommittedDecision):
            raise InvalidProblemError(
                f"previous must be a CommittedDecision, got a {type(previous).__name__}"
            )
        elif previous.step != previous.vehicles.steps:
            raise InvalidProblemError(
                "previous must be the last decision, of step "
                f"{previous.vehicles.steps}, got that of step {previous.step}"
            )
        else:
            vehicles = previous.vehicles
        return vehicles.advance(self.team.split(state), rng)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CommittedDecision(Decision):
    """Decision of a CommittedTeam, with the memories of its vehicles.

    Attributes:
        vehicles: The vehicles; the next decision changes them.
        step: Number of steps decided so far, this one included.
    """

    vehicles: CommittedVehicles
    step: int


class CommittedVehicles:
    """Vehicles of a team on their committed plans.

    Attributes:
        steps: Number of steps decided so far.
        tracking_error: Largest measured distance of a vehicle from its plan so far [m].
        apart: Lower bound of the distance of the nearest two plans in each step [m].
    """

    def __init__(
        self,
        team: CommittedTeam,
        time: float,
        states: Sequence[Array],
        rng: np.random.Generator,
    ) -> None:
        """Make the first plans, one after another, and commit to them."""
        n = len(states)
        self.steps, self.tracking_error = 0, 0.0
        self.apart = list[float]()
        self._team, self._start = team, time
        self._reserve = np.zeros(n)
        problem = team.team.agents[0].controller.planner.problem
        self._pieces = team.lead + 2 * problem.intervals
        self._paths = dict[int, Path]()
        self._violations = dict[int, float]()
        if n > 1:
            most_hops("starts", self._places(states), team.links.radio_range)
        plans = no_plans(n, self._pieces)
        order = team.team.order
        for made, i in enumerate(order):
            self._paths[i] = self._first(i, states[i], order[:made], plans, rng)
        self._agreement = Agreement(
            plans,
            np.array([self._paths[i].rest.is_goal for i in range(n)]),
            distance=team.plan_distance,
            links=team.links,
            rule="acknowledged",
            step_s=team.dt,
        )

    def log(self) -> Log:
        """Return all plans that were proposed, and what became of them."""
        return self._agreement.log(self.steps)

    def certificate(self) -> str:
        """Return the flight's certificate, the text of a file to be checked."""
        return certificate_text(self.log(), self._team.plan_distance)

    @property
    def have_arrived(self) -> Flags:
        """Mask of the vehicles whose plan ends in the set of the goal, shape (n,)."""
        rows = self._agreement.members.committed
        return np.array(self._agreement.terms.is_last[rows])

    @property
    def allowed_error(self) -> float:
        """Largest distance of a vehicle from its plan that the proof allows [m]."""
        return self._team.tracking_error

    def advance(
        self, states: Sequence[Array], rng: np.random.Generator
    ) -> CommittedDecision:
        """Let all vehicles exchange messages and plan; return controls for a step."""
        agreed, step = self._agreement, self.steps
        period = self._team.links.period
        places = self._places(states)
        for tick in range(step * period, (step + 1) * period):
            agreed.exchange(tick, rng)
            if tick % period == 0:
                for i in rng.permutation(agreed.may_propose(tick)).tolist():
                    self._plan(i, tick, rng)
            agreed.send(tick, places, rng)
        rows = agreed.members.committed
        paths = [self._paths[row] for row in rows.tolist()]
        control = list[Array]()
        for body, path, state in zip(self._team.bodies, paths, states, strict=True):
            control.append(body.control(path, step, state))
            off = body.position(state) - body.position(path.states[step - path.first])
            self.tracking_error = max(self.tracking_error, float(np.linalg.norm(off)))
        self.apart.append(least_gap(rows, step, agreed.plans))
        plans = tuple(self._followed(i, x) for i, x in enumerate(states))
        self.steps = step + 1
        rests = all(plan.source is Source.LINEAR for plan in plans)
        return CommittedDecision(
            control=np.concatenate(control), plans=plans,
            mode=Mode.LINEAR if rests else Mode.PLANNED,
            vehicles=self, step=self.steps,
        )  # fmt: skip

    def _places(self, states: Sequence[Array]) -> Array:
        """Return the positions of all vehicles, shape (n, 3) [m]."""
        bodies = self._team.bodies
        return np.array([b.position(x) for b, x in zip(bodies, states, strict=True)])

    def _first(
        self,
        i: int,
        state: Array,
        before: Sequence[int],
        plans: Plans,
        rng: np.random.Generator,
    ) -> Path:
        """Write the first plan of a vehicle, clear of those before; return its path.

        Raises:
            InvalidProblemError: If it finds none; the message names the vehicle.
        """
        loop, others = self._loop(i), [(j, j) for j in before]
        for _ in range(TRIES):
            known = self._known(i, 0, plans, others, self._reserve[i])
            plan = loop.planner.plan(
                state, known=known, guess=loop.first, in_loop=True, rng=rng,
                candidates=self._candidates(i, 0),
            )  # fmt: skip
            if not plan.feasible:
                raise InvalidProblemError(
                    f"the first plan of vehicle {i} must be feasible, its violation is "
                    f"{plan.violation:.4g}"
                )
            try:
                path = self._team.bodies[i].path(0, state, plan.controls)
            except NoRestError as error:
                raise NoRestError(f"vehicle {i}: {error}") from error
            self._write(i, i, path, 0, plans)
            missing = self._missing(i, before, 0, plans)
            if missing <= 0.0:
                self._violations[i] = plan.violation
                return path
            self._reserve[i] += self._added(missing)
        j = min(before, key=lambda j: self._gap(i, j, 0, plans))
        raise InvalidProblemError(
            f"the first plans of vehicles {j} and {i} must be "
            f"{self._team.plan_distance:g} m apart at all times and in rest, they are "
            f"{self._gap(i, j, 0, plans):.4g} m apart"
        )

    def _plan(self, i: int, tick: int, rng: np.random.Generator) -> None:
        """Let a vehicle propose a plan from where its committed plan leads, if it pays.

        A plan that is not clear is made again, at larger distances from the others.
        """
        agreed, team, loop = self._agreement, self._team, self._loop(i)
        body, committed = team.bodies[i], self._paths[int(agreed.members.committed[i])]
        step, begin = self.steps, self.steps + team.lead
        intervals = loop.planner.problem.intervals
        body.grow(committed, begin + intervals - committed.first)
        start = committed.states[begin - committed.first]
        goes_on, heard = _window(committed, begin, intervals), self._heard(i)
        going = loop.planner.fitness.value(
            goes_on, start, self._known(i, begin, agreed.plans, heard)
        )
        agreed.not_before[i] = tick + rng.integers(2, DOUBT)
        for _ in range(TRIES):
            row = agreed.free_row()
            known = self._known(i, begin, agreed.plans, heard, self._reserve[i])
            plan = loop.planner.plan(
                start, known=known, guess=goes_on, near=True, last_cost=going[0],
                in_loop=True, rng=rng, candidates=self._candidates(i, begin),
            )  # fmt: skip
            if not (plan.feasible and _is_worth(plan, going, loop)):
                return
            try:
                made = body.path(begin, start, plan.controls)
            except NoRestError:
                return
            path = joined(committed, made, step)
            self._write(i, row, path, step, agreed.plans)
            begin_as(row, int(agreed.members.committed[i]), team.lead, agreed.plans)
            if is_clear(i, row, step, team.plan_distance, agreed.members, agreed.plans):
                self._paths[row], self._violations[row] = path, plan.violation
                agreed.propose(i, tick, parting=begin, is_last=path.rest.is_goal)
                return
            others = agreed.heard_of(i).tolist()
            missing = self._missing(row, others, step, agreed.plans)
            self._reserve[i] += self._added(missing)

    def _loop(self, i: int) -> RecedingHorizon:
        return self._team.team.agents[i].controller

    def _heard(self, i: int) -> list[tuple[int, int]]:
        """Return the rows of committed plans and candidates that a vehicle knows."""
        members = self._agreement.members
        pairs = zip(
            members.heard_committed[i].tolist(), members.heard_candidate[i].tolist(),
            strict=True,
        )  # fmt: skip
        return [
            (plan, plan if candidate < 0 else candidate)
            for j, (plan, candidate) in enumerate(pairs)
            if j != i
        ]

    def _candidates(self, i: int, step: int) -> Array | None:
        """Return further controls that a search of a vehicle tries at a step."""
        given = self._loop(i).candidates
        return None if given is None else given(self._start + step * self._team.dt)

    def _known(
        self,
        i: int,
        step: int,
        plans: Plans,
        others: Sequence[tuple[int, int]],
        reserve: float = 0.0,
    ) -> Known:
        """Return the known data of a vehicle's plan that begins at a step.

        Args:
            i: Number of the vehicle.
            step: The step.
            plans: All plans of the vehicles, each a row.
            others: Rows of committed plans and candidates of the others; of those that
                are missing nothing is known.
            reserve: Distance to keep from others in addition to the least one [m].
        """
        team, loop = self._team, self._loop(i)
        problem, axes = loop.planner.problem, len(team.bodies[i].rows)
        nodes = step + np.arange(problem.nodes) / problem.checks
        room = len(team.bodies) - 1
        unseen = [np.full((axes, nodes.size), FAR)] * (room - len(others))
        seen = [
            [*(_positions(row, nodes, plans)[:axes] for row in kind), *unseen]
            for kind in ([pair[0] for pair in others], [pair[1] for pair in others])
        ]
        more = np.full((1, nodes.size), reserve)
        known = loop.known(
            self._start + step * team.dt, (*itertools.chain(*seen), more)
        )
        return known._replace(parameters=team.bodies[i].parameters)

    def _write(self, i: int, row: int, path: Path, step: int, plans: Plans) -> None:
        """Write the tube of a vehicle's path into a row."""
        samples, bulges = self._team.bodies[i].tube(path, step, self._pieces)
        plans.first[row] = step
        plans.samples[row], plans.bulges[row] = samples, bulges

    def _missing(
        self, row: int, others: Sequence[int], step: int, plans: Plans
    ) -> float:
        """Return by how much a plan is too near to others; at most 0 if it is clear."""
        gaps = [self._gap(row, other, step, plans) for other in others]
        return self._team.plan_distance - min(gaps, default=np.inf)

    def _added(self, missing: float) -> float:
        """Return what to add to the reserve if a plan lacked some distance [m]."""
        return MORE * max(0.0, missing) + LEAST * self._team.plan_distance

    def _gap(self, one: int, other: int, step: int, plans: Plans) -> float:
        """Return the least distance of two plans from a step on, less their bulges."""
        rows = np.array([one, other])
        last = int(plans.first[rows].max()) + self._pieces
        return min(least_gap(rows, k, plans) for k in range(step, last + 1))

    def _followed(self, i: int, state: Array) -> Plan:
        """Return what a vehicle follows, as a plan over the horizon.

        Its violation is that of the plan when it was made, up to its own end.
        """
        agreed, loop, step = self._agreement, self._loop(i), self.steps
        rows = agreed.members.committed.tolist()
        path, intervals = self._paths[rows[i]], loop.planner.problem.intervals
        self._team.bodies[i].grow(path, step + intervals - path.first)
        others = [(row, row) for j, row in enumerate(rows) if j != i]
        known = self._known(i, step, agreed.plans, others)
        controls = _window(path, step, intervals)
        cost, _ = loop.planner.fitness.value(controls, state, known)
        return loop.planner.evaluated(
            controls, state, known=known, value=(cost, self._violations[rows[i]]),
            source=Source.LINEAR if step >= path.ends else Source.COMMITTED,
        )  # fmt: skip


def _parameters(loop: RecedingHorizon) -> Array:
    """Return the parameters at the start, with which sets are certified."""
    given = () if loop.parameters is None else loop.parameters(0.0)
    return np.asarray(given, dtype=np.float64)


def begin_as(plan: int, committed: int, lead: int, plans: Plans) -> None:
    """Overwrite the beginning of a new plan by the committed one, until they part.

    Samples are copied up to the one at which the plans part, and bulges likewise. If
    the committed plan has ended by then, that sample is only the centre of a ball that
    contains the vehicle, and differs from the sample that the new plan had there. So
    the bulge of the new plan's next piece is increased by the distance of the two.

    Args:
        plan: Row of the new plan, which is written already.
        committed: Row of the committed plan from which it parts.
        lead: Number of steps from the plan's first sample until they part.
        plans: All plans of the vehicles, each a row.
    """
    place, bulge = plans.samples[plan, lead].copy(), plans.bulges[plan, lead]
    branch(plan, committed, (int(plans.first[plan]), lead), plans)
    off = np.linalg.norm(place - plans.samples[plan, lead])
    plans.bulges[plan, lead] = bulge + off


def _window(path: Path, step: int, intervals: int) -> Array:
    """Return the controls of a path from a step on, shape (nu, intervals)."""
    begin = step - path.first
    return np.array(path.controls[begin : begin + intervals]).T


def _positions(row: int, steps: Array, plans: Plans) -> Array:
    """Return where a plan is at some times, counted in steps, shape (3, times) [m]."""
    samples = plans.samples[row]
    index = np.clip(steps - plans.first[row], 0, len(samples) - 1)
    return np.stack([np.interp(index, np.arange(len(samples)), s) for s in samples.T])


def _is_worth(plan: Plan, going: tuple[float, float], loop: RecedingHorizon) -> bool:
    """Return whether a plan is better than to go on, by more than a small part."""
    found, tolerance = (plan.cost, plan.violation), loop.planner.problem.tolerance
    if going[1] > tolerance:
        return is_better(found, going, tolerance=tolerance)
    return plan.cost < going[0] - WORTH * abs(going[0])


def _require_fit(team: Team) -> None:
    """Raise if a vehicle cannot plan against the committed plans of the others."""
    n = len(team.agents)
    planners = [agent.controller.planner for agent in team.agents]
    lengths = sorted({planner.problem.intervals for planner in planners})
    if len(lengths) > 1:
        raise InvalidProblemError(
            f"vehicles must share the number of intervals, got {lengths}"
        )
    for number, (agent, planner) in enumerate(zip(team.agents, planners, strict=True)):
        if agent.watches or not 1 <= len(agent.shows) <= AXES:
            raise InvalidProblemError(
                f"vehicle {number} must watch none, and show 1 to {AXES} rows of its "
                f"position; it watches {agent.watches} and shows {agent.shows}"
            )
        links, model = planner.lowered.links, planner.problem.model
        if agent.controller.within is not None:
            raise InvalidProblemError(
                f"vehicle {number} must have no time for a plan with committed plans: "
                f"expected within=None, got {agent.controller.within:g} s"
            )
        roles = [link.rewrite.role for link in links]
        what = [MORE_DECIDED.get(role, role) for role in roles]
        what += ["signals or a time in its equations"] * bool(model.varying.numel())
        what += ["states that jump"] * model.jumps
        if what:
            raise InvalidProblemError(
                f"committed plans need a problem without {what[0]}; that of vehicle "
                f"{number} has it"
            )
        least = 2 * len(agent.shows) * (n - 1) + 1
        if planner.problem.ns < least:
            raise InvalidProblemError(
                f"the problem of vehicle {number} must have at least {least} signals, "
                f"for the plans of the others and a reserve, got {planner.problem.ns}"
            )
