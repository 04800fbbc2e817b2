"""A finished run: its results, how it ended in one sentence, and its key."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from swarmstart.arguments import a_number, checked
from swarmstart.cases.campaign.running.claims import judged
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.kind import Flight, Measure, Posed
from swarmstart.cases.format.registry import SOLVE
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.record.bound_content import CERTIFICATE
from swarmstart.cases.record.multiplier_arrays import told
from swarmstart.cases.record.record import run_key, versions
from swarmstart.cases.record.trajectory_arrays import planned
from swarmstart.errors import Sendable
from swarmstart.ocp import (
    DualMode,
    LowerBound,
    SearchReport,
    SolutionStatus,
    Trajectory,
    chosen_backend,
)
from swarmstart.ocp.answer import paragraph_of
from swarmstart.ocp.common import Paragraph
from swarmstart.ocp.nlp import Multipliers
from swarmstart.ocp.search import StartsAccount
from swarmstart.ocp.statement import piece_at

if TYPE_CHECKING:
    import control

    from swarmstart.ocp.swarm.committed_team import CommittedDecision


ROUNDED = 1e-9
"""Distance of a vehicle from its plan that is rounding [m]."""
_MOST_RAMPS = 3
"""Number of ramps that a status names."""


class RunStatus(NamedTuple):
    """The end of a run.

    Attributes:
        is_usable: Whether any of its plans can be used.
        plan: Status of the one plan that was followed to its end; None for other runs.
        found: What was found, in words: how many planned steps found a feasible plan,
            or found none; the status of the one plan; or, for vehicles with committed
            plans, that each followed its own.
        more: Text after `found`; it is empty or begins with a comma or semicolon.
        all_found: Whether every plan is feasible.
        reason: Reason for the status of the one plan; empty for other runs.
        advice: Advice on what to change; empty if there is none.
        paragraphs: Paragraphs of the docs that explain what is wrong with the result;
            empty if nothing is wrong.
    """

    is_usable: bool
    plan: SolutionStatus | None
    found: str
    more: str
    all_found: bool
    reason: str = ""
    advice: str = ""
    paragraphs: tuple[Paragraph, ...] = ()

    def sentence(self, remark: str = "") -> str:
        """Return one sentence on how the run ended; the remark follows `found`."""
        why = "; ".join(filter(None, (self.reason, self.advice)))
        told = f"simulated to the end; {self.found}{remark}{self.more}"
        return f"{told}: {why}" if why else told


def _status_of(flight: Flight[Posed], trajectory: Trajectory) -> RunStatus:
    """Return how a run ended."""
    controller = flight.controller
    unproven = ""
    if isinstance(controller, DualMode) and controller.uncertified:
        unproven = "; the linear law's terminal sets are not certified"
    if flight.posed.controller is not None:
        said = flight.posed.ended
        return RunStatus(True, plan=None, found=said, more="", all_found=True)
    if flight.posed.committed is not None:
        return _of_committed(cast("CommittedDecision", trajectory.decisions[-1]))
    if flight.posed.open_loop:
        return _of_one_plan(flight, trajectory, unproven)
    return _of_loop(flight, trajectory, unproven)


def _of_loop(flight: Flight[Posed], trajectory: Trajectory, unproven: str) -> RunStatus:
    """Return the status of a closed loop, by the steps that found feasible plans."""
    found = [d.has_feasible_plans for d in trajectory.decisions if planned(d)]
    infeasible, linear = found.count(False), len(trajectory.decisions) - len(found)
    ramps = _named_ramps(flight.posed)
    more = _searched(trajectory) + _stopped(trajectory) + unproven + ramps
    if not infeasible:
        under = f", {counted(linear, 'step')} under the linear law" if linear else ""
        more = under + more
        said = "every planned step found a feasible plan"
    elif infeasible == len(found):
        more = _stopped(trajectory) + unproven + ramps
        said = "no step found a feasible plan"
    else:
        said = f"{infeasible} of {len(found)} planned steps found no feasible plan"
    explained = {
        Paragraph.NO_STEP: bool(found) and not any(found),
        Paragraph.SOME_STEPS: any(found) and not all(found),
        Paragraph.WITHIN: bool(trajectory.stopped_steps),
        Paragraph.NOT_CERTIFIED: bool(unproven),
        Paragraph.RAMP: bool(ramps),
    }
    return RunStatus(
        # Usable also if the linear law did all steps, and no plan was made.
        infeasible < len(found) or not infeasible,
        plan=None,
        found=said,
        more=more,
        all_found=not infeasible,
        paragraphs=tuple(one for one, is_so in explained.items() if is_so),
    )


def _named_ramps(posed: Posed) -> str:
    """Return the signals that first plans take as linear, in words; empty without."""
    return "".join(f"; {ramp}" for ramp in posed.ramps[:_MOST_RAMPS])


def _of_committed(last: CommittedDecision) -> RunStatus:
    """Return the status of vehicles that followed committed plans."""
    vehicles = last.vehicles
    arrived = int(vehicles.have_arrived.sum())
    found = (
        f"each vehicle followed its committed plans; those of {arrived} of "
        f"{vehicles.have_arrived.size} end in the sets of their goals"
    )
    off, allowed = vehicles.tracking_error, vehicles.allowed_error
    more = ""
    if off > max(allowed, ROUNDED):
        more = (
            f"; a vehicle was {off:.3g} off its plan, above the tracking_error of "
            f"{allowed:g}: the distance is not proven for the vehicles"
        )
    return RunStatus(
        True,
        plan=None,
        found=found,
        more=more,
        all_found=not more,
        paragraphs=(Paragraph.OFF_PLAN,) if more else (),
    )


def _of_one_plan(
    flight: Flight[Posed], trajectory: Trajectory, unproven: str
) -> RunStatus:
    """Return the status of a plan followed to its end, confirmed along its path."""
    answer = flight.answer(trajectory)
    is_confirmed = answer.status.is_confirmed
    said = answer.status.value
    # The others are sentences themselves.
    if is_confirmed or said.startswith("not "):
        said = f"the plan is {said}"
    more, differs = "", flight.posed.differs
    if differs:
        more = ", for the model it was made with: the simulated system is another"
        more += _named_ramps(flight.posed)
    more += unproven
    explained = (
        paragraph_of(answer.status, answer.reason),
        Paragraph.OTHER_SYSTEM if differs else None,
        Paragraph.NOT_CERTIFIED if unproven else None,
    )
    return RunStatus(
        is_confirmed,
        plan=answer.status,
        found=said,
        more=more,
        all_found=is_confirmed,
        reason=answer.reason,
        advice=answer.advice,
        paragraphs=tuple(filter(None, explained)),
    )


def _searched(trajectory: Trajectory) -> str:
    """Return how many plans were searched, if a warm polish was enough for some."""
    plans = [
        plan
        for decision in trajectory.decisions
        if planned(decision)
        for plan in decision.plans
        if plan.polish_status is not None
    ]
    searched = sum(plan.is_searched for plan in plans)
    # A number tells something only if a warm polish replaced some searches.
    if searched in {0, len(plans)}:
        return ""
    were = "was" if searched == 1 else "were"
    return f", {searched} of {len(plans)} plans {were} searched"


def _stopped(trajectory: Trajectory) -> str:
    """Return at how many steps planning was stopped in time, if at any."""
    count, steps = trajectory.stopped_steps, len(trajectory.decisions)
    if not count:
        return ""
    were = "was" if count == 1 else "were"
    return f", {count} of {counted(steps, 'step')} {were} stopped in time (within_s)"


class Interrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C during a run, whose finished steps are in its folder.

    Attributes:
        folder: The run's folder; None if the run is not recorded.
        finished: Number of finished steps.
        run: The finished run, if only the search for its lower bound was interrupted;
            it has the best bound found by then, if any. None if the simulation was
            interrupted.
    """

    def __init__(
        self, folder: Path | None, finished: int, *, run: Run | None = None
    ) -> None:
        """Keep the finished steps and their folder."""
        super().__init__(
            f"{finished} finished steps are kept in {folder}; the same command again "
            "goes on from there"
            if run is None
            else _without_bound(run)
        )
        self.folder = folder
        self.finished = finished
        self.run = run


