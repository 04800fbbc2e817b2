"""Description of the machine that did a cell, without data about its owner."""

from __future__ import annotations

import os
import platform
from functools import cache
from pathlib import Path
from typing import Any

CPU_INFO = Path("/proc/cpuinfo")
_MODEL = "model name"


@cache
def machine() -> dict[str, Any]:
    """Return processor, cores, system and Python; no names of hosts, users or folders.

    Example:
        >>> sorted(machine())
        ['cores', 'processor', 'python', 'system']
    """
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def load() -> float | None:
    """Return the load average of the last minute; None if the system has none."""
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):
        return None


def _processor() -> str:
    """Return the processor's name, or that of its architecture."""
    try:
        lines = CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        name, _, value = line.partition(":")
        if name.strip() == _MODEL and value.strip():
            return " ".join(value.split())
    return platform.processor() or platform.machine()
