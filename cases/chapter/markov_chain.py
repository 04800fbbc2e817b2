"""Differential evolution on a small grid of one variable, as an exact Markov chain.

DE/rand/1 with NP individuals on the grid points 0, 1, ..., m - 1 with costs f. The
state is the population, x = (x_1, ..., x_NP): there are m^NP. In one generation each
individual i draws r1, r2, r3, distinct and none of them i, and

    v = floor(x_r1 + F (x_r2 - x_r3) + 1/2)               (mutant, rounded half up)
    u = v, or the nearest grid point where v is outside                      (clip)
    u = v, or x_i where v is outside                                       (reject)
    u = a uniform grid point, with probability eps                      (immigrant)
    x_i <- u  if f(u) <= f(x_i)

All trials are built from the population before. Given it the individuals move
independently of each other, so the row of a state in the transition matrix P is

    P(x, y) = product over i of p_i(y_i | x)

with p_i counted over all (NP-1)(NP-2)(NP-3) triples. The populations with an optimum
form a closed set. With Q the block of P over the others, b their probabilities to enter
that set in one generation, and 1 a vector of ones,

    h = (I - Q)^-1 b     probability that an optimum is ever reached
    T = (I - Q)^-1 1     expected number of generations until it is
    Q^t 1                probability that it is not within t generations

Plain DE has dead states, from which no optimum can be reached. With them I - Q is
singular, and h and T are solved over the other states. With eps > 0 there are no dead
states: each of the NP trials is an optimum with probability eps/m or more, and is
accepted, so that

    P(no optimum within t generations) <= (1 - eps/m)^(NP t)

Source: Rudolph (1994), Convergence analysis of canonical genetic algorithms, IEEE
Transactions on Neural Networks 5, for the argument; Storn and Price (1997), see `de`.
"""

from dataclasses import dataclass
from itertools import permutations
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import a_count, a_number, checked, choice
from swarmstart.arrays import Array
from swarmstart.heuristics import F_MAX
from swarmstart.heuristics.laws import require
from swarmstart.heuristics.laws.algorithm import InvalidSettingsError
from swarmstart.machine_code import Count

Mask = NDArray[np.bool_]
GridBoundHandling = Literal["clip", "reject"]
GRID_BOUND_HANDLING: tuple[str, ...] = get_args(GridBoundHandling)

MAX_STATES = 10_000
"""Largest number of populations; their transition matrix needs 800 MB."""


