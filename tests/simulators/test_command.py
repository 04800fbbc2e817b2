"""A program is a plant; its failures cost one sentence, and leave no process."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array

PROGRAM = r"""
import json, os, sys, time
keeps, level = "keeps" in sys.argv[1], 0.0
for line in sys.stdin:
    asked = json.loads(line)
    if "swarmstart" in asked:
        found = {"states": ["level"], "controls": ["inflow"], "keeps_state": keeps}
    elif "start_at" in asked:
        found = {"x": asked["start_at"]}
    else:
        (x,), (u,), dt = asked["x"], asked["u"], asked["dt"]
        found = {"x": [x + dt * (u - 0.5 * x)]}
        if u == 1.5:
            found = {"error": "the tank is empty"}
        once = not os.path.exists(sys.argv[2])
        if u in (2, 3, 4) and (once or "always" in sys.argv[1]):
            open(sys.argv[2], "w").close()
            print("at my end", file=sys.stderr, flush=True)
            if u == 2:
                os._exit(3)
            if u == 3:
                time.sleep(600)
            found = "x" * (1 << 21)
    print(json.dumps(found), flush=True)
"""


def plant(tmp_path: Path, word: str = "", limit_s: float = 60.0) -> ss.CommandPlant:
    return ss.CommandPlant(
        [sys.executable, "-c", PROGRAM, word, str(tmp_path / "once")], limit_s=limit_s
    )


def test_a_closed_loop_is_that_of_the_same_equation(tmp_path: Path) -> None:
    """One Euler step an interval, with the same bits."""
    x, u = ca.SX.sym("level"), ca.SX.sym("inflow")
    model = ss.Model(states=x, controls=u, ode=u - 0.5 * x)
    problem = ss.OptimalControlProblem(
        model, horizon=1.0, intervals=5, stage_cost=(x - 1) ** 2 + 0.1 * u**2,
        bounds=ss.Bounds(controls=(0, 1)),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)

    class Tank:
        def step(self, x: Array, u: Array, dt: float) -> Array:
            return x + dt * (u - 0.5 * x)

    with plant(tmp_path) as ours:
        first, other = (
            ss.simulate(one, loop, [0.2], steps=8, seed=0) for one in (Tank(), ours)
        )
    assert np.array_equal(first.states, other.states)
    assert other.state_names == ("level",)
    assert other.control_names == ("inflow",)


@pytest.mark.parametrize("u", [2.0, 3.0, 4.0], ids=["ends", "hangs", "shouts"])
def test_one_that_is_lost_is_started_again_once(tmp_path: Path, u: float) -> None:
    """It got the state with the step, so nothing is lost."""
    with plant(tmp_path, limit_s=3.0) as one:
        assert one.step([1.0], [u], 0.1).tolist() == [1.0 + 0.1 * (u - 0.5)]
        assert one.restarts == 1


@pytest.mark.parametrize(
    ("u", "message"),
    [(2.0, "has ended"), (3.0, "within 3 s"), (4.0, "longer than")],
    ids=["ends", "hangs", "shouts"],
)
def test_one_that_is_lost_twice_ends_the_run(
    tmp_path: Path, u: float, message: str
) -> None:
    """With what it wrote last."""
    with (
        plant(tmp_path, "always", limit_s=3.0) as one,
        pytest.raises(ss.SimulatorError, match=f"{message}.*it wrote: 'at my end'"),
    ):
        one.step([1.0], [u], 0.1)


def test_one_that_keeps_a_state_is_not_started_again(tmp_path: Path) -> None:
    """A new process would be in another state; and it accepts its own state only."""
    with plant(tmp_path, "keeps") as one:
        with pytest.raises(ss.SimulatorError, match="start_at"):
            one.step([1.0], [0.0], 0.1)
        x = one.start_at([1.0])
        x = one.step(x, [0.0], 0.1)
        with pytest.raises(ss.SimulatorError, match="returned last"):
            one.step([1.0], [0.0], 0.1)
        with pytest.raises(ss.SimulatorError, match="has ended"):
            one.step(x, [2.0], 0.1)
        assert one.restarts == 0
        x = one.start_at([1.0])  # A new run starts it again.
        assert one.step(x, [0.0], 0.1).tolist() == [0.95]


def test_what_it_says_of_an_error_is_in_the_message(tmp_path: Path) -> None:
    """And the next step goes on."""
    with plant(tmp_path) as one:
        with pytest.raises(ss.SimulatorError, match="it said: 'the tank is empty'"):
            one.step([1.0], [1.5], 0.1)
        assert one.step([1.0], [0.0], 0.1).tolist() == [0.95]


def test_what_follows_a_wrong_answer_belongs_to_no_question() -> None:
    """A program that is out of step is started again."""
    text = (
        'print(input() and \'{"states": ["a"], "controls": ["u"]}\', flush=True)\n'
        "asked = input()\n"
        "if '1.5' in asked: print('oh')\n"
        "print('{\"x\": [7.0]}' if '1.5' in asked else '{\"x\": [8.0]}', flush=True)\n"
        "input()\n"
    )
    with ss.CommandPlant([sys.executable, "-c", text]) as one:
        with pytest.raises(ss.SimulatorError, match="found 'oh'"):
            one.step([1.0], [1.5], 0.1)
        assert one.step([1.0], [0.0], 0.1).tolist() == [8.0]


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        (["text"], "expected a JSON object on one line, found 'text'"),
        (["[1]"], "expected a JSON object on one line"),
        (["{}"], 'expected "states" and a list of different names'),
        (['{"states": ["a", "a"], "controls": ["u"]}'], "different names"),
        (['{"states": ["a"], "controls": []}'], '"controls"'),
        (['{"states": ["a"], "controls": ["u"]}', "{}"], '"x" and a list of numbers'),
        (['{"states": ["a"], "controls": ["u"]}', '{"x": ["b"]}'], "list of numbers"),
        (['{"states": ["a"], "controls": ["u"]}', '{"x": ["1.5"]}'], "list of numbers"),
        (
            ['{"states": ["a"], "controls": ["u"]}', '{"x": [1%s]}' % ("0" * 400)],
            "list of numbers",
        ),
        (
            ['{"states": ["a"], "controls": ["u"], "keeps_state": "no"}'],
            'true or false as "keeps_state"',
        ),
        (['{"states": ["a"], "controls": ["u"]}', '{"x": [1, 2]}'], '1 numbers as "x"'),
    ],
)
def test_answers_of_another_form_are_shown(answers: list[str], message: str) -> None:
    """With the form that was expected."""
    text = f"import sys\nfor a in {answers!r}:\n input(); print(a, flush=True)\n"
    with pytest.raises(ss.SimulatorError) as caught:
        ss.CommandPlant([sys.executable, "-c", text]).step([0.0], [0.0], 0.1)
    assert message in str(caught.value)


def test_a_start_elsewhere_is_refused() -> None:
    """The answer of a program has the state at which it begins."""
    text = (
        'input(); print(\'{"states": ["a"], "controls": ["u"]}\', flush=True)\n'
        "input(); print('{\"x\": [2.0]}', flush=True)\n"
    )
    with pytest.raises(ss.SimulatorError, match=r"found a = 2 for 1$"):
        ss.CommandPlant([sys.executable, "-c", text]).start_at([1.0])


def test_a_state_of_nan_ends_a_flight() -> None:
    """JSON of Python and of others writes NaN as a word."""
    text = (
        'input(); print(\'{"states": ["a"], "controls": ["u"]}\', flush=True)\n'
        "input(); print('{\"x\": [NaN]}', flush=True)\n"
    )
    with ss.CommandPlant([sys.executable, "-c", text]) as one:
        assert np.isnan(one.step([1.0], [0.0], 0.1)).all()


def test_no_program() -> None:
    """One that is missing, none at all, one that ends at once."""
    with pytest.raises(ss.SimulatorError, match="expected a program to start"):
        ss.CommandPlant(["/no/such/program"])
    with pytest.raises(ss.SimulatorError, match="found no word"):
        ss.CommandPlant([])
    with pytest.raises(ss.SimulatorError, match="has ended"):
        ss.CommandPlant([sys.executable, "-c", "pass"])
    with pytest.raises(ss.InvalidProblemError, match="command"):
        ss.CommandPlant("python")


def test_lists_within_lists_without_end() -> None:
    """Their depth is that of Python's own reader."""
    with pytest.raises(ss.SimulatorError, match="expected a JSON object on one line"):
        ss.CommandPlant([sys.executable, "-c", "input(); print('[' * 200_000)"])


