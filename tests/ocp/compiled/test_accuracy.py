"""Values of whole graphs against CasADi's, within a running error bound."""

from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.emitter import simplified
from swarmstart.ocp.compiled.simd import compile_flat
from swarmstart.ocp.compiled.vectors.operations import fused_products
from swarmstart.tape import OPERATIONS, Tape, read_tape

Evaluate = Callable[..., tuple[Array, ...]]

TOLERANCE = 1e-13
SMALLEST = 2.0**-1021
"""Below it 1 / x^n and products that lose digits to underflow are not judged."""

SIZES = (0, 1, 7, 8, 9, 1000)
INPUTS, DRAWN, KEPT = 6, 40, 8

LINEAR = "add sub mul neg sq twice fabs fmin fmax copysign if_else_zero".split()
"""Operations whose result changes no more than their operands do."""

COMMON = "add sub mul sq twice add sub mul neg".split()
UNUSED = {"assign", "lift"}
PAIRS = (
    "add sub mul div pow lt le eq ne and or fmod copysign if_else_zero fmin fmax atan2 "
    "hypot remainder"
).split()
OTHERS = sorted(set(OPERATIONS.values()) - UNUSED)
DRAWN_FROM = [*OTHERS, "constpow", "constpow"]
CODES = {name: code for code, name in OPERATIONS.items()}
POWERS = (0.3, 1.5, -2.5, -0.7, 7.0)
HUGE = np.array([1e22, 2.0**30 + 1, -3e9, 1e300])
ODD = np.array([0.0, -0.0, 5e-324, 1e-310, 1e200, np.inf, -np.inf, np.nan, *HUGE])


@pytest.fixture(params=[True, False], ids=["simplified", "as written"])
def simplifies(request: pytest.FixtureRequest) -> Iterator[None]:
    """CasADi simplifies what it is given, or writes x - x too."""
    ca.GlobalOptions.setSimplificationOnTheFly(request.param)
    yield
    ca.GlobalOptions.setSimplificationOnTheFly(True)


