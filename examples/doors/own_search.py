"""A search of your own, ten lines long
====================================

A stirred tank with two reactions has two local optima. Does a hill climb of ten lines
find the better one, and how does it compare with random search?

It is near the best known cost with 10 of 10 seeds, and random search with none, with
4000 evaluations each. `ss.compare` takes a function of (problem, x0, budget, rng,
evaluate) that returns controls as a solver, and judges it as the others, with the same
budget and paired seeds.

Prints::

    climb: 10 of 10 feasible, 10 near the best
    random: 10 of 10 feasible, 0 near the best; costlier

The problem is a shipped scenario: `swarmstart run two_reaction_reactor`. A function of
your own has no YAML form; `swarmstart compare` takes it from an installed package.
"""

import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss


def climb(problem, x0, budget, rng, evaluate):
    """Keep the best of sixteen moves, with steps that shrink; `evaluate` ends it."""
    lower, upper = (side[:, None, None] for side in problem.control_limits)
    best, size = (lower + upper)[:, :, 0] / 2 * np.ones(problem.intervals), 0.5
    while size > 1e-4:
        moves = rng.normal(size=(*best.shape, 16)) * size * (upper - lower)
        tried = np.clip(best[:, :, None] + moves, lower, upper)
        tried[:, :, 0] = best
        cost, violation = evaluate(tried)
        chosen = int(np.argmin(cost + 1e3 * violation))
        best, size = tried[:, :, chosen], size * (0.95 if chosen == 0 else 1.0)
    return best


rows = ss.compare("two_reaction_reactor", [climb, "random"], seeds=10, budget=4000)
axes = plt.figure(figsize=(6.4, 3)).add_subplot(xlabel="cost of each seed")
for row, marker in zip(rows, "os", strict=True):
    said = f"; {row.against_first.partition(' (')[0]}" if row.against_first else ""
    count, near = len(row.outcomes), row.successes
    print(
        f"{row.solver}: {row.feasible} of {count} feasible, {near} near the best{said}"
    )
    axes.plot(row.costs, [row.solver] * count, marker, markersize=10, alpha=0.5)
best = min(rows[0].costs)
axes.axvspan(best, 1.01 * best, color="0.85", label="near the best: within 1 %")
axes.margins(y=0.5)
axes.legend(loc="upper right")
plt.show()
