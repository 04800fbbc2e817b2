"""The project's bars: its own claims, judged over seeds like those of the chapter.

    python benchmarks/bars.py benchmarks/claims/formation.yaml [--short] [--write FILE]

Finished runs are kept, and the same command continues from there.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.campaign.engine.cells import carried_out
from swarmstart.cases.campaign.studies.replication import (
    JudgedClaim,
    cells_of,
    claims_in,
    judged,
    planned,
)
from swarmstart.cases.campaign.studies.verdicts import Verdict
from swarmstart.cases.commands.actions.replicate import recorded
from swarmstart.cases.commands.terminal import Progress


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and judge the claims of a file; return 3 if one is missed."""
    parser = page_options(__doc__)
    parser.add_argument("claims", type=Path, help="a file of benchmarks/claims")
    parser.add_argument("--short", action="store_true", help="one seed of everything")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results") / "bars")
    options = parser.parse_args(arguments)

    bars = claims_in(options.claims.read_bytes(), name=options.claims.name)
    seeds = 1 if options.short else None
    parts = [planned(bars, claim, seeds=seeds) for claim in bars.claims]
    cells = [cell for each in parts for cell in cells_of(each)]
    with Progress("bars") as progress:
        outcomes = carried_out(
            cells, options.out, workers=options.workers, told=progress.update
        )
    by_key = {cell.key: one for cell, one in zip(cells, outcomes, strict=True)}
    found = [judged(c, p, by_key) for c, p in zip(bars.claims, parts, strict=True)]

    missed = [
        claim
        for claim in found
        if not claim.is_expected
        or (
            claim.verdict is Verdict.NOT_JUDGED and not (options.short or _shown(claim))
        )
    ]
    publish(_table(found), options, f"{bars.page}\n")
    print(f"missed: {', '.join(c.claim.text for c in missed) or '-'}", file=sys.stderr)
    return 3 if missed else 0


def _table(found: Sequence[JudgedClaim]) -> list[str]:
    """Return a row for each claim, as Markdown."""
    lines = head(
        "bar", "asked", "lowest / median / highest", "seeds", "verdict", "command"
    )
    for one in found:
        claim = recorded(one)
        parts = claim["parts"]
        failed = [f"a run failed: {why}" for part in parts for why in part["failures"]]
        measured = (
            " ".join([part["measured"], *([f"({part['test']})"] * bool(part["test"]))])
            for part in parts
        )
        commands = {
            f"`{part['command']}`"
            + f"; against `{part['against']}`" * bool(part["against"])
            for part in parts
        }
        lines.append(
            row(
                claim["text"],
                "<br>".join(f"`{part['asked']}`" for part in parts),
                "<br>".join([*measured, *failed]),
                str(parts[0]["runs"]),
                "-" if _shown(one) else claim["verdict"],
                "<br>".join(sorted(commands)),
            )
        )
    return lines


def _shown(claim: JudgedClaim) -> bool:
    """Return whether a claim has no bar and is only shown."""
    return all(part.planned.part.beside for part in claim.parts)


if __name__ == "__main__":
    sys.exit(main())
