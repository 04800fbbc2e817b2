"""Descriptions of the keys of a scenario, taken from the docstrings of their classes.

A class says under "Attributes:" what each of its keys means, once for readers of the
code and of the JSON Schema. An entry is a name, a colon and a sentence.
"""

import inspect
import re

_HEADING = "Attributes:"
_ENTRY = re.compile(r"    (\w+): (.*)")


def attributes_of(given: type) -> dict[str, str]:
    """Return the texts under "Attributes:" of a class and its bases, by name.

    The text of a class takes the place of that of its bases.
    """
    texts: dict[str, str] = {}
    for one in reversed(given.__mro__):
        texts |= _entries(inspect.cleandoc(one.__doc__ or ""))
    return texts


def summary_of(docstring: str) -> str:
    """Return a docstring without its sections."""
    return inspect.cleandoc(docstring).partition(f"\n\n{_HEADING}")[0]


def _entries(text: str) -> dict[str, str]:
    """Return the entries of the section "Attributes:" of a docstring, each in one line.

    A sentence begins with a capital letter, whatever name it begins with in the code.
    """
    lines = text.splitlines()
    if _HEADING not in lines:
        return {}
    entries: dict[str, list[str]] = {}
    name = ""
    for line in lines[lines.index(_HEADING) + 1 :]:
        if line and not line.startswith(" "):
            break
        found = _ENTRY.fullmatch(line)
        if found is not None:
            name = found[1]
            entries[name] = [found[2]]
        elif name and line:
            entries[name].append(line.strip())
    joined = {name: " ".join(parts) for name, parts in entries.items()}
    return {name: said[:1].upper() + said[1:] for name, said in joined.items()}
