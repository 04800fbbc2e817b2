"""Reader of certificate files of lower bounds, which validates every entry.

Every entry is a number, a list or one of a few known words. Nothing is executed. The
statements must have the texts of `expected_claims`, which are exactly those that the
checker judges: free text labelled "proven" would look as if it had been checked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarmstart.terminal_set.checker.file_content import (
    Entries,
    Instruction,
    Limits,
    Vector,
    integer,
    mapping,
    optional,
    unusable,
)

LONGEST_TAPE = 20_000  # instructions
LONGEST_LIST = 100_000  # entries; slabs, faces, coefficients
MOST_COORDINATES = 8  # time, states and controls are boxes of so many dimensions
MOST_CONTROLS = 20
MOST_CONSTRAINTS = 1000
MOST_PRUNINGS = 100
HIGHEST_EXPONENT = 40
LARGEST = 1e30  # so that powers and products neither overflow nor underflow unseen
MOST_PRODUCTS = 50_000  # of Chebyshev polynomials, of the highest exponents
_READ = Entries(largest=LARGEST, longest=LONGEST_LIST, longest_tape=LONGEST_TAPE)

TUBE = "every admissible trajectory stays in the tube"
PRUNING = "no trajectory that costs less than the known cost leaves the set of pruning"
FINAL = "the final step's inequalities hold on the set that the prunings leave"
BOUND = "no admissible trajectory costs less than the bound"


@dataclass(frozen=True, kw_only=True, slots=True)
class Problem:
    """The control problem, as plain numbers.

    Attributes:
        n: Number of states.
        m: Number of controls.
        tape: Instructions (operation, operands, constant).
        rate: Indices of the n instructions for f, the rates of the states.
        stage: Index of the instruction for L, the stage cost.
        end: Index of the instruction for phi, the terminal cost.
        path: Indices of the instructions for the path constraints g <= 0.
        ends: Indices of the instructions for the constraints e <= 0 at the end.
        x0: Initial state.
        horizon: Earliest and latest end time.
        control_box: Lower and upper bounds of the controls.
        state_box: Lower and upper bounds of the states; None for an unbounded one.
        offset: Number added to the cost.
        sense: 1 if the cost is minimised, -1 if it is maximised.
    """

    n: int
    m: int
    tape: tuple[Instruction, ...]
    rate: tuple[int, ...]
    stage: int
    end: int
    path: tuple[int, ...]
    ends: tuple[int, ...]
    x0: Vector
    horizon: tuple[float, float]
    control_box: tuple[Vector, Vector]
    state_box: tuple[Limits, Limits]
    offset: float
    sense: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Step:
    """A polynomial V(t, x) and the slacks of its inequalities (`tasks.py`).

    Attributes:
        middle: Middle of the box of (t, x) that is scaled to [-1, 1], 1 + n numbers.
        half: Half of the width of that box in each variable, above 0, 1 + n numbers.
        exponents: For each coefficient the degrees of its Chebyshev polynomials in t
            and the n states, a tuple of 1 + n whole numbers.
        coefficients: Coefficients of the products of Chebyshev polynomials.
        slack: Slack of V_t + L + V_x f >= -slack over the set of (t, x), with the rates
            f and the stage cost L; >= 0.
        end_slack: Slack of V <= phi + end slack at the end, with the terminal cost phi;
            >= 0; None if nothing is stated.
    """

    middle: Vector
    half: Vector
    exponents: tuple[tuple[int, ...], ...]
    coefficients: Vector
    slack: float
    end_slack: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Certificate:
    """The statements of a certificate, as plain numbers.

    Attributes:
        problem: The problem that is bounded.
        directions: Directions d_k of the faces of the tube {x : d_k x <= s_k(t)}; the
            first 2n are the axes, each in both senses.
        times: Times of the tube, from 0 to the latest end.
        levels: The levels s_k at these times, a row for each time.
        prunings: Pairs of steps (come, go), in order, which give lower bounds of the
            cost from the start to (t, x) and of the cost from there to the end. Each
            pair removes the points (t, x) at which the sum of the two is above the
            known cost.
        final: The step that gives the bound.
        known: Cost of a known solution, which prunings compare with; None if there is
            none.
        bound: Lower bound of the cost, offset included.
    """

    problem: Problem
    directions: tuple[Vector, ...]
    times: Vector
    levels: tuple[Vector, ...]
    prunings: tuple[tuple[Step, Step], ...]
    final: Step
    known: float | None
    bound: float


def certificate_of(content: dict[str, object]) -> Certificate:
    """Return the statements of a file of `LOWER_BOUND`, with its entries validated.

    Raises:
        CertificateFileError: If it is not a valid certificate.
    """
    keys = "format version sha256 problem tube prunings final known bound statements"
    mapping(content, "the file", keys)
    if integer(content["version"], "version", 0, 10**9) != 1:
        raise unusable("version", "1", content["version"])
    problem = _problem(content["problem"])
    tube = mapping(content["tube"], "tube", "directions times levels")
    times = _READ.vector(tube["times"], "tube.times", None)
    if len(times) < 2:  # noqa: PLR2004
        raise unusable("tube.times", "2 times or more", len(times))
    for i in range(len(times) - 1):
        if not times[i] < times[i + 1]:
            raise unusable(f"tube.times[{i + 1}]", "a later time", times[i + 1])
    directions = _READ.matrix(tube["directions"], "tube.directions", None, problem.n)
    _check_axes(directions, problem.n)
    prunings = _READ.list_of(
        content["prunings"],
        "prunings",
        None,
        lambda entry, where: _pruning(entry, where, problem.n),
    )
    if len(prunings) > MOST_PRUNINGS:
        raise unusable("prunings", f"at most {MOST_PRUNINGS}", len(prunings))
    known = content["known"]
    if known is None and prunings:
        raise unusable("known", "a number if there are prunings", known)
    _check_statements(content["statements"], prunings=len(prunings))
    return Certificate(
        problem=problem,
        directions=directions,
        times=times,
        levels=_READ.matrix(tube["levels"], "tube.levels", len(times), len(directions)),
        prunings=prunings,
        final=_step(content["final"], "final", problem.n, with_end=True),
        known=optional(known, "known", _READ.number),
        bound=_READ.number(content["bound"], "bound"),
    )


def _problem(value: object) -> Problem:
    where = "problem"
    entry = mapping(
        value,
        where,
        "n m tape rate stage end path ends x0 sizes horizon control_box state_box "
        "offset sense",
    )
    n = integer(entry["n"], f"{where}.n", 1, MOST_COORDINATES - 1)
    m = integer(entry["m"], f"{where}.m", 0, MOST_CONTROLS)
    tape = _READ.tape(entry["tape"], f"{where}.tape", {"t": 1, "x": n, "u": m})
    _check_sizes(entry["sizes"], f"{where}.sizes", n)
    sense = _READ.number(entry["sense"], f"{where}.sense")
    if abs(sense) != 1.0:
        raise unusable(f"{where}.sense", "1 or -1", sense)
    problem = Problem(
        n=n,
        m=m,
        tape=tape,
        rate=_READ.numbers(entry["rate"], f"{where}.rate", len(tape), n),
        stage=integer(entry["stage"], f"{where}.stage", 0, len(tape) - 1),
        end=integer(entry["end"], f"{where}.end", 0, len(tape) - 1),
        path=_constraints(entry["path"], f"{where}.path", len(tape)),
        ends=_constraints(entry["ends"], f"{where}.ends", len(tape)),
        x0=_READ.vector(entry["x0"], f"{where}.x0", n),
        horizon=_horizon(entry["horizon"], f"{where}.horizon"),
        control_box=_control_box(entry["control_box"], f"{where}.control_box", m),
        state_box=_state_box(entry["state_box"], f"{where}.state_box", n),
        offset=_READ.number(entry["offset"], f"{where}.offset"),
        sense=sense,
    )
    _check_dependence(problem)
    return problem


def _check_dependence(problem: Problem) -> None:
    moved = list[bool]()
    for operation, operands, _ in problem.tape:
        inner = operation not in ("t", "x", "u", "const")
        moved.append(operation == "u" or (inner and any(moved[k] for k in operands)))
    outputs = {"end": (problem.end,), "path": problem.path, "ends": problem.ends}
    for name, numbers in outputs.items():
        for number in numbers:
            if moved[number]:
                raise unusable(f"problem.{name}", "a value without controls", number)


def _check_sizes(value: object, where: str, n: int) -> None:
    # The proof does not depend on them: they convert to the user's units.
    for i, size in enumerate(_READ.vector(value, where, n)):
        if not size > 0.0:
            raise unusable(f"{where}[{i}]", "a number above 0", size)


def _horizon(value: object, where: str) -> tuple[float, float]:
    earliest, latest = _READ.vector(value, where, 2)
    if not 0.0 <= earliest <= latest:
        raise unusable(where, "0 <= earliest <= latest", (earliest, latest))
    return earliest, latest


def _control_box(value: object, where: str, m: int) -> tuple[Vector, Vector]:
    box = mapping(value, where, "lower upper")
    lower = _READ.vector(box["lower"], f"{where}.lower", m)
    upper = _READ.vector(box["upper"], f"{where}.upper", m)
    for i in range(m):
        if not lower[i] <= upper[i]:
            raise unusable(f"{where}.upper[{i}]", f"at least {lower[i]:g}", upper[i])
    return lower, upper


def _state_box(value: object, where: str, n: int) -> tuple[Limits, Limits]:
    box = mapping(value, where, "lower upper")
    lower = _READ.limits(box["lower"], f"{where}.lower", n)
    upper = _READ.limits(box["upper"], f"{where}.upper", n)
    for i, (low, high) in enumerate(zip(lower, upper, strict=True)):
        if low is not None and high is not None and low > high:
            raise unusable(f"{where}.upper[{i}]", f"at least {low:g}", high)
    return lower, upper


def _check_axes(directions: tuple[Vector, ...], n: int) -> None:
    for k in range(2 * n):
        sign = 1.0 if k % 2 == 0 else -1.0
        axis = tuple(sign if i == k // 2 else 0.0 for i in range(n))
        if k >= len(directions) or directions[k] != axis:
            found = directions[k] if k < len(directions) else "none"
            raise unusable(f"tube.directions[{k}]", f"the axis {axis}", found)
    for k, direction in enumerate(directions):
        if not any(direction):
            raise unusable(f"tube.directions[{k}]", "a number other than 0", direction)


def _pruning(value: object, where: str, n: int) -> tuple[Step, Step]:
    entry = mapping(value, where, "come go")
    come = _step(entry["come"], f"{where}.come", n, with_end=False)
    return come, _step(entry["go"], f"{where}.go", n, with_end=True)


def _step(value: object, where: str, n: int, *, with_end: bool) -> Step:
    entry = mapping(value, where, "polynomial slack end_slack boxes")
    integer(entry["boxes"], f"{where}.boxes", 0, 10**15)
    name = f"{where}.polynomial"
    shape = "middle half exponents coefficients"
    polynomial = mapping(entry["polynomial"], name, shape)
    coefficients = _READ.vector(
        polynomial["coefficients"], f"{name}.coefficients", None
    )
    exponents = _READ.list_of(
        polynomial["exponents"],
        f"{name}.exponents",
        len(coefficients),
        lambda row, at: _READ.list_of(
            row, at, 1 + n, lambda e, place: integer(e, place, 0, HIGHEST_EXPONENT)
        ),
    )
    if len(set(exponents)) < len(exponents):
        raise unusable(f"{name}.exponents", "each product once", "one of them twice")
    highest = [max((e[a] for e in exponents), default=0) for a in range(1 + n)]
    if math.prod(1 + e for e in highest) > MOST_PRODUCTS:
        raise unusable(f"{name}.exponents", f"{MOST_PRODUCTS} products", highest)
    half = _READ.vector(polynomial["half"], f"{name}.half", 1 + n)
    if not all(width > 0.0 for width in half):
        raise unusable(f"{name}.half", "numbers above 0", half)
    end_slack = entry["end_slack"]
    if end_slack is None and with_end:
        raise unusable(f"{where}.end_slack", "a number", end_slack)
    return Step(
        middle=_READ.vector(polynomial["middle"], f"{name}.middle", 1 + n),
        half=half,
        exponents=exponents,
        coefficients=coefficients,
        slack=_READ.at_least_zero(entry["slack"], f"{where}.slack"),
        end_slack=optional(end_slack, f"{where}.end_slack", _READ.at_least_zero),
    )


def _check_statements(value: object, *, prunings: int) -> None:
    # A reader would take the word "proven" in the file for the checker's own verdict.
    expected = [
        {"statement": text, "grounds": "proven"} for text in expected_claims(prunings)
    ]
    entries = _READ.list_of(value, "statements", len(expected), lambda one, _: one)
    if list(entries) != expected:
        raise unusable("statements", "the statements of the format", value)


def _constraints(value: object, where: str, count: int) -> tuple[int, ...]:
    numbers = _READ.numbers(value, where, count, None)
    if len(numbers) > MOST_CONSTRAINTS:
        raise unusable(where, f"at most {MOST_CONSTRAINTS} entries", len(numbers))
    return numbers


def expected_claims(prunings: int) -> list[str]:
    """Return the statements of a certificate with this number of prunings, in order."""
    return [TUBE, *(f"{PRUNING} {i + 1}" for i in range(prunings)), FINAL, BOUND]