def _without_bound(run: Run) -> str:
    """Return the message for a run whose bound was interrupted."""
    kept = "" if run.folder is None else f" and kept in {run.folder}"
    best = "no bound was proven yet" if run.bound is None else "the best one is kept"
    return f"the run is finished{kept}; its bound was interrupted: {best}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Run:
    """A finished run.

    Attributes:
        resolved: The scenario as it was run.
        seed: The seed.
        flight: The closed loop that was run.
        trajectory: The simulated trajectory.
        measures: Values of the measures, by name.
        claims: All claims of the scenario, judged if this run can judge them.
        ended: Status in which the run ended.
        wall_s: Wall time of building, simulating and measuring [s], without compiling
            and without an earlier, interrupted run.
        compile_s: Wall time of loading and compiling machine code [s].
        folder: Folder of the record; None without a record.
        figures: Files of the figures that were drawn.
        resumed: Number of steps that an earlier, interrupted run had finished.
        multipliers: Multipliers of the first plan, if one agent plans and a solver
            converged.
        bound: Lower bound of the cost of any plan; None if none was asked for.
        bound_content: The bound as in run.json. If no bound was asked for, it is that
            of an earlier, equal run in the same record; None if there is none.
        documents: Further files of the record: name -> text.
    """

    resolved: Resolved
    seed: int
    flight: Flight[Posed]
    trajectory: Trajectory
    measures: Mapping[str, Measure]
    claims: list[dict[str, Any]]
    ended: RunStatus
    wall_s: float = 0.0
    compile_s: float = 0.0
    folder: Path | None = None
    figures: tuple[Path, ...] = ()
    resumed: int = 0
    multipliers: Multipliers | None = None
    bound: LowerBound | None = None
    bound_content: Mapping[str, Any] | None = None
    documents: Mapping[str, str] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes but the closed loop, which is compiled."""
        return {
            one.name: getattr(self, one.name)
            for one in fields(self)
            if one.name != "flight"
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take all attributes but the closed loop."""
        for name, value in state.items():
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Flight[Posed]:
        """Return the closed loop of a run that was pickled, made at its first use."""
        if name != "flight":  # A slot that is not set.
            raise AttributeError(f"a Run has no attribute {name!r}")
        flight = flight_of(self.resolved.posed(), self.resolved.scenario)
        object.__setattr__(self, "flight", flight)
        return flight

    def __repr__(self) -> str:
        """Return scenario, seed and how it ended in one line."""
        name = self.resolved.scenario.name
        return f"Run of {name}, seed {self.seed}: {self.status}"

    def summary(self) -> dict[str, Any]:
        """Return the data that `--json` prints and run.json contains."""
        settings = self.resolved.settings
        return {
            "schema": 1,
            "scenario": settings["name"],
            "kind": settings["kind"],
            "variant": self.resolved.variant,
            "seed": self.seed,
            "key": key_of(self.resolved, self.seed),
            "solver": SOLVE,
            "search": self.resolved.scenario.search_name,
            "lanes": self.resolved.scenario.random_starts(),
            "polish": self.resolved.scenario.polish_name,
            "status": self.status,
            "reason": self.ended.reason or None,
            "advice": self.ended.advice or None,
            "measures": dict(self.measures),
            "multipliers": told(self.multipliers),
            "starts": self._starts(),
            "search_lanes": self._search_lanes(),
            "bound": None if self.bound_content is None else dict(self.bound_content),
            "claims": self.claims,
            "evaluations": self.measures.get("evaluations"),
            "wall_s": self.wall_s,
            "compile_seconds": self.compile_s,
            "backend": backend_of(self.resolved),
            "resumed_steps": self.resumed,
            "versions": versions(),
            "figures": [file.name for file in self.figures],
            "documents": [
                *self.documents,
                *self.flight.posed.files,
                *self._certificates(),
            ],
            "out": str(self.folder) if self.folder else None,
        }

    def to_time_response(self) -> Any:
        """Return the trajectory as python-control's `control.TimeResponseData`."""
        return self.trajectory.to_time_response()

    @checked(time=a_number())
    def linearised(self, time: float) -> control.StateSpace:
        """Return the linear system of the plant near a point of the run.

        Args:
            time: Time within the run [s].

        Raises:
            InvalidProblemError: If `time` is outside of the run.
            InvalidSystemError: As in `Model.linearised`.
        """
        plant, at = self.flight.plant, np.array([time])
        x, u = self.trajectory.at(time)
        number = piece_at(time, self.trajectory.times)
        # Parameters that the plan of this step has decided.
        plant = plant.with_decided(self.trajectory.decisions[number].decided)
        signals = plant.varying(at)[: plant.model.ns, 0]
        return plant.model.linearised(
            x, u, parameters=plant.parameters(at)[:, 0], signals=signals, time=time
        )

    @property
    def status(self) -> str:
        """One sentence on how the run ended."""
        return self.ended.sentence()

    @property
    def feasible(self) -> bool:
        """True if at least one planned step found a feasible plan."""
        return self.ended.is_usable

    @property
    def starts(self) -> StartsAccount | None:
        """Results of the starts of the first plan; None if it had one start."""
        decisions = self.trajectory.decisions
        plans = decisions[0].plans if decisions else ()
        return plans[0].starts if plans else None

    @property
    def search_report(self) -> SearchReport:
        """Report of the search of the first plan."""
        decisions = self.trajectory.decisions
        plans = decisions[0].plans if decisions else ()
        return plans[0].search if plans else SearchReport()

    def _certificates(self) -> list[str]:
        return [CERTIFICATE] if (self.bound_content or {}).get("certificate") else []

    def _starts(self) -> dict[str, Any] | None:
        return None if self.starts is None else self.starts.told(self.flight.sense)

    def _search_lanes(self) -> dict[str, Any] | None:
        return self.search_report.told(self.flight.sense)


