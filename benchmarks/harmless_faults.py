"""Faults that make no proof, status or verdict wrong, each with the reason.

They change text that is only read, effort, or nothing at all. A place is named by the
line's text, so that it is still found after lines above it have changed.
"""

HARMLESS: tuple[tuple[str, str, str, str], ...] = ()
"""File, line, line with the fault or "*" for any, and why it does no harm."""
