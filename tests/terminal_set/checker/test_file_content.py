"""Only regular files of bounded size are read; all others are refused at once."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmstart.terminal_set.checker.file_content import (
    BINARY,
    LARGEST_FILE,
    UNARY,
    CertificateFileError,
    DigestError,
    Entries,
    digest,
    integer,
    mapping,
    one_of,
    optional,
    read_content,
    text,
    unusable,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import chen


def fifo(path: Path) -> Path:
    os.mkfifo(path)
    return path


NO_FILES: dict[str, Callable[[Path], Path]] = {
    "a pipe that nothing writes to": fifo,
    "a device without end": lambda _: Path("/dev/zero"),
    "a folder": lambda path: path.parent,
}


@pytest.mark.skipif(os.name == "nt", reason="no pipes in the file system")
@pytest.mark.parametrize("make", NO_FILES.values(), ids=NO_FILES)
def test_what_is_no_regular_file_is_refused_without_waiting(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    with pytest.raises(CertificateFileError, match="it is no regular file"):
        read_content(make(tmp_path / "certificate.json"))


def test_files_are_read_where_no_opening_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "O_NONBLOCK")
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(chen()))
    assert read_content(file) == chen()


@pytest.mark.parametrize("more", [0, 1])
def test_a_file_may_have_twenty_megabytes_and_no_byte_more(
    more: int, tmp_path: Path
) -> None:
    file = tmp_path / "certificate.json"
    text = json.dumps(chen())
    file.write_text(text + " " * (LARGEST_FILE + more - len(text)))
    if not more:
        assert read_content(file) == chen()
        return
    with pytest.raises(CertificateFileError, match="larger than 20 MB"):
        read_content(file)


def nested(depth: int) -> str:
    text = json.dumps(chen() | {"format": "HERE"})
    return text.replace('"HERE"', "[" * depth + "]" * depth)


@pytest.mark.parametrize(
    "text", ["[" * 9_000_000, nested(100_000), nested(900), '{"a":' * 1_000_000]
)
def test_deep_nesting_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(text)
    with pytest.raises(CertificateFileError, match=r"nested too deeply|is no"):
        read_content(file)


def test_nesting_that_can_be_read_but_not_written_is_refused(tmp_path: Path) -> None:
    """Between the depths that the reader and the digest can bear."""
    file = tmp_path / "certificate.json"
    for depth in range(700, 1100, 7):
        text = json.dumps(chen() | {"design": "HERE"})
        file.write_text(text.replace('"HERE"', "[" * depth + "]" * depth))
        with pytest.raises((CertificateFileError, DigestError)):
            read_content(file)


def test_a_digest_of_other_content_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(chen() | {"alpha": 0.5}))
    with pytest.raises(DigestError, match=digest(chen() | {"alpha": 0.5})):
        read_content(file)


@pytest.mark.parametrize("stated", [None, 7, "", "0" * 63, "0" * 65, "g" * 64])
def test_what_is_no_digest_is_refused_as_none(stated: object, tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(chen() | {"sha256": stated}))
    with pytest.raises(CertificateFileError, match="64 hexadecimal digits"):
        read_content(file)


READ = Entries(largest=100.0, longest=3, longest_tape=4)
ANY = Entries(longest_tape=4)
Read = Callable[[], Any]


VALID: dict[str, tuple[Read, object]] = {
    "all keys": (lambda: mapping({"b": 1, "a": 2}, "at", "a b"), {"a": 2, "b": 1}),
    "least integer": (lambda: integer(-1, "at", -1, 3), -1),
    "largest integer": (lambda: integer(3, "at", -1, 3), 3),
    "text": (lambda: text("a", "at"), "a"),
    "one of two": (lambda: one_of("b", "at", ("a", "b")), "b"),
    "missing": (lambda: optional(None, "at", READ.number), None),
    "present": (lambda: optional(2, "at", READ.number), 2.0),
    "largest number": (lambda: READ.number(-100.0, "at"), -100.0),
    "number of any size": (lambda: ANY.number(1e308, "at"), 1e308),
    "integer of 53 bits": (lambda: ANY.number(2**53, "at"), 2.0**53),
    "zero": (lambda: READ.at_least_zero(0, "at"), 0.0),
    "tiny": (lambda: READ.positive(5e-324, "at"), 5e-324),
    "one": (lambda: READ.positive(1, "at"), 1.0),
    "longest list": (lambda: READ.vector([1, 2, 3], "at", None), (1.0, 2.0, 3.0)),
    "list of any length": (lambda: ANY.vector([0] * 99, "at", 99), (0.0,) * 99),
    "empty list": (lambda: READ.vector([], "at", 0), ()),
    "matrix": (lambda: READ.matrix([[1, 2], [3, 4]], "at", 2, 2), ((1, 2), (3, 4))),
    "limits": (lambda: READ.limits([None, 1], "at", 2), (None, 1.0)),
    "numbers": (lambda: READ.numbers([0, 2, 1], "at", 3, None), (0, 2, 1)),
    "shortest tape": (
        lambda: READ.tape([["const", 2.5]], "at", {"x": 2}),
        (("const", (), 2.5),),
    ),
    "longest tape": (
        lambda: ANY.tape(
            [["x", 1], ["neg", 0], ["mul", 1, 0], ["sq", 2]], "at", {"x": 2}
        ),
        (("x", (1,), 0.0), ("neg", (0,), 0.0), ("mul", (1, 0), 0.0), ("sq", (2,), 0.0)),
    ),
}


@pytest.mark.parametrize(("read", "expected"), VALID.values(), ids=VALID)
def test_valid_entries_are_read_as_they_are(read: Read, expected: object) -> None:
    assert read() == expected


X = ["x", 0]
INVALID: dict[str, tuple[Read, str]] = {
    "no object": (lambda: mapping([1], "at", "a"), r"at: expected an object"),
    "missing key": (
        lambda: mapping({"a": 1}, "at", "a b"),
        r'the key "b", found \'none',
    ),
    "key too many": (
        lambda: mapping({"a": 1, "b": 2, "c": 3}, "at", "a b"),
        r"at: expected only the keys a, b, found 'c'",
    ),
    "integer too small": (lambda: integer(-2, "at", -1, 3), r"from -1 to 3, found -2"),
    "integer too large": (lambda: integer(4, "at", -1, 3), r"from -1 to 3, found 4"),
    "true as an integer": (
        lambda: integer(True, "at", -1, 3),
        r"an integer, found True",
    ),
    "float as an integer": (
        lambda: integer(1.0, "at", -1, 3),
        r"an integer, found 1\.0",
    ),
    "number as a text": (lambda: text(1, "at"), r"a text, found 1"),
    "third text": (lambda: one_of("c", "at", ("a", "b")), r'"a" or "b", found \'c'),
    "true as a number": (lambda: READ.number(True, "at"), r"a number, found True"),
    "text as a number": (lambda: READ.number("1", "at"), r"a number, found '1'"),
    "number too large": (lambda: READ.number(100.1, "at"), r"at most 100 in size"),
    "number too small": (lambda: READ.number(-100.1, "at"), r"at most 100 in size"),
    "integer beyond floats": (lambda: ANY.number(10**400, "at"), r"a finite number"),
    "infinite": (lambda: ANY.number(math.inf, "at"), r"of double precision"),
    "not a number": (lambda: ANY.number(math.nan, "at"), r"of double precision"),
    "integer of 54 bits": (lambda: ANY.number(2**53 + 1, "at"), r"double precision"),
    "below zero": (lambda: READ.at_least_zero(-5e-324, "at"), r"of at least 0"),
    "zero, not positive": (
        lambda: READ.positive(0, "at"),
        r"a number above 0, found 0",
    ),
    "no list": (lambda: READ.vector({"a": 1}, "at", 1), r"at: expected a list"),
    "list too short": (
        lambda: READ.vector([1], "at", 2),
        r"list of 2, found '1 entries",
    ),
    "list too long": (lambda: READ.vector([1, 2], "at", 1), r"of 1, found '2 entries"),
    "list beyond all": (lambda: READ.vector([0] * 4, "at", None), r"at most 3 entries"),
    "wrong entry": (lambda: READ.vector([1, "a"], "at", 2), r"at\[1\]: expected a num"),
    "short row": (lambda: READ.matrix([[1, 2], [3]], "at", 2, 2), r"at\[1\]: .* of 2"),
    "missing row": (lambda: READ.matrix([[1, 2]], "at", 2, 2), r"a list of 2"),
    "number of none": (
        lambda: READ.numbers([0, 3], "at", 3, None),
        r"at\[1\]: .* 0 to 2",
    ),
    "limits of one": (lambda: READ.limits([1], "at", 2), r"a list of 2"),
    "no tape": (lambda: READ.tape("a", "at", {}), r"at: expected a list"),
    "empty tape": (lambda: READ.tape([], "at", {}), r"1 to 4 instructions, found 0"),
    "tape too long": (lambda: ANY.tape([X] * 5, "at", {"x": 1}), r"1 to 4 .* found 5"),
    "empty instruction": (
        lambda: READ.tape([[]], "at", {}),
        r"at\[0\]\[0\]: .* a text",
    ),
    "unknown operation": (lambda: READ.tape([["y", 0]], "at", {"x": 1}), r"a known op"),
    "one operand of two": (lambda: ANY.tape([X, ["add", 0]], "at", {"x": 1}), r"of 3"),
    "two operands of one": (
        lambda: ANY.tape([X, ["neg", 0, 0]], "at", {"x": 1}),
        r"of 2",
    ),
    "constant of two": (lambda: ANY.tape([["const", 1, 2]], "at", {}), r"a list of 2"),
    "constant of text": (lambda: ANY.tape([["const", "a"]], "at", {}), r"at\[0\]\[1\]"),
    "own result": (
        lambda: ANY.tape([X, ["neg", 1]], "at", {"x": 1}),
        r"0 to 0, found 1",
    ),
    "second operand": (
        lambda: ANY.tape([X, ["add", 0, 1]], "at", {"x": 1}),
        r"at\[1\]\[2\]: expected an integer from 0 to 0, found 1",
    ),
    "operand below": (lambda: ANY.tape([X, ["neg", -1]], "at", {"x": 1}), r"found -1"),
    "first on an earlier": (
        lambda: ANY.tape([["neg", 0]], "at", {"x": 1}),
        r"on an earl",
    ),
    "input too many": (
        lambda: ANY.tape([["x", 2]], "at", {"x": 2}),
        r"0 to 1, found 2",
    ),
    "input of none": (lambda: ANY.tape([["x", 0]], "at", {"x": 0}), r"on an earlier"),
}


@pytest.mark.parametrize(("read", "message"), INVALID.values(), ids=INVALID)
def test_invalid_entries_are_refused_with_their_place(read: Read, message: str) -> None:
    with pytest.raises(CertificateFileError, match=message):
        read()


@pytest.mark.parametrize("name", sorted(UNARY | BINARY))
def test_operations_take_their_number_of_operands(name: str) -> None:
    operands = [0] * (1 if name in UNARY else 2)
    tape = ANY.tape([X, [name, *operands]], "at", {"x": 1})
    assert tape[1] == (name, tuple(operands), 0.0)
    with pytest.raises(CertificateFileError, match=rf"a list of {len(operands) + 1}"):
        ANY.tape([X, [name, *operands, 0]], "at", {"x": 1})


def test_long_values_are_shown_in_short() -> None:
    assert len(str(unusable("at", "a text", "x" * 10**6))) < 100


def write(path: Path, content: str) -> Path:
    path.write_text(content, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not valid JSON"),
        ('{"a": NaN}', "NaN is no number"),
        ('{"a": 1, "a": 2}', "a key is given twice"),
        ('{"a": 1e999}', "the file is no"),
        ("[]", "the file is no"),
        ("{}", "the file is no"),
        ('{"format": ["swarmstart terminal set certificate"]}', "the file is no"),
    ],
)
def test_other_files_are_refused(content: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(CertificateFileError, match=message):
        read_content(write(tmp_path / "a.json", content))


def test_a_number_that_is_not_finite_has_no_digest(tmp_path: Path) -> None:
    text_of = json.dumps(chen()).replace("0.5", "1e999", 1)
    with pytest.raises(CertificateFileError, match="a number is not finite"):
        read_content(write(tmp_path / "a.json", text_of))


def test_a_digest_does_not_depend_on_the_order_or_on_itself() -> None:
    assert digest({"a": 1, "b": [2], "sha256": "x"}) == digest({"b": [2], "a": 1})
    assert digest({"a": 1}) != digest({"a": 2})
