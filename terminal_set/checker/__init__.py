"""The parts of the independent checker of terminal-set certificates.

Nothing here imports the rest of swarmstart: a mistake there must not repeat itself in
the check. `swarmstart.terminal_set.check` is the command.
"""

from swarmstart.terminal_set.checker.command import (
    checked,
    parsed,
)
from swarmstart.terminal_set.checker.file_content import (
    read_content,
    unusable,
)
from swarmstart.terminal_set.checker.findings import (
    NEVER,
    Deadline,
    Finding,
    TimeIsUpError,
    Verdict,
)

__all__ = [
    "NEVER",
    "Deadline",
    "Finding",
    "TimeIsUpError",
    "Verdict",
    "checked",
    "parsed",
    "read_content",
    "unusable",
]
