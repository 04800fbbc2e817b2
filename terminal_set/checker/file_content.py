"""Reader of certificate files: limits of size, the digest, and entries of the JSON.

Every entry is a number, a list or one of a few known words; nothing is executed.

The digest is SHA-256 of all keys but "sha256" as JSON with sorted keys, no spaces and
ASCII only. It detects accidents and careless edits; a file with a new digest must still
pass the proof.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import reprlib
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

TERMINAL_SET = "swarmstart terminal set certificate"
LOWER_BOUND = "swarmstart lower bound certificate"
SWARM_FLIGHT = "swarmstart swarm flight certificate"
LARGEST_FILE = 20_000_000  # bytes; a hundred vehicles have some millions
UNARY = frozenset("neg sq twice inv fabs sqrt sin cos tan exp log atan tanh".split())
BINARY = frozenset("add sub mul div pow fmin fmax".split())

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]
Limits = tuple[float | None, ...]
Instruction = tuple[str, tuple[int, ...], float]
T = TypeVar("T")

FORMATS = [
    TERMINAL_SET,
    LOWER_BOUND,
    SWARM_FLIGHT,
]  # no set: what a file has may not be hashable
_DIGEST = re.compile("[0-9a-f]{64}")


class CertificateFileError(ValueError):
    """The file is not a valid certificate."""


class DigestError(ValueError):
    """The file does not match its digest: it was changed after it was written."""


def read_content(path: Path) -> dict[str, object]:
    """Read a file and compare its digest.

    Args:
        path: The file.

    Returns:
        The file as a mapping.

    Raises:
        OSError: If the file cannot be read.
        CertificateFileError: If it is not a regular file, too large, or not JSON of one
            of the formats.
        DigestError: If it was changed after it was written.
    """
    try:
        content = json.loads(
            read_bounded(path).decode(),
            parse_constant=_refuse_constant,
            object_pairs_hook=_without_repetition,
        )
    except RecursionError:
        raise CertificateFileError("the file is nested too deeply") from None
    except ValueError as error:
        raise CertificateFileError(f"the file is not valid JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") not in FORMATS:
        names = ", ".join(f'"{name}"' for name in FORMATS)
        raise CertificateFileError(f"the file is none of {names}")
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


def read_bounded(path: Path) -> bytes:
    """Return the bytes of a file, which must be a regular one of at most LARGEST_FILE.

    Raises:
        OSError: If it cannot be read.
        CertificateFileError: If it is another kind of file, or too large.
    """
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


def mapping(value: object, where: str, names: str) -> dict[str, object]:
    """Return a JSON object; its keys must be exactly the words of the text `names`."""
    keys = set(names.split())
    if not isinstance(value, dict):
        raise unusable(where, "an object", value)
    for key in sorted(keys - set(value)):
        raise unusable(where, f'the key "{key}"', "none")
    for key in sorted(set(value) - keys):
        raise unusable(where, "only the keys " + ", ".join(sorted(keys)), key)
    return value


def integer(value: object, where: str, least: int, most: int) -> int:
    """Return a whole number within limits."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise unusable(where, "an integer", value)
    if not least <= value <= most:
        raise unusable(where, f"an integer from {least} to {most}", value)
    return value


def text(value: object, where: str) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise unusable(where, "a text", value)
    return value


def one_of(value: object, where: str, allowed: tuple[str, ...]) -> str:
    """Return a text, which must be one of `allowed`."""
    if text(value, where) not in allowed:
        raise unusable(where, " or ".join(f'"{name}"' for name in allowed), value)
    return str(value)


def optional(value: object, where: str, read: Callable[[object, str], T]) -> T | None:
    """Return None for None, and any other value as `read` returns it."""
    return None if value is None else read(value, where)


