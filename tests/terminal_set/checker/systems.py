"""Systems of the certificates by hand, in floats, and their certificates as read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.certificate_file import (
    Certificate,
    certificate_of,
)
from swarmstart.terminal_set.checker.file_content import read_content
from swarmstart.tests.terminal_set.checker.certificates_by_hand import MU, Content

Field = Callable[[Array, Array], Array]


def as_read(content: Content) -> Certificate:
    """Return a certificate as the checker reads it from a file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "certificate.json"
        path.write_text(json.dumps(content))
        return certificate_of(read_content(path))


def chen_field(x: Array, u: Array) -> Array:
    """Return the rate of the example of Chen and Allgoewer."""
    return np.array(
        [x[1] + u[0] * (MU + (1 - MU) * x[0]), x[0] + u[0] * (MU - 4 * (1 - MU) * x[1])]
    )


def unicycle_field(x: Array, u: Array) -> Array:
    """Return the rate of the formation's model."""
    return np.array([u[0], u[1], x[0] * np.cos(x[1]), x[0] * np.sin(x[1])])


def runge_kutta(f: Field, x: Array, u: Array, time: float, steps: int) -> Array:
    """Return the state after some classic Runge-Kutta steps with the input held."""
    h = time / steps
    for _ in range(steps):
        k1 = f(x, u)
        k2 = f(x + h / 2 * k1, u)
        k3 = f(x + h / 2 * k2, u)
        k4 = f(x + h * k3, u)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def relative_motion(
    f: Field, certificate: Certificate, e: Array, time: float | None
) -> Array:
    """Return the rate relative to the reference, or where e is after a time."""
    x, u = np.array(certificate.x_ref), np.array(certificate.u_ref)
    law = u - np.array(certificate.K) @ e
    if time is None:
        return f(x + e, law) - f(x, u)
    steps = certificate.substeps or 1
    ours = runge_kutta(f, x + e, law, time, steps)
    return ours - runge_kutta(f, x, u, time, steps)


def change(f: Field, certificate: Certificate, e: Array) -> float:
    """Return c(e) of the decrease, without the margins of integrator and drift."""
    P, Q_m = np.array(certificate.P), np.array(certificate.Q_m)
    moved = relative_motion(f, certificate, e, certificate.dt)
    margin = float(e @ Q_m @ e)
    if certificate.dt is None:
        return float(2 * e @ P @ moved) + margin
    return float(moved @ P @ moved - e @ P @ e) + margin
