import casadi as ca
import pytest

from swarmstart.ocp.compiled.emitter import (
    repeated_functions,
    simplified,
    with_inverses,
)
from swarmstart.tape import Node, Tape, read_tape


def tape_of(inputs: list[ca.SX], *outputs: ca.SX) -> Tape:
    return simplified(read_tape(ca.Function("f", inputs, list(outputs))))


def written(tape: Tape, number: int) -> str:
    """Return a value as text: x0 is entry 0 of the first argument."""
    node = tape.nodes[number]
    if node.operation == "input":
        return "xyz"[node.arguments[0]] + str(node.arguments[1])
    if node.operation == "constant":
        return f"{node.value:g}"
    arguments = ", ".join(written(tape, a) for a in node.arguments)
    return f"{node.operation}({arguments})"


def only(inputs: list[ca.SX], value: ca.SX) -> str:
    tape = tape_of(inputs, value)
    return written(tape, tape.outputs[0][0])


@pytest.fixture
def x() -> ca.SX:
    return ca.SX.sym("x")


@pytest.fixture
def k(x: ca.SX) -> ca.SX:
    return ca.sin(x)


def test_step_of_a_constant_rate_is_one_multiple(x: ca.SX, k: ca.SX) -> None:
    assert only([x], 0.3 / 6 * (k + 2 * k + 2 * k + k)) in (
        "mul(sin(x0), 0.3)",
        "mul(0.3, sin(x0))",
    )
    assert only([x], 1 / 6 * (k + 2 * k + 2 * k + k)) == "sin(x0)"


def test_multiples_are_added_within_a_longer_sum(x: ca.SX, k: ca.SX) -> None:
    y = ca.SX.sym("y")
    assert only([x, y], (y + 2 * k) + 3 * k).count("sin") == 1
    assert only([x, y], (2 * k + y) + 3 * k).count("mul") == 1


@pytest.mark.parametrize("factor", [-1.0, -2.0, -3.0])
def test_multiples_of_opposite_signs_are_left(factor: float) -> None:
    """Sums must cancel as those of CasADi do."""
    x = ca.SX.sym("x")
    value = 3.5 * x + ca.SX(factor) * x
    tape = read_tape(ca.Function("f", [x], [value]))
    assert simplified(tape) == tape


def test_sum_that_something_else_uses_is_left(x: ca.SX, k: ca.SX) -> None:
    y = ca.SX.sym("y")
    partial = y + 3 * k
    tape = read_tape(ca.Function("f", [x, y], [partial + 5 * k, ca.cos(partial)]))
    assert simplified(tape) == tape


def test_graph_whose_every_value_is_an_output_is_left(x: ca.SX) -> None:
    a, b = 3 * x, 5 * x
    tape = read_tape(ca.Function("f", [x], [ca.vertcat(a, b, a + b, 2.5 * (a + b))]))
    assert simplified(tape) == tape


def test_constants_of_different_values_are_left(x: ca.SX) -> None:
    y = ca.SX.sym("y")
    tape = read_tape(ca.Function("f", [x, y], [3 * x + 3 * y]))
    assert simplified(tape) == tape


@pytest.mark.parametrize(("a", "b"), [(1e308, 1.5e308), (3e-300, 2e-300)])
def test_factors_at_the_ends_of_the_exponents_are_left(
    x: ca.SX, a: float, b: float
) -> None:
    """Their sum would be infinite where the multiples are not."""
    tape = read_tape(ca.Function("f", [x], [a * x + b * x]))
    assert simplified(tape) == tape


def test_simplified_twice_is_simplified_once(x: ca.SX, k: ca.SX) -> None:
    y = ca.SX.sym("y")
    value = y + 0.1 * (k + 2 * k + 2 * k + k) + y * (x + x + x)
    once = tape_of([x, y], value)
    assert simplified(once) == once


def test_inputs_and_outputs_keep_their_places(x: ca.SX) -> None:
    tape = tape_of([ca.SX.sym("unused", 2), x], x, ca.SX(2, 1), 2 * x + 3 * x)
    assert tape.inputs == (2, 1)
    assert [len(output) for output in tape.outputs] == [1, 2, 1]
    assert tape.nodes[tape.outputs[0][0]] == Node("input", (1, 0))


def stage(after: ca.SX, state: ca.SX, *others: ca.SX) -> Tape:
    return tape_of([state], after, *others)


def test_function_of_the_state_after_is_the_next_stage_s() -> None:
    x = ca.SX.sym("x", 2)
    after = ca.vertcat(x[0] + ca.cos(x[1]), x[1] + 0.1)
    tape = stage(after, x, ca.cos(after[1]))
    ((entry, now, later),) = repeated_functions(tape)
    assert entry == 1
    assert written(tape, now) == "cos(x1)"
    assert written(tape, later) == f"cos({written(tape, tape.outputs[0][1])})"


def test_function_of_another_entry_or_another_function_is_not_repeated() -> None:
    x = ca.SX.sym("x", 2)
    after = x + 0.1
    assert repeated_functions(stage(after, x, ca.cos(x[0]), ca.cos(after[1]))) == []
    assert repeated_functions(stage(after, x, ca.sin(x[0]), ca.cos(after[0]))) == []


def test_function_of_a_state_that_stays_is_known_for_all_stages() -> None:
    x = ca.SX.sym("x")
    ((entry, now, later),) = repeated_functions(stage(x, x, ca.exp(x)))
    assert entry == 0
    assert now == later


def test_what_divides_several_times_is_inverted_once() -> None:
    a, b, c, p = (ca.SX.sym(name) for name in "abcp")
    function = ca.Function("f", [ca.vertcat(a, b, c, p)], [a / p, b / p, c / a])
    tape = with_inverses(read_tape(function))
    assert [written(tape, number) for (number,) in tape.outputs] == [
        "mul(x0, inv(x3))", "mul(inv(x3), x1)", "div(x2, x0)",
    ]  # fmt: skip
    assert sum(node.operation == "inv" for node in tape.nodes) == 1
    assert with_inverses(tape) == tape
