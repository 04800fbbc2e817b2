"""The parts of the independent checker of certificates of lower bounds.

Nothing here imports CasADi or the code that finds or writes a bound: a mistake there
must not repeat itself in the check. `swarmstart.ocp.lower_bound.check` is the command.
"""
