"""The base of every error a user of swarmstart can cause.

Each folder derives its own classes in the module that raises them; each carries, as
attributes, the data a program needs to react, and a message that says what was
expected, what was found and where.
"""


class SwarmstartError(Exception):
    """Base of all errors a caller can cause; the message says what is wrong and why."""
