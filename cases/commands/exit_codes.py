"""Exit codes of the command line, as its help lists them."""

DONE, INTERNAL, INVALID, GATE, INFEASIBLE, FILE, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
