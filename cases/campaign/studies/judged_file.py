"""Judgement of a trajectory file on a problem: cost, violations, and rank.

The file is a CSV table: a column for each control under its name, a row for each
interval of the plan. A decided number, such as `end_time`, has a column with the same
value in all rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.own_solver import plan_of
from swarmstart.cases.format.document import counted, printable, shown
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.hard.best_known import BestKnown, best_known
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.kinds.problem.stated.values import (
    csv_columns,
    csv_lines,
    csv_names,
    number_of,
)
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import OptimalControlProblem, Planner, Start, verified
from swarmstart.ocp.answer import paragraph_of
from swarmstart.ocp.common import Paragraph
from swarmstart.ocp.rollout.checking import Excess
from swarmstart.ocp.statement import END_TIME

MOST_BYTES = 20_000_000
"""Largest size of a trajectory file."""
ROUND_OFF = 1e-9
"""Relative excess over a bound of a control that is only round-off."""
BETTER = 1e-6
"""Relative difference from the best known cost that counts as better."""
END_TIME_COLUMN = "end_time"
"""Column of a free end time, which has the name of its measure."""


class TrajectoryFileError(SwarmstartError, ValueError):
    """A trajectory file does not fit the problem."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement:
    """A judged trajectory.

    Attributes:
        problem: Name of the problem.
        file: Name of the file, for messages.
        is_accepted: Whether all constraints are kept along the finely simulated path,
            and the cost of this path agrees with that on the plan's own grid.
        reason: Reason why the trajectory is refused; empty if it is accepted.
        paragraph: Paragraph of the docs that explains the refusal; None if the
            trajectory is accepted.
        cost: Cost along the finely simulated path, as the problem's file states it.
        worst: The excess over a limit that is largest relative to the limit's scale;
            None if no limit is exceeded.
        best: Best known value of the problem; None if no value is known.
        sense: 1 if the cost is minimised, -1 if it is maximised.
    """

    problem: str
    file: str
    is_accepted: bool
    reason: str
    cost: float
    worst: Excess | None
    best: BestKnown | None
    sense: float
    paragraph: Paragraph | None = None

    @property
    def ratio(self) -> float | None:
        """Cost divided by the best known cost; None if that is unknown or zero."""
        known = None if self.best is None else self.best.cost
        return self.cost / known if known else None

    @property
    def is_better(self) -> bool:
        """True if the trajectory is accepted and better than the best known cost."""
        if not self.is_accepted or self.best is None:
            return False
        known = self.best.cost
        # The first trajectory of an open problem is better than none.
        return known is None or self.sense * (known - self.cost) > BETTER * abs(known)

    def content(self) -> dict[str, Any]:
        """Return the judgement as plain data, for JSON."""
        worst, best = self.worst, self.best
        return {
            "problem": self.problem,
            "file": self.file,
            "accepted": self.is_accepted,
            "reason": self.reason,
            "cost": self.cost,
            "worst": None
            if worst is None
            else {
                "row": worst.name,
                "amount": worst.amount,
                "scale": worst.scale,
                "time_s": worst.time,
            },
            "best_known": None if best is None else best.cost,
            "known_by": None if best is None else best.known_by,
            "ratio": self.ratio,
            "better": self.is_better,
        }


def judge(problem: str, file: str | Path) -> Judgement:
    r"""Return the judgement of a trajectory file.

    Args:
        problem: Name of a problem that has one plan, such as `hard/walls_4`, or path of
            its file.
        file: The CSV file.

    Raises:
        TrajectoryFileError: If the file has wrong columns or rows, or values outside of
            the bounds of the controls.
        OwnSolverError: If a control that must be a whole number has another value.
        SwarmstartError: If the problem cannot be read or posed.

    Example:
        >>> from pathlib import Path; from tempfile import mkdtemp
        >>> file = Path(mkdtemp()) / "first_gear.csv"
        >>> _ = file.write_text("gear\n" + "1\n" * 6)
        >>> judged = judge("hard/gears_6", file)
        >>> judged.is_accepted, judged.is_better
        (True, False)
    """
    document = read_document(problem)
    posed = first_problem(resolve(document).posed())
    name, columns = _columns(Path(file))
    planner = Planner(posed.problem, search=None, polish=None)
    start = _start(planner, columns, name)
    plan = plan_of(planner, start, name, x0=posed.x0, known=posed.known)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    solution = verified(planner.tracer, plan, x0, known, advised=False)
    confirmed = bool(solution.status.is_confirmed)
    broken = solution.path.broken
    breaks = broken and broken[0].relative > posed.problem.path_tolerance
    reason = f"{broken[0]}" if breaks else solution.reason
    return Judgement(
        problem=problem,
        file=name,
        is_accepted=confirmed,
        reason="" if confirmed else reason,
        cost=solution.verified_cost,
        worst=broken[0] if broken else None,
        best=best_known().get(problem),
        sense=posed.problem.sense,
        paragraph=None if confirmed else paragraph_of(solution.status, solution.reason),
    )


