"""A solver on a scenario, with a cell for each seed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swarmstart.cases.campaign.engine.cells import Cell
from swarmstart.cases.campaign.trials.peer_names import PEERS
from swarmstart.cases.campaign.trials.solver_names import Solver
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.record.record import package_version


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """A solver on a scenario.

    Attributes:
        scenario: The scenario's name.
        solver: The solver.
        cells: One for each seed; only one if the solver is deterministic.
    """

    scenario: str
    solver: Solver
    cells: tuple[Cell, ...]

    @property
    def settings_key(self) -> str:
        """Key of the settings that its results depend on, without the seeds."""
        if not self.cells:
            return ""
        job = {k: v for k, v in self.cells[0].job.items() if k != "seed"}
        text = json.dumps(job, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def entry_of(
    resolved: Resolved,
    solver: Solver,
    *,
    seeds: int,
    budget: Mapping[str, Any],
    timeout_s: float,
    repair: bool,
) -> Entry:
    """Return the cells of a solver on a scenario.

    Args:
        resolved: The scenario with the solver's search.
        solver: The solver.
        seeds: Number of seeds, from 0 on.
        budget: Budget of one planning problem.
        timeout_s: Time limit of a cell [s].
        repair: Whether answers that break constraints between the checks are solved
            again with a margin.
    """
    settings, permissions = resolved.anonymous_settings(), resolved.permissions()
    cells = [
        Cell(
            work="swarmstart.cases.campaign.trials.solvers:solve_cell",
            job={
                "settings": settings,
                "variant": resolved.variant,
                "solver": solver.name,
                "budget": dict(budget),
                "seed": seed,
                "repair": repair,
                **_package(solver),
            },
            label=f"{resolved.scenario.name}, {solver.name}, seed {seed}",
            timeout_s=timeout_s,
            permissions=permissions,
            rescue="swarmstart.cases.campaign.trials.solvers:judge_checkpoint",
        )
        for seed in range(1 if solver.is_deterministic else seeds)
    ]
    return Entry(scenario=resolved.scenario.name, solver=solver, cells=tuple(cells))


def _package(solver: Solver) -> dict[str, str]:
    """Return the version of the package of a peer."""
    if not solver.peer:
        return {}
    name = PEERS[solver.peer].pip
    return {"package": f"{name} {package_version(name)}"}
