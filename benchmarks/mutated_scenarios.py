"""Shipped scenarios with seeded mutations: each runs, or is refused in sentences.

    python benchmarks/mutated_scenarios.py --count 10000 --seed 0

Each scenario is a shipped one with one to three mutations of its text (lines dropped,
doubled, indented; characters changed) or of its keys and values (misspelt, dropped,
replaced by numbers at and beyond the limits, by other types, by expressions). It is
resolved in every variant, with all checks across its parts. Of those that are valid a
share is checked to the end by `swarmstart check`, which compiles its problems, and run
for one step.

Counted as wrong: an exit code other than 0, 2, 3 and 4, an exception, a traceback, a
refusal without a word, and more than LIMIT_S seconds.
"""

import argparse
import contextlib
import io
import random
import re
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from swarmstart.cases.commands.cli import main
from swarmstart.cases.commands.exit_codes import (
    DONE,
    GATE,
    INFEASIBLE,
    INTERNAL,
    INVALID,
)
from swarmstart.cases.format.scenario import read_document, resolve, shipped
from swarmstart.errors import SwarmstartError

LIMIT_S = 180
"""A proof of a terminal set gives up after a minute, and there may be two."""
MEMORY = 8 << 30
"""Address space of the process [B], so that what asks for more is refused."""
NUMBERS = (
    *("0", "-1", "1", "2", "0.5", "-0.5", "1e-9", "-1e-300", "1e9", "1e29", "-1e30"),
    *("1e31", "1e200", "1e308", "1e999", ".inf", ".nan", "-0", "1e-400", "007", "0x10"),
    *("1000000", "1000000000000", "9223372036854775808", "9" * 40),
)
TEXTS = (
    *("null", "true", "''", "text", "[]", "{}", "[1, 2]", "[[1]]", "{a: 1}", "[-1, 1]"),
    *("[1, 1]", "pi", "1/0", "sqrt(-1)", "9**9**9", "none", "ipopt", '"\\e[31m"'),
    *(
        '"\\0"',
        "~",
        "*a",
        "&a 1",
        "!!python/none",
        "- 1",
        "? a",
        "|",
        "'",
        '"',
        "{",
        "]",
    ),
)
ANY = "\t\x00\x1b\u2028\ud7ff#:,[]{}&*!|>'\"%@`-0.9eE\u017c\U0001f600"
_SCALAR = re.compile(r"(?<=: )[^\s,{}\[\]#]+|(?<=[\[ ])[-+]?[0-9.]+(?:e[-+]?[0-9]+)?")
_END = re.compile(r"\Z")
_KEY = re.compile(r"[A-Za-z_0-9]+(?=:)")

Mutation = Callable[[str, random.Random], str]


def _found(pattern: re.Pattern[str], text: str, chance: random.Random) -> re.Match[str]:
    """Return one of the places where a pattern is found, or an end of the text."""
    return chance.choice([*pattern.finditer(text)] or [*_END.finditer(text)])


def _value(text: str, chance: random.Random) -> str:
    """Replace a value."""
    found = _found(_SCALAR, text, chance)
    new = chance.choice(NUMBERS if chance.random() < 0.7 else TEXTS)
    return f"{text[: found.start()]}{new}{text[found.end() :]}"


def _scaled(text: str, chance: random.Random) -> str:
    """Multiply a number."""
    found = _found(_SCALAR, text, chance)
    try:
        new = float(found.group()) * chance.choice((-1.0, 0.1, 0.9, 1.1, 3.0, 1e3))
    except ValueError:
        return text
    return f"{text[: found.start()]}{new:.6g}{text[found.end() :]}"


def _key(text: str, chance: random.Random) -> str:
    """Misspell a key."""
    found = _found(_KEY, text, chance)
    key = found.group()
    place = chance.randrange(len(key) + 1)
    new = chance.choice(
        (key + "x", key[:place] + key[place + 1 :], key.upper(), "kind")
    )
    return f"{text[: found.start()]}{new}{text[found.end() :]}"


def _line(text: str, chance: random.Random) -> str:
    """Drop, double, move or indent a line."""
    lines = text.splitlines(keepends=True)
    place, what = chance.randrange(len(lines)), chance.randrange(4)
    line = lines.pop(place)
    if what == 1:
        lines[place:place] = [line, line]
    elif what == 2:
        lines.insert(chance.randrange(len(lines) + 1), line)
    elif what == 3:
        lines.insert(place, chance.choice(("  ", " ", "\t")) + line)
    return "".join(lines)


