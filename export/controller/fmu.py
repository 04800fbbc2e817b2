"""A controller in C as an FMU: functional mock-up unit for co-simulation, FMI 2 or 3.

An FMU is a ZIP archive of modelDescription.xml, the sources, and a shared library for
each platform. Inputs are the states, then parameters and signals; outputs are the
controls, the status and the cost of the plan.
"""

import hashlib
import io
import itertools
import platform
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np

from swarmstart.arguments import FLAG, checked, choice, of_kind
from swarmstart.export.controller.exported import (
    FLAGS,
    CExport,
    NoCCompilerError,
    compiled_library,
    compiler_command,
)
from swarmstart.ocp.common.errors import refused

Version = Literal["2.0", "3.0"]
_TIME = (1980, 1, 1, 0, 0, 0)
"""Time of the files in the archive, so that the same FMU has the same bytes."""
_PLATFORMS = {
    ("Linux", "x86_64"): ("linux64", "x86_64-linux", ".so"),
    ("Linux", "aarch64"): ("aarch64-linux", "aarch64-linux", ".so"),
    ("Darwin", "x86_64"): ("darwin64", "x86_64-darwin", ".dylib"),
    ("Darwin", "arm64"): ("aarch64-darwin", "aarch64-darwin", ".dylib"),
}
"""System and processor -> folders of its binaries in FMI 2 and 3, and their ending."""


@checked(
    refused,
    made=of_kind(CExport, "a CExport"),
    version=choice(("3.0", "2.0")),
    compiled=FLAG,
)
def export_fmu(
    made: CExport, version: Version = "3.0", *, compiled: bool = True
) -> bytes:
    """Return a controller in C as an FMU for co-simulation.

    Inputs are the states, then parameters and signals; outputs are the controls, the
    status and the cost. A step from t to t + dt, with dt the control interval, takes
    the inputs of time t; its outputs are the controls for the interval that begins at
    t.

    Args:
        made: The controller in C, from `export_c`.
        version: Version of FMI, "2.0" or "3.0".
        compiled: Whether to add a library for this machine, if a compiler is there.
            Without a library, the result is a source FMU.

    Returns:
        The archive, the content of NAME.fmu.

    Raises:
        ExportError: If the compiler fails.

    Example:
        >>> import casadi as ca, io, zipfile
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=x + u), horizon=2.0, intervals=4,
        ...     stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> made = ss.export_c(ss.RecedingHorizon(planner=planner), [1.0], name="one")
        >>> fmu = ss.export_fmu(made, compiled=False)
        >>> sorted(zipfile.ZipFile(io.BytesIO(fmu)).namelist())[0]
        'modelDescription.xml'
    """
    token = _token(made, version)
    sources = {
        f"{made.name}.c": made.files[f"{made.name}.c"],
        f"{made.name}_fmu.c": _wrapper(made, version, token),
        f"{made.name}.h": made.files[f"{made.name}.h"],
    }
    content = {f"sources/{name}": text.encode() for name, text in sources.items()}
    content["modelDescription.xml"] = _description(made, version, token)
    if version == "3.0":
        content["sources/buildDescription.xml"] = _build(made)
    certificate = f"{made.name}.certificate.json"
    if certificate in made.files:
        content[f"resources/{certificate}"] = made.files[certificate].encode()
    if compiled:
        content |= _library(made.name, version, sources)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(content):
            archive.writestr(zipfile.ZipInfo(name, _TIME), content[name])
    return buffer.getvalue()


def is_compiled(fmu: bytes) -> bool:
    """Return whether an FMU has a compiled library."""
    with zipfile.ZipFile(io.BytesIO(fmu)) as archive:
        return any(name.startswith("binaries/") for name in archive.namelist())


def _token(made: CExport, version: str) -> str:
    """Return the identifier that binds description and binary."""
    text = version + "".join(made.files[f"{made.name}{end}"] for end in (".c", ".h"))
    digest = hashlib.sha256(text.encode()).hexdigest()
    cuts = (0, 8, 12, 16, 20, 32)
    parts = [digest[a:b] for a, b in itertools.pairwise(cuts)]
    return f"{{{'-'.join(parts)}}}"


def _inputs(made: CExport) -> dict[str, float]:
    """Return names of the inputs, with their first values."""
    one, problem = made.posed, made.posed.problem
    model, known = problem.model, one.known
    states = model.state_names[: one.stated]
    found = dict(zip(states, one.x0[: one.stated].tolist(), strict=True))
    parameters = np.asarray(known.parameters, dtype=float)
    found |= {f"parameter_{i + 1}": float(v) for i, v in enumerate(parameters)}
    signals = np.atleast_2d(np.asarray(known.signals, dtype=float))
    if problem.ns:
        for node in range(problem.nodes):
            for row in range(problem.ns):
                found[f"signal_{row + 1}[{node + 1}]"] = float(signals[row, node])
    return found


def _outputs(made: CExport) -> list[str]:
    return [*made.posed.problem.model.control_names, "status", "cost"]


def _variables(made: CExport) -> dict[str, float | None]:
    """Return all variables: inputs with their first values, outputs with None."""
    inputs = _inputs(made)
    names = [
        name if name not in inputs else f"{name}_output" for name in _outputs(made)
    ]
    return {**inputs, **dict.fromkeys(names, None)}


