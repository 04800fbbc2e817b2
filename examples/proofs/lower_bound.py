"""A proof of how far the optimum can be
=====================================

A solver ends in a local optimum. How much cheaper could another control be, that no
search has found?

At most 1 % cheaper here, and this is proven, rounding errors included: no control, held
or not, has a cost in the grey part of the picture. The costs of ten thousand random
controls all lie right of it. `solve(..., bound=1)` has the proof made after the answer,
with one unit of work, about a second; the same work proves the same bound everywhere.

Prints::

    answer 0.496, lower bound proven
    at most 1 % above the optimum: True

The same in YAML; `swarmstart run lower_bound.yaml --bound 1s` solves it and proves it:

.. literalinclude:: ../../../examples/proofs/lower_bound.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

x, u = ca.SX.sym("x"), ca.SX.sym("u")
problem = ss.OptimalControlProblem(
    ss.Model(states=x, controls=u, ode=u - x**3),
    horizon=1.0,
    intervals=20,
    stage_cost=x**2 + u**2,
    bounds=ss.Bounds(controls=(-1.0, 1.0), states=(-2.0, 2.0)),
)
solution = ss.solve(problem, x0=[1.0], seed=0, bound=1.0)
bound, gap = solution.bound, solution.gap
print(f"answer {solution.cost:.3f}, lower bound {bound.kind.value}")
print(f"at most 1 % above the optimum: {gap.gap < 0.01}")

# The costs of random controls, each a line from one value to another; Euler's steps.
first, last = np.random.default_rng(0).uniform(-1, 1, (2, 10_000))
state, costs = np.ones(10_000), np.zeros(10_000)
for time in np.arange(0, 1, 0.001):
    control = first + (last - first) * time
    costs += 0.001 * (state**2 + control**2)
    state += 0.001 * (control - state**3)

axes = plt.figure().add_subplot(xlabel="cost", ylabel="number of controls")
axes.hist(costs, bins=60, color="tab:blue", label="10,000 random controls")
axes.axvspan(0.4, bound.value, color="0.85", label="proven: no control costs less")
axes.axvline(solution.cost, color="tab:orange", linewidth=2, label="the answer")
axes.set_xlim(0.4, 1.4)
axes.legend()
plt.show()
