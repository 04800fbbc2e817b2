"""A network in ONNX is a plant: the numbers of NumPy, and clear refusals."""

import pickle
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
NAMES: dict[str, Any] = {
    "states": ["angle", "speed"], "controls": ["torque"], "dt": 0.1,
}  # fmt: skip
A = np.array([[1.0, 0.1], [-0.981, 0.98]])
B = np.array([[0.005], [0.1]])
BENT = 0.01


def network(
    file: Path, kind: str = "FLOAT", *, rows: Any = 1, size: int = 3, inputs: int = 1
) -> Path:
    """Write a network: one linear layer, and a little of its hyperbolic tangent."""
    helper, type_ = onnx.helper, getattr(onnx.TensorProto, kind)
    dtype = helper.tensor_dtype_to_np_dtype(type_)
    both = np.hstack([A, B])[:, :size].T.astype(dtype)
    nodes = [
        helper.make_node("MatMul", ["in0", "W"], ["linear"]),
        helper.make_node("Tanh", ["linear"], ["bent"]),
        helper.make_node("Mul", ["bent", "part"], ["small"]),
        helper.make_node("Add", ["linear", "small"], ["out"]),
    ]
    given = [
        helper.make_tensor_value_info(f"in{i}", type_, [rows, size])
        for i in range(inputs)
    ]
    graph = helper.make_graph(
        nodes, "net", given,
        [helper.make_tensor_value_info("out", type_, [rows, 2])],
        [
            onnx.numpy_helper.from_array(both, "W"),
            onnx.numpy_helper.from_array(np.array(BENT, dtype), "part"),
        ],
    )  # fmt: skip
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8
    )
    onnx.save(model, str(file))
    return file


def expected(x: Array, u: Array) -> Array:
    linear = A @ x + B @ u
    return linear + BENT * np.tanh(linear)


@pytest.mark.parametrize(("kind", "near"), [("DOUBLE", 1e-14), ("FLOAT", 1e-6)])
@pytest.mark.parametrize("rows", [1, "batch"])
def test_a_step_has_the_numbers_of_numpy(
    tmp_path: Path, kind: str, near: float, rows: object
) -> None:
    """In either precision, with one row or a number of rows that is left open."""
    plant = ss.OnnxPlant(network(tmp_path / "net.onnx", kind, rows=rows), **NAMES)
    rng = np.random.default_rng(0)
    for x, u in zip(rng.normal(size=(9, 2)), rng.normal(size=(9, 1)), strict=True):
        assert np.abs(plant.step(x, u, 0.1) - expected(x, u)).max() < near
        changed = ss.OnnxPlant(tmp_path / "net.onnx", **NAMES, gives_change=True)
        assert np.abs(changed.step(x, u, 0.1) - x - expected(x, u)).max() < near


def test_a_closed_loop_on_a_network(tmp_path: Path) -> None:
    """A plan with the linear part alone brings it to rest; a copy by pickle, too."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    after = ca.DM(A) @ x + ca.DM(B) @ u
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, next_state=after, dt=0.1), horizon=1.0,
        intervals=10, stage_cost=ca.sumsqr(x) + 0.01 * u**2,
        bounds=ss.Bounds(controls=(-20, 20)),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    plant = ss.OnnxPlant(network(tmp_path / "net.onnx", "DOUBLE"), **NAMES)
    copy = pickle.loads(pickle.dumps(plant))
    run, again = (
        ss.simulate(one, loop, [1.0, 0.0], steps=40, seed=0) for one in (plant, copy)
    )
    assert np.abs(run.states[:, -1]).max() < 0.05
    assert np.array_equal(run.states, again.states)
    assert run.state_names == ("angle", "speed")


@pytest.mark.parametrize(
    ("form", "message"),
    [
        ({"size": 2}, r"input of shape \(1, 3\) for 2 states and 1 controls, found"),
        ({"rows": 5}, r"input of shape \(1, 3\)"),
        ({"inputs": 2}, "expected one input.*found in0, in1"),
    ],
)
def test_a_network_of_another_shape(
    tmp_path: Path, form: dict[str, Any], message: str
) -> None:
    """One sentence with the shape that was expected."""
    file = network(tmp_path / "net.onnx", **form)
    with pytest.raises(ss.SimulatorError, match=message):
        ss.OnnxPlant(file, **NAMES)


def test_an_output_of_whole_numbers(tmp_path: Path) -> None:
    """A state is none of them."""
    helper, proto = onnx.helper, onnx.TensorProto
    graph = helper.make_graph(
        [helper.make_node("Cast", ["in0"], ["out"], to=proto.INT64)], "net",
        [helper.make_tensor_value_info("in0", proto.FLOAT, [1, 3])],
        [helper.make_tensor_value_info("out", proto.INT64, [1, 3])],
    )  # fmt: skip
    opset = helper.make_opsetid("", 17)
    file = tmp_path / "net.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[opset], ir_version=8), str(file))
    with pytest.raises(ss.SimulatorError, match=r"output of floats.*int64"):
        ss.OnnxPlant(file, states=["a", "b", "c"], controls=[], dt=0.1)


def test_what_is_no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A text, a folder, no file, a file beyond the limit, data in another file."""
    file = tmp_path / "net.onnx"
    file.write_text("a text")
    with pytest.raises(ss.SimulatorError, match="expected a network in ONNX"):
        ss.OnnxPlant(file, **NAMES)
    with pytest.raises(ss.SimulatorError, match="expected a network; "):
        ss.OnnxPlant(tmp_path, **NAMES)
    with pytest.raises(ss.SimulatorError, match="found no file"):
        ss.OnnxPlant(tmp_path / "none.onnx", **NAMES)
    network(file)
    model = onnx.load(str(file))
    onnx.save(model, str(tmp_path / "apart.onnx"), save_as_external_data=True,
              size_threshold=0)  # fmt: skip
    with pytest.raises(ss.SimulatorError, match="expected a network in ONNX"):
        ss.OnnxPlant(tmp_path / "apart.onnx", **NAMES)
    monkeypatch.setattr("swarmstart.simulators.network.MOST_BYTES", 10)
    with pytest.raises(ss.SimulatorError, match="at most 10 bytes"):
        ss.OnnxPlant(file, **NAMES)


def test_what_does_not_fit_a_step(tmp_path: Path) -> None:
    """Another step, no numbers, another size."""
    plant = ss.OnnxPlant(network(tmp_path / "net.onnx"), **NAMES)
    with pytest.raises(ss.SimulatorError, match=r"step of 0\.1 s, found 0\.2 s"):
        plant.step([0.0, 0.0], [0.0], 0.2)
    with pytest.raises(ss.SimulatorError, match="finite numbers as the state"):
        plant.step([0.0, np.nan], [0.0], 0.1)
    with pytest.raises(ss.SimulatorError, match="finite numbers as the controls"):
        plant.step([0.0, 0.0], [0.0, 1.0], 0.1)
