"""Compiled controllers decide as the library's lanes do, with the same bits always."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.export import CExport
from swarmstart.export.controller.exported import FLAGS, NoCCompilerError
from swarmstart.export.controller.numbers import Status
from swarmstart.export.controller.twin import Twin
from swarmstart.export.paths import ExportError
from swarmstart.tests.export.controller.controllers import CASES, pendulum

pytestmark = pytest.mark.usefixtures("c_compiler")
Made = Callable[[str], CExport]
STEPS = 12


def flight(made: CExport, steps: int, *flags: str) -> np.ndarray:
    """Return the controls of a flight with the controller's own model."""
    compiled, x = made.controller(*flags), made.posed.x0[: made.posed.stated]
    twin, found = Twin(made.posed, iterations=made.iterations), []
    for _ in range(steps):
        found.append(compiled.step(x))
        x = twin.model(x, found[-1])
    return np.array(found)


@pytest.mark.parametrize("name", CASES)
def test_each_step_is_that_of_the_lanes(made: Made, name: str) -> None:
    """Controls to 1e-7 of what machine code finds, and the same decisions.

    The two are in the same memory at each step; the tolerance is that of a local solve.
    """
    export = made(name)
    compiled = export.controller()
    twin, x = Twin(export.posed, iterations=export.iterations), export.posed.x0
    x = x[: export.posed.stated]
    for _ in range(STEPS):
        mine, (theirs, status) = compiled.step(x), twin.step(x)
        np.testing.assert_allclose(mine, theirs, atol=1e-7)
        assert compiled.status is status
        x = twin.model(x, theirs)


def test_flags_do_not_change_a_bit(made: Made) -> None:
    """For the pendulum, at all optimisations and with the processor's own fma."""
    plain = flight(made("pendulum"), STEPS, *FLAGS)
    for more in (("-O0",), ("-O3",), ("-O2", "-march=native")):
        assert np.array_equal(plain, flight(made("pendulum"), STEPS, *FLAGS, *more))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_compilers_do_not_warn(
    made: Made, name: str, compiler: str, tmp_path: Path
) -> None:
    """With all warnings of conversions, of the source and of the test main."""
    export = made(name)
    for file, text in export.files.items():
        (tmp_path / file).write_text(text)
    command = [
        compiler, "-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Wconversion",
        "-Werror", f"{name}.c", f"{name}_main.c", "-o", "flown", "-lm",
    ]  # fmt: skip
    try:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip(f"no {compiler} here")
    assert done.returncode == 0, done.stderr.decode()[:2000]
    flown = subprocess.run([tmp_path / "flown"], capture_output=True, check=False)
    assert flown.returncode == 0, flown.stderr.decode()
    rows = flown.stdout.decode().splitlines()
    assert len(rows) == 1 + round(10.0 / export.posed.problem.dt)


@pytest.mark.parametrize("name", CASES)
def test_any_state_gives_a_control_within_its_bounds(made: Made, name: str) -> None:
    """NaN, infinities, huge and random states; work stays below the printed bound."""
    export, rng = made(name), np.random.default_rng(0)
    compiled, nx = export.controller(), export.posed.stated
    lower, upper = export.posed.problem.control_limits
    wild = [np.full(nx, v) for v in (np.nan, np.inf, -np.inf, 1e308, 1e30, 1e-320)]
    wild += [rng.normal(size=nx) * 10.0 ** rng.uniform(-3, 12) for _ in range(10)]
    for x in wild:
        u = compiled.step(x)
        assert np.isfinite(u).all()
        assert (u >= lower).all()
        assert (u <= upper).all()
        assert (compiled.status is Status.INVALID) == (not np.isfinite(x).all())
        assert 0 <= compiled.operations <= export.most_operations


def test_controls_are_remembered_without_a_state(made: Made) -> None:
    """A step without a number applies the plan, whose control the next one follows.

    A controller that is given the same state and the right control before finds the
    same plan.
    """
    export = made("tracking")
    compiled, x = export.controller(), np.array([0.5])
    compiled.step(x)
    control = compiled.step(np.array([np.nan]))
    assert compiled.status is Status.INVALID
    twin = Twin(export.posed, iterations=export.iterations)
    twin.step(x)
    twin._shift(export.posed.known)
    twin._remembered = control
    np.testing.assert_allclose(compiled.step(x), twin.step(x)[0], atol=1e-7)


