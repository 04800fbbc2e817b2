"""The parts of the independent checker of certificates of all kinds.

Nothing here imports the rest of swarmstart: a mistake there must not repeat itself in
the check. `swarmstart.terminal_set.check` is the command. Only what judges a terminal
set needs python-flint.
"""
