"""`swarmstart judge`: cost and violations of the controls in a CSV file."""

import argparse
import json

from swarmstart.cases.campaign.studies.judged_file import Judgement, judge
from swarmstart.cases.commands.terminal import DONE, INFEASIBLE, answer

SCHEMA = 1
"""Version of what --json prints."""


def judge_command(options: argparse.Namespace) -> int:
    """Judge the trajectory file that the options name; return the exit code."""
    judged = judge(options.scenario, options.file)
    if options.json:
        answer(json.dumps({"schema": SCHEMA, **judged.content()}))
    else:
        answer("\n".join(lines(judged)))
    return DONE if judged.is_accepted else INFEASIBLE


def lines(judged: Judgement) -> list[str]:
    """Return a judgement as a few lines of text."""
    verdict = "accepted" if judged.is_accepted else f"refused: {judged.reason}"
    worst = judged.worst
    kept = "none along the path" if worst is None else f"at most: {worst}"
    found = [
        f"{judged.problem}, {judged.file}: {verdict}",
        f"  cost        {judged.cost:.9g}",
        f"  violations  {kept}",
    ]
    if judged.paragraph is not None:
        found.append(f"  more        {judged.paragraph}")
    return [*found, *_rank(judged)]


def _rank(judged: Judgement) -> list[str]:
    """Return lines on the best known value; none if the problem is no hard one."""
    best = judged.best
    if best is None:
        return []
    if best.cost is None:
        found = ["  best known  none: the problem is open"]
    else:
        found = [f"  best known  {best.cost:.9g}, known by: {best.known_by}"]
    if judged.is_accepted and judged.ratio is not None:
        found.append(f"  ratio       {judged.ratio:.9g}")
    if judged.is_better:
        found.append("  This trajectory is better than the best known one.")
    return found
