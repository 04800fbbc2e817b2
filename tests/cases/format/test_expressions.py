import ast
import builtins
import itertools
import math
import os
import pickle
import sys
from collections.abc import Callable

import casadi as ca
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmstart.cases.format.expressions import (
    CONSTANTS,
    FLOAT_OPERATIONS,
    FUNCTIONS,
    MAX_CHARACTERS,
    ExpressionError,
    evaluate,
    interpret,
    parse,
)

unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])

NAMES = {"x": 2.0, "y": -0.5, "mass_kg": 7.5}

GOOD = [
    ("pi/18", math.pi / 18),
    ("-pi", -math.pi),
    ("+3", 3.0),
    ("1e-3", 1e-3),
    (".5 + 5. + 1E+3", 1005.5),
    ("1 + 2*3 - 4/5", 1 + 2 * 3 - 4 / 5),
    ("(1 + 2)*3", 9.0),
    ("8/4/2", 1.0),
    ("5 - 3 - 1", 1.0),
    ("-2**2", -4.0),
    ("2**-2", 0.25),
    ("2**2**2", 16.0),
    ("4**(1/2)", 2.0),
    ("x**3", 8.0),
    ("sqrt(2)", math.sqrt(2)),
    ("sin(pi/6) + cos(pi/3)*tan(1)", math.sin(math.pi / 6) + 0.5 * math.tan(1)),
    ("asin(.5) + acos(.25) + atan(3)", math.asin(0.5) + math.acos(0.25) + math.atan(3)),
    ("atan2(-1, -2)", math.atan2(-1, -2)),
    ("exp(1)*log(10)", math.e * math.log(10)),
    ("abs(y)", 0.5),
    ("min(3, x, 4)", 2.0),
    ("max(3, x, 4)", 4.0),
    ("radians(30)", math.radians(30)),
    (" \tmass_kg * 9.81 \n", 7.5 * 9.81),
    ("(" * 100 + "1" + ")" * 100, 1.0),
    ("1+" * 99 + "1", 100.0),
    ("9" * 300, float("9" * 300)),
]

HOSTILE = [
    "",
    " \t ",
    "__import__('os').system('touch pwned')",
    "__import__",
    "open(0)",
    "exec(1)",
    "eval(1)",
    "print(1)",
    "().__class__",
    "x.real",
    "1 .real",
    "1..real",
    "x[0]",
    "[1]",
    "{1}",
    "(1, 2)",
    "()",
    "1, 2",
    "'a'",
    '"a"*9',
    "b'a'",
    "f'{x}'",
    "lambda: 1",
    "lambda x=1 : x",
    "[i for i in x]",
    "x if x else y",
    "x and y",
    "not x",
    "x < y",
    "x == y",
    "x := 1",
    "x = 1",
    "await x",
    "yield x",
    "x; y",
    "x\ny",
    "x # comment",
    "x \\\n y",
    "sin(*x)",
    "max(*x, 1)",
    "sin(x=1)",
    "sin(**x)",
    "sin()",
    "sin(1, 2)",
    "atan2(1)",
    "max(1)",
    "sin(sin)",
    "sin(1)(2)",
    "(1)(2)",
    "9**9**9",
    "2**9",
    "2**-9",
    "2**(1/0)",
    "1e999",
    "-1e999",
    "1e308*10",
    "1/(1e308*10)",
    "1/0",
    "0**-1",
    "log(-1)",
    "log(0)",
    "sqrt(-1)",
    "asin(2)",
    "exp(1000)",
    "(-8)**(1/3)",
    "1j",
    "1_000",
    "0x10",
    "0b1",
    "0o7",
    "017",
    "1or 2",
    "True",
    "None",
    "...",
    "nan",
    "inf",
    "x//y",
    "x % y",
    "x @ y",
    "x | y",
    "x << 1",
    "~x",
    "3 4",
    "1 +",
    "* 2",
    "(1",
    "1)",
    "π",
    "\u0661 + 1",
    "1\u00a0+ 1",
    "x\x00y",
    "\ud800",
    "unknown",
    "-" * 400 + "1",
    "-" * 199 + "1",
    "+" * 499 + "1",
    "(" * 499,
    "(" * 249 + ")" * 249,
    "1+" * 101 + "1",
    "max(" + "1," * 200 + "1)",
    "-" * 100_000,
    "+x" * 100_000,
    "9" * 5_000,
    "9" * 400,
]


@pytest.mark.parametrize(("text", "value"), GOOD)
def test_value_is_that_of_the_formula(text: str, value: float) -> None:
    assert evaluate(text, NAMES) == pytest.approx(value, rel=1e-15)


