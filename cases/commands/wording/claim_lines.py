"""Claims of a scenario as lines: a short summary, or a table of all of them."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from swarmstart.cases.commands.terminal.output import table_lines
from swarmstart.cases.commands.wording.measure_lines import value_text
from swarmstart.cases.format.kind import NEVER

VERDICTS = {True: "holds", False: "does not hold", None: "not judged"}
SHOWN = 10
"""Claims that the summary names; further ones are counted."""

Claim = Mapping[str, Any]


def short_claims(claims: Sequence[Claim]) -> list[str]:
    """Return how many claims hold, and each that does not; nothing without claims."""
    if not claims:
        return []
    counts = Counter(claim["holds"] for claim in claims)
    words = {True: "hold", False: "do not hold", None: "not judged"}
    if counts[False] == 1:
        words[False] = "does not hold"
    if counts[True] == 1:
        words[True] = "holds"
    said = [f"{counts[is_so]} {word}" for is_so, word in words.items() if counts[is_so]]
    lines = [f"Claims: {', '.join(said)}{_needs(claims)}."]
    wrong = [claim for claim in claims if claim["holds"] is False]
    lines += table_lines([_row(claim) for claim in wrong[:SHOWN]])
    if len(wrong) > SHOWN:
        lines.append(f"  and {len(wrong) - SHOWN} more, see --measures")
    return lines


def claim_table(claims: Iterable[Claim]) -> list[str]:
    """Return all claims: those that were judged, then those that were not."""
    lines: list[str] = []
    judged = [claim for claim in claims if claim["holds"] is not None]
    if judged:
        lines += ["", "claims", *table_lines([_row(claim) for claim in judged])]
    others = [claim for claim in claims if claim["holds"] is None]
    if others:
        lines += ["", "claims not judged, and what they need"]
        lines += table_lines([(c["id"], c["needs"], c["text"]) for c in others])
    return lines


def _needs(claims: Iterable[Claim]) -> str:
    """Return what most of the claims need that were not judged."""
    needs = Counter(claim["needs"] for claim in claims if claim["holds"] is None)
    if not needs:
        return ""
    (most, count), total = needs.most_common(1)[0], needs.total()
    if count == total:
        return f" (needs {most})"
    if 2 * count <= total:
        return " (--measures shows what they need)"
    return f" ({count} of them: needs {most}; --measures shows all)"


def _row(claim: Claim) -> tuple[str, ...]:
    """Return a judged claim as a row of a table."""
    bound = NEVER if claim["bound"] is None else f"{claim['bound']:.4g}"
    undefined = claim["measured"] is None
    measured = NEVER if undefined else value_text(claim["measured"])
    question = f"{claim['measure']} = {measured} {claim['relation']} {bound}"
    return claim["id"], VERDICTS[claim["holds"]], question, claim["text"]
