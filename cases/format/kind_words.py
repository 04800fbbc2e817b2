"""Words of a kind of scenario: all that is said of it, and known of its rows, as text.

Nothing heavy is imported here, so that `swarmstart list` and `--help` stay quick.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True, slots=True)
class KindWords:
    """Words of a kind, which its folder states as WORDS.

    Attributes:
        kind: "module:attribute" of its Kind.
        title: Description in a few words, for the list of kinds.
        measures: Name of a measure -> meaning, with its unit in brackets at the end.
        templates: Commented files that `swarmstart new` copies, in the folder
            `templates` beside this module: name -> ending of the new file; empty: that
            of the scenario. Without any there is no template.
        example: Shipped scenario to start from if there is no template; may be empty.
        runs_code: Whether scenarios run a file of the user's.
        flown_by: Aircraft of a flight: one word that is counted ("UAV"), or a phrase;
            empty: no flight of aircraft, so that constraints are told, not distances.
        outcome: "module:function" that returns the result of a run in a sentence:
            (trajectory, measures) -> text; empty: the cost, as of any problem.
        ending: "module:function" that returns a further sentence on the end of a run:
            (measures) -> text, which may be empty; empty: there is none.
        captions: Stem of a figure's file -> caption.
        costs: Measures that are the cost of a run: the first that is defined counts.
        numbered_rows: Whether names of states and controls end in the number of the
            vehicle, which moves in the plane; else vehicles follow one another.
        vehicles: Names of the vehicles; empty: those of the scenario.
        relative: Whether the positions are those of a leader seen from its wingman.
        surroundings: "module:function" that returns what is around the vehicles:
            (scenario as recorded, times, positions, headings) -> Surroundings; empty:
            nothing.
        for_pages: Settings of a scenario that is posed again to draw a page.
    """

    kind: str = ""
    title: str = ""
    measures: Mapping[str, str] = field(default_factory=dict)
    templates: Mapping[str, str] = field(default_factory=dict)
    example: str = ""
    runs_code: bool = False
    flown_by: str = ""
    outcome: str = ""
    ending: str = ""
    captions: Mapping[str, str] = field(default_factory=dict)
    costs: tuple[str, ...] = ()
    numbered_rows: bool = False
    vehicles: tuple[str, ...] = ()
    relative: bool = False
    surroundings: str = ""
    for_pages: tuple[str, ...] = ()


DRAWN_PLANNING = (
    "(d) Wall time of each step against the control interval, and where the control of "
    "each step comes from."
)
"""Caption of the part of a sheet that shows what planning took."""