@checked(
    InvalidSettingsError,
    size=a_count(least=4),
    bound_handling=choice(GRID_BOUND_HANDLING),
    immigrant=a_number(least=0, most=1),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GridDE:
    """DE/rand/1 on the points of a grid.

    Attributes:
        costs: Costs of the grid points, shape (m,), m at least 2, finite and not all
            equal; copied and read-only. The points of least cost are the optima.
        size: Number of individuals NP, at least 4; m^NP at most MAX_STATES.
        F: Weight of the difference, in (0, 2].
        bound_handling: Treatment of a mutant outside the grid: "clip" moves it to the
            nearest grid point, "reject" keeps its parent.
        immigrant: Probability eps that a trial is replaced by a uniform grid point, in
            [0, 1].

    Raises:
        InvalidSettingsError: If a value is out of its range.
    """

    costs: Array
    size: int = 4
    F: float = 0.5
    bound_handling: GridBoundHandling = "clip"
    immigrant: float = 0.0

    def __post_init__(self) -> None:
        """Check the values, copy the costs and set them read-only."""
        costs = np.array(self.costs, dtype=np.float64)
        costs.setflags(write=False)
        object.__setattr__(self, "costs", costs)
        finite = costs.ndim == 1 and bool(np.isfinite(costs).all())
        ok = finite and np.unique(costs).size > 1
        allowed = "a vector of at least 2 finite numbers, not all equal"
        require("costs", costs.tolist(), ok=ok, allowed=allowed)
        states = f"{self.points}**{self.size}"
        # First the size alone, since the power of a huge one takes for ever: from two
        # points on, 2**size is above the limit.
        ok = self.size < MAX_STATES.bit_length() and self.states <= MAX_STATES
        require("populations", states, ok=ok, allowed=f"at most {MAX_STATES}")
        require("F", self.F, ok=0.0 < self.F <= F_MAX, allowed=f"in (0, {F_MAX}]")

    @property
    def points(self) -> int:
        """Number of grid points m."""
        return self.costs.size

    @property
    def states(self) -> int:
        """Number of populations m^NP."""
        return int(self.points**self.size)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MarkovChain:
    """Markov chain of DE, as `build_chain` returns it; the arrays are read-only.

    Attributes:
        grid: Settings of DE and the grid.
        populations: The states, int64, shape (m^NP, NP): indices of grid points, the
            last individual counting fastest.
        transition: Transition matrix P, shape (m^NP, m^NP): probabilities to go from
            the row's state to the column's.
        optimal: Whether each state contains an optimum, shape (m^NP,); such states form
            a closed set.
    """

    grid: GridDE
    populations: Count
    transition: Array
    optimal: Mask


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Absorption:
    """Probabilities that an optimum is ever reached.

    Attributes:
        by_state: Probability from each initial population, shape (m^NP,), read-only.
        uniform: Probability with initial individuals uniform on the grid, independent
            of each other.
        without_optimum: Probability as `uniform`, given that no initial individual is
            an optimum.
    """

    by_state: Array
    uniform: float
    without_optimum: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HittingTimes:
    """Expected numbers of generations until an optimum is reached.

    Attributes:
        by_state: Expected number from each initial population, shape (m^NP,),
            read-only; infinite if a dead state can be reached.
        longest: Largest entry of `by_state`.
        mean: Expected number with initial individuals uniform on the grid, independent
            of each other.
    """

    by_state: Array
    longest: float
    mean: float


def build_chain(grid: GridDE) -> MarkovChain:
    """Compute all states and the transitions between them."""
    indices = np.indices((grid.points,) * grid.size, dtype=np.int64)
    populations = np.ascontiguousarray(indices.reshape(grid.size, -1).T)
    moves = _moves(grid, populations)
    transition = moves[:, 0]
    for i in range(1, grid.size):
        # Given the population, individuals move independently: probabilities multiply.
        product = transition[:, :, None] * moves[:, i, None, :]
        transition = product.reshape(grid.states, -1)
    optimal = (grid.costs == grid.costs.min())[populations].any(axis=1)
    for array in (populations, transition, optimal):
        array.setflags(write=False)
    return MarkovChain(
        grid=grid, populations=populations, transition=transition, optimal=optimal
    )


def dead_states(chain: MarkovChain) -> Mask:
    """Return which states are dead: no optimum can be reached from them, (m^NP,)."""
    return ~_reaching(chain, chain.optimal)


def fixed_points(chain: MarkovChain) -> Mask:
    """Return which states have no optimum and are never left, shape (m^NP,)."""
    one_successor: Mask = np.count_nonzero(chain.transition, axis=1) == 1
    return one_successor & (chain.transition.diagonal() > 0.0) & ~chain.optimal


def absorption(chain: MarkovChain) -> Absorption:
    """Compute the probability that an optimum is ever reached, h = (I - Q)^-1 b.

    Q has the probabilities of transitions between the states without an optimum from
    which an optimum can be reached, and b their probabilities to reach one in one
    generation. From the other states without an optimum the probability is 0.
    """
    undecided = ~dead_states(chain) & ~chain.optimal
    by_state = chain.optimal.astype(np.float64)
    # by_state is 1 at the optima and 0 elsewhere, so the product is b.
    by_state[undecided] = _solve(chain, undecided, chain.transition @ by_state)
    by_state.setflags(write=False)
    return Absorption(
        by_state=by_state,
        uniform=float(by_state.mean()),
        without_optimum=float(by_state[~chain.optimal].mean()),
    )


def hitting_times(chain: MarkovChain) -> HittingTimes:
    """Compute the expected number of generations until an optimum is reached.

    It is T = (I - Q)^-1 1, with a vector of ones, and the probabilities Q of
    transitions between the states without an optimum from which no dead state can be
    reached. From all other states without an optimum it is infinite.
    """
    # A dead state on the way makes the expectation infinite.
    may_fail = _reaching(chain, dead_states(chain))
    by_state = np.where(may_fail, np.inf, 0.0)
    transient = ~may_fail & ~chain.optimal
    by_state[transient] = _solve(chain, transient, np.ones(by_state.size))
    by_state.setflags(write=False)
    longest, mean = float(by_state.max()), float(by_state.mean())
    return HittingTimes(by_state=by_state, longest=longest, mean=mean)


def spectral_radius(chain: MarkovChain) -> float:
    """Compute the largest modulus of an eigenvalue of Q; 1 if a state is dead.

    Q is the block of the transition matrix over the states without an optimum.
    """
    return float(np.abs(np.linalg.eigvals(_block(chain, ~chain.optimal))).max())


def miss_probabilities(chain: MarkovChain, generations: int) -> Array:
    """Compute the probability to miss an optimum from the worst initial population.

    Args:
        chain: The chain.
        generations: Number of generations, at least 0.

    Returns:
        Largest entry of Q^t 1 for t = 0, ..., generations, shape (generations + 1,).
        Q is the block of the transition matrix over the states without an optimum, and
        1 a vector of ones: an entry is the probability to be without an optimum in all
        of the first t generations.

    Raises:
        InvalidSettingsError: If `generations` is no integer or negative.
    """
    t = _times(generations)
    Q = _block(chain, ~chain.optimal)
    missed = np.ones(len(Q))
    largest = np.ones(t.size)
    for k in t[1:]:
        missed = Q @ missed
        largest[k] = missed.max()
    return largest


def miss_bounds(grid: GridDE, generations: int) -> Array:
    """Bound the probability that no optimum is found within t generations.

    The bound is (1 - eps/m)^(NP t), with m grid points, NP individuals, and the
    probability eps that a trial is replaced by a uniform grid point.

    Args:
        grid: Settings of DE and the grid.
        generations: Number of generations, at least 0.

    Returns:
        The bounds for t = 0, ..., generations, shape (generations + 1,).

    Raises:
        InvalidSettingsError: If `generations` is no integer or negative.

    Source: Rudolph (1994), for algorithms that keep the best and can draw any point.
    """
    missed = 1.0 - grid.immigrant / grid.points
    return np.asarray(missed ** (grid.size * _times(generations)))


def _moves(grid: GridDE, populations: Count) -> Array:
    """Compute the moves of each individual, p_i(y | x), shape (m^NP, NP, m)."""
    m, size, states = grid.points, grid.size, np.arange(grid.states)
    counts = np.zeros((grid.states, size, m))
    for i, r1, r2, r3 in permutations(range(size), 4):
        x, x1, x2, x3 = populations[:, [i, r1, r2, r3]].T
        # Half up, as at the head; np.rint rounds half to even.
        mutant = np.floor(x1 + grid.F * (x2 - x3) + 0.5).astype(np.int64)
        trial = np.clip(mutant, 0, m - 1)
        if grid.bound_handling == "reject":
            trial = np.where(trial == mutant, mutant, x)
        accepted = grid.costs[trial] <= grid.costs[x]
        counts[states, i, np.where(accepted, trial, x)] += 1.0
    # Each of the triples (r1, r2, r3) is equally likely.
    moves = counts / ((size - 1) * (size - 2) * (size - 3))
    # From row to column: uniform over the m points, accepted if not worse.
    arrivals = (grid.costs[None, :] <= grid.costs[:, None]) / m
    # An immigrant that is refused leaves its parent in place.
    arrivals += np.diag(1.0 - arrivals.sum(axis=1))
    return (1.0 - grid.immigrant) * moves + grid.immigrant * arrivals[populations]


def _reaching(chain: MarkovChain, target: Mask) -> Mask:
    """Find the states from which the target can be reached, itself among them."""
    reaching = target
    while True:
        grown = reaching | (chain.transition @ reaching > 0.0)
        if (grown == reaching).all():
            return grown
        # At most as many rounds as there are states.
        reaching = grown


def _block(chain: MarkovChain, states: Mask) -> Array:
    """Cut the transitions among some states out of the matrix; a copy."""
    return chain.transition[np.ix_(states, states)]


def _solve(chain: MarkovChain, states: Mask, right: Array) -> Array:
    """Solve (I - Q) h = right over some states that the chain leaves for good."""
    Q = _block(chain, states)
    return np.asarray(np.linalg.solve(np.eye(len(Q)) - Q, right[states]))


def _times(generations: int) -> Count:
    """List 0, ..., generations, which must be an integer of at least 0."""
    ok = isinstance(generations, int) and generations >= 0
    require("generations", generations, ok=ok, allowed="an integer of at least 0")
    return np.arange(generations + 1)