def _character(text: str, chance: random.Random) -> str:
    """Change, drop or insert a character, or cut the text."""
    place = chance.randrange(len(text))
    new, what = chance.choice(ANY), chance.randrange(8)
    if what == 0:
        return text[:place]
    return text[:place] + ("" if what == 1 else new) + text[place + (what < 5) :]


MUTATIONS: tuple[Mutation, ...] = (
    *(_value, _value, _value, _scaled, _scaled, _key, _line, _character),
)


def mutated(count: int, chance: random.Random) -> Iterator[str]:
    """Yield mutated scenarios as their texts.

    Args:
        count: Their number.
        chance: Source of all randomness.
    """
    originals = [path.read_text("utf-8") for path in shipped().values()]
    for _ in range(count):
        text = chance.choice(originals)
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            text = chance.choice(MUTATIONS)(text or "a: 1", chance)
        yield text


class TooSlowError(BaseException):
    """A command has taken longer than LIMIT_S."""


def resolved(file: Path) -> tuple[int, str]:
    """Return the exit code and the errors of all variants, resolved and not built."""
    try:
        document = read_document(str(file))
        variants = document.data.get("variants")
        for name in [*variants] if isinstance(variants, dict) and variants else [None]:
            resolve(document, variant=name)
    except SwarmstartError as error:
        return INVALID, str(error)
    return DONE, ""


def told(*arguments: object) -> tuple[int, str]:
    """Return the exit code and the errors of a command in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return code, err.getvalue()


def judged(
    ask: Callable[[], tuple[int, str]], allowed: Sequence[int]
) -> tuple[int, str]:
    """Return how a command ends, and what is wrong with that; empty: nothing."""
    late: list[int] = []

    def too_slow(number: int, _: object) -> None:
        late.append(number)
        raise TooSlowError

    before = signal.signal(signal.SIGALRM, too_slow)
    signal.alarm(LIMIT_S)
    try:
        code, err = ask()
    except TooSlowError:
        return INTERNAL, f"more than {LIMIT_S} s"
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        return INTERNAL, f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    if late:  # IPOPT swallows what is raised within it.
        return INTERNAL, f"more than {LIMIT_S} s"
    if code not in allowed or "Traceback" in err:
        return code, f"exit code {code}: {err[:300]}"
    silent = code == INVALID and not err.strip()
    return code, "refused without a word" if silent else ""


def assay(
    text: str, place: Path, *, to_the_end: bool, counted: Counter[str]
) -> list[str]:
    """Try one scenario; return what is wrong.

    Args:
        text: The scenario.
        place: A folder of its own.
        to_the_end: Whether a valid one is also checked to the end, and run.
        counted: What came of it is added here.
    """
    file = place / "mutated.yaml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    code, wrong = judged(lambda: resolved(file), (DONE, INVALID))
    counted["valid" if code == DONE else "refused"] += 1
    if wrong or code != DONE or not to_the_end:
        return [f"resolving: {wrong}"] if wrong else []
    code, wrong = judged(lambda: told("check", file), (DONE, INVALID))
    if wrong or code != DONE:
        counted["refused by the whole check"] += 1
        return [f"check: {wrong}"] if wrong else []
    run = (
        *("run", file, "--set", "steps=1", "--no-figures", "--quiet"),
        *("--set", "budget={evaluations: 400}", "--set", "ipopt.max_iterations=5"),
        *("--out", place / "run"),
    )
    counted["run"] += 1
    _, wrong = judged(lambda: told(*run), (DONE, GATE, INFEASIBLE, INVALID))
    return [f"run: {wrong}"] if wrong else []


def main_of(arguments: Sequence[str] | None = None) -> int:
    """Try all; say what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--every", type=int, default=40, help="of the scenarios one is run; default: 40"
    )
    options = parser.parse_args(arguments)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    counted, wrong = Counter[str](), 0
    began, used = time.monotonic(), time.process_time()
    texts = mutated(options.count, random.Random(options.seed))
    for number, text in enumerate(texts):
        with tempfile.TemporaryDirectory() as place:
            found = assay(
                text,
                Path(place),
                to_the_end=number % options.every == 0,
                counted=counted,
            )
        for what in found:
            wrong += 1
            print(f"{number}: {what}", flush=True)
            kept = Path(tempfile.gettempdir()) / f"mutated_{options.seed}_{number}.yaml"
            kept.write_bytes(text.encode("utf-8", "surrogatepass"))
    print(
        f"{options.count} scenarios, seed {options.seed}: "
        + ", ".join(f"{count} {what}" for what, count in sorted(counted.items()))
        + f"; wrong: {wrong}; {time.monotonic() - began:.0f} s, "
        f"{time.process_time() - used:.0f} s of CPU"
    )
    return GATE if wrong else DONE


if __name__ == "__main__":
    sys.exit(main_of())
