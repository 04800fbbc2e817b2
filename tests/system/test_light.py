"""Commands that need no heavy library do not import one."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.format.registry import KINDS, POLISHES, SEARCHES
from swarmstart.cases.format.scenario import shipped
from swarmstart.cases.kinds.formation_flight.names import MEASURES

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

HEAVY = {
    *("numpy", "casadi", "scipy", "pydantic", "matplotlib", "control", "numba"),
    "rich",
}

PROBE = """
import sys
from swarmstart.cases.commands.front.cli import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        *(["--help"], ["run", "--help"], ["--version"], ["list"], ["list", "--json"]),
        *(["list", "scenarios"], ["list", "measures", "pendulum"], ["rnu"]),
    ],
    ids=" ".join,
)
def test_what_only_talks_imports_nothing_heavy(arguments: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    modules = set(done.stderr.split())
    assert done.stdout or arguments == ["rnu"]
    assert "swarmstart" in modules
    assert not modules & HEAVY


def test_the_package_itself_imports_nothing_heavy() -> None:
    code = "import sys, swarmstart; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not {name.partition(".")[0] for name in done.stdout.split()} & HEAVY


def test_python_m_swarmstart_is_the_command_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "swarmstart", "--version"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.match(r"swarmstart \d+\.\d+.* \(Python 3.*casadi .*numba ", done.stdout)


def test_list_names_what_a_scenario_and_the_options_can_name(command: Command) -> None:
    said = command("list", "--json")
    assert (said.code, said.err) == (0, "")
    listed = json.loads(said.out)
    assert listed["schema"] == 2
    assert listed["scenarios"].keys() == shipped().keys()
    assert {"formation_v", "formation_obstacle"} <= listed["scenarios"].keys()
    assert all(one["title"] for one in listed["scenarios"].values())
    assert listed["searches"].keys() == SEARCHES.keys()
    assert listed["polishes"].keys() == POLISHES.keys()
    assert listed["kinds"].keys() == KINDS.keys()
    assert listed["measures"]["formation_flight"].keys() == MEASURES.keys()


@pytest.mark.parametrize(
    ("topic", "names"),
    [
        ("scenarios", [*shipped()]),
        ("searches", [*SEARCHES]),
        ("polishes", [*POLISHES]),
        ("measures", [*MEASURES]),
        ("kinds", [*KINDS]),
    ],
)
def test_list_shows_a_person_each_name_of_a_topic(
    topic: str, names: list[str], command: Command
) -> None:
    said = command("list", topic)
    assert (said.code, said.err) == (0, "")
    for name in names:
        assert re.search(rf"^  {name} ", said.out, re.MULTILINE)


def test_list_shows_what_contains_a_text(command: Command) -> None:
    said = command("list", "L-shade")
    assert (said.code, said.err) == (0, "")
    assert "  lshade " in said.out
    assert "scenarios" not in said.out and "measures" not in said.out
    headed = command("list", "measures of transfer").out.splitlines()
    assert headed[0] == "measures of transfer" and len(headed) > 10
    listed = json.loads(command("list", "swap_5", "--json").out)
    assert [*listed["scenarios"]] == ["swap_5"] and not listed["searches"]
    nothing = command("list", "zeppelin")
    assert (nothing.code, nothing.out) == (2, "")
    assert nothing.err == (
        "swarmstart: expected a text that the list contains, found 'zeppelin'; see "
        "swarmstart list\n"
    )


@pytest.mark.parametrize("name", ["run", "compare", "replicate", "list", "check"])
def test_a_wrong_option_prints_the_usage_of_its_command(
    name: str, command: Command
) -> None:
    said = command(name, "passing_side", "--bogus")
    assert (said.code, said.out) == (2, "")
    assert f"\nusage: swarmstart {name} " in said.err
    assert f"swarmstart {name}: error: unrecognized arguments: " in said.err


def test_a_command_is_required_and_help_shows_the_exit_codes(command: Command) -> None:
    nothing = command()
    assert (nothing.code, nothing.out) == (2, "") and "COMMAND" in nothing.err
    assert "4  no feasible or no confirmed solution" in command("--help").out


def test_the_schema_of_an_unknown_kind_is_refused(command: Command) -> None:
    said = command("schema", "formation")
    assert (said.code, said.out) == (2, "")
    assert (
        "argument KIND: unknown 'formation'; did you mean 'close_formation'? expected "
        f"one of {', '.join(KINDS)}, best_known\n"
    ) in said.err


def modules_of(arguments: list[str]) -> set[str]:
    """Return the top-level modules that a command has imported."""
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stderr.split("\n")[-2].split())


STATE_A_PROBLEM = """
import sys
import casadi as ca
import swarmstart as ss
x, u = ca.SX.sym("x"), ca.SX.sym("u")
ss.OptimalControlProblem(
    ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
    stage_cost=u**2, bounds=ss.Bounds(controls=(-1, 1)))
ss.solve, ss.minimize, ss.simulate, ss.Planner, ss.RecedingHorizon, ss.Plant
ss.LSHADE(), ss.Budget(evaluations=9), ss.IpoptOptions(), ss.DualMode
print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
"""


def test_the_names_of_a_problem_import_no_compiler_and_no_scipy() -> None:
    done = subprocess.run(
        [sys.executable, "-c", STATE_A_PROBLEM],
        capture_output=True,
        text=True,
        check=True,
    )
    modules = set(done.stderr.split())
    assert {"casadi", "numpy", "swarmstart"} <= modules
    assert not modules & (HEAVY - {"casadi", "numpy"})


def test_runs_without_committed_plans_import_none_of_their_kernels() -> None:
    code = (
        "import sys, swarmstart.cases.campaign.running.run, "
        "swarmstart.cases.kinds.problem.kind; print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    swarm = {n for n in done.stdout.split() if n.startswith("swarmstart.ocp.swarm")}
    assert swarm == {"swarmstart.ocp.swarm", "swarmstart.ocp.swarm.swarm"}


def test_a_run_that_designs_nothing_imports_no_drawing_and_no_control(
    tmp_path: Path,
) -> None:
    out = ["--no-figures", "--out", str(tmp_path / "out")]
    for arguments in (
        ["run", "double_integrator", *out],
        ["run", "formation_v", "--variant", "literal", "--set", "steps=1", *out],
        ["check", "formation_obstacle_uav3", "pendulum"],
    ):
        modules = modules_of(arguments)
        assert "casadi" in modules
        assert not modules & {"matplotlib", "control", "pebble"}
        # pint, which reads units for `check`, imports SciPy's top and, if there, Dask.
        unused = {"jinja2"} if arguments[0] == "run" else {"numba"}
        assert not modules & unused


def test_python_control_designs_the_linear_law_of_a_flight_once(
    tmp_path: Path, fresh_cache: Path
) -> None:
    flight = "run formation_v --no-figures --set steps=1 --out".split()
    assert "control" in modules_of([*flight, str(tmp_path / "first")])
    assert any(fresh_cache.iterdir())
    assert "control" not in modules_of([*flight, str(tmp_path / "second")])
    checked = modules_of(["check", "formation_v"])
    assert "casadi" in checked and not checked & {"control", "numba", "scipy"}
