from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.tape import OPERATIONS, read_tape

Evaluate = Callable[..., tuple[Array, ...]]
Reference = Callable[..., Array]

UNARY: dict[str, Callable[[ca.SX], ca.SX]] = {
    "neg": lambda x: -x,
    "sq": lambda x: ca.SX.unary(ca.OP_SQ, x),
    "twice": lambda x: ca.SX.unary(ca.OP_TWICE, x),
    "inv": lambda x: ca.SX.unary(ca.OP_INV, x),
    "not": ca.logic_not,
    **{
        name: getattr(ca, name)
        for name in (
            "exp log sqrt sin cos tan asin acos atan floor ceil fabs sign erf sinh "
            "cosh tanh asinh acosh atanh log1p expm1"
        ).split()
    },
}
BINARY: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "pow": lambda x, y: x**y,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "if_else_zero": lambda x, y: ca.SX.binary(ca.OP_IF_ELSE_ZERO, x, y),
    "lift": lambda x, y: ca.SX.binary(ca.OP_LIFT, x, y),
    **{
        name: getattr(ca, name)
        for name in "fmod copysign fmin fmax atan2 hypot remainder".split()
    },
}
POWERS = (2.5, 0.3, -1.5, 3.0, -3.0, 4.0, 7.0, 8.0, -8.0, 9.0, 100.0, np.inf, -np.inf)
OTHERS = {"assign", "constpow"}
"""Operations that SX never writes or, constpow, that take a constant."""

APPROXIMATED = set(
    "exp expm1 log log1p sin cos tan sinh cosh tanh asinh acosh atanh erf asin acos "
    "atan atan2 pow constpow".split()
)
"""Operations that are polynomials here: within 4 ulp of the C library's."""

VALUES = np.array(
    [
        *(0.0, 0.5, 1.0, 1.5, 2.5, 3.0, np.pi, 7.25, 20.0, 745.0, 1e22, 2.0**30 + 1),
        *(5e-324, 1e-310, 2.2250738585072014e-308, 1e-200, 1e-17, 0.9999999999999999),
        *(1e200, 1.7976931348623157e308, np.inf, np.nan),
    ]
)
SPECIAL = np.concatenate([VALUES, -VALUES])


def agrees(name: str, got: Array, want: Array, ulps: Callable[..., Array]) -> bool:
    """Return whether values are what CasADi has: NaN if NaN, inf if inf."""
    apart = ulps(got, want)
    if name == "constpow":  # 1 / x^n where x^n over- or underflows.
        apart[(np.abs(got) < 2.0**-1021) & (np.abs(want) < 2.0**-1021)] = 0
    if name not in APPROXIMATED:
        return bool(np.all(apart == 0))
    return bool(np.all(apart <= 4)) and np.array_equal(np.isinf(got), np.isinf(want))


def same_signs(got: Array, want: Array) -> bool:
    """Return whether signs agree, those of zeros too; NaN has none."""
    number = ~np.isnan(want)
    return np.array_equal(np.signbit(got)[number], np.signbit(want)[number])


def test_every_operation_is_tested() -> None:
    assert UNARY.keys() | BINARY.keys() | OTHERS == set(OPERATIONS.values())


@pytest.mark.parametrize("name", UNARY)
def test_unary_operation_on_special_values_is_casadi_s(
    compiled: Callable[..., Evaluate],
    by_casadi: Reference,
    ulps_apart: Callable[..., Array],
    name: str,
) -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [UNARY[name](x)])
    assert read_tape(function).nodes[-1].operation == name
    got = compiled([x], [UNARY[name](x)])(SPECIAL[None])[0]
    want = by_casadi(function, SPECIAL[None])
    assert agrees(name, got, want, ulps_apart), np.stack([SPECIAL, got[0], want[0]]).T
    assert same_signs(got, want)


@pytest.mark.parametrize("name", BINARY)
def test_binary_operation_on_special_values_is_casadi_s(
    compiled: Callable[..., Evaluate],
    by_casadi: Reference,
    ulps_apart: Callable[..., Array],
    name: str,
) -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [BINARY[name](x, y)])
    # Lifting, for Newton's method, changes no value: no instruction is left of it.
    made = {node.operation for node in read_tape(function).nodes}
    assert name in made or name == "lift"
    a, b = (grid.ravel()[None] for grid in np.meshgrid(SPECIAL, SPECIAL))
    got = compiled([x, y], [BINARY[name](x, y)])(a, b)[0]
    want = by_casadi(function, a, b)
    wrong = ulps_apart(got, want)[0] > 0
    shown = np.concatenate([a, b, got, want]).T[wrong][:9]
    assert agrees(name, got, want, ulps_apart), shown
    # C leaves the sign of fmin(0, -0) open.
    assert name in ("fmin", "fmax") or same_signs(got, want)


