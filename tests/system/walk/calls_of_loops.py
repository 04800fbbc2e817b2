"""Calls of the walk: controllers, plants and closed loops."""

from __future__ import annotations

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import swarmstart as ss
from swarmstart import ocp
from swarmstart.ocp import Controller
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import Call, Calls, record, with_defaults


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    return {**_plants(), **_controllers(), **_teams(), **_laws(), **_runs()}


def _plants() -> Calls:
    plant, controls = made.plant(), made.CONTROLS
    stepped = ss.SteppedPlant(made.Tank(), dt=0.1)
    times = {
        "states": np.zeros((2, 3)),
        "controls": controls,
        "times": np.zeros(3),
    }
    one = {"state": made.START, "control": np.zeros(1), "time": 0.0}
    along = np.zeros((1, 2))
    return {
        "Plant": with_defaults(ss.Plant, model=made.model(), dt=0.1, substeps=2),
        "Plant.__call__": Call(plant.__call__, one),
        "Plant.along": Call(
            plant.along, {"state": made.START, "controls": along, "time": 0.0}
        ),
        "Plant.along_until_end": Call(
            plant.along_until_end,
            {"state": made.START, "controls": along, "time": 0.0},
        ),
        "Plant.until_end": Call(plant.until_end, one),
        "Plant.outputs": Call(plant.outputs, times),
        "Plant.parameters": Call(plant.parameters, {"times": np.zeros(3)}),
        "Plant.varying": Call(plant.varying, {"times": np.zeros(3)}),
        "Plant.with_decided": Call(plant.with_decided, {"values": {}}),
        "Plant.with_interval": Call(plant.with_interval, {"dt": 0.1}),
        "SteppedPlant": Call(ss.SteppedPlant, {"steps": made.Tank(), "dt": 0.1}),
        "SteppedPlant.__call__": Call(stepped.__call__, one),
        "SteppedPlant.outputs": Call(stepped.outputs, times),
        "SteppedPlant.start_at": Call(stepped.start_at, {"state": made.START}),
        "SteppedPlant.with_interval": Call(stepped.with_interval, {"dt": 0.1}),
    }


def _decide(controller: Controller, nx: int = 2) -> Call:
    return Call(
        controller.decide,
        {"time": 0.0, "state": np.zeros(nx), "previous": None, "rng": made.rng()},
    )


def _controllers() -> Calls:
    loop, phased = made.loop(), made.phased()
    return {
        "RecedingHorizon": with_defaults(ss.RecedingHorizon, planner=made.planner()),
        "RecedingHorizon.decide": _decide(loop),
        "RecedingHorizon.flown": Call(loop.flown, {"plan": made.plan()}),
        "RecedingHorizon.known": with_defaults(loop.known, time=0.0),
        "RecedingHorizon.plan": with_defaults(
            loop.plan, time=0.0, state=made.START, last=None, rng=made.rng()
        ),
        "OpenLoop": with_defaults(ss.OpenLoop, loop=loop),
        "OpenLoop.decide": _decide(ss.OpenLoop(loop=loop)),
        "Decision": record(made.decision()),
        "PhasedHorizon": record(phased),
        "PhasedHorizon.decide": _decide(phased, 4),
        "PhasedHorizon.plant": with_defaults(phased.plant, substeps=1),
        "PhasedHorizon.start": Call(phased.start, {"x0": [0.0]}),
        "phased_horizon": with_defaults(
            ss.phased_horizon,
            stated=made.legs(),
            period=0.25,
            polish=ss.IpoptOptions(),
        ),
    }


def _teams() -> Calls:
    team, local = made.team(), made.local_team()
    return {
        "Agent": with_defaults(ss.Agent, controller=made.loop()),
        "Team": with_defaults(ss.Team, agents=[ss.Agent(controller=made.loop())]),
        "Team.decide": _decide(team),
        "Team.split": Call(team.split, {"state": made.START}),
        "Team.plans": Call(
            team.plans,
            {"state": made.START, "make": lambda number, own, seen: made.plan()},
        ),
        "LocalAgent": with_defaults(ss.LocalAgent, parameters=[0]),
        "LocalTeam": with_defaults(
            ss.LocalTeam,
            agents=[made.local_agent()],
            order=(0,),
            **made.local_parts(),
        ),
        **_swarms(),
        "LocalTeam.decide": _decide(local),
        "LocalTeam.within_range": Call(
            local.within_range,
            {"shown": {}, "states": np.zeros((1, 2)), "number": 0},
        ),
    }


