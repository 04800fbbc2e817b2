"""Certificates written by hand, with the numbers that are known of their systems."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import json
import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.interval_arithmetic.tape import tape_of

Content = dict[str, Any]
CHEN_REFUTED = 0.95108  # the smallest level with a point where V does not fall
MU = 0.5


def signed(content: Content) -> Content:
    """The digest as the format prescribes it, computed independently here."""
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(
        rest, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False
    )
    return {**rest, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def chen(**changes: Any) -> Content:
    """Chen and Allgoewer (1998): x1' = x2 + u (mu + (1-mu) x1), and so on."""
    content: Content = {
        "format": "swarmstart terminal set certificate",
        "version": 1,
        "dynamics": {
            "nx": 2,
            "nu": 1,
            "tape": [
                ["x", 0],
                ["x", 1],
                ["u", 0],
                ["const", MU],
                ["const", 1 - MU],
                ["mul", 4, 0],
                ["add", 3, 5],
                ["mul", 2, 6],
                ["add", 1, 7],
                ["mul", 4, 1],
                ["const", 4.0],
                ["mul", 10, 9],
                ["sub", 3, 11],
                ["mul", 2, 12],
                ["add", 0, 13],
            ],
            "xdot": [8, 14],
        },
        "reference": {"x": [0.0, 0.0], "u": [0.0]},
        "bounds": {
            "u_lower": [-2.0],
            "u_upper": [2.0],
            "x_lower": [None, None],
            "x_upper": [None, 1.0],
        },
        "K": [[2.118, 2.118]],
        "P": [[16.5926, 11.5926], [11.5926, 16.5926]],
        "alpha": 0.99 * CHEN_REFUTED,
        "core": {"level": 0.0, "drift": 0.0},
        "dt": None,
        "substeps": None,
        "Q_m": [[0.0, 0.0], [0.0, 0.0]],
        "margins": {"integrator": None, "between_samples": None},
        "refuted": refuted_chen(),
        "design": {"name": "lqr", "Q": [[0.5, 0.0], [0.0, 0.5]], "R": [[1.0]]}
        | {"kappa": 0.95},
        "proof": {"boxes": 500, "seconds": 0.02},
        "statements": [
            {
                "statement": "e'Pe falls by more than e'Q_m e a second "
                "outside the stated core, which is not left",
                "grounds": "proven",
            },
            {
                "statement": "the inputs stay within their bounds on the set",
                "grounds": "closed form",
            },
        ],
    }
    return signed(content | changes)


def refuted_chen(level: float = 0.9512) -> Content:
    """The point of a level where V falls least, on a fine grid of angles."""
    P = np.array([[16.5926, 11.5926], [11.5926, 16.5926]])
    angles = np.linspace(0.0, 2 * np.pi, 20_001)
    L = np.linalg.cholesky(P)
    circle = np.vstack([np.cos(angles), np.sin(angles)])
    e = math.sqrt(level) * np.linalg.solve(L.T, circle)
    u = -2.118 * (e[0] + e[1])
    rate = np.vstack(
        [
            e[1] + u * (MU + (1 - MU) * e[0]),
            e[0] + u * (MU - 4 * (1 - MU) * e[1]),
        ]
    )
    change = 2 * np.sum(e * (P @ rate), axis=0)
    worst = int(np.argmax(change))
    return {"alpha": level, "e": e[:, worst].tolist(), "change": float(change[worst])}


