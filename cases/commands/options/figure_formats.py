"""Formats of the figures that a command was asked for."""

import argparse

from swarmstart.cases.record.record import PNG


def figure_formats(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the formats of the figures of `run`, each once."""
    return tuple(dict.fromkeys(options.formats)) or PNG