def test_value_is_a_float_even_of_integers() -> None:
    assert type(evaluate("2*3")) is float


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_is_refused_without_running_anything(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: object, **__: object) -> None:
        raise SystemExit("something of the expression was run")

    for name in ("eval", "exec", "print", "open"):
        monkeypatch.setattr(builtins, name, forbidden)
    monkeypatch.setattr(os, "system", forbidden)
    with pytest.raises(ExpressionError) as caught:
        evaluate(text, NAMES)
    message = str(caught.value)
    assert message.isprintable() and message.isascii() and len(message) < 400
    assert 1 <= caught.value.column <= len(text) + 1
    assert caught.value.expression == text


def test_text_that_is_too_long_never_reaches_the_parser(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ast, "parse", lambda *_, **__: pytest.fail("was parsed"))
    with pytest.raises(ExpressionError, match="at most 500 characters, found 501"):
        parse("1" * (MAX_CHARACTERS + 1))


@pytest.mark.parametrize("error", [RecursionError, MemoryError, ValueError])
def test_failure_of_the_parser_is_an_expression_error(
    error: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(ast, "parse", failing)
    with pytest.raises(ExpressionError, match=error.__name__):
        parse("1")


@pytest.mark.parametrize(
    ("text", "column", "what"),
    [
        ("2 + mas_kg", 5, "unknown name 'mas_kg': did you mean 'mass_kg'?"),
        ("2 + q", 5, "unknown name 'q'; known: mass_kg, pi, x, y"),
        ("  sinn(1)", 3, "unknown function 'sinn': did you mean 'sin'?"),
        ("1 + 0x10", 5, "expected an expression, found '0x10'; allowed are"),
        ("1 + x.a", 6, "expected an expression, found '.a'; allowed are"),
        ("1,5*x", 1, "found '1,5*x'; write 1.5*x"),
        ("3*(x, y)", 3, "found '(x, y)'; allowed are numbers, names"),
        ("2*x**9", 6, "a constant from -8 to 8 as exponent, found 9.0"),
        ("1 + 1/0", 5, "expected a finite real value, found '/' of 1.0, 0.0"),
        ("2*(1 +", 3, "expected a complete expression, found: '(' was never closed"),
        ("  1 +", 6, "expected a complete expression"),
        ("1 + atan2(1)", 5, "expected atan2 with 2 plain argument(s), found 1"),
        ("2^3", 2, "expected ** for a power"),
        ("", 1, "expected an expression, found nothing"),
    ],
)
def test_error_names_the_column_and_what_is_expected(
    text: str, column: int, what: str
) -> None:
    with pytest.raises(ExpressionError) as caught:
        evaluate(text, NAMES)
    assert caught.value.column == column
    assert what in caught.value.what
    assert f"column {column}: " in str(caught.value)


def test_error_survives_pickling() -> None:
    with pytest.raises(ExpressionError) as caught:
        evaluate("1/0")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.column) == (str(caught.value), caught.value.column)


def test_value_of_a_name_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ExpressionError, match="finite values of the names"):
        evaluate("x", {"x": math.nan})


def test_names_of_the_caller_come_before_constants() -> None:
    assert evaluate("pi", {"pi": 3.0}) == 3.0


def test_expression_knows_its_names() -> None:
    assert parse("x*sin(pi*y) + x").names == {"x", "y", "pi"}


def test_same_tree_is_computed_in_symbols() -> None:
    text = "min(x, y, 3)**2 + atan2(-x, radians(y)) - abs(y)*sqrt(exp(x)/pi) + log(x)"
    symbols = {"x": ca.SX.sym("x"), "y": ca.SX.sym("y")}
    casadi_names = {"abs": "fabs", "min": "fmin", "max": "fmax"}
    operations = {
        **FLOAT_OPERATIONS,
        **{
            name: getattr(ca, casadi_names.get(name, name))
            for name in FUNCTIONS
            if name != "radians"
        },
        "radians": lambda degrees: degrees * math.pi / 180,
        "**": lambda base, exponent: base**exponent,
    }
    graph = interpret(parse(text), operations=operations, names=symbols)
    compiled = ca.Function("f", list(symbols.values()), [graph])
    # Two libraries' elementary functions agree to a few units in the last place.
    assert float(compiled(2.0, -0.5)) == pytest.approx(evaluate(text, NAMES), rel=1e-13)


def test_table_of_operations_covers_every_function() -> None:
    assert set(FUNCTIONS) | {"neg", "+", "-", "*", "/", "**"} == set(FLOAT_OPERATIONS)
    assert not set(FUNCTIONS) & set(CONSTANTS)