@dataclass(frozen=True, kw_only=True, slots=True)
class Entries:
    """Readers of numbers and lists, with the limits of a kind of file.

    Attributes:
        largest: Largest absolute value of a number.
        longest: Largest number of entries of a list.
        longest_tape: Largest number of instructions of a tape.
    """

    largest: float = math.inf
    longest: float = math.inf
    longest_tape: int

    def number(self, value: object, where: str) -> float:
        """Return a finite number."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise unusable(where, "a number", value)
        try:
            number = float(value)
        except OverflowError:
            raise unusable(where, "a finite number", value) from None
        # An integer above 2^53 would be read as another number than the written one.
        if not math.isfinite(number) or number != value:
            raise unusable(where, "a finite number of double precision", value)
        if abs(number) > self.largest:
            expected = f"a number of at most {self.largest:g} in size"
            raise unusable(where, expected, value)
        return number

    def at_least_zero(self, value: object, where: str) -> float:
        """Return a number that is not negative."""
        number = self.number(value, where)
        if number < 0.0:
            raise unusable(where, "a number of at least 0", value)
        return number

    def positive(self, value: object, where: str) -> float:
        """Return a number above 0."""
        number = self.number(value, where)
        if not number > 0.0:
            raise unusable(where, "a number above 0", value)
        return number

    def list_of(
        self,
        value: object,
        where: str,
        length: int | None,
        read: Callable[[object, str], T],
    ) -> tuple[T, ...]:
        """Return the entries of a list, each as a reader returns it.

        Args:
            value: The list.
            where: Its place in the file.
            length: Number of its entries; None means any.
            read: Reader of an entry: (entry, its place) -> the value to return.
        """
        if not isinstance(value, list):
            raise unusable(where, "a list", value)
        if length is not None and len(value) != length:
            raise unusable(where, f"a list of {length}", f"{len(value)} entries")
        if len(value) > self.longest:
            raise unusable(where, f"at most {self.longest} entries", len(value))
        return tuple(read(entry, f"{where}[{i}]") for i, entry in enumerate(value))

    def vector(self, value: object, where: str, length: int | None) -> Vector:
        """Return a list of numbers."""
        return self.list_of(value, where, length, self.number)

    def matrix(
        self, value: object, where: str, rows: int | None, columns: int
    ) -> Matrix:
        """Return a list of rows."""
        return self.list_of(
            value, where, rows, lambda row, at: self.vector(row, at, columns)
        )

    def limits(self, value: object, where: str, length: int) -> Limits:
        """Return a list of numbers, each of which may be None."""
        return self.list_of(
            value, where, length, lambda entry, at: optional(entry, at, self.number)
        )

    def numbers(
        self, value: object, where: str, count: int, length: int | None
    ) -> tuple[int, ...]:
        """Return a list of indices of instructions, each below `count`."""
        return self.list_of(
            value, where, length, lambda entry, at: integer(entry, at, 0, count - 1)
        )

    def tape(
        self, value: object, where: str, inputs: Mapping[str, int]
    ) -> tuple[Instruction, ...]:
        """Return the instructions of a tape.

        Args:
            value: The list of instructions.
            where: Its place in the file.
            inputs: Name of an input, such as "x" -> number of its entries.
        """
        length = len(value) if isinstance(value, list) else 1
        if not 1 <= length <= self.longest_tape:
            raise unusable(where, f"1 to {self.longest_tape} instructions", length)
        kept: list[Instruction] = []

        def read(entry: object, at: str) -> None:
            kept.append(self._instruction(entry, at, inputs, len(kept)))

        self.list_of(value, where, None, read)
        return tuple(kept)

    def _instruction(
        self, value: object, where: str, inputs: Mapping[str, int], number: int
    ) -> Instruction:
        parts = self.list_of(value, where, None, lambda part, _: part)
        operation = text(parts[0] if parts else None, f"{where}[0]")
        counts = dict.fromkeys(("const", *inputs), 1)
        counts |= dict.fromkeys(UNARY, 1) | dict.fromkeys(BINARY, 2)
        if operation not in counts:
            raise unusable(f"{where}[0]", "a known operation", operation)
        self.list_of(value, where, counts[operation] + 1, lambda part, _: part)
        if operation == "const":
            return operation, (), self.number(parts[1], f"{where}[1]")
        # Operands are results of earlier instructions, so that there is no loop.
        most = inputs.get(operation, number) - 1
        if most < 0:
            raise unusable(where, "an operation on an earlier instruction", operation)
        operands = tuple(
            integer(part, f"{where}[{i}]", 0, most)
            for i, part in enumerate(parts[1:], start=1)
        )
        return operation, operands, 0.0
