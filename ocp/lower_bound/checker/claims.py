"""The statements of a certificate, in the only accepted words.

The checker judges exactly these. Free text labelled "proven" would look as if it had
been checked.
"""

from __future__ import annotations

TUBE = "every admissible trajectory stays in the tube"
PRUNING = "no trajectory that costs less than the known cost leaves the set of pruning"
FINAL = "the final step's inequalities hold on the set that the prunings leave"
BOUND = "no admissible trajectory costs less than the bound"


def expected_claims(prunings: int) -> list[str]:
    """Return the statements of a certificate, in order.

    Args:
        prunings: Number of its prunings.
    """
    return [TUBE, *(f"{PRUNING} {i + 1}" for i in range(prunings)), FINAL, BOUND]
