"""The cross-entropy method against the solvers here
=================================================

The cross-entropy method is popular in robotics: draw controls, keep the best fifth, and
draw the next ones as these are spread. How does it do on a stirred tank with two local
optima, beside IPOPT?

It leaves the costlier optimum, in which IPOPT from zero controls stays at a cost 80 %
higher. But it is seldom within 1 % of the best. L-SHADE with IPOPT always is, and so
is IPOPT from random controls, repeated: both are better on this problem. `ss.compare`
gives all the same budget and seeds, and simulates every answer with finer steps.

Prints::

    cross_entropy: 1 of 6 near the best, median cost 0.138
    lshade+ipopt: 6 of 6 near the best, median cost 0.136
    repeated-ipopt: 6 of 6 near the best, median cost 0.136
    ipopt: 0 of 1 near the best, median cost 0.245

The problem is a shipped scenario: `swarmstart run two_reaction_reactor`. A function of
your own has no YAML form; `swarmstart compare` takes it from an installed package.
"""

import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss


def cross_entropy(problem, x0, budget, rng, evaluate):
    """Draw controls as the best of the last draw; `evaluate` ends it."""
    lower, upper = (side[:, None, None] for side in problem.control_limits)
    middle = np.ones((1, problem.intervals, 1)) * (lower + upper) / 2
    spread = np.ones((1, problem.intervals, 1)) * (upper - lower) / 2
    while True:
        drawn = rng.normal(middle, spread, (len(lower), problem.intervals, 50))
        drawn = np.clip(drawn, lower, upper)
        cost, violation = evaluate(drawn)
        best = drawn[:, :, np.argsort(cost + 1e3 * violation)[:10]]
        middle, spread = best.mean(axis=2)[..., None], best.std(axis=2)[..., None]


solvers = [cross_entropy, "lshade+ipopt", "repeated-ipopt", "ipopt"]
rows = ss.compare("two_reaction_reactor", solvers, seeds=6, budget=4000)
axes = plt.figure().add_subplot(ylabel="cost: median, least and largest")
for row in rows:
    least, median, largest = np.quantile(row.costs, [0, 0.5, 1])
    count = len(row.outcomes)
    print(f"{row.solver}: {row.successes} of {count} near the best,", end=" ")
    print(f"median cost {median:.3f}")
    reach = [[median - least], [largest - median]]
    colour = "tab:blue" if row.solver == "cross_entropy" else "0.5"
    axes.bar(row.solver, median, yerr=reach, capsize=8, color=colour)
    label = f"{row.successes} of {count}\nnear the best"
    axes.text(row.solver, median / 2, label, ha="center", color="w", fontsize=9)
plt.show()
