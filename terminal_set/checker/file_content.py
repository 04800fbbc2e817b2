"""A certificate file as data: regular, bounded in size, JSON, its digest compared.

The digest is SHA-256 of all keys but "sha256" as JSON with sorted keys, no spaces and
ASCII only. It detects accidents and careless edits; a file with a new digest must still
pass the proof.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import reprlib
import stat
from pathlib import Path

FORMAT = "swarmstart terminal set certificate"
LARGEST_FILE = 10_000_000  # bytes; a genuine one has some thousands
_DIGEST = re.compile("[0-9a-f]{64}")


class CertificateFileError(ValueError):
    """The file is not a valid certificate."""


class DigestError(ValueError):
    """The file does not match its digest: it was changed after it was written."""


def read_content(path: Path, format_name: str = FORMAT) -> dict[str, object]:
    """Read a file and compare its digest.

    Args:
        path: The file.
        format_name: Required value of its key "format".

    Returns:
        The file as a mapping.

    Raises:
        OSError: If the file cannot be read.
        CertificateFileError: If it is not a regular file, too large, or not JSON of the
            format.
        DigestError: If it was changed after it was written.
    """
    try:
        content = json.loads(
            _read(path).decode(),
            parse_constant=_refuse_constant,
            object_pairs_hook=_without_repetition,
        )
    except RecursionError:
        raise CertificateFileError("the file is nested too deeply") from None
    except ValueError as error:
        raise CertificateFileError(f"the file is not valid JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != format_name:
        raise CertificateFileError(f'the file is no "{format_name}"')
    _compare_digest(content)
    return content


def digest(content: dict[str, object]) -> str:
    """Compute SHA-256 of everything but the digest itself.

    Args:
        content: The file as a mapping.

    Returns:
        64 hexadecimal digits.
    """
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(
        rest, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()


def unusable(where: str, expected: str, found: object) -> CertificateFileError:
    """Return the error of one entry: its place, what was expected, what was found."""
    shown = reprlib.repr(found)  # Of bounded length and depth.
    return CertificateFileError(f"{where}: expected {expected}, found {shown}")


def _read(path: Path) -> bytes:
    # Without O_NONBLOCK, opening a pipe would block before its type can be checked.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise CertificateFileError("it is no regular file")
    with os.fdopen(descriptor, "rb") as file:
        content = file.read(LARGEST_FILE + 1)
    if len(content) > LARGEST_FILE:
        largest = LARGEST_FILE // 1_000_000
        raise CertificateFileError(f"the file is larger than {largest} MB")
    return content


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number")


def _without_repetition(pairs: list[tuple[str, object]]) -> dict[str, object]:
    names = [name for name, _ in pairs]
    if len(set(names)) < len(names):
        raise ValueError("a key is given twice")
    return dict(pairs)


def _compare_digest(content: dict[str, object]) -> None:
    stated = content.get("sha256")
    if not isinstance(stated, str) or not _DIGEST.fullmatch(stated):
        raise unusable("sha256", "64 hexadecimal digits", stated)
    try:
        computed = digest(content)
    except RecursionError:
        raise CertificateFileError("the file is nested too deeply") from None
    except ValueError as error:
        raise CertificateFileError(f"a number is not finite: {error}") from error
    if stated != computed:
        raise DigestError(f"the file's digest is {stated}, its content's is {computed}")
