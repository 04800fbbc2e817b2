"""Search a better start for a problem that is written in CasADi's Opti.

Shows: `warm_start`, one added line. IPOPT passes the disc below, since the first guess
does; the searched start leads above it, at a lower cost.

Prints:
    IPOPT from its own start: cost 3.702
    with a searched start: cost 2.800
    what won: searched start
"""

import casadi as ca

import swarmstart as ss

INTERVALS, STEP = 40, 0.2  # s


def past_a_disc() -> tuple[ca.Opti, ca.MX, ca.MX]:
    """Return the problem with its states (4, N + 1) and controls (2, N)."""
    opti = ca.Opti()
    x, u = opti.variable(4, INTERVALS + 1), opti.variable(2, INTERVALS)
    for k in range(INTERVALS):
        place, speed = x[:2, k], x[2:, k]
        moved = place + STEP * speed + STEP**2 / 2 * u[:, k]
        opti.subject_to(x[:, k + 1] == ca.vertcat(moved, speed + STEP * u[:, k]))
    for k in range(1, INTERVALS):
        from_centre = x[:2, k] - ca.DM([5.0, -0.4])
        opti.subject_to(ca.sumsqr(from_centre) >= 1.5**2)
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[:, -1] == ca.DM([10, 0, 0, 0]))
    opti.subject_to(opti.bounded(-2, ca.vec(u), 2))
    opti.minimize(STEP * ca.sumsqr(u))
    opti.set_initial(x[1, :], -1.5)  # below the disc
    opti.set_initial(x[0, :], ca.linspace(0, 10, INTERVALS + 1).T)
    opti.solver("ipopt", {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0})
    return opti, x, u


def main() -> None:
    """Solve it with and without the added line."""
    opti, x, u = past_a_disc()
    alone = opti.solve()
    print(f"IPOPT from its own start: cost {alone.value(opti.f):.3f}")

    warm = ss.warm_start(opti, controls=[u], states=[x])  # the added line
    solution = warm.solve()  # in place of opti.solve()
    print(f"with a searched start: cost {solution.value(opti.f):.3f}")
    if warm.report is not None:
        print(f"what won: {warm.report.winner}")


if __name__ == "__main__":
    main()
