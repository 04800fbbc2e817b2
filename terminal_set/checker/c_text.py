"""Comparison of a certificate with the C file of a controller.

The gain, the matrix and the level of the set, the reference, the bounds of the inputs,
the time for which an input is held and the number of integrator steps in it are read
from the text of the file, and must be those of the certificate bit by bit. The
functions that apply the law must be, word by word, those that exported controllers
have. Nothing else of the file is judged: only a program that is compiled with it can
show whether the rest of its code calls these functions, and what its header defines. A
file that could say one thing to this reader and another to a compiler is refused: one
with directives that exported controllers do not have, with a constant that is given
twice, or with words of the language that are defined anew. A macro must be a number or
one of those of exported controllers: any other macro could change what the text of the
law means.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
    read_bounded,
)
from swarmstart.terminal_set.checker.findings import Finding, Verdict

_HEXADECIMAL = r"-?0x[01]\.[0-9a-f]{1,13}p[+-]\d{1,4}"
_DIRECTIVE = re.compile(
    r'#(include ("\w+\.h"|<(math|stdint|string)\.h>)|ifdef __FAST_MATH__'
    rf'|error "[^"\\]*"|endif|define \w+ (\d+(ul)?|\(?{_HEXADECIMAL}\)?)'
    r"|define INFINITE \(\(real\)INFINITY\)|define NOT_A_NUMBER \(\(real\)NAN\)"
    r"|define SIGNALS\(k\) (m->signals|\(m->signals \+ \(k\) \* CHECKS \* NS\))"
    r"|define RUN\(name\) \(name\(m\), m->operations \+= OPERATIONS_##name\))"
)
_LAW = (
    """
static int is_inside(const real x[NX]) {
  real value = 0;
  int i, j;
  for (i = 0; i < NX; ++i) {
    real row = 0;
    for (j = 0; j < NX; ++j) {
      row += set_matrix[i * NX + j] * (x[j] - x_reference[j]);
    }
    value += (x[i] - x_reference[i]) * row;
  }
  return value <= set_level[0];
}
""",
    """
static void follow_law(memory_t *m, const real x[NX]) {
  real here[NX], after[NX], cost, broken;
  int k, i, j;
  memcpy(here, x, sizeof here);
  for (k = 0; k < N; ++k) {
    for (i = 0; i < NU; ++i) {
      real u = u_reference[i];
      for (j = 0; j < NX; ++j) {
        u -= gain[i * NX + j] * (here[j] - x_reference[j]);
      }
      m->plan[k * NU + i] = clipped(u, u_lower[i], u_upper[i]);
    }
    f_interval(here, m->plan + k * NU, m->p, SIGNALS(k), after, &cost, &broken);
    m->operations += OPERATIONS_f_interval + 2 * NX * NU;
    memcpy(here, after, sizeof here);
  }
}
""",
    """