Computed = tuple[str, float]


def _binary(parts: tuple[str, Computed, Computed]) -> Computed:
    symbol, (left, a), (right, b) = parts
    value = {"+": a + b, "-": a - b, "*": a * b, "/": a / b if b else math.nan}[symbol]
    return f"({left} {symbol} {right})", value


_ONE: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "atan": math.atan,
    "abs": abs,
}
_TWO: dict[str, Callable[[float, float], float]] = {
    "atan2": math.atan2,
    "min": min,
    "max": max,
}


def _call(parts: tuple[str, Computed, Computed]) -> Computed:
    name, (left, a), (right, b) = parts
    if name in _ONE:
        # Python's sine of infinity is an error.
        return f"{name}({left})", _ONE[name](a) if math.isfinite(a) else math.nan
    return f"{name}( {left},{right})", _TWO[name](a, b)


_leaves: st.SearchStrategy[Computed] = st.one_of(
    st.floats(0, 1e6).map(lambda value: (repr(value), value)),
    st.integers(0, 10**9).map(lambda value: (str(value), float(value))),
    st.sampled_from(sorted(NAMES.items())),
)


def _larger(trees: st.SearchStrategy[Computed]) -> st.SearchStrategy[Computed]:
    return st.one_of(
        st.tuples(st.sampled_from("+-*/"), trees, trees).map(_binary),
        st.tuples(st.sampled_from([*_ONE, *_TWO]), trees, trees).map(_call),
        trees.map(lambda tree: (f"(-{tree[0]})", -tree[1])),
    )


@unhurried
@given(st.recursive(_leaves, _larger, max_leaves=12))
def test_random_tree_has_the_value_computed_directly(tree: Computed) -> None:
    text, value = tree
    if len(text) > MAX_CHARACTERS or not math.isfinite(value):
        with pytest.raises(ExpressionError):
            evaluate(text, NAMES)
    else:
        try:
            assert evaluate(text, NAMES) == value
        except ExpressionError as error:  # a step below was not finite, the whole is
            assert "expected a finite real value" in error.what


@unhurried
@given(
    st.lists(st.floats(0.1, 100), min_size=2, max_size=9),
    st.lists(st.sampled_from(["+", "-", "*", "/"]), min_size=8, max_size=8),
)
def test_precedence_is_that_of_arithmetic(
    numbers: list[float], symbols: list[str]
) -> None:
    parts = itertools.zip_longest(map(repr, numbers), symbols[: len(numbers) - 1])
    text = " ".join(filter(None, itertools.chain.from_iterable(parts)))
    total, product, sign = 0.0, numbers[0], 1.0
    for symbol, number in zip(symbols, numbers[1:], strict=False):
        if symbol in "*/":
            product = product * number if symbol == "*" else product / number
        else:
            total, product = total + sign * product, number
            sign = 1.0 if symbol == "+" else -1.0
    assert evaluate(text) == pytest.approx(total + sign * product, rel=1e-12, abs=1e-9)


@unhurried
@given(st.text(max_size=60))
def test_any_text_gives_a_finite_number_or_an_expression_error(text: str) -> None:
    try:
        assert math.isfinite(evaluate(text, NAMES))
    except ExpressionError as error:
        assert str(error).isprintable()


@unhurried
@given(st.text(alphabet="0123456789.eExypi+-*/(), sinmaxj_[]'", max_size=60))
def test_text_of_allowed_characters_gives_a_number_or_an_expression_error(
    text: str,
) -> None:
    try:
        assert math.isfinite(evaluate(text, NAMES))
    except ExpressionError as error:
        assert str(error).isprintable()


def test_module_itself_contains_no_call_that_runs_text() -> None:
    source = sys.modules[evaluate.__module__].__file__
    assert source is not None
    with open(source, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    called = {
        node.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert not called & {"eval", "exec", "compile", "__import__"}


def test_a_name_may_be_an_exponent() -> None:
    assert evaluate("2**n", {"n": 3.0}) == 8.0


@pytest.mark.parametrize("text", ["x.end", "integral(x)", "max(x)", "x.middle"])
def test_only_measures_may_ask_for_a_number_of_a_path(text: str) -> None:
    with pytest.raises(ExpressionError):
        parse(text)
    if text != "x.middle":
        assert parse(text, of_paths=True).names == {"x"}


def test_a_path_has_no_other_attributes() -> None:
    for text in ("x.middle", "x.__class__", "x.end()", "x.end.real", "(1).end.x"):
        with pytest.raises(ExpressionError):
            parse(text, of_paths=True)