@pytest.fixture(scope="module")
def one_operation(by_casadi: Callable[..., Array]) -> Callable[..., Array]:
    """(operation, operands (n,)) -> CasADi's value of one operation, (n,)."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    functions: dict[str, ca.Function] = {}

    def evaluate(name: str, *operands: Array) -> Array:
        if name not in functions:
            given = [x, y][: len(operands)]
            made = applied(name, *given)
            functions[name] = ca.Function(f"one_{name}", given, [made])
        value: Array = by_casadi(functions[name], *(a[None] for a in operands))[0]
        return value

    return evaluate


def applied(name: str, *operands: ca.SX) -> ca.SX:
    if len(operands) == 2:
        return ca.SX.binary(CODES[name], *operands)
    return ca.SX.unary(CODES[name], *operands)


def random_graph(rng: np.random.Generator) -> ca.Function:
    """Return the last values of a graph of operations, each on values before it."""
    symbols = ca.SX.sym("x", INPUTS)
    nodes = [symbols[i] for i in range(INPUTS)]
    factors = [2.0, 3.0, 0.5, -1.5, 1e-3]
    for _ in range(DRAWN):
        name = str(rng.choice(COMMON if rng.random() < 0.6 else DRAWN_FROM))
        # Most operands are recent, so that products are used once, and fused.
        recent = len(nodes) - 1 - rng.geometric(0.15, 2)
        chosen = np.where(recent >= 0, recent, rng.integers(len(nodes), size=2))
        operands = [nodes[int(i)] for i in chosen[: 1 + (name in PAIRS)]]
        if rng.random() < 0.15:  # As a step of an integrator.
            k, a = operands[0], float(rng.choice(factors))
            nodes.append(nodes[int(chosen[1])] + a * (k + 2 * k + 2 * k + k))
        elif name == "constpow":
            nodes.append(operands[0] ** float(rng.choice(POWERS)))
        else:
            nodes.append(applied(name, *operands))
    return ca.Function("f", [symbols], [ca.vertcat(*nodes[-KEPT:])])


def population_of(rng: np.random.Generator, size: int) -> Array:
    """Ordinary numbers; in a third of the individuals an odd one among them."""
    values = rng.normal(size=(INPUTS, size)) * np.exp2(
        rng.integers(-6, 7, (INPUTS, size))
    )
    row = rng.integers(INPUTS, size=size)
    odd = np.arange(size) % 3 == 1
    values[row[odd], np.flatnonzero(odd)] = rng.choice(ODD, odd.sum())
    return values


def with_bounds(
    tape: Tape, population: Array, one_operation: Callable[..., Array]
) -> tuple[Array, Array]:
    """Return CasADi's values of a tape's output and their running error bounds.

    A value's bound is how far the bounds of its operands move it, and its magnitude:
    its own rounding is one unit. Infinite if nothing can be said.
    """
    values: list[Array] = []
    bounds: list[Array] = []
    for node in tape.nodes:
        value, bound = np.full(population.shape[1], node.value), np.zeros(1)
        if node.operation == "input":
            value = population[node.arguments[1]]
        elif node.operation != "constant":
            value, bound = bounded(
                {"constpow": "pow"}.get(node.operation, node.operation),
                [values[i] for i in node.arguments],
                [bounds[i] for i in node.arguments],
                one_operation,
            )
        values.append(value)
        bounds.append(np.broadcast_to(bound, value.shape))
    kept = tape.outputs[0]
    return np.array([values[i] for i in kept]), np.array([bounds[i] for i in kept])


@np.errstate(all="ignore")
def bounded(
    name: str,
    operands: Sequence[Array],
    bounds: Sequence[Array],
    one_operation: Callable[..., Array],
) -> tuple[Array, Array]:
    """Return an operation's value, and its bound from those of its operands.

    The derivative is taken over all the way that the operands may move, so that a
    comparison that they could flip has an unbounded value.
    """
    value = one_operation(name, *operands)
    steps = [TOLERANCE * bound for bound in bounds]
    moves = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
    corners = [
        one_operation(
            name,
            *(
                np.where(np.isfinite(a), a + way * step, a)
                for way, a, step in zip(ways, operands, steps, strict=False)
            ),
        )
        for ways in (moves if len(operands) == 2 else moves[::2])
    ]
    moved = np.max(np.abs(np.array(corners) - value), axis=0)
    bound = moved / TOLERANCE + np.maximum(np.abs(value), SMALLEST)
    vague = np.any([~np.isfinite(b) for b in bounds], axis=0)
    if name not in LINEAR:
        vague |= moved > 0.01 * np.abs(value)
    # A fused product does not overflow before the sum does.
    vague |= np.isinf(value) & np.all(np.isfinite(operands), axis=0)
    vague |= jumps(name, operands, steps)
    same = np.all([(c == value) | (np.isnan(c) & np.isnan(value)) for c in corners], 0)
    bound = np.where(np.isfinite(value), bound, np.where(same, 0.0, np.inf))
    tiny = (np.abs(value) < SMALLEST) & (value != 0)
    return value, np.where(vague | tiny | np.isnan(bound), np.inf, bound)


def jumps(
    name: str, operands: Sequence[Array], steps: Sequence[Array]
) -> NDArray[np.bool_]:
    """Return where an operation could jump between the corners, unseen."""
    first, last = operands[0], operands[-1]
    on_the_way = np.zeros(first.shape, dtype=bool)
    if name in ("not", "and", "or", "if_else_zero"):
        for a, step in zip(operands, steps, strict=True):
            on_the_way |= (np.abs(a) <= step) & (step > 0)
    elif name in ("eq", "ne", "lt", "le"):
        room = steps[0] + steps[1]
        on_the_way = (np.abs(first - last) <= room) & (room > 0)
    elif name in ("sin", "cos", "tan"):
        on_the_way = steps[0] > 0.01
    elif name in ("fmod", "remainder"):
        moved = steps[0] + np.abs(first / last) * steps[1]
        on_the_way = moved > 0.01 * np.abs(last)
    elif name == "copysign":  # NaN has no sign that is defined.
        on_the_way = np.isnan(last)
    elif name == "pow":
        on_the_way = (first < 0) & (steps[1] > 0)
    return on_the_way


def disagreements(got: Array, want: Array, bound: Array) -> NDArray[np.bool_]:
    """Return where a value is further from CasADi's than its bound allows."""
    with np.errstate(invalid="ignore"):
        near = np.abs(got - want) <= TOLERANCE * (np.abs(want) + bound)
    same = (got == want) | (np.isnan(got) & np.isnan(want))
    agrees: NDArray[np.bool_] = same | near | np.isinf(bound)
    return ~agrees


