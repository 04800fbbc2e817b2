"""The parts of the independent checker of terminal-set certificates.

Nothing here imports the rest of swarmstart: a mistake there must not repeat itself in
the check. `swarmstart.terminal_set.check` is the command.
"""
