"""`swarmstart export c` and `fmu`: the controller of a scenario as C99."""

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.commands.actions.checking import warn_of_ramps
from swarmstart.cases.commands.terminal import say
from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.record.files import require_new
from swarmstart.errors import SwarmstartError
from swarmstart.export import export_c, export_fmu, is_compiled, require_name
from swarmstart.ocp import DualMode, OpenLoop, RecedingHorizon, Team


class WrongSourceError(SwarmstartError, ValueError):
    """A scenario has no controller that can be exported."""


def c_files(options: argparse.Namespace) -> tuple[Path, Mapping[str, bytes]]:
    """Return the folder and the files of a controller.

    Raises:
        WrongSourceError: If the scenario has no receding-horizon controller, or no such
            vehicle.
        ExportError: If the controller cannot be written as C.
    """
    seed = options.seed or 0
    resolved = resolve(
        read_document(options.source),
        variant=options.variant,
        assignments=options.assignments or (),
    )
    name = options.name or re.sub(r"[^A-Za-z0-9_]", "_", resolved.scenario.name)
    folder, ending = Path(options.out or name), options.what
    # Refused before it takes time; all files are asked for when they are written.
    require_name(name)
    require_new([folder / f"{name}.{ending}"], "choose another --out")
    flight = flight_of(resolved.posed(), resolved.scenario)
    controller, x0, seen = controller_of(flight, options.vehicle, seed)
    warn_of_ramps(resolved.scenario.name, flight.posed)
    made = export_c(
        controller, x0, name=name, seen=seen, seed=seed, main=options.main,
        starts=16 if options.starts is None else options.starts,
        iterations=options.iterations or 100,
        precision=options.precision or "double",
    )  # fmt: skip
    files = {file: text.encode() for file, text in made.files.items()}
    if options.what == "fmu":
        files = {f"{name}.fmu": export_fmu(made, options.fmi or "3.0")}
        if not is_compiled(files[f"{name}.fmu"]):
            say("no C compiler is here: the FMU has sources only")
    return folder, files


def controller_of(
    flight: Flight[Posed], vehicles: Sequence[str] = (), seed: int = 0
) -> tuple[RecedingHorizon | DualMode, Array, tuple[Array, ...]]:
    """Return the controller of a vehicle, its initial state, and plans that it uses.

    Args:
        flight: The scenario's closed loop.
        vehicles: Number of the vehicle, as on the command line; empty means the first
            one.
        seed: Seed of the plans of other vehicles that the controller uses.

    Raises:
        WrongSourceError: As in `c_files`.
    """
    controller, x0 = flight.controller, flight.x0
    if isinstance(controller, OpenLoop):
        controller = controller.loop  # In C its horizon recedes.
    if isinstance(controller, DualMode) and len(controller.sets) > 1:
        # All switch to their laws at once; one alone has none.
        controller = controller.team
    if isinstance(controller, RecedingHorizon | DualMode):
        _number(vehicles, 1)
        return controller, x0, ()
    if not isinstance(controller, Team):
        raise WrongSourceError(
            "expected a receding-horizon controller, or a team of them that use the "
            f"plans of all others; found {type(controller).__name__}"
        )
    number = _number(vehicles, len(controller.agents))
    agent = controller.agents[number]
    seen: tuple[Array, ...] = ()
    if agent.watches:
        rng = np.random.default_rng(seed)
        plans = controller.decide(0.0, x0, None, rng=rng).plans
        shows = [controller.agents[j].shows for j in agent.watches]
        seen = tuple(
            plans[j].states[list(rows)]
            for j, rows in zip(agent.watches, shows, strict=True)
        )
    return agent.controller, controller.split(x0)[number], seen


def _number(vehicles: Sequence[str], count: int) -> int:
    """Return the number of the vehicle that is asked for, from 0."""
    if not vehicles:
        return 0
    if len(vehicles) > 1 or not re.fullmatch(r"[1-9][0-9]{0,5}", vehicles[0]):
        raise WrongSourceError(
            f"--vehicle: expected one number from 1 to {count}, since a C file is the "
            f"controller of one vehicle; found {', '.join(vehicles)}"
        )
    number = int(vehicles[0])
    if number > count:
        raise WrongSourceError(
            f"--vehicle: expected a number from 1 to {count}, found {number}"
        )
    return number - 1
