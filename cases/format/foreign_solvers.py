"""Options of NLP solvers of other packages that a scenario file may set.

A file is data. An option of a solver could name a library to load (hsllib), a file to
write (output_file) or a compiler to run (jit), so those are refused, and so is text
that could be the path of a plug-in or a library. A file may set none of the options
that reach beyond the solve.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

_BEYOND = (
    *("hsllib", "pardisolib", "output_file", "option_file", "jit", "compiler"),
    *("dump", "external", "custom_jacobian", "cache"),
)
"""Beginnings of options that name files or run programs."""
_WORD = re.compile(r"[A-Za-z0-9_.,+ -]{0,100}")


def reaches_beyond(name: str, value: Any) -> bool:
    """Return whether an option could name a file or run a program.

    Args:
        name: Name of the option, perhaps with a prefix such as "ipopt.".
        value: Its value.

    Example:
        >>> reaches_beyond("ipopt.hsllib", "mine.so"), reaches_beyond("mu_init", 0.1)
        (True, False)
    """
    # Every part, since a prefix such as "ipopt." may be there; IPOPT ignores case.
    if any(part.casefold().startswith(_BEYOND) for part in name.split(".")):
        return True
    return isinstance(value, str) and not _WORD.fullmatch(value)


def refused(options: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield name and error of each option that a user's file may not set."""
    for name, value in options.items():
        if reaches_beyond(name, value):
            yield (
                name,
                "expected an option that neither names a file nor runs a program, "
                f"found {name}",
            )
