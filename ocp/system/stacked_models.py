"""Models side by side as one model."""

from collections.abc import Sequence

import casadi as ca

from swarmstart.arguments import checked, of_kind, several
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.system.model import (
    Model,
    jump_of,
    outputs_of,
    rate_of,
    shown_units,
)

_ROLES = ("states", "controls", "parameters", "signals")


@checked(refused, models=several(of_kind(Model, "a Model"), "a sequence of models"))
def stack_models(models: Sequence[Model]) -> Model:
    """Stack models side by side into one model, states and controls in order.

    Args:
        models: At least one model; none is changed, one may occur several times.

    Returns:
        The combined model; parameters and signals are stacked as well.

    Raises:
        InvalidProblemError: If there is no model, or one has nonlinear algebraic
            equations.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> cart = ss.Model(states=x, controls=u, ode=u)
        >>> two = ss.stack_models([cart, cart])
        >>> two.nx, two.nu
        (2, 2)
    """
    if not models:
        raise InvalidProblemError("stack_models needs at least one model, got none")
    if any(model.elimination.unsolved.numel() for model in models):
        raise InvalidProblemError(
            "stack_models needs models without nonlinear algebraic equations: the path "
            "constraint that these are solved would be lost"
        )
    columns = {role: ca.vertcat(*c) for role, c in _side_by_side(models).items()}
    names = [f"{name}_{i}" for i, m in enumerate(models) for name in m.outputs]
    return Model(
        states=columns["states"],
        controls=columns["controls"],
        ode=columns["ode"],
        next_state=columns.get("next_state", ca.SX(0, 1)),
        parameters=columns["parameters"],
        signals=columns["signals"],
        time=_one_time(models),
        state_names=tuple(
            f"{name}_{i}" for i, m in enumerate(models) for name in m.state_names
        ),
        control_names=tuple(
            f"{name}_{i}" for i, m in enumerate(models) for name in m.control_names
        ),
        outputs=dict(zip(names, ca.vertsplit(columns["outputs"]), strict=True))
        if names
        else {},
        units={
            f"{name}_{i}": unit
            for i, m in enumerate(models)
            for name, unit in shown_units(m).items()
        },
    )


def _side_by_side(models: Sequence[Model]) -> dict[str, list[ca.SX]]:
    """Return the symbols and equations of copies of the models, by their roles."""
    found: dict[str, list[ca.SX]] = {}
    jumping = any(model.jumps for model in models)
    time = _one_time(models)
    for number, model in enumerate(models):
        copies = {
            # New symbols: one model may occur several times.
            role: ca.SX.sym(f"{letter}{number}", getattr(model, role).numel())
            for role, letter in zip(_ROLES, "xups", strict=True)
        }
        s = ca.vertcat(copies["signals"], time if model.time.numel() else ca.SX(0, 1))
        arguments = [*[*copies.values()][:3], s]
        copies["ode"] = rate_of(model)(*arguments)
        copies["outputs"] = outputs_of(model)(*arguments)
        if jumping:
            copies["next_state"] = jump_of(model)(*arguments)
        for role, rows in copies.items():
            # The empty SX keeps the columns SX if no model has this role.
            found.setdefault(role, [ca.SX(0, 1)]).append(rows)
    return found


def _one_time(models: Sequence[Model]) -> ca.SX:
    """Return one symbol of the time for all models; empty if they have none."""
    times = [model.time for model in models if model.time.numel()]
    return times[0] if times else ca.SX(0, 1)
