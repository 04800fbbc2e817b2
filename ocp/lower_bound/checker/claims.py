"""The statements of a certificate, in the only words that are accepted.

They are those that the checker judges: a text of its own, labelled proven, would pass
for something that was checked.
"""

from __future__ import annotations

TUBE = "every admissible trajectory stays in the tube"
PRUNING = "no trajectory that costs less than the known cost leaves the set of pruning"
FINAL = "the final step's inequalities hold on the set that the prunings leave"
BOUND = "no admissible trajectory costs less than the bound"


def expected_claims(prunings: int) -> list[str]:
    """Return what a certificate states, in order.

    Args:
        prunings: How many prunings it has.
    """
    return [TUBE, *(f"{PRUNING} {i + 1}" for i in range(prunings)), FINAL, BOUND]
