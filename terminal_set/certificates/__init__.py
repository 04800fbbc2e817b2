"""Terminal sets and their certificates: K, P and level, with the evidence for them.

`design.py` makes the set that bounds alone allow; `proving` certifies it.
"""

from swarmstart.terminal_set.certificates.certificate import (
    digest,
)

__all__ = [
    "digest",
]
