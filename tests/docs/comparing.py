"""Comparison of two texts: words exactly, numbers as far as the first shows digits."""

from __future__ import annotations

import re
from itertools import zip_longest

NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.\d*|\.?\d+)(?:e[-+]?\d+)?", re.IGNORECASE)
UNITS_OF_THE_LAST_DIGIT = 2.0
"""Allowed difference of a number: it was rounded, on another processor perhaps."""


def differences(shown: str, printed: str) -> list[str]:
    """Return the places at which a page shows something else than was printed.

    Args:
        shown: The text of the page; a line "..." stands for any lines, "..." within
            a line for any characters.
        printed: What was printed.
    """
    ours, theirs = _lines(shown), _lines(printed)
    if "..." in ours:
        return _with_gaps(ours, theirs)
    return [
        f"the page shows {a!r}, printed was {b!r}"
        for a, b in zip_longest(ours, theirs, fillvalue="")
        if not _is_like(a, b)
    ]


def _lines(text: str) -> list[str]:
    return [
        " ".join(line.split()) for line in text.strip().splitlines() if line.strip()
    ]


def _with_gaps(ours: list[str], theirs: list[str]) -> list[str]:
    """Find the lines between gaps in order; return those that are missing."""
    at, missing, after_gap = 0, [], False
    for line in ours:
        if line == "...":
            after_gap = True
            continue
        places = range(at, len(theirs) if after_gap else min(at + 1, len(theirs)))
        found = next((k for k in places if _is_like(line, theirs[k])), None)
        if found is None:
            missing.append(f"the page shows {line!r}, which was not printed there")
        else:
            at, after_gap = found + 1, False
    return missing


def _is_like(shown: str, printed: str) -> bool:
    """Return whether two lines agree; "..." in the first stands for any text."""
    numbers: list[str] = NUMBER.findall(shown)
    pattern = NUMBER.sub("\0", shown)
    pattern = re.escape(pattern).replace(r"\.\.\.", ".*")
    pattern = pattern.replace("\0", f"({NUMBER.pattern})")
    match = re.fullmatch(pattern, printed, re.IGNORECASE)
    if match is None:
        return False
    return all(
        abs(float(a) - float(b)) <= UNITS_OF_THE_LAST_DIGIT * _last_digit(a)
        for a, b in zip(numbers, match.groups(), strict=True)
    )


def _last_digit(number: str) -> float:
    """Return the size of one unit of a number's last digit; 0 of a whole number."""
    digits, _, exponent = number.lower().partition("e")
    _, point, decimals = digits.partition(".")
    if not point and not exponent:
        return 0.0
    return float(10.0 ** (int(exponent or 0) - len(decimals)))
