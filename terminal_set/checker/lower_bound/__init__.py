"""Checks of certificates of lower bounds.

`swarmstart.terminal_set.check` is the command.
"""