def formation(R: tuple[float, float] = (1.0, 100.0), **changes: Any) -> Content:
    """A unicycle at 15 m/s, its input held 1 s, gains by the discrete Riccati."""
    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    A[2, 0], A[3, 1], B[0, 0], B[1, 1] = 1.0, 15.0, 1.0, 1.0
    Ad = np.eye(4) + A
    Bd = (np.eye(4) + A / 2) @ B
    P = scipy.linalg.solve_discrete_are(Ad, Bd, np.eye(4), np.diag(R))
    K = np.linalg.solve(np.diag(R) + Bd.T @ P @ Bd, Bd.T @ P @ Ad)
    room = [5.0, math.radians(10.0)]
    reach = np.sum(K * np.linalg.solve(P, K.T).T, axis=1)
    alpha = float(np.min(np.square(room) / reach)) * (1 - 1e-12)
    content: Content = {
        "format": "swarmstart terminal set certificate",
        "version": 2,
        "dynamics": {
            "nx": 4,
            "nu": 2,
            "tape": [
                ["x", 0],
                ["x", 1],
                ["u", 0],
                ["u", 1],
                ["cos", 1],
                ["sin", 1],
                ["mul", 0, 4],
                ["mul", 0, 5],
            ],
            "xdot": [2, 3, 6, 7],
        },
        "reference": {
            "x": [15.0, 0.0, 0.0, 0.0],
            "u": [0.0, 0.0],
            "velocity": [0.0, 0.0, 15.0, 0.0],
        },
        "bounds": {
            "u_lower": [-room[0], -room[1]],
            "u_upper": room,
            "x_lower": [5.0, None, None, None],
            "x_upper": [25.0, None, None, None],
        },
        "K": K.tolist(),
        "P": ((P + P.T) / 2).tolist(),
        "alpha": alpha,
        "core": {"level": 0.0, "drift": 0.0},
        "dt": 1.0,
        "substeps": 1,
        "Q_m": np.zeros((4, 4)).tolist(),
        "margins": {
            "integrator": {
                "relative_error": 2.1e-4,
                "grounds": "measured",
                "samples": 2000,
            },
            "between_samples": None,
        },
        "refuted": None,
        "design": {"name": "lqr", "Q": None, "R": None, "kappa": None},
        "proof": {"boxes": 356, "seconds": 0.04},
        "statements": [
            {
                "statement": "e'Pe falls by more than e'Q_m e a hold "
                "outside the stated core, which is not left, for the "
                "Runge-Kutta map and any motion that differs from it by the stated "
                "error",
                "grounds": "proven",
            }
        ],
    }
    return signed(content | changes)


def replaced(content: Content, path: tuple[Any, ...], value: object) -> Content:
    """A copy with one entry replaced; the digest stays."""
    changed = copy.deepcopy(content)
    place: Any = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return changed


def scalar(offset: float = 0.0, **changes: Any) -> Content:
    """x' = -(x - x_ref) + offset without input, P = 1, the set |e| <= 1."""
    x_ref = changes.pop("x_ref", 0.0)
    free = {"u_lower": [None], "u_upper": [None], "x_lower": [None], "x_upper": [None]}
    content = chen(
        dynamics={
            "nx": 1,
            "nu": 1,
            "tape": [
                ["x", 0],
                ["const", x_ref],
                ["sub", 1, 0],
                ["const", offset],
                ["add", 2, 3],
            ],
            "xdot": [4],
        },
        reference={"x": [x_ref], "u": [0.0]},
        bounds=free,
        K=[[0.0]],
        P=[[1.0]],
        alpha=1.0,
        Q_m=[[0.0]],
        refuted=None,
        design={"name": "by hand", "Q": None, "R": None, "kappa": None},
    )
    if "dt" in changes:
        margin = {"relative_error": 1e-3, "grounds": "measured", "samples": 1}
        held = {"integrator": margin, "between_samples": None}
        content |= {"substeps": 1, "margins": held, "statements": []}
    return signed(content | changes)


def certificate_of(
    dynamics: ca.Function,
    P: Sequence[Sequence[float]],
    alpha: float,
    *,
    dt: float | None = None,
    growth: float | None = None,
    velocity: Sequence[float] = (),
    **changes: Any,
) -> Certificate:
    """Return the statements of a file with these dynamics f(x, u) and P, no bounds."""
    nx, nu = dynamics.size1_in(0), dynamics.size1_in(1)
    tape, xdot = tape_of(dynamics)
    zero = [[0.0] * nx for _ in range(nx)]
    stated = Certificate(
        tape=tuple(
            (name, (), float(operands[0]))
            if name == "const"
            else (str(name), tuple(int(i) for i in operands), 0.0)
            for name, *operands in tape
        ),
        xdot=tuple(xdot),
        x_ref=(0.0,) * nx,
        velocity=tuple(velocity) or (0.0,) * nx,
        u_ref=(0.0,) * nu,
        bounds={
            "u_lower": (None,) * nu,
            "u_upper": (None,) * nu,
            "x_lower": (None,) * nx,
            "x_upper": (None,) * nx,
        },
        K=((0.0,) * nx,) * nu,
        P=tuple(tuple(float(entry) for entry in row) for row in P),
        alpha=alpha,
        core=0.0,
        drift=0.0,
        dt=dt,
        substeps=None if dt is None else 1,
        Q_m=tuple(tuple(row) for row in zero),
        integrator=None if dt is None else 0.0,
        growth=growth,
        growth_proven=growth is not None,
        refuted=None,
    )
    return dataclasses.replace(stated, **changes)