def _description(made: CExport, version: str, token: str) -> bytes:
    """Return modelDescription.xml."""
    identifier, is_new = f"{made.name}_fmu", version == "3.0"
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": version, "modelName": made.name,
        ("instantiationToken" if is_new else "guid"): token,
        "generationTool": "swarmstart",
        "description": "A receding-horizon controller: after a step at time t, the "
        "outputs are the controls for the interval that begins at t.",
    })  # fmt: skip
    if not is_new:
        root.set("variableNamingConvention", "structured")
    dt = repr(float(made.posed.problem.dt))
    flags = {
        "modelIdentifier": identifier,
        "canHandleVariableCommunicationStepSize": "false",
    }  # fmt: skip
    state = "canGetAndSetFMUState" if is_new else "canGetAndSetFMUstate"
    flags[state] = "true"
    if is_new:
        flags["fixedInternalStepSize"] = dt
    steps = ET.SubElement(root, "CoSimulation", flags)
    if not is_new:
        sources = ET.SubElement(steps, "SourceFiles")
        _name_sources(sources, "File", made)
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0", "stepSize": dt})
    variables = ET.SubElement(root, "ModelVariables")
    if is_new:
        independent = {
            "name": "time", "valueReference": "0", "causality": "independent",
            "variability": "continuous",
        }  # fmt: skip
        ET.SubElement(variables, "Float64", independent)
    outputs = []
    for number, (name, value) in enumerate(_variables(made).items(), start=1):
        _add_variable(variables, name, number, value, is_new=is_new)
        if value is None:
            outputs.append(str(number))
    root.append((_structure if is_new else _old_structure)(outputs))
    return _xml(root)


def _name_sources(parent: ET.Element, kind: str, made: CExport) -> None:
    """Add an element for each source."""
    for name in (f"{made.name}.c", f"{made.name}_fmu.c"):
        ET.SubElement(parent, kind, {"name": name})


def _xml(root: ET.Element) -> bytes:
    """Return a document as text."""
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _structure(outputs: Sequence[str]) -> ET.Element:
    """Return the structure of FMI 3: outputs, all unknown at first."""
    found = ET.Element("ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for number in outputs:
            ET.SubElement(found, kind, {"valueReference": number})
    return found


def _old_structure(outputs: Sequence[str]) -> ET.Element:
    """Return the structure of FMI 2."""
    found = ET.Element("ModelStructure")
    for kind in ("Outputs", "InitialUnknowns"):
        group = ET.SubElement(found, kind)
        for number in outputs:
            ET.SubElement(group, "Unknown", {"index": number})
    return found


def _add_variable(
    variables: ET.Element, name: str, number: int, value: float | None, *, is_new: bool
) -> None:
    """Add an input, or an output if it has no value."""
    common = {
        "name": name, "valueReference": str(number),
        "causality": "output" if value is None else "input", "variability": "discrete",
    }  # fmt: skip
    start = {} if value is None else {"start": repr(value)}
    if is_new:
        ET.SubElement(variables, "Float64", common | start)
    else:
        ET.SubElement(ET.SubElement(variables, "ScalarVariable", common), "Real", start)


def _build(made: CExport) -> bytes:
    """Return buildDescription.xml of FMI 3."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = ET.SubElement(
        root, "BuildConfiguration", {"modelIdentifier": f"{made.name}_fmu"}
    )
    flags = {"language": "C99", "compilerOptions": " ".join(FLAGS[2:])}
    sources = ET.SubElement(build, "SourceFileSet", flags)
    _name_sources(sources, "SourceFile", made)
    ET.SubElement(build, "Library", {"name": "m"})
    return _xml(root)


def _wrapper(made: CExport, version: str, token: str) -> str:
    """Return the functions of FMI as C."""
    room = files(__package__)
    functions = room.joinpath({"2.0": "fmi2.c", "3.0": "fmi3.c"}[version])
    problem, inputs = made.posed.problem, _inputs(made)
    variables = _variables(made)
    arrays, filled, passed = "", "", ""
    first, np_ = made.posed.stated, problem.model.np
    groups = (("parameters", np_, "NP"), ("signals", problem.ns * problem.nodes, "NS"))
    for name, count, size in groups:
        if count:
            arrays += f"  NAME_real {name}[NAME_{size}];\n"
            filled += (
                f"  for (i = 0; i < NAME_{size}; ++i) {{\n    {name}[i] = "
                f"(NAME_real)one->values[{first} + i];\n  }}\n"
            )
            passed += f", {name}"
            first += count
    values = [repr(float(value or 0.0)) for value in variables.values()]
    places = {
        "VERSION": version, "REALS": str(len(variables)), "INPUTS": str(len(inputs)),
        "STARTS": ",\n    ".join(values), "TOKEN": token, "ARRAYS": arrays,
        "FILLED": filled, "PASSED": passed, "FUNCTIONS": functions.read_text("utf-8"),
    }  # fmt: skip
    text = room.joinpath("fmu.c").read_text("utf-8")
    for place, value in places.items():
        text = text.replace(f"@{place}@", value)
    return text.replace("NAME", made.name)


def _library(name: str, version: str, sources: Mapping[str, str]) -> dict[str, bytes]:
    """Return the library for this machine by its place; nothing without a compiler."""
    known = _PLATFORMS.get((platform.system(), platform.machine()))
    if known is None:
        return {}
    try:
        command = compiler_command()
    except NoCCompilerError:
        return {}
    old, new, ending = known
    file, flags = f"{name}_fmu{ending}", (*FLAGS, "-fvisibility=hidden")
    with tempfile.TemporaryDirectory(prefix="swarmstart-") as folder:
        library = compiled_library(sources, file, Path(folder), command, flags)
        return {
            f"binaries/{new if version == '3.0' else old}/{file}": library.read_bytes()
        }
