"""FMUs of a controller are valid, and decide as the C file does, to the last bit."""

import importlib
import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.export import CExport, is_compiled
from swarmstart.export.controller import exported, fmu

Made = Callable[[str], CExport]


def names_in(content: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return archive.namelist()


def test_a_source_fmu_needs_no_compiler(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has the same description and sources, and the certificate of its set."""
    monkeypatch.setattr(exported, "COMPILERS", ("no-such-compiler",))
    found = names_in(ss.export_fmu(made("dual_mode")))
    assert found == [
        "modelDescription.xml", "resources/dual_mode.certificate.json",
        "sources/buildDescription.xml", "sources/dual_mode.c", "sources/dual_mode.h",
        "sources/dual_mode_fmu.c",
    ]  # fmt: skip


def test_the_same_fmu_has_the_same_bytes(made: Made) -> None:
    """Without a library, of which the compiler decides."""
    first, second = (ss.export_fmu(made("tracking"), compiled=False) for _ in range(2))
    assert first == second
    assert not is_compiled(first)


@pytest.mark.usefixtures("c_compiler")
@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("name", ["dual_mode", "tracking", "way_round"])
def test_fmpy_finds_it_valid_and_steps_it(
    made: Made, name: str, version: fmu.Version, tmp_path: Path
) -> None:
    """States, parameters and signals as inputs; the bits are those of the C file."""
    fmpy = pytest.importorskip("fmpy")
    validation = pytest.importorskip("fmpy.validation")
    file = tmp_path / f"{name}.fmu"
    file.write_bytes(ss.export_fmu(made(name), version))
    assert validation.validate_fmu(str(file)) == []
    described = fmpy.read_model_description(str(file))
    slave = _slave(fmpy, str(file), described, version)
    variables = described.modelVariables
    inputs, outputs = (
        [one.valueReference for one in variables if one.causality == kind]
        for kind in ("input", "output")
    )
    assert len(inputs) == len(fmu._inputs(made(name)))
    posed, dt = made(name).posed, made(name).posed.problem.dt
    compiled, x = made(name).controller(), posed.x0[: posed.stated]
    for k in range(4):
        _set(slave, version)(inputs[: x.size], x.tolist())
        slave.doStep(currentCommunicationPoint=k * dt, communicationStepSize=dt)
        *u, status, cost = _get(slave, version)(outputs)
        assert u == compiled.step(x).tolist()
        assert (status, cost) == (compiled.status, compiled.cost)
        x = x + 0.1
    with pytest.raises(Exception, match=r"doStep|DoStep"):
        slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=dt / 2)
    slave.freeInstance()


@pytest.mark.usefixtures("c_compiler")
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_its_state_can_be_kept_and_set(
    made: Made, version: fmu.Version, tmp_path: Path
) -> None:
    """A step from a kept state gives the same control again."""
    fmpy = pytest.importorskip("fmpy")
    file = tmp_path / "kept.fmu"
    file.write_bytes(ss.export_fmu(made("pendulum"), version))
    described = fmpy.read_model_description(str(file))
    slave = _slave(fmpy, str(file), described, version)
    dt, controls = made("pendulum").posed.problem.dt, []
    control = [v.valueReference for v in described.modelVariables if v.name == "u"]
    state = slave.getFMUState() if version == "3.0" else slave.getFMUstate()
    for _ in range(2):
        for k in range(3):
            slave.doStep(currentCommunicationPoint=k * dt, communicationStepSize=dt)
        controls.append(_get(slave, version)(control))
        (slave.setFMUState if version == "3.0" else slave.setFMUstate)(state)
    assert controls[0] == controls[1]
    assert np.isfinite(controls).all()
    slave.freeInstance()


def _slave(fmpy: Any, file: str, described: Any, version: str) -> Any:
    """Return an instance after its initialization."""
    number = version[0]
    room = importlib.import_module(f"fmpy.fmi{number}")
    slave = getattr(room, f"FMU{number}Slave")(
        guid=described.guid, unzipDirectory=fmpy.extract(file), instanceName="one",
        modelIdentifier=described.coSimulation.modelIdentifier,
    )  # fmt: skip
    slave.instantiate()
    if version == "2.0":
        slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave


def _set(slave: Any, version: str) -> Any:
    return slave.setFloat64 if version == "3.0" else slave.setReal


def _get(slave: Any, version: str) -> Any:
    return slave.getFloat64 if version == "3.0" else slave.getReal
