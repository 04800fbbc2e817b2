"""Shipped scenarios with seeded mutations: each runs, or is refused in sentences.

    python benchmarks/mutated_scenarios.py --count 10000 --seed 0
    python benchmarks/mutated_scenarios.py --kind problem --check-every 1 --every 20

Each scenario is a shipped one, or one of `mutation_bases`, with one to three mutations
of its text (lines dropped, doubled, indented; characters changed), of its keys and
values (misspelt, dropped, replaced by numbers beyond the limits or by other types),
of its expressions (operators, powers, depth, names), of its names everywhere (words of
Python, of LaTeX, very long ones) or of its parts. It is resolved in every variant, with
all checks across its parts. Of those that are valid a share is checked to the end by
`swarmstart check`, which compiles its problems, and a share of these is run for two
steps with its figures.

Counted as wrong: an exit code other than 0, 2, 3, 4 and 5, a run that is refused after
its check, an exception, a traceback, a refusal without a word, and more than LIMIT_S
seconds.
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

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.terminal import (
    DONE,
    FILE,
    GATE,
    INFEASIBLE,
    INTERNAL,
    INVALID,
)
from swarmstart.cases.format.scenario import read_document, resolve, shipped
from swarmstart.errors import SwarmstartError

LIMIT_S = 180
"""Time limit of a command [s]: a proof stops after a minute, and there may be two."""
STEPS = 2
"""Steps of a run."""
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
EXPRESSIONS = (
    *("1/0", "0/0", "10**308*10", "exp(999)", "log(0)", "0**-1", "2**9", "-1**0.5"),
    *("time", "time.end", ".end", "x.start.end", "max()", "max(1)", "min(1, 2, 3)"),
    *("sin", "sin()", "sin(1, 2)", "x(1)", "pi(2)", "integral(time)", "1, 2", "()"),
    *("lambda: 0", "__import__(1)", "x.__class__", "[1]", "1 if 1 else 2", "x = 1"),
    *("unknown", "E", "e", "inf", "nan", "None", "True", "1 2", "1//2", "2%3", "~1"),
    *("1/(time - 1)", "sqrt(1 - time)", "exp(1e3*time)", "1e29**8", "$x^2$", "\u03c0"),
    *("(" * 99 + "1" + ")" * 99, "-" * 150 + "1", "+".join("1" * 150), "9" * 499),
)
WRAPPED = (
    *("{0}/0", "({0})**8", "(({0})**8)**8", "({0})**({0})", "1/({0})", "sqrt({0})"),
    *("log({0})", "exp(exp({0}))", "max({0}, 1/0)", "min({0}, 0)", "abs({0})"),
    *("{0}.end", "({0}).start", "{0}, {0}", "atan2({0}, 0)", "1e30*({0})", "-({0})"),
    *("max({0})", "mean({0})", "settling({0}, 0, 0)", "sin(" * 40 + "{0}" + ")" * 40),
    *("({0})*1e-30", "({0})/({0})", "acos({0})", "tan({0})", "({0}", "{0})", "{0} +"),
)
NAMES = (
    *("lambda", "E", "e", "inf", "nan", "None", "import", "True", "pi", "time", "sin"),
    *(
        "x" * 64,
        "x" * 65,
        "x" * 5000,
        "_",
        "__class__",
        "a b",
        "a.b",
        "1a",
        "",
        "x_y_z",
    ),
    *(
        "\u017c\u00f3\u0142w",
        "\u03b8",
        "$x$",
        "x^2",
        "%s",
        "{0}",
        "\\\\frac",
        "null",
        "end",
        "start",
    ),
    *("cost", "settling", "x_left", "self", "_x", "u", "t", "ode", "p", "A" * 40),
)
UNITS = (
    "$",
    "%",
    "$$",
    "$x",
    "m_2^",
    "\\\\frac{",
    "_",
    "^",
    "m" * 3000,
    "\u00b0",
    "{}",
)
PARTS = (
    *("dual_mode: {at: {x: 0}, Q: {x: 1}, R: {a: 1}}", "dual_mode: {}", "guess: {}"),
    *("candidates: [{}]", "candidates: []", "candidates: [{u: 1/0}]", "terminal: [{}]"),
    *("plant: {substeps: 10000}", "plant: {substeps: 1, disturbance: {x: 1e30}}"),
    *("plant: {disturbance: {x: {deviation: 1e20}}}", "guess: {record: /nowhere}"),
    *("guess: {controls: {u: {times: [0, 0], values: [1, 2]}}}", "signals: {s: time}"),
    *("guess: {states: {x: .nan}}", "parameters: {p: {times: [], values: []}}"),
    *("parameters: {p: {times: [2, 1], values: [1, .nan]}}", "constants: {c: c}"),
    *("path: [{distance: [x], at_least: 1e30}]", "path: [{expression: 1, lower: 2}]"),
    *("path: [{expression: x, lower: 1, upper: 0}]", "terminal: [{expression: time}]"),
    *("vehicles: {members: []}", "vehicles: {members: [{name: a}, {name: a}]}"),
    *("vehicles: {members: [{name: a}, {name: b}], planning: priority}", "steps: 2"),
    *(
        "prediction: {horizon_s: 1, intervals: 0}",
        "prediction: {horizon_s: 1e-30, intervals: 1}",
    ),
    *(
        "prediction: {horizon_s: 1e30, intervals: 3}",
        "prediction: {horizon_s: 1, intervals: 1}",
    ),
    *(
        "prediction: {horizon_s: 9, intervals: 10000}",
        "prediction: {horizon_s: 1, intervals: 5, substeps: 1000}",
    ),
    *("prediction: {horizon_s: 1, intervals: 9, checks: 100}", "feedback: open_loop"),
    *("feedback: receding_horizon", "feedback: {law: 1}", "search: {name: none}"),
    *("maximize: true", "stage_cost: 0", "stage_cost: -1e30*time", "polish: none"),
    *(
        "states: {x: {start: 0, rate: 0}}",
        "controls: {}",
        "states: {}",
        "title: $\\frac",
    ),
    *("controls: {u: {bounds: [1, 1]}}", "controls: {u: {bounds: [-1e30, 1e30]}}"),
    *("controls: {u: {}}", "states: {x: {start: 1, rate: x**8, bounds: [1, 1]}}"),
    *("states: {x: {start: 1, rate: x**2 + 1e9}}", "definitions: {a: b, b: a}"),
    *(
        "measures: {m: 1/(max(time) - max(time))}",
        "measures: {m: time}",
        "measures: {'': 1}",
    ),
    *("claims: [{id: a, text: '', source: '', measure: m, relation: '>=', bound: 1}]",),
    *(
        "uncertain: {}",
        "uncertain: {values: {p: [1, 2]}}",
        "phases: []",
        "phases: [{}]",
    ),
    *(
        "uncertain: {drawn: {p: {normal: [0, 1e30]}}, samples: 1000}",
        "algebraic: {z: z}",
    ),
    *("algebraic: {z: {equation: z**3 - 1e30, scale: 1e-30}}", "algebraic: {z: 1/0}"),
    *("phases: [{horizon_s: 1, intervals: 2}]", "phases: [{intervals: 10000}, null]"),
    *("phases: [{horizon_s: 1, intervals: 2}, {horizon_s: 1, intervals: 3}]",),
    *("controls: {u: {bounds: [-1, time], integer: true}}", "uncertain: {values: 1}"),
    *("states: {x: {start: {same_as: y}}, y: {start: {free: [0, 1]}, rate: u}}",),
)
ANY = "\t\x00\x1b\u2028\ud7ff#:,[]{}&*!|>'\"%@`-0.9eE\u017c\U0001f600"
_SCALAR = re.compile(r"(?<=: )[^\s,{}\[\]#]+|(?<=[\[ ])[-+]?[0-9.]+(?:e[-+]?[0-9]+)?")
_END = re.compile(r"\Z")
_KEY = re.compile(r"[A-Za-z_0-9]+(?=:)")
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")
_OPERATOR = re.compile(r"\*\*|[-+*/(),]")
_EXPRESSION = re.compile(r"(?<=: )(?![&*!|>'\"])[^\s{}\[\]#:,][^{}\[\]#:,\n]*")
_UNIT = re.compile(r"(?<=unit: )[^\s,}]+")
_BASES = Path(__file__).parent / "mutation_bases"

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


def _expression(text: str, chance: random.Random) -> str:
    """Replace an expression, an operator or a name in it, or make it deeper."""
    found = _found(_EXPRESSION, text, chance)
    old, what = found.group() or "1", chance.randrange(4)
    if what == 0:
        new = chance.choice(EXPRESSIONS)
    elif what == 1:
        new = chance.choice(WRAPPED).replace("{0}", old)
    else:
        part = _found((_OPERATOR, _WORD)[what - 2], old, chance)
        others = ("+", "-", "*", "/", "**", ",", "(", ")", " ", "***")
        words = [word.group() for word in _WORD.finditer(text)]
        put = chance.choice(others if what == 2 else [*words, *NAMES])
        new = f"{old[: part.start()]}{put}{old[part.end() :]}"
    return f"{text[: found.start()]}{new}{text[found.end() :]}"


def _renamed(text: str, chance: random.Random) -> str:
    """Rename a key or a name everywhere."""
    old, new = _found(_KEY, text, chance).group(), chance.choice(NAMES)
    quoted = chance.choice((new, f'"{new}"'))
    return re.sub(rf"\b{old}\b", lambda _: quoted, text) if old else text


def _unit(text: str, chance: random.Random) -> str:
    """Replace a unit."""
    found = _found(_UNIT, text, chance)
    return f"{text[: found.start()]}'{chance.choice(UNITS)}'{text[found.end() :]}"


def _part(text: str, chance: random.Random) -> str:
    """Replace or add a part of a problem."""
    part = chance.choice(PARTS)
    key = part.partition(":")[0]
    rest = re.sub(rf"(?m)^{key}:.*\n(?:[ ].*\n)*", "", text)
    return f"{rest.rstrip()}\n{part}\n"


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
OF_PROBLEMS = (*MUTATIONS, *(_expression, _expression, _expression, _renamed, _unit))
OF_PROBLEMS = (*OF_PROBLEMS, *(_part, _part))


def originals(kind: str = "") -> list[str]:
    """Return the texts that are mutated: the shipped scenarios, or those of a kind.

    Those with tables in a file are left out: a mutated text has no such file.
    """
    files = [*shipped().values(), *(_BASES.glob("*.yaml") if kind else ())]
    files = [path for path in sorted(files) if not path.with_suffix(".csv").exists()]
    texts = [path.read_text("utf-8") for path in files]
    return [text for text in texts if not kind or f"\nkind: {kind}\n" in text]


def mutated(count: int, chance: random.Random, kind: str = "") -> Iterator[str]:
    """Yield mutated scenarios as their texts.

    Args:
        count: Their number.
        chance: Source of all randomness.
        kind: Of the scenarios; empty: any.
    """
    texts = originals(kind)
    mutations = OF_PROBLEMS if kind == "problem" else MUTATIONS
    for _ in range(count):
        text = chance.choice(texts)
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            text = chance.choice(mutations)(text or "a: 1", chance)
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
    text: str,
    place: Path,
    *,
    to_check: bool = False,
    to_run: bool = False,
    counted: Counter[str],
) -> list[str]:
    """Try one scenario; return what is wrong.

    Args:
        text: The scenario.
        place: A folder of its own.
        to_check: Whether a valid one is also checked to the end.
        to_run: Whether one that is checked and valid is also run.
        counted: What came of it is added here.
    """
    file = place / "mutated.yaml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    check = (lambda: told("check", file)) if to_check else (lambda: resolved(file))
    code, wrong = judged(check, (DONE, INVALID, FILE))
    counted[f"{'checked' if to_check else 'resolved'}: {code}"] += 1
    if wrong or code != DONE or not (to_check and to_run):
        return [f"checking: {wrong}"] if wrong else []
    is_long = resolve(read_document(str(file))).scenario.steps > STEPS
    run = (
        *("run", file, "--quiet", "--out", place / "run"),
        *("--set", "budget={evaluations: 200}", "--set", "ipopt.max_iterations=5"),
        *(("--set", f"steps={STEPS}") if is_long else ()),
    )
    code, wrong = judged(lambda: told(*run), (DONE, GATE, INFEASIBLE, FILE))
    counted[f"run: {code}"] += 1
    return [f"run: {wrong}"] if wrong else []


def main_of(arguments: Sequence[str] | None = None) -> int:
    """Try all; say what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", default="", help="of scenario; default: any")
    for option, what in (("check-every", "checked to the end"), ("every", "run")):
        parser.add_argument(
            f"--{option}", type=int, default=40,
            help=f"of that many scenarios one is {what}; default: 40",
        )  # fmt: skip
    options = parser.parse_args(arguments)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    counted, wrong = Counter[str](), 0
    began, used = time.monotonic(), time.process_time()
    texts = mutated(options.count, random.Random(options.seed), options.kind)
    for number, text in enumerate(texts):
        with tempfile.TemporaryDirectory() as place:
            found = assay(
                text,
                Path(place),
                to_check=number % options.check_every == 0,
                to_run=number % options.every == 0,
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
