"""Guesses of states that lead to where the end fixes them: lines with sine modes.

Where the controls of a start lead far from the end, an NLP solver may not find back;
from states that reach it, it often does. Such guesses are drawn, not optimised: which
of them leads to a good optimum shows only in the NLP solver's answer.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.fitness import Fitness, Known, at_nodes, shared_arguments
from swarmstart.ocp.guess import zero_controls
from swarmstart.ocp.search_space import Start

Array = NDArray[np.float64]

MODES = (1, 3)
"""Sine modes of a guess, in turn."""
_AMPLITUDE = 0.5
"""Standard deviation of the first mode, in parts of the way; of mode k its k-th."""


def straight_states(fitness: Fitness, x0: ArrayLike, known: Known) -> Array | None:
    """Return states that lead straight to where the end fixes them, (nx, nodes).

    Those that it does not fix stay; None: it fixes none.

    Args:
        fitness: The problem's evaluator.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
    """
    way = _way(fitness, x0, known)
    return None if way is None else way[0]


def state_guesses(
    fitness: Fitness, x0: ArrayLike, known: Known, n: int, rng: np.random.Generator
) -> list[Start]:
    """Return guesses whose states begin at x0 and end where the end fixes them.

    The first is the line itself, the others have sine modes on it; all have zero
    controls. None where the end fixes no state.

    Args:
        fitness: The problem's evaluator.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
        n: How many.
        rng: Source of all randomness.
    """
    way = _way(fitness, x0, known)
    if way is None or n < 1:
        return []
    line, fixed = way
    problem = fitness.problem
    controls = zero_controls(problem)
    reach = np.abs(line[:, -1] - line[:, 0])
    # A state that ends where it begins has its natural size to go away and come back.
    sizes = fitness.arguments.sizes(x0, known).states
    reach = np.where(fixed, np.where(reach > 0, reach, sizes), 0.0)
    part = np.linspace(0.0, 1.0, problem.nodes)
    lower, upper = (side[:, None] for side in problem.state_limits)
    found = [Start(controls, line)]
    for number in range(n - 1):
        modes = np.arange(1, MODES[number % len(MODES)] + 1)
        drawn = rng.standard_normal((reach.size, modes.size))
        amplitudes = _AMPLITUDE * reach[:, None] * drawn / modes
        bent = line + amplitudes @ np.sin(np.pi * np.outer(modes, part))
        inside = np.clip(bent, lower, upper)
        inside[:, 0] = line[:, 0]
        found.append(Start(controls, inside))
    return found


def _way(
    fitness: Fitness, x0: ArrayLike, known: Known
) -> tuple[Array, NDArray[np.bool_]] | None:
    """Return the line at the nodes, and which states the end fixes."""
    problem = fitness.problem
    state, p, flat = shared_arguments(problem, x0, known)
    signals = at_nodes(problem, flat)
    target = fitness.shooting.sizing.target(p, signals[:, -1])
    fixed = ~np.isnan(target)
    if not fixed.any():
        return None
    reached = np.where(fixed, target, state)
    part = np.linspace(0.0, 1.0, problem.nodes)
    return state[:, None] + np.outer(reached - state, part), fixed
