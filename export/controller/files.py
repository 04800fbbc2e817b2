"""The files of a controller in C."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from importlib.resources import files
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    a_count,
    checked,
    choice,
    of_kind,
    reals,
    text,
)
from swarmstart.export.controller.c_writer import c_number, c_table
from swarmstart.export.controller.exported import FLAGS, CExport
from swarmstart.export.controller.numbers import Status
from swarmstart.export.controller.posed import PosedController, posed_controller
from swarmstart.export.controller.source import controller_text
from swarmstart.export.controller.twin import Twin
from swarmstart.export.paths import ExportError
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS
from swarmstart.ocp.loop.controller import SEEN, RecedingHorizon
from swarmstart.ocp.loop.dual_mode import DualMode
from swarmstart.ocp.rollout.fitness import flatten
from swarmstart.tape import UnknownOperationError
from swarmstart.terminal_set import certificate_text

MOST_STARTS, MOST_ITERATIONS = 256, 1000
LONGEST_NAME, LONGEST_SOURCE = 40, 8_000_000
"""Largest number of characters of a name, and of the source."""
FLOWN = 10.0
"""Time that the test program simulates [s]."""
MOST_STEPS = 2000
_LEAST_RANGE = 1e-9
"""Least range of a control that a difference is divided by."""
_SAYING = 1e-3
"""Part of the noise of a cost above which a status does not depend on rounding."""
APART = {"double": 1e-6, "single": 5e-3}
"""Largest difference of a control in the test program, relative to its range."""
EXACTNESS = {"double": (1e-8, 2e-15), "single": (1e-6, 1e-6)}
"""Largest scaled error at which a local solve ends, and rounding error of its cost."""
_WORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for "
    "goto if inline int long register restrict return short signed sizeof static "
    "struct switch typedef union unsigned void volatile while main real memory".split()
)


@checked(
    refused,
    controller=of_kind((RecedingHorizon, DualMode), "a RecedingHorizon or a DualMode"),
    x0=reals(),
    name=text(),
    starts=a_count(most=MOST_STARTS),
    iterations=a_count(least=1, most=MOST_ITERATIONS),
    precision=choice(("double", "single")),
    main=FLAG,
    seen=SEEN,
    seed=a_count(),
)
def export_c(  # noqa: PLR0913 - what a file is made of, by name
    controller: RecedingHorizon | DualMode,
    x0: ArrayLike,
    *,
    name: str,
    starts: int = 16,
    iterations: int = 100,
    precision: Literal["double", "single"] = "double",
    main: bool = False,
    seen: Sequence[ArrayLike] = (),
    seed: int = 0,
) -> CExport:
    """Write a receding-horizon controller as one C99 file, without heap and recursion.

    A step solves the problem by the local solver of the lanes
    (docs/controller_in_c.md) from the shifted last plan. If the answer is no feasible
    local optimum, or the cost jumps, the step solves from `starts` seeded starts, too,
    and keeps the best plan. Inside the set of a `DualMode` it applies the linear law.

    Args:
        controller: The controller of one vehicle. Its search makes the first plan, and
            is replaced by the seeded starts afterwards.
        x0: Initial state, shape (nx,), SI units. The first plan begins there, and the
            sizes by which all numbers are divided are computed there.
        name: Name of the files and prefix of all public names in C.
        starts: Number of seeded starts; if 0, the header says that there are none.
        iterations: Largest number of steps of a local solve.
        precision: Precision of all numbers in C.
        main: Whether to write a program that simulates 10 s, prints CSV and compares
            its controls with those of the library.
        seen: Signals of the first plan that come after those of the reference, such as
            plans of other vehicles: rows, each of shape (k, nodes).
        seed: Seed of the starts and of the first plan.

    Returns:
        The text of NAME.c, NAME.h and CMakeLists.txt; if `main` is True, of
        NAME_main.c; and if there is a proven terminal set, of NAME.certificate.json.

    Raises:
        ExportError: If the controller cannot be written as C, or the name is not one
            for C; the message says what would make it possible.
        InvalidProblemError: If an argument is invalid.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=x + u), horizon=2.0, intervals=4,
        ...     stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> loop = ss.RecedingHorizon(planner=planner)
        >>> sorted(ss.export_c(loop, [1.0], name="first").files)
        ['CMakeLists.txt', 'first.c', 'first.h']
    """
    require_name(name)
    rng = np.random.default_rng(seed)
    one = posed_controller(
        controller,
        x0,
        starts=starts,
        iterations=iterations,
        exactness=EXACTNESS[precision],
        seen=seen,
        rng=rng,
    )
    try:
        made = controller_text(
            name, one, precision=precision, iterations=iterations,
            remark=_remark(name, one, precision),
        )  # fmt: skip
    except UnknownOperationError as error:
        raise ExportError(
            f"the controller cannot be written as C: {error}. State that part by "
            "elementary functions, tables of data by splines of fewer values"
        ) from error
    if len(made.source) > LONGEST_SOURCE:
        raise ExportError(
            f"the C file would have {len(made.source) / 1e6:.1f} MB, expected at most "
            f"{LONGEST_SOURCE / 1e6:g}: fewer substeps, checks or values of tables "
            "make it shorter"
        )
    found = {f"{name}.c": made.source, f"{name}.h": made.header}
    found["CMakeLists.txt"] = _cmake(name, main=main)
    if main:
        found[f"{name}_main.c"] = _main_text(name, one, precision, iterations)
    near = one.terminal_set
    if near is not None and near.certificate is not None and precision == "double":
        found[f"{name}.certificate.json"] = certificate_text(near.certificate)
    return CExport(
        name=name, files=found, precision=precision, posed=one, iterations=iterations,
        most_operations=made.most_operations,
    )  # fmt: skip


def require_name(name: str) -> None:
    """Raise unless a name is a C identifier that is no word of C.

    Raises:
        ExportError: If the name is not one, or is too long.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or name in _WORDS:
        raise ExportError(
            "name: expected letters, digits and _, a letter first, and no word of C; "
            f"found {name!r}"
        )
    if len(name) > LONGEST_NAME:
        raise ExportError(
            f"name: expected at most {LONGEST_NAME} characters, found {len(name)}"
        )


