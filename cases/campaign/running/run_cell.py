"""A run as a cell of a campaign."""

from swarmstart.cases.campaign.engine.cells import Cell
from swarmstart.cases.format.scenario import Resolved

FLOWN_BY = "swarmstart.cases.campaign.running.flown:fly"


def run_cell(
    resolved: Resolved, seed: int, *, figures: bool = False, flown_by: str = FLOWN_BY
) -> Cell:
    """Return the cell of one run.

    Args:
        resolved: The scenario.
        seed: The seed.
        figures: Whether figures are drawn, into `figures` of its folder.
        flown_by: "module:function" that runs it; by default it measures the run.
    """
    settings = dict(resolved.settings) if figures else resolved.anonymous_settings()
    variant = f" {resolved.variant}" if resolved.variant else ""
    return Cell(
        work=flown_by,
        job={
            "settings": settings,
            "variant": resolved.variant,
            "seed": seed,
            "figures": figures,
        },
        label=f"{resolved.scenario.name}{variant}, seed {seed}",
    )