static real clipped(real value, real least, real most) {
  return value > most ? most : value >= least ? value : least;
}
""",
)
_TABLES = "gain set_matrix set_level x_reference u_reference u_lower u_upper".split()
_INFINITE = {"INFINITE": float("inf"), "(-INFINITE)": float("-inf")}


def compared(certificate: Certificate, path: Path) -> Iterator[Finding]:
    """Compare a certificate with a C file.

    There is a finding for each difference. If nothing differs, a single finding says
    so.

    Args:
        certificate: The statements of the certificate.
        path: The C file.

    Raises:
        OSError: If the file cannot be read.
        CertificateFileError: If it is not a controller in C of double precision.
    """
    lines, code = _read(path)
    defined = _defined(lines)
    differs = [*_changed(certificate, code), *_numbers(certificate, defined)]
    differs += _law(code)
    for text in differs:
        yield Finding(Verdict.REFUSED, f"{path.name}: {text}")
    if not differs:
        yield Finding(
            Verdict.PROVED,
            f"{path.name} has the gain, the matrix, the level, the reference, the "
            "bounds and the law of the certificate",
        )


def _unusable(text: str) -> CertificateFileError:
    return CertificateFileError(f"the C file {text}")


def _read(path: Path) -> tuple[list[str], str]:
    """Return the directives, and the code without comments and directives."""
    try:
        content = read_bounded(path)
    except CertificateFileError as error:
        raise _unusable(f"is unusable: {error}") from error
    try:
        text = _without_comments(content.decode("ascii"))
    except UnicodeDecodeError:
        raise _unusable("has other characters than ASCII") from None
    directives, code = list[str](), list[str]()
    for line in text.split("\n"):
        if "#" in line:
            directives.append(" ".join(line.split()))
        else:
            code.append(line)
    for line in directives:
        if not _DIRECTIVE.fullmatch(line):
            raise _unusable(f"has a directive that is not a known one: {line[:60]}")
    if any('"' in line for line in code):
        raise _unusable("has a text in quotes outside a directive")
    return directives, "\n".join(code)


def _without_comments(text: str) -> str:
    if "\\\n" in text or "??" in text or "//" in text or "\r" in text:
        raise _unusable("has continued lines, trigraphs or comments after //")
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)
    if "/*" in text or "*/" in text or "'" in text:
        raise _unusable("has an open comment or a character in quotes")
    return text


def _defined(directives: list[str]) -> Mapping[str, str]:
    """Return the macros; words that the constants rest on must not be among them."""
    found: dict[str, str] = {}
    own = {
        *_TABLES,
        *re.findall(r"[a-z_]\w*", "".join(_LAW)),
        "real",
        "typedef",
        "double",
    }
    for line in directives:
        match = re.fullmatch(r"#define (\w+)(\(\w+\))? (.*)", line)
        if match is None:
            continue
        name = match[1]
        if name in own or name in found:
            raise _unusable(f"defines {name} anew")
        found[name] = match[3]
    return found


def _changed(certificate: Certificate, code: str) -> Iterator[str]:
    """Yield what differs among the tables."""
    bounds = certificate.bounds
    wanted: dict[str, list[float]] = {
        "gain": [value for row in certificate.K for value in row],
        "set_matrix": [value for row in certificate.P for value in row],
        "set_level": [certificate.alpha],
        "x_reference": [*certificate.x_ref],
        "u_reference": [*certificate.u_ref],
        "u_lower": [_limit(one, -1.0) for one in bounds["u_lower"]],
        "u_upper": [_limit(one, 1.0) for one in bounds["u_upper"]],
    }
    for name in _TABLES:
        found = _table(name, code)
        if len(found) != len(wanted[name]):
            count = len(wanted[name])
            yield f"{name} has {len(found)} numbers, the certificate has {count}"
            continue
        for i, (one, other) in enumerate(zip(found, wanted[name], strict=True)):
            if _bits(one) != _bits(other):
                yield f"{name}[{i}] is {one!r}, in the certificate {other!r}"


def _limit(value: float | None, sign: float) -> float:
    return sign * float("inf") if value is None else value


def _bits(value: float) -> bytes:
    # Minus zero acts as zero does.
    return struct.pack("<d", value + 0.0)


def _table(name: str, code: str) -> list[float]:
    """Return the numbers of a constant array, which must be there once."""
    declared = re.findall(
        rf"static\s+const\s+real\s+{name}\s*\[\s*(\d+)\s*\]\s*=\s*\{{([^{{}}]*)\}}\s*;",
        code,
    )
    if len(declared) != 1:
        raise _unusable(f"must have the constant {name} once, found {len(declared)}")
    if len(re.findall(rf"\breal\s+\*?\s*{name}\b", code)) > 1:
        raise _unusable(f"has another variable {name}")
    ((count, body),) = declared
    found = [_number(word.strip(), name) for word in body.split(",")]
    if len(found) != int(count):
        raise _unusable(f"says {count} numbers of {name}, and has {len(found)}")
    return found


def _number(word: str, name: str) -> float:
    if word in _INFINITE:
        return _INFINITE[word]
    match = re.fullmatch(rf"\(?({_HEXADECIMAL})\)?", word)
    try:
        return float.fromhex(match[1] if match else "")
    except (OverflowError, ValueError):
        raise _unusable(
            f"must have hexadecimal numbers of double precision in {name}, "
            f"found {word[:40]}"
        ) from None


def _numbers(certificate: Certificate, defined: Mapping[str, str]) -> Iterator[str]:
    """Yield what differs among sizes, the hold and its steps."""
    wanted = {"NX": certificate.nx, "STATED": certificate.nx, "NU": certificate.nu}
    for name, value in wanted.items():
        if defined.get(name) != str(value):
            yield f"{name} is {defined.get(name)}, in the certificate {value}"
    if not re.fullmatch(r"[1-9]\d*", defined.get("N", "")):
        yield f"N is {defined.get('N')}, a plan has an interval or more"
    if certificate.dt is None:
        yield "it holds its inputs, the certificate is of a continuous input"
        return
    hold = defined.get("HOLD", "")
    if _bits(_number(hold, "HOLD")) != _bits(certificate.dt):
        yield f"HOLD is {hold}, in the certificate {certificate.dt!r} s"
    steps = defined.get("ALL_STEPS", "")
    if steps != str(certificate.substeps):
        yield f"ALL_STEPS is {steps}, in the certificate {certificate.substeps}"


def _law(code: str) -> Iterator[str]:
    """Yield what differs in the functions of the law, which must be there once."""
    joined = f" {' '.join(_words(code))} "
    for text in _LAW:
        name = text[: text.index("(")].split()[-1]
        if joined.count(f" {' '.join(_words(text))} ") != 1:
            yield f"the function {name} is not the known one"
        elif len(re.findall(rf"\b(?:real|int|void)\s+{name}\s*\(", code)) != 1:
            yield f"the function {name} is declared twice"


def _words(code: str) -> list[str]:
    return re.findall(r"\w+|[^\w\s]", code)
