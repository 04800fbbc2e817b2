"""`swarmstart cache`: show the cache of machine code, or remove its files."""

import argparse
import json

from swarmstart.cases.commands.terminal import answer
from swarmstart.cases.format.document import counted
from swarmstart.cases.record.files import RecordError
from swarmstart.machine_code import LIMIT_BYTES, cache_usage, clear_cache

_MB = 1e6


def cache_command(options: argparse.Namespace) -> int:
    """Print folder and size of the cache, or clear the cache; return the exit code.

    Raises:
        RecordError: If a file cannot be removed.
    """
    removed = None  # Not asked for; 0: there was nothing to remove.
    if options.clear:
        try:
            removed = clear_cache()
        except OSError as error:
            message = f"{error.filename}: expected to remove it: {error.strerror}"
            raise RecordError(message) from error
    # After the removal, so that it shows what is left.
    now = cache_usage()
    told = {
        "folder": str(now.folder),
        "files": now.files,
        "bytes": now.bytes,
        "limit_bytes": LIMIT_BYTES,
        "refused": now.refused,
        **({} if removed is None else {"removed": removed}),
    }
    if options.json:
        answer(json.dumps(told, indent=2))
        return 0
    size = f"{now.bytes / _MB:.1f} MB of at most {LIMIT_BYTES / _MB:.0f} MB"
    lines = [f"folder   {now.folder}", f"files    {now.files}, {size}"]
    if now.refused is not None:
        lines.append(f"not used: {now.refused}; machine code is made in each process")
    if removed is not None:
        lines.append(f"removed  {counted(removed, 'file')}")
    answer("\n".join(lines))
    return 0