def measured_run(
    resolved: Resolved, flight: Flight[Posed], trajectory: Trajectory, seed: int
) -> Run:
    """Return a run with its measures and judged claims."""
    scenario = resolved.scenario
    measures = resolved.kind.measure(scenario, flight, trajectory)
    return Run(
        resolved=resolved,
        seed=seed,
        flight=flight,
        trajectory=trajectory,
        measures=measures,
        documents=flight.documents,
        claims=judged(
            scenario.claims,
            resolved.settings,
            measures,
            variant=resolved.variant,
            undefined=resolved.kind.undefined_of(scenario),
        ),
        ended=_status_of(flight, trajectory),
    )


def default_folder(resolved: Resolved, seed: int, root: Path) -> Path:
    """Return root/<scenario>/<key>, the default folder of a run's record.

    The key is the hash of all that determines the result of the run (`key_of`).
    """
    return root / resolved.scenario.name / key_of(resolved, seed)


def key_of(resolved: Resolved, seed: int) -> str:
    """Return the hash of all that determines a run's result."""
    settings = determining(resolved)
    settings.pop("instances", None)  # Of a sweep alone.
    return run_key(settings, seed, backend_of(resolved))


def determining(resolved: Resolved) -> dict[str, Any]:
    """Return the settings that can change a result.

    The setting `backend` is left out: the hash that names a run (`key_of`) contains the
    evaluator that was chosen by this setting.
    """
    told_only = "claims", "title", "source", "backend"
    return {
        name: value
        for name, value in resolved.settings.items()
        if name not in told_only
    }


def backend_of(resolved: Resolved) -> str:
    """Return the name of the evaluator of populations that a run uses."""
    return chosen_backend(resolved.scenario.evaluator)
