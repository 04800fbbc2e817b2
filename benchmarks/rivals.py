"""Other ways to evaluate a population, to measure ours against.

serial_map      CasADi's own serial map, its buffers in place: the baseline
numpy_by_hand   the UAVs' rollout in NumPy, vectorised over the population
generated_c     CasADi's C code of the rollout, called in a loop over the individuals
hand_written_c  five_uavs.c, vectors of individuals

Each uses buffers in its preferred layout; copying into them is not timed.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.problems import DISTANCE, SLOTS, SPEED, STEPS, UAVS, Instance
from swarmstart.ocp.rollout.fitness import shared_arguments
from swarmstart.ocp.rollout.shooting import Shooting

SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
OPTIONS = ("-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno")
YARDSTICK = Path(__file__).with_name("five_uavs.c")
LOOP = """
#include "rollout.c"

void kernel(double **in, double **out, long n) {{
    casadi_int iw[{iw} + 1];
    double w[{w} + 1];
    for (long i = 0; i < n; i++) {{
        const double *arg[{arg}] = {{in[0] + {dim} * i, in[1], in[2], in[3]}};
        double *res[{res}] = {{out[0] + i, out[1] + i}};
        rollout(arg, res, iw, w, 0);
    }}
}}
"""


class Contestant(NamedTuple):
    """One way to evaluate one population.

    Attributes:
        run: Evaluates it; this is timed.
        outputs: Cost and violation, each (size,), that `run` fills; None if it
            returns them.
        keeps_alive: Objects that must live as long as `run` is called.
    """

    run: Callable[[], Any]
    outputs: tuple[Array, Array] | None = None
    keeps_alive: object = None

    def values(self) -> tuple[Array, Array]:
        """Return cost and violation."""
        returned: tuple[Array, Array] = self.run()
        return self.outputs or returned


def serial_map(instance: Instance, population: Array) -> Contestant:
    """Return CasADi's serial map of the rollout, called through its buffers."""
    size = population.shape[1]
    function = Shooting(instance.problem).rollout
    mapped = function.map("mapped", "serial", size, [1, 2, 3], [])
    buffer, run = mapped.buffer()
    arguments = [np.array(population.T, order="C"), *_shared(instance)]
    outputs = np.empty(size), np.empty(size)
    for i, array in enumerate(arguments):
        if array.size:
            buffer.set_arg(i, array.data)  # type: ignore[call-arg]
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)  # type: ignore[call-arg]
    return Contestant(run, outputs, (mapped, buffer, arguments))


def numpy_by_hand(instance: Instance, population: Array) -> Contestant | None:
    """Return the rollout in NumPy, one array operation for all individuals and UAVs.

    Speed and heading change evenly over a step, so RK4 is Simpson's rule for the
    positions. None for other problems than `five_uavs` and `one_uav`.
    """
    uavs, substeps = _uavs(instance), instance.problem.substeps
    if uavs is None:
        return None
    start = instance.x0.reshape(uavs, 4)
    leader = np.asarray(instance.known.signals)

    def run() -> tuple[Array, Array]:
        controls = population.reshape(STEPS, uavs, 2, -1)
        size = controls.shape[-1]
        state = [np.repeat(column[:, None], size, axis=1) for column in start.T]
        cost, violation = np.zeros(size), np.zeros(size)
        for step, (acceleration, turn_rate) in enumerate(controls.swapaxes(1, 2)):
            cost += _errors(state, leader[:, step])
            cost += np.sum(acceleration**2 + turn_rate**2, axis=0)
            for _ in range(substeps):
                state = _moved(state, acceleration, turn_rate, 1.0 / substeps)
            violation += _closeness(state)
        return cost + 10.0 * _errors(state, leader[:, -1]), violation

    return Contestant(run)


def generated_c(instance: Instance, population: Array) -> Contestant | None:
    """Return CasADi's C code of the rollout in a loop; None without a C compiler."""
    function = Shooting(instance.problem).rollout
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("rollout.c")
        generator.add(function)
        generator.generate(f"{folder}/")
        loop = Path(folder, "loop.c")
        sizes = {
            name: getattr(function, f"sz_{name}")()
            for name in ("arg", "res", "iw", "w")
        }
        loop.write_text(LOOP.format(**sizes, dim=instance.dim))
        library = compiled_library(loop)
    return _from_library(library, instance, np.array(population.T, order="C"))


def hand_written_c(instance: Instance, population: Array) -> Contestant | None:
    """Return five_uavs.c; None for other problems, or without a C compiler."""
    if _uavs(instance) != UAVS:
        return None
    library = compiled_library(YARDSTICK, f"-DSUBSTEPS={instance.problem.substeps}")
    return _from_library(library, instance, population)


def compiler() -> str | None:
    """Return the path of the C compiler; None if it is missing."""
    return shutil.which("cc") or shutil.which("gcc")


def compiled_library(source: Path, *options: str) -> ctypes.CDLL | None:
    """Return a C file as a loaded library; None without a C compiler."""
    command = compiler()
    if command is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        library = f"{folder}/library.so"
        shared = ("-shared", "-fPIC", "-o", library, str(source), "-lm")
        subprocess.run([command, *OPTIONS, *options, *shared], check=True)
        return ctypes.CDLL(library)


def _from_library(
    library: ctypes.CDLL | None, instance: Instance, controls: Array
) -> Contestant | None:
    """Return the `kernel` of a library, bound to buffers."""
    if library is None:
        return None
    size = controls.size // instance.dim
    outputs = np.empty(size), np.empty(size)
    given = [np.ascontiguousarray(controls), *_shared(instance)]
    tables = _addresses(given), _addresses(outputs)
    run = partial(SIGNATURE(("kernel", library)), *map(ctypes.addressof, tables), size)
    return Contestant(run, outputs, (library, given, tables))


def _addresses(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))


def _shared(instance: Instance) -> tuple[Array, Array, Array]:
    return shared_arguments(instance.problem, instance.x0, instance.known)


def _uavs(instance: Instance) -> int | None:
    """Return how many UAVs `five_uavs` or `one_uav` has; None for other problems."""
    return {"five UAVs": UAVS, "one UAV": 1}.get(instance.name.split(",")[0])


def _errors(state: Sequence[Array], leader: Array) -> Array:
    """Return the squared errors of speed, heading and place, summed over the UAVs."""
    speed, heading, x, y = state
    slots = leader + SLOTS[: len(x)]
    squares = (speed - SPEED) ** 2 + heading**2
    squares += (x - slots[:, :1]) ** 2 + (y - slots[:, 1:]) ** 2
    total: Array = np.sum(squares, axis=0)
    return total


def _moved(
    state: Sequence[Array], acceleration: Array, turn_rate: Array, h: float
) -> list[Array]:
    """Return the state after a substep of h seconds."""
    speed, heading, x, y = state
    middle = 4.0 * (speed + h / 2 * acceleration)
    turned = heading + h / 2 * turn_rate
    faster, end = speed + h * acceleration, heading + h * turn_rate
    along = speed * np.cos(heading) + middle * np.cos(turned) + faster * np.cos(end)
    across = speed * np.sin(heading) + middle * np.sin(turned) + faster * np.sin(end)
    return [faster, end, x + h / 6 * along, y + h / 6 * across]


def _closeness(state: Sequence[Array]) -> Array:
    """Return the sum over pairs of the shortfall of the least distance."""
    _, _, x, y = state
    i, j = np.tril_indices(len(x), -1)
    apart = np.sqrt((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2)
    total: Array = np.sum(np.maximum(DISTANCE - apart, 0.0), axis=0)
    return total
