"""A plan on disk is read unchanged, or refused with the reason."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.record.results import recorded_plan
from swarmstart.ocp import Bounds, Model, OptimalControlProblem, solve


def test_a_saved_solution_is_a_guess_as_it_is(tmp_path: Path) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=2.0,
        intervals=5,
        checks=3,
        stage_cost=(x - 1) ** 2 + u**2,
        bounds=Bounds(controls=(-1.0, 1.0)),
    )
    solution = solve(problem, [0.0], search=None, seed=0)
    times, rows = recorded_plan(str(solution.save(tmp_path / "saved")))
    np.testing.assert_allclose(times, 0.4 * np.arange(5), rtol=1e-15)
    np.testing.assert_array_equal(rows, solution.controls)


@pytest.mark.parametrize(
    "arrays",
    [
        {},
        {"times": np.zeros(3), "controls": np.zeros((1, 2))},
        {"times": np.arange(3.0), "controls": np.full((1, 2), np.nan)},
        {"times": np.arange(3.0), "controls": np.zeros(2)},
        {"times": np.arange(3.0), "controls": np.zeros((1, 0))},
        {"times": np.array(["a", "b"]), "controls": np.zeros((1, 2))},
        {"times": np.arange(3.0), "controls": np.array([[{}, {}]], dtype=object)},
    ],
)
def test_what_is_no_plan_is_refused(tmp_path: Path, arrays: dict[str, object]) -> None:
    np.savez(tmp_path / "solution.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"expected (guess\.record|a plan)"):
        recorded_plan(str(tmp_path))


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04" + bytes(40)])
def test_a_file_that_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "trajectory.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"guess\.record"):
        recorded_plan(str(tmp_path))
