"""Weights and learning rates of CMA-ES, from dimension and population size.

Numbers such as (8) are equations of the tutorial below.

Source: Hansen (2016), The CMA evolution strategy: a tutorial, arXiv:1604.00772v1,
Table 1 and eq. (48)-(58).
"""

import math
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import kernel

ALPHA_COV = 2.0


class Constants(NamedTuple):
    """Learning rates for one dimension n and one population size lambda.

    Attributes:
        mu_eff: Variance effective selection mass (8).
        c_sigma: Rate of the path of the step size (55).
        d_sigma: Damping of the step size (55).
        c_c: Rate of the path of the covariance (56).
        c_1: Rate of the rank-one update (57).
        c_mu: Rate of the rank-mu update (58).
        chi: Expected length of a standard normal vector (p. 28).
    """

    mu_eff: float
    c_sigma: float
    d_sigma: float
    c_c: float
    c_1: float
    c_mu: float
    chi: float


def default_size(dim: int) -> int:
    """Number of individuals lambda = 4 + floor(3 ln n) (48)."""
    return 4 + math.floor(3.0 * math.log(dim))


@kernel
def preliminary_weights(size: int) -> Array:
    """Convex-shaped weights w' of the ranks, the best first, shape (size,) (49)."""
    weights = np.empty(size)
    for i in range(size):
        weights[i] = math.log(0.5 * (size + 1.0)) - math.log(i + 1.0)
    return weights


@kernel
def selection_mass(weights: Array) -> float:
    """Variance effective selection mass (sum w)^2 / sum w^2 (8)."""
    total, squares = 0.0, 0.0
    for weight in weights:
        total += weight
        squares += weight * weight
    return total * total / squares


@kernel
def constants_of(dim: int, size: int) -> Constants:
    """Learning rates for a dimension and a population size of at least 4."""
    mu_eff = selection_mass(preliminary_weights(size)[: size // 2])
    c_sigma = (mu_eff + 2.0) / (dim + mu_eff + 5.0)  # (55)
    excess = max(0.0, math.sqrt((mu_eff - 1.0) / (dim + 1.0)) - 1.0)
    c_1 = ALPHA_COV / ((dim + 1.3) ** 2 + mu_eff)  # (57)
    c_mu = ALPHA_COV * (mu_eff - 2.0 + 1.0 / mu_eff)
    c_mu /= (dim + 2.0) ** 2 + 0.5 * ALPHA_COV * mu_eff
    return Constants(
        mu_eff,
        c_sigma,
        1.0 + 2.0 * excess + c_sigma,  # d_sigma (55)
        (4.0 + mu_eff / dim) / (dim + 4.0 + 2.0 * mu_eff / dim),  # c_c (56)
        c_1,
        min(1.0 - c_1, c_mu),  # (58)
        math.sqrt(dim) * (1.0 - 1.0 / (4.0 * dim) + 1.0 / (21.0 * dim**2)),
    )


@kernel
def weights_of(dim: int, size: int, constants: Constants) -> Array:
    """Weights w of the ranks, the best first, shape (size,); the worse half below 0.

    The positive weights sum to 1, the negative ones to minus the least of the three
    numbers (50), (51) and (52) of Hansen (2016).
    """
    weights = preliminary_weights(size)
    mu = size // 2
    c_1, c_mu = constants.c_1, constants.c_mu
    mu_eff_minus = selection_mass(weights[mu:])
    alpha = min(
        1.0 + c_1 / c_mu,  # (50)
        1.0 + 2.0 * mu_eff_minus / (constants.mu_eff + 2.0),  # (51)
        (1.0 - c_1 - c_mu) / (dim * c_mu),  # (52)
    )
    positive, negative = 0.0, 0.0
    for weight in weights:
        positive += max(weight, 0.0)
        negative += max(-weight, 0.0)
    for i in range(size):  # (53)
        weights[i] *= 1.0 / positive if weights[i] >= 0.0 else alpha / negative
    return weights