@pytest.mark.usefixtures("simplifies")
@pytest.mark.parametrize("seed", range(14))
def test_values_of_a_random_graph_are_casadi_s_within_the_running_error_bound(
    by_casadi: Callable[..., Array], one_operation: Callable[..., Array], seed: int
) -> None:
    """Every operation; NaN, infinities, huge angles; any number of individuals."""
    rng = np.random.default_rng(seed)
    function, population = random_graph(rng), population_of(rng, SIZES[-1])
    want, bound = with_bounds(read_tape(function), population, one_operation)
    np.testing.assert_array_equal(by_casadi(function, population), want)
    evaluate = compile_flat(function, (True,)).bind(())
    got = evaluate(population)
    wrong = disagreements(got, want, bound)
    shown = np.stack([got, want, bound], axis=-1)[wrong][:3]
    assert not wrong.any(), (np.argwhere(wrong)[:3], shown)
    for size in SIZES:
        np.testing.assert_array_equal(evaluate(population[:, :size]), got[:, :size])


def test_random_graphs_are_judged_merged_and_fused(
    one_operation: Callable[..., Array],
) -> None:
    """So that the test above tests what it claims."""
    judged, finite, merged, fused = [], [], 0, 0
    seen: set[str] = set()
    for seed in range(14):
        rng = np.random.default_rng(seed)
        tape, population = read_tape(random_graph(rng)), population_of(rng, 99)
        values, bounds = with_bounds(tape, population, one_operation)
        judged.append(np.isfinite(bounds).mean())
        finite.append(np.isfinite(values).mean())
        merged += simplified(tape) != tape
        fused += len(fused_products(simplified(tape)))
        seen |= {node.operation for node in tape.nodes}
    assert np.mean(judged) > 0.6
    assert np.mean(finite) > 0.3
    assert merged >= 6
    assert fused >= 30
    assert len(set(OTHERS) - seen) <= 6, set(OTHERS) - seen


def graph_of_sums(rng: np.random.Generator, symbols: ca.SX) -> ca.SX:
    """A sum of multiples of few values and of products, in random order."""
    base = [symbols[i] for i in range(INPUTS)]
    total = base[0]
    for _ in range(14):
        a, b = (base[int(i)] for i in rng.integers(INPUTS, size=2))
        factor = float(rng.choice([0.25, 2.0, 3.0, 1 / 3, -2.0]))
        terms = [factor * a, a * b, a * a, a, 2 * a]
        term = terms[int(rng.integers(len(terms)))]
        total = total - term if rng.random() < 0.3 else total + term
        if rng.random() < 0.2:
            total = factor * total
    return total


@pytest.mark.parametrize("seed", range(8))
def test_merged_and_fused_sums_are_casadi_s_within_the_running_error_bound(
    one_operation: Callable[..., Array], seed: int
) -> None:
    """A hundred times nearer than asked for: nothing but rounding differs."""
    rng = np.random.default_rng(seed)
    symbols = ca.SX.sym("x", INPUTS)
    function = ca.Function("f", [symbols], [graph_of_sums(rng, symbols)])
    population = rng.normal(size=(INPUTS, 200))
    want, bound = with_bounds(read_tape(function), population, one_operation)
    got = compile_flat(function, (True,)).bind(())(population)
    assert np.isfinite(bound).all()
    assert np.all(np.abs(got - want) <= 1e-15 * (np.abs(want) + bound))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("dead", [ca.SX(np.inf), ca.SX(np.nan)])
def test_branch_whose_dead_side_is_infinite_has_the_other_s_value(
    compiled: Callable[..., Evaluate], dead: ca.SX, size: int
) -> None:
    x = ca.SX.sym("x")
    alive = x > 0
    branches = [
        ca.if_else(alive, ca.log(x), ca.sqrt(-x)),
        ca.if_else(alive, x**-1.5, dead * x),
        ca.if_else(alive, x, 2 / (x * 0)) + x * x,
    ]
    values = np.random.default_rng(size).normal(size=(1, size))
    (got,) = compiled([x], [ca.vertcat(*branches)])(values)
    positive, v = values[0] > 0, values[0]
    magnitude = np.abs(v)
    want = np.where(positive, np.log(magnitude), np.sqrt(magnitude))
    np.testing.assert_allclose(got[0], want, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(
        got[1][positive], magnitude[positive] ** -1.5, rtol=1e-15
    )
    assert not np.isfinite(got[1][~positive]).any()
    np.testing.assert_allclose(got[2][positive], (v + v * v)[positive], rtol=1e-15)
