"""Simulators of other programs as plants of closed loops.

    fmu        an FMU for co-simulation, FMI 2.0 or 3.0, called through FMPy
    command    a program in any language that speaks JSON lines
    aircraft   aircraft of JSBSim behind an autopilot
    network    a network in ONNX, evaluated by onnxruntime
    selected   a part of the states and controls of any of them

    planning   plans from roll-outs, by searches and a surrogate (surrogate.py) that
               is fitted to the roll-outs, which run in processes (workers.py,
               worker.py)

Each simulator keeps its state inside, as `swarmstart.Simulator` describes, or gets the
state with each step. Foreign code runs here: the other folders of the package import
this one only if a user asks for a simulator.
"""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # Loaded when first used: most runs need none.
    from swarmstart.simulators.aircraft import (
        AircraftPlant as AircraftPlant,
        Autopilot as Autopilot,
    )
    from swarmstart.simulators.command import (
        CommandPlant as CommandPlant,
    )
    from swarmstart.simulators.common import (
        SimulatorError as SimulatorError,
        require_units as require_units,
    )
    from swarmstart.simulators.fmu import (
        FmuPlant as FmuPlant,
    )
    from swarmstart.simulators.network import (
        OnnxPlant as OnnxPlant,
    )
    from swarmstart.simulators.planning import (
        RollOutsInterrupted as RollOutsInterrupted,
        SimulatedPlan as SimulatedPlan,
        SurrogateRound as SurrogateRound,
        solve_simulated as solve_simulated,
    )
    from swarmstart.simulators.selected import (
        SelectedPlant as SelectedPlant,
    )

_NAMES = {
    "aircraft": "AircraftPlant Autopilot",
    "command": "CommandPlant",
    "common": "SimulatorError require_units",
    "fmu": "FmuPlant",
    "network": "OnnxPlant",
    "planning": "RollOutsInterrupted SimulatedPlan SurrogateRound solve_simulated",
    "selected": "SelectedPlant",
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
