"""Calls of the walk: the statement of a problem and what it is compiled to."""

from __future__ import annotations

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart import ocp
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import Call, Calls, record, with_defaults


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    return {**_models(), **_constraints(), **_problems(), **_compiled()}


def _models() -> Calls:
    x, u = made.model().states, made.model().controls
    table = made.table()
    algebraic = ca.SX.sym("z")
    return {
        "Model": with_defaults(
            ss.Model, states=x, controls=u, ode=ca.vertcat(x[1], u),
            **dict.fromkeys(
                ("next_state", "parameters", "signals", "time"), ca.SX(0, 1)
            ),
            outputs={"v": x[1]}, units={"v": "m/s"},
            symbol_map=made.model().symbol_map, elimination=made.model().elimination,
        ),
        "Model.from_system": Call(ss.Model.from_system, {"system": _system()}),
        "Model.linearised": with_defaults(
            made.model().linearised, x=made.START, u=np.zeros(1)
        ),
        "Model.require_step": Call(made.model().require_step, {"dt": 0.1}),
        "Model.sx": Call(made.model().sx, {"role": "cost", "expression": x[0]}),
        "AlgebraicEquations": with_defaults(
            ss.AlgebraicEquations, symbols=algebraic, residual=algebraic - x[0]
        ),
        "right_hand_side": Call(ocp.right_hand_side, {"model": made.model()}),
        "stack_models": Call(ss.stack_models, {"models": [made.model()]}),
        "held_step": with_defaults(
            ocp.held_step, model=made.model(), dt=0.1, method="rk4", substeps=1
        ),
        "Radau": with_defaults(ss.Radau),
        "Table": record(made.table()),
        "Table.at": Call(
            lambda arguments: made.table().at(arguments), {"arguments": 0.5}
        ),
        "Table.__call__": Call(
            lambda arguments: (table(arguments),), {"arguments": 0.5}
        ),
        "table": with_defaults(ss.table, x=[0, 1, 2], y=[1.0, 2.0, 4.0]),
    }  # fmt: skip


def _system() -> object:
    import control  # noqa: PLC0415 - slow

    return control.ss([[0, 1], [0, -0.5]], [[0], [2]], [[1, 0]], 0)


def _constraints() -> Calls:
    x, u = made.model().states, made.model().controls
    first, second = x[:1], ca.vertcat(x[1], u)
    found: Calls = {
        "Bounds": with_defaults(ss.Bounds, controls=(-1, 1)),
        "Free": with_defaults(ss.Free, lower=1.0, upper=2.0),
        "CountedFrom": with_defaults(ss.CountedFrom, numbers={"x": 1e9}),
        "HeldSignals": with_defaults(ss.HeldSignals, names=["price"]),
        "TransportDelay": with_defaults(ss.TransportDelay, seconds={"u": 0.5}),
        "Rows": Call(ocp.Rows, {"values": x, "lower": made.START, "upper": made.START}),
        "Connection": with_defaults(ss.Connection, relative=second, distance=1.0),
        "Separation": with_defaults(ss.Separation, relative=second, distance=1.0),
        "PathConstraint": with_defaults(ss.PathConstraint, expression=x[0], upper=1.0),
        "TerminalConstraint": with_defaults(ss.TerminalConstraint, expression=x[0]),
        "disc": with_defaults(ss.disc, position=second, centre=[1, 1], radius=0.5),
    }
    for constraint in (
        ss.Connection(relative=second, distance=1.0),
        ss.Separation(relative=second, distance=1.0),
        ss.PathConstraint(expression=first, upper=1.0),
        ss.TerminalConstraint(expression=first),
    ):
        name = type(constraint).__name__
        value = getattr(constraint, "relative", first)
        found |= {
            f"{name}.rows": Call(constraint.rows, {"value": value}),
            f"{name}.smooth": Call(constraint.smooth, {"value": value}),
            f"{name}.excess": Call(constraint.excess, {"start": value, "end": value}),
            f"{name}.indicated": Call(constraint.indicated, {"excess": value[0]}),
        }
    return found


def _problems() -> Calls:
    x, u = made.model().states, made.model().controls
    ensemble = made.problem_of(parameters=1)
    return {
        "OptimalControlProblem": with_defaults(
            ss.OptimalControlProblem, model=made.model(), horizon=1.0, intervals=3,
            stage_cost=u**2, terminal_cost=x[0] ** 2,
            bounds=ss.Bounds(controls=(-1, 1)),
            signals=ca.SX(0, 1), integrator_tolerance=None, step_cost=u**2,
            initial_cost=x[0], previous=ca.SX(0, 1), start={}, decided={}, scales={},
        ),
        "OptimalControlProblem.averaged": Call(
            made.problem().averaged, {"controls": made.CONTROLS}
        ),
        "Phases": record(ss.phases(made.legs())),
        "Phases.start": Call(ss.phases(made.legs()).start, {"x0": [0.0]}),
        "phases": with_defaults(ss.phases, stated=made.legs()),
        "ensemble": with_defaults(
            ss.ensemble, problem=ensemble, parameters={"p": [1.0, 2.0]}
        ),
        "shifted_controls": with_defaults(
            ocp.shifted_controls, problem=made.problem(), controls=made.CONTROLS,
            append="zero",
        ),
        "zero_controls": Call(ocp.zero_controls, {"problem": made.problem()}),
    }  # fmt: skip


def _compiled() -> Calls:
    states, controls = np.zeros((2, 4)), np.zeros((1, 4))
    return {
        "compile_batch": with_defaults(ss.compile_batch, function=made.dynamics()),
        "BatchFunction": Call(
            ocp.BatchFunction,
            {
                "function": made.dynamics(),
                "backend": "casadi",
                "precision": "double",
                "threads": 1,
            },
        ),
        "BatchFunction.__call__": Call(
            lambda arguments: made.batch()(arguments, controls), {"arguments": states}
        ),
        "BatchFunction.prepare": Call(
            lambda arguments: made.batch().prepare(arguments, controls),
            {"arguments": states},
        ),
        "chosen_backend": Call(ocp.chosen_backend, {"backend": None}),
    }
