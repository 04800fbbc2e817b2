"""A posed problem, with data for its measures and figures."""

from collections.abc import Mapping
from dataclasses import dataclass

from swarmstart.cases.format.kind import Posed
from swarmstart.cases.kinds.problem.stated.members import Member
from swarmstart.cases.kinds.problem.stated.symbols import Signal


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProblemPosed(Posed):
    """A posed problem, with data for measures and figures.

    Attributes:
        known: Name of a parameter of the plant, or of a signal -> its values over time.
        members: The vehicles, the one system, or the phases.
    """

    known: Mapping[str, Signal]
    members: tuple[Member, ...]
