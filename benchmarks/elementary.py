"""Time of elementary functions of a population, compared with NumPy's."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.special import erf

from swarmstart.arrays import Array
from swarmstart.benchmarks.timing import Timing, timings
from swarmstart.ocp import compile_batch

VALUES = 1000
OURS, NUMPY = "ours, prepared", "NumPy"
_AGREE = 1e-12
"""Largest relative difference from NumPy's value."""


class Way(NamedTuple):
    """An elementary function in both.

    Attributes:
        ours: Of CasADi's expressions.
        theirs: Of NumPy, or of SciPy, into an array `out`.
        ranges: Between which values each argument is drawn, uniformly.
    """

    ours: Callable[..., ca.SX]
    theirs: Callable[..., Array]
    ranges: tuple[tuple[float, float], ...]


_ANY, _ONE, _POSITIVE = ((-10.0, 10.0),), ((-1.0, 1.0),), ((1e-3, 10.0),)
FUNCTIONS: Mapping[str, Way] = {
    "sin": Way(ca.sin, np.sin, _ANY),
    "cos": Way(ca.cos, np.cos, _ANY),
    "tan": Way(ca.tan, np.tan, _ANY),
    "asin": Way(ca.asin, np.arcsin, _ONE),
    "acos": Way(ca.acos, np.arccos, _ONE),
    "atan": Way(ca.atan, np.arctan, _ANY),
    "atan2": Way(ca.atan2, np.arctan2, (*_ANY, *_ANY)),
    "sinh": Way(ca.sinh, np.sinh, _ANY),
    "cosh": Way(ca.cosh, np.cosh, _ANY),
    "tanh": Way(ca.tanh, np.tanh, _ANY),
    "asinh": Way(ca.asinh, np.arcsinh, _ANY),
    "exp": Way(ca.exp, np.exp, _ANY),
    "expm1": Way(ca.expm1, np.expm1, _ANY),
    "log": Way(ca.log, np.log, _POSITIVE),
    "log1p": Way(ca.log1p, np.log1p, _POSITIVE),
    "sqrt": Way(ca.sqrt, np.sqrt, _POSITIVE),
    "pow": Way(lambda x, y: x**y, np.power, (*_POSITIVE, *_ANY)),
    "fmod": Way(ca.fmod, np.fmod, (*_ANY, *_POSITIVE)),
    "erf (SciPy's)": Way(ca.erf, erf, _ANY),
}


class Timed(NamedTuple):
    """Time of one value of a function.

    Attributes:
        name: Of the function.
        ns: Ours and theirs [ns].
    """

    name: str
    ns: Mapping[str, Timing]

    @property
    def ratio(self) -> float:
        """Speed of ours relative to theirs, by the medians."""
        return self.ns[NUMPY].median / self.ns[OURS].median


def timed(*, rounds: int) -> list[Timed]:
    """Return the time of each function, both in turns on the same values.

    Args:
        rounds: Number of turns of each.

    Raises:
        ArithmeticError: If a value is not NumPy's.
    """
    return [_timed(name, way, rounds) for name, way in FUNCTIONS.items()]


def _timed(name: str, way: Way, rounds: int) -> Timed:
    rng = np.random.default_rng(0)
    arguments = [rng.uniform(*one, VALUES) for one in way.ranges]
    symbols = [ca.SX.sym(f"x{i}") for i in range(len(arguments))]
    function = ca.Function("elementary", symbols, [way.ours(*symbols)])
    prepared = compile_batch(function, backend="llvm").prepare(
        *(one[None] for one in arguments)
    )
    out = np.empty(VALUES)
    calls: dict[str, Callable[[], object]] = {
        OURS: prepared.run,
        NUMPY: lambda: way.theirs(*arguments, out=out),
    }
    for call in calls.values():
        call()
    if not np.allclose(prepared.outputs[0][0], out, rtol=_AGREE, atol=1e-300):
        raise ArithmeticError(f"{name}: other values than NumPy's")
    found = timings(calls, rounds=rounds)
    ns = {
        who: Timing(*(1e9 * second / VALUES for second in timing))
        for who, timing in found.items()
    }
    return Timed(name, ns)
