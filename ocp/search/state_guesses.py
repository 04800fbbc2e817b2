"""Guesses of states that reach a fixed end.

If the controls of a start lead far from a fixed end, an NLP solver may not recover;
from states that reach the end, it often does. Such guesses, lines with sine modes, are
drawn, not optimised: only the NLP solver's answer shows which guess leads to a good
optimum.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import Fitness, Known, at_nodes, shared_arguments
from swarmstart.ocp.statement.guesses import zero_controls

MODES = (1, 3)
"""Numbers of the sine modes, used in turn."""
_AMPLITUDE = 0.5
"""Standard deviation of the first mode, relative to the way; mode k has 1/k of it."""


def straight_states(fitness: Fitness, x0: ArrayLike, known: Known) -> Array | None:
    """Return states that lead straight to the fixed end states, (nx, nodes).

    Other states stay at their initial value. None if the end fixes no state.

    Args:
        fitness: The problem's evaluator.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
    """
    way = _way(fitness, x0, known)
    return None if way is None else way[0]


def state_guesses(
    fitness: Fitness, x0: ArrayLike, known: Known, n: int, rng: np.random.Generator
) -> list[Start]:
    """Return guesses whose states start at x0 and reach the fixed end states.

    The first is the straight line, the others add sine modes to it; all have zero
    controls. The list is empty if the end fixes no state.

    Args:
        fitness: The problem's evaluator.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        n: Number of guesses.
        rng: Source of all randomness.
    """
    way = _way(fitness, x0, known)
    if way is None or n < 1:
        return []
    line, fixed = way
    problem = fitness.problem
    controls = zero_controls(problem)
    reach = np.abs(line[:, -1] - line[:, 0])
    # A state whose end equals its start gets its natural size as amplitude.
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
        inside[:, 0] = line[:, 0]  # The start is given, even beyond a bound.
        found.append(Start(controls, inside))
    return found


def _way(
    fitness: Fitness, x0: ArrayLike, known: Known
) -> tuple[Array, NDArray[np.bool_]] | None:
    """Return the line at the nodes, and a mask of the states that the end fixes."""
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