def _columns(file: Path) -> tuple[str, dict[str, Array]]:
    """Return the file's name for messages, and its columns by name, each (rows,)."""
    if file.suffix != ".csv":
        raise TrajectoryFileError(
            f"expected a CSV file, such as controls.csv; found {shown(str(file))}"
        )
    try:
        name, rows = csv_lines(file, most=MOST_BYTES)
        names, body = csv_names(name, rows, "names of controls")
    except ValueError as error:  # A file that cannot be read has its own exit code.
        raise TrajectoryFileError(str(error)) from None
    for line, row in body:
        if len(row) != len(names):
            raise TrajectoryFileError(
                f"{name}:{line}: expected {counted(len(names), 'cell')}, as in the "
                f"first line; found {len(row)}"
            )
        for column, cell in zip(names, row, strict=True):
            if number_of(cell) is None:
                raise TrajectoryFileError(
                    f"{name}:{line}: expected a finite number as {printable(column)}, "
                    f"found {shown(cell)}"
                )
    return name, csv_columns(names, body)


def _start(planner: Planner, columns: Mapping[str, Array], name: str) -> Start:
    """Return controls and decisions of a file.

    Raises:
        TrajectoryFileError: If columns or rows are missing or too many, or a decision
            is outside of its bounds.
    """
    problem = planner.stated
    controls, decided = problem.model.control_names, _decided(planner)
    wanted = [*controls, *decided]
    if columns.keys() != {*wanted}:
        raise TrajectoryFileError(
            f"{name}:1: expected the columns {', '.join(wanted)}; found "
            f"{', '.join(map(printable, columns))}"
        )
    rows = problem.intervals + problem.has_knots
    found = len(columns[wanted[0]])
    if found != rows:
        raise TrajectoryFileError(
            f"{name}: expected {rows} rows, one for each interval; found {found}"
        )
    for one, (lower, upper) in decided.items():
        low, high = columns[one].min(), columns[one].max()
        if low < high or not lower <= low <= upper:
            raise TrajectoryFileError(
                f"{name}: expected one value of {one} in all rows, from {lower:.12g} "
                f"to {upper:.12g}; found {low:.12g} to {high:.12g}"
            )
    found_controls = np.array([columns[one] for one in controls])
    _require_bounds(problem, found_controls, name)
    return Start(
        controls=found_controls,
        decided={
            END_TIME if one == END_TIME_COLUMN else one: float(columns[one][0])
            for one in decided
        },
    )


def _require_bounds(problem: OptimalControlProblem, controls: Array, name: str) -> None:
    """Raise a TrajectoryFileError for the control that leaves its bounds the most."""
    lower, upper = (limit[:, None] for limit in problem.control_limits)
    over = np.maximum(controls - upper, lower - controls)
    row, interval = np.unravel_index(int(np.argmax(over)), over.shape)
    if over[row, interval] > ROUND_OFF * max(1.0, abs(controls[row, interval])):
        raise TrajectoryFileError(
            f"{name}: expected {problem.model.control_names[row]} from "
            f"{lower[row, 0]:.12g} to {upper[row, 0]:.12g}; found "
            f"{controls[row, interval]:.12g} in interval {interval + 1}"
        )


def _decided(planner: Planner) -> dict[str, tuple[float, float]]:
    """Return the bounds of the decided numbers by name, as the problem counts them."""
    core, origin = planner.lowered.core, planner.lowered.origin
    found = {}
    for one in core.free_starts:
        place = one.states[0]
        name = core.model.state_names[place]
        lower, upper = one.value.lower + origin[place], one.value.upper + origin[place]
        column = END_TIME_COLUMN if name == END_TIME else name
        found[column] = float(lower), float(upper)
    return found
