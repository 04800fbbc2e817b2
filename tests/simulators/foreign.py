"""Simulators for tests, in a module that other processes can import."""

import ctypes
import os
import sys
import time
from pathlib import Path

import numpy as np

from swarmstart.arrays import Array

CRASHES, HANGS, NAN, FAILS, LEAVES = 1.0, 2.0, 3.0, 4.0, 5.0
"""First states at which the simulator has these faults."""


class Faulty:
    """x' = u by Euler's method, with faults at some starts."""

    def step(self, x: Array, u: Array, dt: float) -> Array:
        kind = round(float(x[1]))
        if kind == CRASHES:
            ctypes.string_at(0)
        if kind == HANGS:
            time.sleep(1000)
        if kind == NAN:
            x = np.array([np.nan, x[1]])
        if kind == FAILS:
            raise RuntimeError("the pump\nis broken")
        if kind == LEAVES:
            os._exit(3)
        sys.stdout.write("noise on standard output")
        after: Array = x + np.array([dt * u[0], 0.0])
        return after


class Cart:
    """A cart with friction that its model lacks."""

    def step(self, x: Array, u: Array, dt: float) -> Array:
        def rate(at: Array) -> Array:
            return np.array([at[1], u[0] - 0.3 * at[1] * abs(at[1])])

        for _ in range(10):
            x = x + dt / 10 * rate(x + dt / 20 * rate(x))
        return x


class Brittle(Cart):
    """The same; it ends its process whenever it would move fast."""

    def step(self, x: Array, u: Array, dt: float) -> Array:
        if abs(x[1]) > 1.2:
            os._exit(1)
        return super().step(x, u, dt)


class Counted(Cart):
    """The same; each roll-out adds a line to a file."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def start_at(self, x: Array) -> Array:
        with self.file.open("a") as stream:
            stream.write("x")
        return x


class Unloadable:
    """A simulator that cannot be made again in another process."""

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return os.stat, ("/does/not/exist",)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        return x
