"""The command line, as `swarmstart` and as `python -m swarmstart`."""

import importlib
import sys


def program() -> int:
    """Run the command of sys.argv; return its exit code, 130 if it is interrupted."""
    try:
        cli = importlib.import_module("swarmstart.cases.commands.front.cli")
    except KeyboardInterrupt:  # Nothing handles signals before it is imported.
        return 130
    return int(cli.program())


if __name__ == "__main__":
    sys.exit(program())
