"""Files that a scenario names, of code that others have written.

They lie in the scenario's folder or below, and are identified by their hash. Reading a
scenario hashes them; nothing here loads or runs one.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from swarmstart.cases.format.document import printable, shown

LONGEST = 300
"""Largest number of characters of a path."""
MOST_BYTES = 2**30
"""Largest file [bytes]."""
_PART = 2**20


@dataclass(frozen=True, kw_only=True, slots=True)
class ForeignFile:
    """A file that was hashed, but not loaded.

    Attributes:
        file: The file.
        sha256: The hash of its content, in hexadecimal.
    """

    file: Path
    sha256: str

    def __str__(self) -> str:
        """Return its name, as in a scenario of the same folder."""
        return self.file.name


def file_below(given: object, folder: Path, suffix: str = "") -> Path | None:
    """Return the path of a file in a folder or below.

    Args:
        given: The path as the scenario gives it.
        folder: The scenario's folder.
        suffix: End that the file's name must have; empty allows any name.

    Returns:
        The path; None if it leads elsewhere, or has another end, or is no text. It is
        not checked whether the file exists.
    """
    if not (isinstance(given, str) and 0 < len(given) <= LONGEST):
        return None
    path = PurePosixPath(given)
    is_below = not path.is_absolute() and ".." not in path.parts
    is_plain = "\\" not in given and "\0" not in given
    fits = path.name.lower().endswith(suffix)
    return folder / path if is_below and is_plain and fits else None


def foreign_file(given: object, folder: Path, *, key: str, suffix: str) -> ForeignFile:
    """Return a file that a scenario names.

    Args:
        given: The path as the scenario gives it.
        folder: The scenario's folder.
        key: Key of the scenario that names the file, for messages.
        suffix: End that the file's name must have.

    Raises:
        ValueError: If there is no such file in the folder or below, or it is too large.
    """
    file = file_below(given, folder, suffix)
    if file is None:
        raise ValueError(
            f"expected {key} to be a file in the scenario's folder or below, such as "
            f"plant{suffix}; found {shown(str(given))}"
        )
    return ForeignFile(file=file, sha256=hash_of(file))


def hash_of(file: Path) -> str:
    """Return the hash of a file's content.

    Raises:
        ValueError: If it cannot be read, or is too large.
    """
    found, rest = hashlib.sha256(), MOST_BYTES
    try:
        if not file.is_file():  # Not a pipe, from which reading would not end.
            raise FileNotFoundError("no such file")
        with file.open("rb") as stream:
            while part := stream.read(_PART):
                found.update(part)
                rest -= len(part)
                if rest < 0:
                    raise OSError(f"more than {MOST_BYTES:,} bytes")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ValueError(
            f"{printable(str(file))}: expected a file that can be read: {why}"
        ) from None
    return found.hexdigest()
