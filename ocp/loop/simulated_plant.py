"""External simulator as the plant of a run that also has a model.

The simulator makes the steps. The model of the plans gives the names, and the
parameters and signals with which costs and constraints of the run are measured.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from swarmstart.arguments import checked, function
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.loop.plant import Plant, Steps, begun, stepped
from swarmstart.ocp.system.model import Model


@checked(refused, load=function())
class SimulatedPlant(Plant):
    """External simulator, with a model of the same states and controls.

    It gets the commands as they are decided, and applies any delay itself. Controls
    that change within one of its steps are replaced by their mean.
    """

    def __init__(
        self, model: Model, *, load: Callable[[], Steps], **about: Any
    ) -> None:
        """Keep the simulator, which is loaded for its first step.

        Args:
            model: The model.
            load: Function that returns the simulator, the same one at each call; it
                makes `substeps` steps in a control interval.
            **about: Further arguments, as in `Plant`.
        """
        super().__init__(model, **about)
        self._load = load

    def start_at(self, state: Array) -> Array:
        """Begin a run, and return the state at which it begins; see SteppedPlant."""
        return begun(self._load(), state)

    def until_end(self, state: Array, control: Array, time: float = 0.0) -> Array:
        """Return the states after each step, shape (nx, substeps); see Plant."""
        del time
        self._require_sizes(state, control)
        held = control[:, None] if control.ndim == 1 else control
        return self._stepped(state, np.repeat(held, self.substeps // held.shape[1], 1))

    def along_until_end(
        self, state: Array, controls: Array, time: float = 0.0
    ) -> Array:
        """Return the states after each step; a linear control is its mean there."""
        del time
        self._require_sizes(state, controls)
        return self._stepped(state, (controls[:, :-1] + controls[:, 1:]) / 2)

    def _ended(self, states: Array, last: Array, time: float) -> Array:
        """Return the states as they are: jumps of the model are not the simulator's."""
        del last, time
        return states

    def _stepped(self, state: Array, held: Array) -> Array:
        """Return the states after steps with controls (nu, substeps)."""
        return stepped(self._load(), state, held, self.dt / self.substeps)
