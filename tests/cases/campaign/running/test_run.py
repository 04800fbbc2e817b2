"""A run's record states whether its linear law is certified."""

from __future__ import annotations

import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.scenario import read_document, resolve


@pytest.mark.parametrize(
    ("variant", "enabled", "is_said"),
    [
        ("literal", "true", True),
        ("literal", "false", False),
        ("corrected", "true", False),
    ],
)
def test_sets_that_are_not_certified_are_named_in_the_status(
    variant: str, enabled: str, is_said: bool
) -> None:
    """The literal law has no certificate; it is used if the scenario asks for it."""
    assignments = ("steps=1", f"dual_mode.enabled={enabled}")
    resolved = resolve(
        read_document("formation_v"), variant=variant, assignments=assignments
    )
    said = run(resolved, seed=0).status
    assert said.endswith("terminal sets are not certified") == is_said


def test_progress_of_one_plan_says_solving_from_the_beginning() -> None:
    said: list[tuple[int, int, str]] = []
    settings = ("search={name: none}", "lanes=0")
    resolved = resolve(read_document("double_integrator"), assignments=settings)
    run(resolved, seed=0, progress=lambda *told: said.append(told))
    # Once before the plan is made, then after each of its steps.
    steps = resolved.scenario.steps
    assert said.count((0, 0, "solving")) == steps + 1
    assert not any(what == "simulating" for _, _, what in said)
