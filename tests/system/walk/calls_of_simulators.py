"""Calls of simulators of others; of FMUs and aircraft if they can be made here."""

import importlib
import importlib.util
import shutil
import tempfile
from pathlib import Path

import swarmstart as ss
from swarmstart.tests.simulators import pendulum
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import Call, Calls, with_defaults


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    return {**_commands(), **_fmus(), **_aircraft(), **_networks()}


def _commands() -> Calls:
    plant = ss.CommandPlant(made.TANK)
    part = ss.SelectedPlant(plant, states=["level"], controls=["inflow"])

    def step(x: object, u: object, dt: object) -> object:
        # The valid call comes first, and ends at another state.
        part.start_at([1.0])
        return part.step(x, u, dt)  # type: ignore[arg-type]

    return {
        "CommandPlant": with_defaults(ss.CommandPlant, command=made.TANK),
        "CommandPlant.start_at": Call(plant.start_at, {"x": [1.0]}),
        "CommandPlant.step": Call(plant.step, {"x": [1.0], "u": [0.0], "dt": 0.1}),
        "Autopilot": with_defaults(ss.Autopilot),
        "SelectedPlant": with_defaults(
            ss.SelectedPlant, simulator=plant, states=["level"], controls=["inflow"]
        ),
        "solve_simulated": with_defaults(
            ss.solve_simulated,
            problem=made.problem(),
            simulator=made.Tank(),
            x0=[1.0, 0.0],
            rollouts=2,
            surrogate=False,
            search="random",
            workers=0,
            seed=0,
            progress=False,
        ),
        "SelectedPlant.start_at": Call(part.start_at, {"x": [1.0]}),
        "SelectedPlant.step": Call(step, {"x": [1.0], "u": [0.0], "dt": 0.1}),
    }


def _fmus() -> Calls:
    compiler = shutil.which("cc")
    if compiler is None or _is_missing("fmpy"):
        return {}
    file = pendulum.built(Path(tempfile.mkdtemp()), "2.0", compiler)
    states, controls = ["angle", "speed"], ["torque"]
    plant = ss.FmuPlant(file, states=states, controls=controls)

    def step(x: object, u: object, dt: object) -> object:
        # The valid call comes first, and ends at another state.
        plant.start_at([0.0, 0.0])
        return plant.step(x, u, dt)  # type: ignore[arg-type]

    return {
        "FmuPlant": with_defaults(
            ss.FmuPlant, file=file, states=states, controls=controls
        ),
        "FmuPlant.start_at": Call(plant.start_at, {"x": [0.0, 0.0]}),
        "FmuPlant.step": Call(step, {"x": [0.0, 0.0], "u": [1.0], "dt": 0.1}),
    }


def _aircraft() -> Calls:
    if _is_missing("jsbsim"):
        return {}
    plant = ss.AircraftPlant()
    start = [222.0, 0.0, 4572.0, 0.0, 0.0]

    def step(x: object, u: object, dt: object) -> object:
        begun = plant.start_at(start)
        x = begun if x is start else x
        return plant.step(x, u, dt)  # type: ignore[arg-type]

    return {
        "AircraftPlant": with_defaults(ss.AircraftPlant),
        "AircraftPlant.start_at": Call(plant.start_at, {"x": start}),
        "AircraftPlant.step": Call(step, {"x": start, "u": start[:3], "dt": 0.1}),
    }


def _networks() -> Calls:
    if any(map(_is_missing, ("onnx", "onnxruntime"))):
        return {}
    made_by = importlib.import_module("swarmstart.tests.simulators.test_network")
    file = made_by.network(Path(tempfile.mkdtemp()) / "net.onnx")
    plant = ss.OnnxPlant(file, **made_by.NAMES)
    return {
        "OnnxPlant": with_defaults(ss.OnnxPlant, file=file, **made_by.NAMES),
        "OnnxPlant.step": Call(plant.step, {"x": [0.0, 0.0], "u": [1.0], "dt": 0.1}),
    }


def _is_missing(package: str) -> bool:
    return importlib.util.find_spec(package) is None
