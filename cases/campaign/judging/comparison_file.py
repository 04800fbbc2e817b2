"""A comparison read from a user's file, checked before use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.judging.comparison_shape import fault_of, short
from swarmstart.cases.campaign.judging.content import SCHEMA
from swarmstart.cases.record.files import RecordError, said

MOST_BYTES = 200 * 1024 * 1024


def read_comparison(path: Path) -> dict[str, Any]:
    """Return a comparison written by `compare`.

    Args:
        path: comparison.json, or the folder that holds it.

    Returns:
        Its content, as from `content_of`.

    Raises:
        RecordError: If the file cannot be read, or has another form.
    """
    file = path / "comparison.json" if path.is_dir() else path
    try:
        if file.stat().st_size > MOST_BYTES:
            raise _foreign(file, f"more than {MOST_BYTES >> 20} MiB")
        content = json.loads(file.read_text(encoding="utf-8"), parse_constant=_refuse)
    except OSError as error:
        raise RecordError(f"{file}: expected a comparison: {said(error)}") from error
    except (ValueError, RecursionError) as error:  # JSON, UTF-8, a NUL, huge numbers
        raise _foreign(file, "a file that is not JSON") from error
    if not isinstance(content, dict) or content.get("record") != "comparison":
        raise _foreign(file, "other JSON")
    if content.get("schema") != SCHEMA:
        raise _foreign(file, f"schema {short(content.get('schema'))}")
    fault = fault_of(content)
    if fault:
        raise _foreign(file, fault)
    return content


def _foreign(file: Path, found: str) -> RecordError:
    return RecordError(
        f"{file}: expected a comparison of schema {SCHEMA}, as `swarmstart compare` "
        f"writes it; found {found}"
    )


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is not a number of JSON")
