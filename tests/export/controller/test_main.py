"""The test main of an exported controller notices changes of the C code."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import swarmstart as ss
from swarmstart.export import CExport
from swarmstart.tests.export.controller.controllers import integrator, loop_of

pytestmark = pytest.mark.usefixtures("c_compiler")
Made = Callable[[str], CExport]
CHANGES = (
    ("value > most ? most", "value > most ? least"),
    ("value >= least ? value", "value >= least ? value / 2"),
    ("if (!(values[i] - values[i] == 0))", "if (0)"),
    ("found.cost += cost;\n  found.size", "found.cost -= cost;\n  found.size"),
    ("m->lane.fixed[i] = x[i] / size_x[i];", "m->lane.fixed[i] = 0;"),
    ("m->lane.rho[0] = FIRST_RHO;\n  m->lane.spent", "m->lane.spent"),
    ("follow_law(m, here);", ""),
    ("best = rolled(m, here, m->plan, m->path);\n  /*", "best.cost = 0;\n  /*"),
    ("turn < TURNS", "turn < 3"),
    ("met = m->lane.met[0] > 0;", "met = 0;"),
    ("m->lane.u[k * INPUTS + i] * size_u[i]", "m->lane.u[k * INPUTS + i]"),
    ("memcpy(m->plan, m->found, sizeof m->plan);", ""),
    ("memmove(m->plan, m->plan + NU", "memmove(m->plan, m->plan"),
    ("warm & BETTER", "warm & 0"),
    ("status = NAME_PLANNED;", "status = NAME_SHIFTED;"),
    ("u -= gain", "u += gain"),
    ("return value <= set_level[0];", "return 0;"),
    ("return value <= set_level[0];", "return value <= 9 * set_level[0];"),
    ("m->is_begun = 1;\n  m->cost", "m->cost"),
    ("f_before(m->y + j * NX", "f_before(m->y"),
    ("if (m->is_begun) {\n    shift(m);", "if (0) {\n    shift(m);"),
)
"""Old and new words of the C code."""


def flown(folder: Path, files: dict[str, str], command: str) -> int:
    """Return the exit code of the test main."""
    for name, text in files.items():
        (folder / name).write_text(text)
    sources = [name for name in files if name.endswith(".c")]
    flags = ("-std=c99", "-O1", "-ffp-contract=off")
    done = subprocess.run(
        [command, *flags, *sources, "-o", "flown", "-lm"], cwd=folder, check=False,
        capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr.decode()[:1000]
    run = subprocess.run(
        [folder / "flown"], capture_output=True, check=False, timeout=300
    )
    return run.returncode


@pytest.mark.parametrize("number", range(len(CHANGES)))
def test_a_change_of_the_code_is_noticed(
    made: Made, number: int, tmp_path: Path, c_compiler: str
) -> None:
    """By the double integrator with a law, the pendulum or the way round a disc."""
    (old, new), codes = CHANGES[number], []
    for name in ("dual_mode", "pendulum", "way_round"):
        files = dict(made(name).files)
        before = files[f"{name}.c"]
        changed = before.replace(old.replace("NAME", name), new.replace("NAME", name))
        if changed == before:
            continue
        files[f"{name}.c"] = changed
        codes.append(flown(tmp_path, files, c_compiler))
        if codes[-1]:
            break
    assert codes
    assert codes[-1] == 1


def test_a_control_without_freedom_is_no_difference(
    tmp_path: Path, c_compiler: str
) -> None:
    """Equal bounds have no range to divide by."""
    problem = integrator()
    fixed = replace(problem, bounds=ss.Bounds(controls=(0.5, 0.5)))
    made = ss.export_c(loop_of(fixed), [1.0, 0.0], name="fixed", starts=0, main=True)
    assert flown(tmp_path, dict(made.files), c_compiler) == 0