def test_one_that_does_not_read_is_late() -> None:
    """A question that fills the pipe has the same time limit."""
    names = "[str(i) for i in range(20_000)]"
    text = (
        "import json, time\n"
        f"found = dict(states={names}, controls=['u'])\n"
        "input(); print(json.dumps(found), flush=True)\n"
        "time.sleep(600)\n"
    )
    with ss.CommandPlant([sys.executable, "-c", text], limit_s=5.0) as one:
        with pytest.raises(ss.SimulatorError, match="within 5 s"):
            one.step(np.zeros(20_000), [0.0], 0.1)


def test_nothing_is_written_to_files_that_took_the_place_of_its_pipes(
    tmp_path: Path,
) -> None:
    """The system gives their numbers to whatever is opened next."""
    with plant(tmp_path, "keeps") as one:
        with pytest.raises(ss.SimulatorError, match="has ended"):
            one.step(one.start_at([1.0]), [2.0], 0.1)
        files = [(tmp_path / str(number)).open("w+b") for number in range(9)]
        one.start_at([1.0])
        sizes = [os.fstat(file.fileno()).st_size for file in files]
        for file in files:
            file.close()
    assert not any(sizes)


def test_a_closed_one_is_not_started_again(tmp_path: Path) -> None:
    """Its user has ended it."""
    one = plant(tmp_path)
    one.close()
    with pytest.raises(ss.SimulatorError, match="found it closed"):
        one.start_at([1.0])
    with pytest.raises(ss.SimulatorError, match="found it closed"):
        one.step([1.0], [0.0], 0.1)


def test_no_process_is_left(tmp_path: Path) -> None:
    """Also children of the program, and after Ctrl-C during a step that hangs."""
    child = tmp_path / "child"
    text = (
        "import json, subprocess, sys, time\n"
        "sleep = [sys.executable, '-c', 'import time; time.sleep(600)']\n"
        "one = subprocess.Popen(sleep)\n"
        f"open({str(child)!r}, 'w').write(str(one.pid))\n"
        'input(); print(\'{"states": ["a"], "controls": ["u"]}\', flush=True)\n'
        "time.sleep(600)\n"
    )
    script = (
        "import sys, swarmstart as ss\n"
        f"one = ss.CommandPlant([sys.executable, '-c', {text!r}], limit_s=600.0)\n"
        "print('ready', flush=True)\n"
        "one.step([0.0], [0.0], 0.1)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    process.send_signal(signal.SIGINT)
    process.wait(timeout=60)
    process.stdout.close()
    assert process.returncode != 0
    end = time.monotonic() + 60
    while _runs(int(child.read_text())) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _runs(int(child.read_text()))


def _runs(pid: int) -> bool:
    """Return whether a process runs: exists, and is not only waited for."""
    try:
        os.kill(pid, 0)
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
