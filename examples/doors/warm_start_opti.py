"""A better start for a problem in CasADi's Opti
=============================================

A vehicle goes past a disc, and the problem is written with `casadi.Opti` already. The
first guess passes below the disc. Does IPOPT notice that above is better?

It does not: from its own start it ends below, at a cost of 3.70. One added line,
`ss.warm_start`, searches a better start; from there IPOPT passes above, at 2.80. The
answer is never worse than that of the own start, which is tried as well.

Prints::

    IPOPT from its own start: cost 3.702
    with a searched start: cost 2.800
    what won: searched start

There is no YAML form: an Opti is code.
"""

import casadi as ca
import matplotlib.pyplot as plt

import swarmstart as ss

INTERVALS, STEP = 40, 0.2  # s

opti = ca.Opti()
x, u = opti.variable(4, INTERVALS + 1), opti.variable(2, INTERVALS)
for k in range(INTERVALS):
    place, speed = x[:2, k], x[2:, k]  # m, m/s
    moved = place + STEP * speed + STEP**2 / 2 * u[:, k]
    opti.subject_to(x[:, k + 1] == ca.vertcat(moved, speed + STEP * u[:, k]))
for k in range(1, INTERVALS):
    opti.subject_to(ca.sumsqr(x[:2, k] - ca.DM([5.0, -0.4])) >= 1.5**2)
opti.subject_to(x[:, 0] == 0)
opti.subject_to(x[:, -1] == ca.DM([10, 0, 0, 0]))
opti.subject_to(opti.bounded(-2, ca.vec(u), 2))  # m/s^2
opti.minimize(STEP * ca.sumsqr(u))
opti.set_initial(x[1, :], -1.5)  # below the disc
opti.set_initial(x[0, :], ca.linspace(0, 10, INTERVALS + 1).T)
opti.solver("ipopt", {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0})

alone = opti.solve()
print(f"IPOPT from its own start: cost {alone.value(opti.f):.3f}")

warm = ss.warm_start(opti, controls=[u], states=[x], seed=0)  # the added line
solution = warm.solve()  # in place of opti.solve()
print(f"with a searched start: cost {solution.value(opti.f):.3f}")
print(f"what won: {warm.report.winner}")

axes = plt.figure(figsize=(6.4, 3.2)).add_subplot(aspect="equal")
axes.add_patch(plt.Circle((5, -0.4), 1.5, color="0.75"))
axes.plot(*alone.value(x)[:2], "o--", markersize=3, label="IPOPT from its own start")
axes.plot(*solution.value(x)[:2], "o-", markersize=3, label="with a searched start")
axes.set(xlabel="x [m]", ylabel="y [m]", ylim=(-2.5, 2.5))
axes.legend(loc="upper left")
plt.show()
