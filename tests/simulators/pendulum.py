"""A pendulum with friction as an FMU, built here, and the same as a model.

Its step is that of `ss.Plant`: ten steps of Runge-Kutta of order 4, in the same order
of operations. At a torque of FAILS it fails, at one of NAN its speed is no number.
"""

import io
import platform
import zipfile
from importlib.resources import files
from pathlib import Path

import casadi as ca

import swarmstart as ss
from swarmstart.export.controller.exported import FLAGS, compiled_library
from swarmstart.export.controller.fmu import _PLATFORMS

FRICTION = 0.2
SUBSTEPS = 10
FAILS, NAN, EARLY = 666.0, 777.0, 888.0
_SOURCE = r"""
#include <math.h>
#include <stdlib.h>
#include <string.h>
#define EXPORTED __attribute__((visibility("default")))
enum { OK = 0, ERROR = 3 };
enum { REALS = 4, INPUTS = 1 };
typedef struct { double values[4]; } instance_t; /* torque, angle, speed, friction */
static void restart(instance_t *one)
{
  const double starts[4] = {0, 0.25, 0, 0.2};
  memcpy(one->values, starts, sizeof starts);
}
static instance_t *instantiated(const char *token)
{
  instance_t *one = 0;
  if (token && strcmp(token, "TOKEN") == 0) {
    one = (instance_t *)calloc(1, sizeof *one);
    restart(one);
  }
  return one;
}
static int read_reals(instance_t *one, const unsigned which[], size_t n,
                      double values[])
{
  for (size_t i = 0; i < n; ++i) {
    values[i] = one->values[which[i] - 1];
  }
  return OK;
}
static int write_reals(instance_t *one, const unsigned which[], size_t n,
                       const double values[])
{
  for (size_t i = 0; i < n; ++i) {
    one->values[which[i] - 1] = values[i];
  }
  return OK;
}
static int step(instance_t *one, double length)
{
  const double h = length / 10, torque = one->values[0], friction = one->values[3];
  double *x = one->values + 1, k[4][2];
  if (torque == 666) {
    return ERROR;
  }
  if (torque == 777) {
    x[1] = NAN;
  }
  for (int i = 0; i < 10; ++i) {
    double a = x[0], w = x[1];
    for (int j = 0; j < 4; ++j) {
      k[j][0] = w;
      k[j][1] = torque - 9.81 * sin(a) - friction * w;
      const double part = j < 2 ? h / 2 : h;
      a = x[0] + part * k[j][0];
      w = x[1] + part * k[j][1];
    }
    for (int j = 0; j < 2; ++j) {
      x[j] = x[j] + h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]);
    }
  }
  return OK;
}
static int kept(const instance_t *one, void **state)
{
  *state = malloc(sizeof *one);
  memcpy(*state, one, sizeof *one);
  return OK;
}
static int freed(void **state)
{
  free(*state);
  *state = 0;
  return OK;
}
"""
_VARIABLES = (
    ("torque", 'causality="input" variability="continuous"', "0", "N.m"),
    ("angle", 'causality="output" variability="continuous" initial="INITIAL"', "0.25",
     "rad"),
    ("speed", 'causality="output" variability="continuous" initial="INITIAL"', "0",
     "rad/s"),
    ("friction", 'causality="parameter" variability="fixed"', "0.2", ""),
)  # fmt: skip


def description(version: str, *, settable: bool = True) -> str:
    """Return modelDescription.xml."""
    is_3 = version == "3.0"
    rows = ['<Float64 name="time" valueReference="0" causality="independent" '
            'variability="continuous"/>'] * is_3  # fmt: skip
    for number, (name, stated, start, unit) in enumerate(_VARIABLES, start=1):
        words = stated.replace("INITIAL", "exact" if settable else "calculated")
        value = f' start="{start}"' if "calculated" not in words else ""
        value += f' unit="{unit}"' if unit else ""
        if name == "torque":
            value += ' min="-5" max="5"'
        head = f'name="{name}" valueReference="{number}" {words}'
        rows.append(
            f"<Float64 {head}{value}/>"
            if is_3
            else f"<ScalarVariable {head}><Real{value}/></ScalarVariable>"
        )
    units = "".join(f'<Unit name="{u}"/>' for u in ("N.m", "rad", "rad/s"))
    outputs = "".join(
        f'<Output valueReference="{n}"/>' if is_3 else f'<Unknown index="{n}"/>'
        for n in (2, 3)
    )
    outputs = outputs if is_3 else f"<Outputs>{outputs}</Outputs>"
    token, can = ("instantiationToken", "FMUState") if is_3 else ("guid", "FMUstate")
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription '
        f'fmiVersion="{version}" modelName="pendulum" {token}="TOKEN">'
        f'<CoSimulation modelIdentifier="pendulum" canGetAndSet{can}="true" '
        'canHandleVariableCommunicationStepSize="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions>"
        f"<ModelVariables>{''.join(rows)}</ModelVariables>"
        f"<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )


def built(folder: Path, version: str, compiler: str, *, settable: bool = True) -> Path:
    """Write the FMU into a folder, and return its path."""
    rest = files("swarmstart.export.controller") / f"fmi{version[0]}.c"
    source = _SOURCE + rest.read_text()
    old, new, ending = _PLATFORMS[platform.system(), platform.machine()]
    library = compiled_library(
        {"pendulum.c": source}, f"pendulum{ending}", folder, compiler, FLAGS
    )
    inside = f"binaries/{new if version == '3.0' else old}/pendulum{ending}"
    text = description(version, settable=settable)
    return archived(
        folder / "pendulum.fmu",
        {"modelDescription.xml": text.encode(), inside: library.read_bytes()},
    )


def archived(file: Path, content: dict[str, bytes]) -> Path:
    """Write an archive, and return its path."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, one in content.items():
            archive.writestr(name, one)
    file.write_bytes(buffer.getvalue())
    return file


def model() -> ss.Model:
    """Return the same pendulum as a model."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rate = u - 9.81 * ca.sin(x[0]) - FRICTION * x[1]
    return ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], rate))


def loop() -> ss.RecedingHorizon:
    """Return a controller that swings it up, planned without friction."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    low = 1 + ca.cos(x[0])
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0]))),
        horizon=2.0, intervals=20, bounds=ss.Bounds(controls=(-5, 5)),
        stage_cost=10 * low + 0.1 * x[1] ** 2 + 0.05 * u**2,
        terminal_cost=100 * low + 10 * x[1] ** 2,
    )  # fmt: skip
    planner = ss.Planner(problem, search="lshade", polish=ss.IpoptOptions())
    return ss.RecedingHorizon(planner=planner)
