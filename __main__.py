"""`python -m swarmstart` is the command line."""

import sys

from swarmstart.cases.cli import main

sys.exit(main())
