"""A battery buys and sells over a day
===================================

A battery of 20 kWh buys and sells energy at a price that is known for the day. A part
is lost as heat, the more the higher the power. When does it charge, and what is the
stored energy worth?

It is filled and emptied twice, which earns 6.22 euro. The worth of a stored kWh is its
multiplier, `solution.multipliers.costates`: 0.21 euro at first, 0.15 at noon and 0.31
in the evening. It stays constant until the battery is full or empty, so that all trade
is a comparison of two lines: buy if the price is below the worth, sell if it is above.
With such prices there is one optimum, and every start leads to it.

Prints::

    earned 6.22 euro
    worth of a stored kWh at 3, 13 and 20 h: 0.210, 0.148, 0.312 euro

The same in YAML; `swarmstart run battery_price.yaml` solves it:

.. literalinclude:: ../../../examples/processes/battery_price.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

HOUR = 3600.0  # s
hours, prices = [0, 4, 8, 11, 14, 19, 24], [0.21, 0.18, 0.33, 0.14, 0.05, 0.42, 0.24]

energy, power, price = (ca.SX.sym(name) for name in ("energy", "power", "price"))
problem = ss.OptimalControlProblem(
    ss.Model(
        states=energy,  # kWh
        controls=power,  # kW that it buys; negative: it sells
        ode=(power - 0.01 * power**2) / HOUR,  # 5 % are lost at 5 kW
    ),
    horizon=24 * HOUR,
    intervals=96,
    stage_cost=price * power / HOUR,  # price in euro per kWh
    signals=price,
    bounds=ss.Bounds(controls=(-5, 5), states=(0, 20)),
    terminal=[energy >= 5],
)
times = np.linspace(0, 24, problem.nodes)
known = ss.Known(signals=np.interp(times, hours, prices)[None, :])
solution = ss.solve(problem, [5], known=known, seed=0)
worth = -solution.multipliers.costates[0]
print(f"earned {-solution.cost:.2f} euro")
texts = ", ".join(f"{worth[4 * hour]:.3f}" for hour in (3, 13, 20))
print(f"worth of a stored kWh at 3, 13 and 20 h: {texts} euro")

upper, lower = plt.figure().subplots(2, sharex=True)
upper.plot(hours, prices, label="price")
upper.stairs(worth, times, baseline=None, lw=2, label="worth of stored energy")
upper.set(ylabel="euro per kWh")
upper.legend()
lower.fill_between(times, solution.states[0], alpha=0.4)
lower.set(xlim=(0, 24), xticks=range(0, 25, 4))
lower.set(xlabel="hour of the day", ylabel="stored energy [kWh]")
plt.show()
