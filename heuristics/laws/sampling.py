"""Initial populations.

uniform          independent in every variable
latin_hypercube  one of the n points in each n-th of every variable (McKay et al. 1979)
smooth           correlated in time
half_smooth      the first half smooth, the rest uniform

Smooth in time: if the variables are a sequence in time, independent draws jitter; a
sequence that turns one way all the time, for example, hardly occurs among them. Smooth
draws have the same distribution in each variable (uniform), and are correlated in time
by a first-order autoregressive process,

    z_0 = n_0,  z_k = r z_k-1 + sqrt(1 - r^2) n_k,  r = exp(-1 / steps),  u_k = Phi(z_k)

with n_k standard normal and Phi its distribution: correlated over the whole sequence.
"""

import math
from typing import Literal

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.box import Box
from swarmstart.machine_code import kernel


def sample_uniform(box: Box, size: int, *, rng: np.random.Generator) -> Array:
    """Draw points uniformly in the box.

    Args:
        box: The box.
        size: Number of points.
        rng: Source of randomness.

    Returns:
        The points as columns, shape (dim, size), a new array.
    """
    points = box.lower[:, None] + box.width[:, None] * rng.random((box.dim, size))
    return np.minimum(points, box.upper[:, None])  # rounding may step over


Sampling = Literal["uniform", "latin_hypercube", "smooth", "half_smooth"]


def sample(
    box: Box, size: int, *, sampling: Sampling, rng: np.random.Generator
) -> Array:
    """Draw an initial population.

    Args:
        box: The box; smooth sampling needs its `per_step`.
        size: Number of points.
        sampling: See the head of this module.
        rng: Source of randomness.

    Returns:
        The points as columns, shape (dim, size), a new array.
    """
    if sampling == "uniform":
        return sample_uniform(box, size, rng=rng)
    if sampling == "latin_hypercube":
        fractions = latin_hypercube((box.dim, size), rng=rng)
    else:
        smooth = size if sampling == "smooth" else size // 2
        fractions = smooth_in(box, smooth, rng=rng)
    points = box.lower[:, None] + box.width[:, None] * fractions
    points = np.minimum(points, box.upper[:, None])  # rounding may step over
    rest = sample_uniform(box, size - points.shape[1], rng=rng)
    return np.concatenate([points, rest], axis=1)


def latin_hypercube(shape: tuple[int, int], *, rng: np.random.Generator) -> Array:
    """Draw points of a Latin hypercube in (0, 1).

    Args:
        shape: (dim, size), the shape of the result.
        rng: Source of randomness.
    """
    dim, size = shape
    strata = np.tile(np.arange(size), (dim, 1))
    points: Array = (rng.permuted(strata, axis=1) + rng.random(shape)) / size
    return points


def smooth_fractions(
    shape: tuple[int, int], *, per_step: int, rng: np.random.Generator
) -> Array:
    """Draw numbers uniform in (0, 1), each column correlated over its steps.

    Args:
        shape: (dim, size), the shape of the result.
        per_step: How many variables belong to one step; divides dim.
        rng: Source of randomness.

    Returns:
        The numbers, a new array; columns, and variables of one step, are independent.
    """
    fractions = np.empty(shape)
    correlate(rng, per_step, fractions)
    return fractions


def smooth_in(box: Box, size: int, *, rng: np.random.Generator) -> Array:
    """Draw numbers uniform in (0, 1), smooth over the steps of a box's variables.

    Variables that belong to no step are independent.

    Args:
        box: The box.
        size: Number of columns.
        rng: Source of randomness.
    """
    per_step = box.per_step or box.in_sequence
    smooth = smooth_fractions((box.in_sequence, size), per_step=per_step, rng=rng)
    if not box.constant:
        return smooth
    return np.concatenate([smooth, rng.random((box.constant, size))])


@kernel
def correlate(rng: np.random.Generator, per_step: int, fractions: Array) -> None:
    """Fill (dim, size) with the process at the head of this module."""
    dim, size = fractions.shape
    r = math.exp(-per_step / dim)
    spread = math.sqrt(1.0 - r * r)
    for i in range(size):
        for variable in range(per_step):
            z = rng.standard_normal()
            for d in range(variable, dim, per_step):
                if d != variable:
                    z = r * z + spread * rng.standard_normal()
                fractions[d, i] = 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))
