"""How long work tells the program that asked for it how far it is."""

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""(done, of, what is being done) -> None. The library itself prints nothing."""


def tell_nothing(done: int, of: int, what: str, /) -> None:
    """Tell nothing: the default."""
