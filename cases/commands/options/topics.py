"""Words that the parser, the list and the completion share."""

TOPICS = {
    "scenarios": "with kind, variants and run time",
    "searches": "search algorithms, for --search",
    "polishes": "local solvers that finish a search, for --polish",
    "measures": "numbers that a run returns, with unit and meaning",
    "kinds": "kinds of scenario",
}
"""The parts of `swarmstart list`, and what each shows."""
SHELLS = ("bash", "zsh", "tcsh")
"""Shells in which `swarmstart completion` completes."""
