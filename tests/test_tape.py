import casadi as ca
import numpy as np
import pytest

from swarmstart.tape import Node, UnknownOperationError, read_tape


def tape_of(*outputs: ca.SX, inputs: list[ca.SX]) -> list[Node]:
    return list(read_tape(ca.Function("f", inputs, list(outputs))).nodes)


def operations(*outputs: ca.SX, inputs: list[ca.SX]) -> list[str]:
    return [node.operation for node in tape_of(*outputs, inputs=inputs)]


def test_products_in_either_order_are_one_value() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    made = operations(x * y + ca.sin(y * x), inputs=[x, y])
    assert made.count("mul") == 1


def test_differences_in_either_order_are_two_values() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    assert operations(x - y, ca.sin(y - x), inputs=[x, y]).count("sub") == 2


def test_equal_expressions_are_one_value() -> None:
    x = ca.SX.sym("x")
    assert operations(ca.sin(x), 1 + ca.sin(x), inputs=[x]).count("sin") == 1


def test_equal_constants_are_one_value_and_so_are_those_that_are_no_number() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [ca.vertcat(2.0, x, 2.0), ca.vertcat(0, np.nan)])
    constants = [n for n in read_tape(function).nodes if n.operation == "constant"]
    assert [repr(n.value) for n in constants] == ["0.0", "2.0", "nan"]


@pytest.fixture
def unsimplified(request: pytest.FixtureRequest) -> None:
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    request.addfinalizer(lambda: ca.GlobalOptions.setSimplificationOnTheFly(True))


@pytest.mark.usefixtures("unsimplified")
def test_arithmetic_of_constants_is_folded_by_casadi() -> None:
    """Simplification or not; so the tape need not."""
    x, two = ca.SX.sym("x"), ca.SX(2)
    operated = ca.SX.binary(ca.OP_MUL, ca.sqrt(two + 7), two)
    lifted = ca.SX.binary(ca.OP_LIFT, operated, two) - 1
    assert operations(operated, -lifted, inputs=[x]) == ["constant", "constant"]


def test_lifted_value_is_the_value() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    lifted = ca.SX.binary(ca.OP_LIFT, x, y)
    assert operations(ca.sin(lifted), inputs=[x, y]) == ["input", "sin"]


def test_what_no_output_needs_is_left_out() -> None:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    whole = ca.Function("f", [x, y], [x[1], ca.sin(y)])
    tape = read_tape(whole)
    assert [n.arguments for n in tape.nodes if n.operation == "input"] == [
        (0, 1),
        (1, 0),
    ]
    assert tape.inputs == (3, 1)


def test_arguments_come_before_what_is_computed_from_them() -> None:
    x = ca.SX.sym("x", 4)
    nodes = tape_of(ca.sumsqr(ca.sin(x)) / (1 + ca.norm_2(x)), inputs=[x])
    for number, node in enumerate(nodes):
        assert node.operation == "input" or all(a < number for a in node.arguments)


def test_outputs_keep_their_order_and_dense_places() -> None:
    x = ca.SX.sym("x")
    sparse = ca.SX(3, 2)
    sparse[2, 1] = x
    tape = read_tape(ca.Function("f", [x], [sparse, x, ca.SX(0, 1)]))
    (zero,) = {*tape.outputs[0][:5]}
    assert tape.nodes[zero] == Node("constant", (), 0.0)
    assert tape.outputs[0][5] == tape.outputs[1][0]
    assert tape.outputs[2] == ()


def test_entries_of_sparse_inputs_are_numbered_densely() -> None:
    m = ca.SX.sym("m", ca.Sparsity.diag(3))
    (node,) = tape_of(m[1, 1], inputs=[m])
    assert node == Node("input", (0, 4))


def test_uses_are_counted_outputs_included() -> None:
    x = ca.SX.sym("x")
    tape = read_tape(ca.Function("f", [x], [ca.sin(x) * x, x]))
    uses = dict(zip([n.operation for n in tape.nodes], tape.users(), strict=True))
    assert uses == {"input": 3, "sin": 1, "mul": 1}


def test_matrix_expression_is_refused() -> None:
    x = ca.MX.sym("x")
    with pytest.raises(UnknownOperationError, match="matrices is no SX function"):
        read_tape(ca.Function("matrices", [x], [ca.sin(x)]))


def test_unknown_operation_is_refused() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(UnknownOperationError, match="operation erfinv,"):
        read_tape(ca.Function("f", [x], [ca.erfinv(x)]))
