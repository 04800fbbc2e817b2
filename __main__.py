"""`python -m swarmstart` is the command line."""

import sys

from swarmstart.cases.commands.cli import program

sys.exit(program())
