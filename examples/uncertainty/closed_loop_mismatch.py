"""Control a pendulum with friction by plans that know of none.

Shows: `Planner`, `Plant`, `OpenLoop`, `RecedingHorizon` and `simulate`.

Prints:
    one plan for 2 s: height 0.5
    60 plans, one every 0.1 s: height 1.000
"""

import casadi as ca

import swarmstart as ss


def pendulum(friction: float) -> ss.Model:
    """Return a pendulum of 1 kg and 1 m that a torque turns.

    Args:
        friction: Torque that slows it down, per speed [N m s].
    """
    angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
    return ss.Model(
        states=ca.vertcat(angle, speed),
        controls=torque,
        ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle) - friction * speed),
    )


def swing_up(model: ss.Model) -> ss.OptimalControlProblem:
    """Return the problem to get the pendulum up soon and keep it there."""
    angle, speed = ca.vertsplit(model.states)
    low = 1 + ca.cos(angle)  # 0 upright, 2 below
    return ss.OptimalControlProblem(
        model,
        horizon=2.0,
        intervals=20,
        stage_cost=10 * low + 0.1 * speed**2 + 0.05 * model.controls**2,
        terminal_cost=100 * low + 10 * speed**2,
        bounds=ss.Bounds(controls=(-5.0, 5.0)),
    )


def main() -> None:
    """Simulate one plan, and then a new plan at every step."""
    problem = swing_up(pendulum(friction=0.0))
    planner = ss.Planner(problem, search="lshade", polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    plant = ss.Plant(pendulum(friction=0.2), dt=problem.dt, substeps=10)
    blind = ss.simulate(plant, ss.OpenLoop(loop=loop), [0, 0], steps=20, seed=0)
    run = ss.simulate(plant, loop, [0, 0], steps=60, seed=0)
    print(f"one plan for 2 s: height {-ca.cos(blind.states[0, -1]):.1f}")
    print(f"60 plans, one every 0.1 s: height {-ca.cos(run.states[0, -1]):.3f}")


if __name__ == "__main__":
    main()
