"""Registries of names in scenarios: "module:attribute" strings, imported when used.

`KindWords` has all texts about a kind of scenario, and the names of its rows. Nothing
heavy is imported here, so that `swarmstart list` and `--help` stay quick.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pkgutil import resolve_name

from swarmstart.heuristics import SEARCHES as OF_ARRAYS
from swarmstart.heuristics import SearchEntry, installed_searches


@dataclass(frozen=True, kw_only=True, slots=True)
class KindWords:
    """Texts about a kind, and the names of its rows; the WORDS of the kind's folder.

    Attributes:
        kind: "module:attribute" of its Kind.
        title: Description in a few words, for the list of kinds.
        measures: Name of a measure -> meaning, with its unit in brackets at the end.
        of_closed_loops: Measures that have a meaning for closed loops only, not for a
            single plan.
        templates: Commented files that `swarmstart new` copies, in the folder
            `templates` beside this module: name -> ending of the new file; an empty
            ending is that of the scenario. No entry means that the kind has no
            template.
        example: Shipped scenario to start from if there is no template; may be empty.
        runs_code: Whether scenarios run a file of the user's.
        flown_by: Aircraft of a flight: one word that is used with a number ("UAV"), or
            a phrase. It is empty if the kind is no flight; texts then mention
            constraints instead of distances.
        outcome: "module:function" that returns the result of a run in a sentence:
            (trajectory, measures) -> text; empty means a sentence on the cost.
        ending: "module:function" that returns a further sentence on the end of a run:
            (measures) -> text, which may be empty; an empty name means no sentence.
        kept: "module:function" that returns a sentence on the constraints, and whether
            they are kept: (measures) -> (text, bool). Empty means a sentence on the
            distances of a flight, or on the constraints of any other run.
        captions: Stem of a figure's file -> caption.
        costs: Names of measures that can be the cost of a run; the first defined one
            counts.
        numbered_rows: Whether the vehicles move in the plane, and names of their states
            and controls end in the number of the vehicle; else the rows of one vehicle
            follow those of another.
        vehicles: Names of the vehicles; empty means those of the scenario.
        called: Word before the number of a vehicle with numbered rows.
        first_number: Number of the first vehicle, if the scenario gives no numbers.
        relative: Whether the positions are those of a leader seen from its wingman.
        surroundings: "module:function" that returns what is around the vehicles:
            (scenario as recorded, times, positions, headings) -> Surroundings; empty
            means no surroundings.
        for_pages: Assignments to settings, as for --set, with which a recorded scenario
            is posed again to draw its page.
    """

    kind: str = ""
    title: str = ""
    measures: Mapping[str, str] = field(default_factory=dict)
    of_closed_loops: tuple[str, ...] = ()
    templates: Mapping[str, str] = field(default_factory=dict)
    example: str = ""
    runs_code: bool = False
    flown_by: str = ""
    outcome: str = ""
    ending: str = ""
    kept: str = ""
    captions: Mapping[str, str] = field(default_factory=dict)
    costs: tuple[str, ...] = ()
    numbered_rows: bool = False
    vehicles: tuple[str, ...] = ()
    called: str = "UAV"
    first_number: int = 1
    relative: bool = False
    surroundings: str = ""
    for_pages: tuple[str, ...] = ()


DRAWN_PLANNING = (
    "(d) Wall time of each step against the control interval, and where the control of "
    "each step comes from."
)
"""Caption of the part of a sheet that shows what planning took."""
SEARCHES = {
    "default": SearchEntry("the default of the library for the budget", ""),
    **OF_ARRAYS,
    "memetic": SearchEntry(
        "L-SHADE whose best members are improved by local solves in lanes",
        "swarmstart.ocp:Memetic",
    ),
    "multistart": SearchEntry(
        "local solves in lanes from random starts, until little is left unseen",
        "swarmstart.ocp:Multistart",
    ),
    "none": SearchEntry("no search: the polish alone", ""),
}
"""Name -> entry of a search; those on arrays are registered in `heuristics`."""
# Another package adds searches, but replaces none of these.
SEARCHES |= {
    name: entry for name, entry in installed_searches().items() if name not in SEARCHES
}
SOLVE = "solve"
"""Name of the way from problem to answer that a run takes, in runs and comparisons."""
RULES = {
    "acknowledged": "a plan of a swarm counts when all others have accepted it",
    "waiting": "a plan of a swarm counts if nothing is heard against it for a while",
    "hearsay": "a plan of a swarm counts at once",
}
"""Rules of a swarm, which are compared as solvers are."""
POLISHES = {
    "ipopt": "IPOPT on multiple shooting, from the search's answer",
    "none": "no polish",
}


def _installed() -> dict[str, str]:
    """Return the kinds of other installed packages: name -> "module:WORDS"."""
    return {point.name: point.value for point in entry_points(group=KIND_GROUP)}


KIND_GROUP = "swarmstart.kinds"
"""Group of entry points in which another package announces a kind of its own."""
_KINDS = "swarmstart.cases.kinds"
KINDS = {
    "problem": f"{_KINDS}.problem.stated.names:WORDS",
    "python": f"{_KINDS}.python.names:WORDS",
    "formation_flight": f"{_KINDS}.formation_flight.names:WORDS",
    "close_formation": f"{_KINDS}.close_formation.names:WORDS",
    "reconfiguration": f"{_KINDS}.reconfiguration.names:WORDS",
    "transfer": f"{_KINDS}.transfer.names:WORDS",
    "swarm": f"{_KINDS}.swarm.names:WORDS",
}
"""Name of a kind -> "module:WORDS" of its `KindWords`; its only registration."""
# Another package adds kinds, but replaces none of these.
KINDS |= {name: words for name, words in _installed().items() if name not in KINDS}


BEST_KNOWN = "best_known"
"""Name of the format of best known values of hard problems, which has a schema, too."""


def words_of(kind: object) -> KindWords:
    """Return the texts about a kind; empty texts for an unknown kind of a record.

    Args:
        kind: A key of KINDS, or any other value that a file has in its place.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        return KindWords()
    words: KindWords = resolve_name(KINDS[kind])
    return words
