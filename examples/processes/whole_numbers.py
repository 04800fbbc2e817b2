"""The fleet is out or in harbour
==============================

Two species of fish, predators and prey, are to be brought into balance by fishing. The
whole fleet is out or none of it: the control is 0 or 1, and may change 60 times. What
does that cost?

Only 0.3 %: the deviation from balance is 1.349, against 1.345 if any part of the fleet
may be out. The fleet is out in one long time, then in three short ones, whose mean is
the smooth answer. The second number is a lower limit if its local optimum is the global
one. `integer=` of `ss.Bounds` names the controls that take whole numbers. The search
uses these only; IPOPT's answer is rounded. Such an answer is never called a local
optimum.

Prints::

    whole fleet or none: 1.349
    any part of the fleet: 1.345

The same as a shipped scenario: `swarmstart run lotka_volterra_whole`.
"""

from dataclasses import replace

import casadi as ca
import matplotlib.pyplot as plt

import swarmstart as ss

prey, predators, fishing = (ca.SX.sym(n) for n in ("prey", "predators", "fishing"))
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(prey, predators),  # 1: in balance
        controls=fishing,  # part of the fleet that is out
        ode=ca.vertcat(
            prey - prey * predators - 0.4 * prey * fishing,
            prey * predators - predators - 0.2 * predators * fishing,
        ),
    ),
    horizon=12.0,  # without a unit, as the rates
    intervals=60,
    stage_cost=(prey - 1) ** 2 + (predators - 1) ** 2,
    bounds=ss.Bounds(controls=(0, 1), integer=["fishing"]),
)
solution = ss.solve(problem, [0.5, 0.7], seed=0)
parts = replace(problem, bounds=ss.Bounds(controls=(0, 1)))
relaxed = ss.solve(parts, [0.5, 0.7], seed=0)
print(f"whole fleet or none: {solution.cost:.3f}")
print(f"any part of the fleet: {relaxed.cost:.3f}")

upper, lower = plt.figure().subplots(2, sharex=True)
for row, name in enumerate(("prey", "predators")):
    upper.plot(solution.path.times, solution.path.states[row], f"C{row}", label=name)
    upper.plot(relaxed.path.times, relaxed.path.states[row], f"C{row}--")
upper.set(ylabel="of the balance")
upper.legend()
lower.stairs(solution.controls[0], solution.times, fill=True, alpha=0.4, label="whole")
lower.stairs(relaxed.controls[0], relaxed.times, color="k", ls="--", label="any part")
lower.set(xlabel="time", ylabel="fleet at sea", xlim=(0, 12))
lower.legend()
plt.show()