def _remark(name: str, one: PosedController, precision: str) -> str:
    """Return the comment at the head of the files."""
    rescue = (
        f"{len(one.starts)} seeded starts are solved if the shifted plan leads to no "
        "feasible optimum, or if the cost jumps"
        if len(one.starts)
        else "THERE IS NO RESCUE: a step stays in the optimum that is next to its last "
        "plan, which may cost far more than another"
    )
    law = (
        "the linear law acts inside the terminal set"
        if one.terminal_set is not None
        else "there is no terminal set"
    )
    problem = one.problem
    lines = [
        f"{name}: a receding-horizon controller, {one.stated} states, "
        f"{problem.model.nu} controls, {problem.intervals} intervals of "
        f"{problem.dt:g} s, {precision} precision.",
        "Generated by swarmstart. The text is yours: use, change and sell it as you "
        "like; there is no warranty.",
        f"Rescue: {rescue}. Law: {law}.",
        "No heap, no recursion; all memory is NAME_memory, which the caller owns, one "
        "for each vehicle.",
        "A step takes at most NAME_MOST_OPERATIONS operations (an addition, product, "
        "division, comparison or root each).",
        f"The same bits for all optimisations: {' '.join(FLAGS)}, with -O0 to -O3.",
    ]
    wrapped = []
    for line in lines:
        wrapped += textwrap.wrap(line.replace("NAME", name), 84)
    return "/* " + "\n   ".join(wrapped) + " */\n"


def _cmake(name: str, *, main: bool) -> str:
    lines = [
        "cmake_minimum_required(VERSION 3.10)",
        f"project({name} C)",
        "set(CMAKE_C_STANDARD 99)",
        f"add_library({name} {name}.c)",
        f"target_compile_options({name} PRIVATE {' '.join(FLAGS[2:])})",
        f"target_include_directories({name} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})",
        f"target_link_libraries({name} PUBLIC m)",
    ]
    if main:
        lines += [
            f"add_executable({name}_main {name}_main.c)",
            f"target_link_libraries({name}_main PRIVATE {name})",
            "enable_testing()",
            f"add_test(NAME {name} COMMAND {name}_main)",
        ]
    return "\n".join(lines) + "\n"


def _main_text(name: str, one: PosedController, precision: str, iterations: int) -> str:
    """Return the program that simulates and compares."""
    problem, form = one.problem, FORMATS[precision]
    steps = max(1, min(round(FLOWN / problem.dt), MOST_STEPS))
    controls, statuses = _flight(one, iterations, steps)
    if precision == "single":  # Rounding decides which plan is better.
        statuses = [-1 for _ in statuses]
    lower, upper = problem.control_limits
    span = upper - lower
    span = np.where(np.isfinite(span), span, np.ptp(controls, axis=0))
    tables = {
        "begin": one.x0[: one.stated], "expected": controls, "least": lower,
        "most": upper, "range": np.maximum(span, _LEAST_RANGE),
        "parameters": one.known.parameters,
        "signals": flatten(np.asarray(one.known.signals)),
    }  # fmt: skip
    lines = [
        f"#define STEPS {steps}", "#define INFINITE ((real)INFINITY)",
        "typedef NAME_real real;",
        f"static const real tolerance = {c_number(APART[precision], form)};",
        f"static const int wanted[] = {{{', '.join(str(int(s)) for s in statuses)}}};",
        *(c_table(key, values, form) for key, values in tables.items()),
    ]  # fmt: skip
    model = problem.model
    passed = ", parameters" if model.np else ""
    passed += ", signals" if problem.ns else ""
    names = ["time", *model.state_names[: one.stated], *model.control_names]
    plain = [re.sub(r"[^A-Za-z0-9_]", "_", name) for name in names]
    filled = {
        "SECONDS": f"{steps * problem.dt:g}",
        "TOLERANCE": f"{APART[precision]:g}", "TABLES": "\n".join(lines),
        "PASSED": passed, "HEADINGS": ",".join([*plain, "status", "cost", "violation"]),
    }  # fmt: skip
    template = files(__package__).joinpath("main.c").read_text("utf-8")
    for place, value in filled.items():
        template = template.replace(f"@{place}@", value)
    return template.replace("NAME", name)


def _flight(
    one: PosedController, iterations: int, steps: int
) -> tuple[np.ndarray, list[int]]:
    """Return controls (steps, nu) and statuses of a simulation by the library's code.

    A status is -1 if rounding decides it.
    """
    twin, x = Twin(one, iterations=iterations), one.x0[: one.stated]
    controls, statuses = [], []
    for _ in range(steps):
        u, status = twin.step(x)
        controls.append(u)
        # Below that, rounding decides whether a plan is better than the last one.
        says = status is Status.LINEAR or twin.size > _SAYING * one.noise
        statuses.append(int(status) if says else -1)
        x = twin.model(x, u)
    return np.array(controls), statuses