def test_a_first_state_that_is_no_number_begins_nothing(made: Made) -> None:
    """The step after it is a first one."""
    compiled = made("dual_mode").controller()
    x = np.array([2.0, 0.0])
    first = compiled.step(x)
    again = made("dual_mode").controller()
    again.step(np.array([np.nan, 0.0]))
    assert np.array_equal(first, again.step(x))


def test_the_bound_covers_turns_that_do_everything(made: Made) -> None:
    """All kernels of a step and of a trial, and both derivatives, in each turn.

    Counted here by the numbers in the C text; how many operations a flight takes is
    below that, since few turns do both.
    """
    export = made("pendulum")
    known = dict(re.findall(r"#define (\w+) (\d+)", export.files["pendulum.c"]))
    count = {name: int(value) for name, value in known.items()}
    kernels = "last backward start along aim move trial verdict keep".split()
    followed = count["N"] * count["ALL_STEPS"] * count["OPERATIONS_f_step"]
    pulled = count["N"] * count["ALL_STEPS"] * count["OPERATIONS_f_adjoint"]
    turn = sum(count[f"OPERATIONS_k_{name}"] for name in kernels)
    turn += count["OPERATIONS_DERIVE"] + 2 * followed + pulled
    solves = 1 + count["STARTS"]
    assert 1.0 < export.most_operations / (solves * count["TURNS"] * turn) < 1.1


def test_the_operations_count_the_work(made: Made) -> None:
    """A step of the law costs two roll-outs; one with starts far more."""
    compiled = made("dual_mode").controller()
    compiled.step(np.array([2.0, 0.0]))
    searched = compiled.operations
    compiled.step(np.array([0.1, 0.0]))
    assert compiled.status is Status.LINEAR
    assert 100 < compiled.operations < searched / 100


def test_a_search_leaves_an_optimum_that_became_dear() -> None:
    """The README's pendulum with friction: 71.7 without seeded starts, 16.4 with them.

    These are the costs of the plan at step 17, at which the weak motor cannot hold the
    pendulum any more; 16.4 is what IPOPT finds after a population search, too.
    """
    costs = []
    for starts in (0, 16):
        controller, x0 = pendulum("lshade")
        export = ss.export_c(controller, x0, name="swing", starts=starts)
        compiled, x = export.controller(), np.array(x0)
        plant = _with_friction()
        for _ in range(18):
            x = plant(x, compiled.step(x))
        costs.append(compiled.cost)
    assert costs == pytest.approx([71.68, 16.40], abs=0.02)


def _with_friction() -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    def rate(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array([x[1], u[0] - 9.81 * np.sin(x[0]) - 0.2 * x[1]])

    def step(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        h = 0.1 / 10
        for _ in range(10):
            a = rate(x, u)
            b = rate(x + h / 2 * a, u)
            c = rate(x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, u))
        return x

    return step


def test_it_flies_in_a_closed_loop(made: Made) -> None:
    """`simulate` takes it as a controller; a second run begins anew."""
    export = made("dual_mode")
    controller = export.controller()
    plant = ss.Plant(export.posed.problem.model, dt=controller.dt, substeps=2)
    runs = [
        ss.simulate(plant, controller, [2.0, 0.0], steps=30, seed=0) for _ in range(2)
    ]
    assert abs(runs[0].states[:, -1]).max() < 2e-2
    assert np.array_equal(runs[0].states, runs[1].states)
    assert runs[0].decisions[-1].mode.value == "linear"


def test_a_missing_compiler_is_named(made: Made) -> None:
    """So is one that fails."""
    with pytest.raises(NoCCompilerError, match="no C compiler: expected the command"):
        made("dual_mode").controller(compiler="no-such-compiler")
    with pytest.raises(ExportError, match="the C compiler failed with code 1"):
        made("dual_mode").controller("-no-such-flag")