def _swarms() -> Calls:
    obstacle, places = made.obstacle(), {"starts": np.eye(2, 3), "goals": np.eye(2, 3)}
    return {
        "Obstacle": with_defaults(ss.Obstacle, radius=0.5, path=np.ones((1, 3))),
        "Obstacle.position": Call(obstacle.position, {"times": np.zeros(3)}),
        "Obstacle.bulge": Call(obstacle.bulge, {"times": np.arange(3.0)}),
        "Swarm": with_defaults(ss.Swarm, **places, distance=0.3),
        "Swarm.clearance": Call(made.swarm().clearance, {"obstacle": obstacle}),
        "SwarmController": with_defaults(ss.SwarmController, swarm=made.swarm()),
        "SwarmController.decide": Call(
            made.swarm_loop().decide,
            {
                "time": 0.0,
                "state": made.swarm_loop().x0,
                "previous": None,
                "rng": made.rng(),
            },
        ),
        "CommittedTeam": with_defaults(ss.CommittedTeam, **made.committed_parts()),
        "CommittedTeam.decide": _decide(made.committed_team()),
        "swarm_model": Call(ss.swarm_model, {"n": 1}),
        "Links": with_defaults(ss.Links, silences={0: (0.0, 1.0)}),
        "SwarmFlight": record(ss.simulate_swarm(made.swarm(), seconds=0.5, seed=0)),
        "simulate_swarm": with_defaults(
            ss.simulate_swarm, swarm=made.swarm(), seconds=0.5, seed=0
        ),
    }


def _laws() -> Calls:
    dual = made.dual_mode()
    return {
        "DualMode": with_defaults(
            ss.DualMode,
            team=made.team(),
            sets=[made.held_set()],
            targets=[lambda time: made.START],
            uncertified=True,
        ),
        "DualMode.decide": _decide(dual),
        "DualMode.errors": Call(dual.errors, {"time": 0.0, "state": made.START}),
        "DualMode.inside": Call(dual.inside, {"time": 0.0, "state": made.START}),
        "DualMode.linear_law": with_defaults(dual.linear_law),
        "export_c": with_defaults(
            ss.export_c, controller=made.loop(), x0=[0, 0], name="one", starts=0
        ),
        "export_fmu": with_defaults(
            ss.export_fmu,
            made=ss.export_c(made.loop(), [0, 0], name="one", starts=0),
            compiled=False,
        ),
        "CExport": record(ss.export_c(made.loop(), [0, 0], name="one", starts=0)),
        "terminal_set_of": with_defaults(
            ss.terminal_set_of,
            problem=made.problem(),
            at=[0, 0],
            weights=made.weights(),
            options=made.OPTIONS,
            rng=made.rng(),
        ),
    }


def _runs() -> Calls:
    begin = {"controller": made.loop(), "x0": [0, 0], "steps": 1}
    run = made.trajectory()
    path = ss.interpolate(made.plant(), run)
    step = next(
        iter(ss.fly(made.plant(), made.loop(), [0, 0], steps=1, rng=made.rng()))
    )
    index = np.array([0])
    pair = {"curves": path.curves[:, None], "first": index, "second": index + 1}
    return {
        "fly": with_defaults(ss.fly, plant=made.plant(), **begin, rng=made.rng()),
        "simulate": with_defaults(ss.simulate, plant=made.plant(), **begin, seed=0),
        "collected": Call(ocp.collected, {"plant": made.plant(), "steps": [step]}),
        "Step": record(step),
        "Trajectory": record(run),
        "Trajectory.at": Call(run.at, {"time": 0.1}),
        "Trajectory.save": Call(run.save, {"folder": Path(mkdtemp()), "force": True}),
        "interpolate": Call(ss.interpolate, {"plant": made.plant(), "trajectory": run}),
        "DenseOutput": record(path),
        "DenseOutput.__call__": Call(path.__call__, {"times": [0.1]}),
        "smallest_distance": Call(ocp.smallest_distance, pair),
        "largest_distance": Call(ocp.largest_distance, pair),
    }
