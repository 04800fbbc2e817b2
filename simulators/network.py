"""A network in ONNX as a plant with a fixed step; onnxruntime evaluates it.

Its one input is the state, followed by the control; its first output the state after
the step, or the change of the state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import FLAG, NAMES, PATH, checked, reals
from swarmstart.arrays import Array
from swarmstart.errors import brief, load_optional
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.simulators.common import STEP, SimulatorError, vector

MOST_BYTES = 2**30
"""Largest file [bytes]."""
_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}


@checked(refused, file=PATH, states=NAMES, controls=NAMES, dt=STEP, gives_change=FLAG)
class OnnxPlant(Called):
    """A network as a plant.

    Attributes:
        state_names: Names of the states.
        control_names: Names of the controls.
        dt: Length of the network's step [s].

    Example:
        >>> import swarmstart as ss
        >>> try:
        ...     ss.OnnxPlant("missing.onnx", states=["x"], controls=["u"], dt=0.1)
        ... except ss.SimulatorError as error:
        ...     print(error)
        missing.onnx: expected a network, found no file
    """

    def __init__(
        self,
        file: str | Path,
        *,
        states: Sequence[str],
        controls: Sequence[str],
        dt: float,
        gives_change: bool = False,
    ) -> None:
        """Load the network.

        Args:
            file: Path of the network, one file without data in other files.
            states: Names of the states, in the order of the input and the output.
            controls: Names of the controls, which follow the states in the input.
            dt: Length of the step that the network was trained for [s].
            gives_change: Whether the output of the network is the change of the state;
                if False, it is the state after the step.

        Raises:
            SimulatorError: If the file is no network, or its sizes are not those of the
                names.
            MissingPackageError: If onnxruntime is not installed (`swarmstart[onnx]`).
        """
        self._name, self.dt, self._gives_change = str(file), float(dt), gives_change
        self.state_names, self.control_names = tuple(states), tuple(controls)
        self._session = _session(Path(file))
        self._input, self._type = self._checked()

    @checked(refused, x=reals(axes=1), u=reals(axes=1), dt=STEP)
    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the state after a step, shape (nx,).

        Args:
            x: State, shape (nx,).
            u: Controls held over the step, shape (nu,).
            dt: Length of the step [s], which must be that of the network.

        Raises:
            SimulatorError: If a size or `dt` is not that of the network, or the network
                fails.
        """
        state = vector(self._name, "the state", x, self.state_names)
        control = vector(self._name, "the controls", u, self.control_names)
        if not math.isclose(dt, self.dt, rel_tol=1e-9):
            raise SimulatorError(
                self._name, f"expected a step of {self.dt:g} s, found {dt:g} s"
            )
        given: Any = np.concatenate([state, control]).astype(self._type)[None, :]
        try:
            found = self._session.run(None, {self._input: given})[0]
        except Exception as error:
            raise SimulatorError(
                self._name, f"the network failed: {brief(str(error))}"
            ) from error
        after = np.asarray(found, dtype=np.float64).reshape(-1)
        if after.shape != state.shape:
            raise SimulatorError(
                self._name,
                f"expected {state.size} numbers as output, found {after.size}",
            )
        return state + after if self._gives_change else after

    def _checked(self) -> tuple[str, type]:
        """Return name and type of the input.

        Raises:
            SimulatorError: If the network has another form.
        """
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1:
            raise SimulatorError(
                self._name,
                "expected one input, states followed by controls; found "
                f"{', '.join(one.name for one in inputs) or 'none'}",
            )
        nx, nu = len(self.state_names), len(self.control_names)
        ends = (("input", inputs[0], nx + nu), ("output", outputs[0], nx))
        for role, one, size in ends:
            if one.type not in _TYPES:
                raise SimulatorError(
                    self._name, f"expected an {role} of floats, found {one.type}"
                )
            # A size that the network leaves open is a name, or None.
            fits = len(one.shape) == 2 and all(  # noqa: PLR2004 - rows and columns
                not isinstance(found, int) or found == wanted
                for found, wanted in zip(one.shape, (1, size), strict=True)
            )
            if not fits:
                raise SimulatorError(
                    self._name,
                    f"expected an {role} of shape (1, {size}) for {nx} states and {nu} "
                    f"controls, found {tuple(one.shape)}",
                )
        return inputs[0].name, _TYPES[inputs[0].type]


def _session(file: Path) -> Any:
    """Return a session of a network, on one thread.

    Raises:
        SimulatorError: If there is no network, or it is too large.
    """
    runtime = load_optional("onnxruntime", extra="onnx", need="a network")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # Errors are raised.
    try:
        if file.stat().st_size > MOST_BYTES:
            raise SimulatorError(str(file), f"expected at most {MOST_BYTES:,} bytes")
        content = file.read_bytes()  # Of bytes alone, no further file is read.
    except FileNotFoundError as error:
        raise SimulatorError(str(file), "expected a network, found no file") from error
    except OSError as error:
        raise SimulatorError(str(file), f"expected a network; {error}") from error
    try:
        return runtime.InferenceSession(
            content, sess_options=options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:
        raise SimulatorError(
            str(file), f"expected a network in ONNX; {brief(str(error))}"
        ) from error