@pytest.mark.parametrize("power", POWERS)
def test_constant_power_on_special_values_is_casadi_s(
    compiled: Callable[..., Evaluate],
    by_casadi: Reference,
    ulps_apart: Callable[..., Array],
    power: float,
) -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [x**power])
    got = compiled([x], [x**power])(SPECIAL[None])[0]
    want = by_casadi(function, SPECIAL[None])
    shown = np.stack([SPECIAL, got[0], want[0]]).T
    assert agrees("constpow", got, want, ulps_apart), shown


def test_dead_branch_may_be_infinite_or_nan(compiled: Callable[..., Evaluate]) -> None:
    x = ca.SX.sym("x")
    evaluate = compiled([x], [ca.if_else(x > 0, ca.log(x), ca.sqrt(-x))])
    got = evaluate(np.array([[1.0, -4.0, 0.0, np.nan]]))[0][0]
    np.testing.assert_array_equal(got, [0.0, 2.0, 0.0, np.nan])


def test_difference_of_equal_products_is_zero(
    compiled: Callable[..., Evaluate],
) -> None:
    """A contracted x x - y y would leave a rounding error, and its root NaN."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    values = np.random.default_rng(1).normal(size=(1, 500))
    got = compiled([x, y], [ca.sqrt(x * x - y * y)])(values, values)[0]
    np.testing.assert_array_equal(got, 0.0)


@pytest.fixture
def unsimplified() -> Iterator[None]:
    """CasADi writes what is asked for, x - x too."""
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    yield
    ca.GlobalOptions.setSimplificationOnTheFly(True)


INPUTS, DRAWN, SIZE = 5, 60, 32


def random_population(rng: np.random.Generator) -> Array:
    """Ordinary, tiny and huge numbers, some of them special."""
    values = rng.normal(size=(INPUTS, SIZE))
    scaled = values * np.exp2(rng.integers(-40, 40, values.shape))
    values = np.where(rng.random(values.shape) < 0.2, scaled, values)
    special = rng.choice(SPECIAL, values.shape)
    return np.where(rng.random(values.shape) < 0.1, special, values)


@pytest.fixture(scope="module")
def single(by_casadi: Reference) -> Callable[..., Array]:
    """(operation, operands (n,)) -> CasADi's value of one operation, (n,)."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    functions = {
        **{name: ca.Function(f"one_{name}", [x], [f(x)]) for name, f in UNARY.items()},
        **{
            name: ca.Function(f"one_{name}", [x, y], [f(x, y)])
            for name, f in BINARY.items()
        },
    }
    return lambda name, *operands: by_casadi(
        functions[name], *(a[None] for a in operands)
    )[0]


@pytest.mark.usefixtures("unsimplified")
@pytest.mark.parametrize("seed", range(8))
def test_every_value_of_a_random_graph_is_casadi_s(
    compiled: Callable[..., Evaluate],
    single: Callable[..., Array],
    ulps_apart: Callable[..., Array],
    seed: int,
) -> None:
    """Operation by operation, each on the operands that the machine code had.

    So no error is carried along, and branches at discontinuities cannot differ.
    """
    rng = np.random.default_rng(seed)
    symbols = ca.SX.sym("x", INPUTS)
    nodes, made = [symbols[i] for i in range(INPUTS)], []
    for _ in range(DRAWN):
        name = str(rng.choice([*UNARY, *BINARY]))
        operands = [int(i) for i in rng.integers(len(nodes), size=2)]
        operation = UNARY.get(name)
        if operation is None:
            nodes.append(BINARY[name](*(nodes[i] for i in operands)))
        else:
            operands = operands[:1]
            nodes.append(operation(nodes[operands[0]]))
        made.append((name, operands))
    population = random_population(rng)
    values = compiled([symbols], [ca.vertcat(*nodes)])(population)[0]
    for row, (name, operands) in enumerate(made, start=INPUTS):
        want = single(name, *(values[i] for i in operands))
        assert agrees(name, values[row], want, ulps_apart), (name, values[row], want)


EXACT = "neg sq twice inv not sqrt floor ceil fabs sign".split()
EXACT_PAIRS = (
    "add sub mul div lt le eq ne and or if_else_zero copysign fmin fmax".split()
)


@pytest.mark.parametrize("seed", range(8))
def test_graph_of_exact_operations_is_casadi_s_bit_for_bit(
    compiled: Callable[..., Evaluate], by_casadi: Reference, seed: int
) -> None:
    """Operations with one IEEE 754 result; CasADi simplifies as it always does."""
    rng = np.random.default_rng(100 + seed)
    symbols = ca.SX.sym("x", INPUTS)
    nodes = [symbols[i] for i in range(INPUTS)]
    for _ in range(DRAWN):
        a, b = (nodes[int(i)] for i in rng.integers(len(nodes), size=2))
        name = str(rng.choice(EXACT + 2 * EXACT_PAIRS))
        nodes.append(UNARY[name](a) if name in UNARY else BINARY[name](a, b))
    outputs = ca.vertcat(*nodes)
    population = random_population(rng)
    want = by_casadi(ca.Function("f", [symbols], [outputs]), population)
    np.testing.assert_array_equal(compiled([symbols], [outputs])(population)[0], want)
