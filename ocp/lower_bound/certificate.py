"""Certificates: the evidence of a proven lower bound, as a file to be checked.

The content is ready for JSON: the problem as a list of instructions (a tape, as in
certificates of terminal sets), the tube, the polynomials, the slacks of the proofs, and
the bound; see `stated/answer.py`. The command
`python -m swarmstart.ocp.lower_bound.check FILE` proves the bound again, with another
arithmetic and without code of the search. The digest of the file detects careless
edits; a file with a new digest must still pass the proof.

    ["t", 0]  ["x", 0]  ["u", 0]  ["const", 9.81]  ["mul", 0, 3]

are the instructions of the tape: time, states divided by their sizes, controls,
constants, and operations on the values of earlier instructions (those of
`terminal_set/interval_arithmetic/tape.py`).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.answer import Evidence, Step, Tube
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.terminal_set.certificates import digest
from swarmstart.terminal_set.interval_arithmetic import Instruction, tape_of

FORMAT = "swarmstart lower bound certificate"
VERSION = 1


def certificate_content(evidence: Evidence) -> dict[str, object]:
    """Return a certificate's content, for `json.dumps(content, allow_nan=False)`.

    Returns:
        Numbers, texts, lists and objects; floats are read back to the last bit; None
        stands for infinite numbers; "sha256" is the digest of the rest.

    Raises:
        UnknownIntervalOperationError: If the file format lacks an operation of the
            problem.
        ValueError: If a number is not finite but must be.
    """
    content: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "problem": _problem(evidence.statement),
        "tube": _tube(evidence.tube),
        "prunings": [
            {"come": _step(pruning.come), "go": _step(pruning.go)}
            for pruning in evidence.prunings
        ],
        "final": _step(evidence.final),
        "known": float(evidence.known) if np.isfinite(evidence.known) else None,
        "bound": float(evidence.bound),
        "statements": [
            {"statement": text, "grounds": "proven"}
            for text in _statements(len(evidence.prunings))
        ],
    }
    content["sha256"] = digest(content)
    return content


def _statements(prunings: int) -> list[str]:
    """Return the statements, in words."""
    # Not imported from the checker, which must share no code with the writer.
    pruning = "no trajectory that costs less than the known cost leaves the set of"
    return [
        "every admissible trajectory stays in the tube",
        *(f"{pruning} pruning {i + 1}" for i in range(prunings)),
        "the final step's inequalities hold on the set that the prunings leave",
        "no admissible trajectory costs less than the bound",
    ]


def _problem(statement: Statement) -> dict[str, object]:
    """Return the problem as data."""
    parts = [statement.rate, statement.stage, statement.end]
    parts += [*statement.path, *statement.ends]
    function = ca.Function(
        "problem", [statement.point, statement.controls], [ca.vertcat(*parts)]
    )
    tape, numbers = tape_of(function)
    n, paths = statement.n, sum(g.numel() for g in statement.path)
    rest = numbers[n + 2 :]  # After f, L and phi.
    return {
        "n": n,
        "m": statement.m,
        "tape": [_instruction(instruction) for instruction in tape],
        "rate": numbers[:n],
        "stage": numbers[n],
        "end": numbers[n + 1],
        "path": rest[:paths],
        "ends": rest[paths:],
        "x0": _list(statement.x0),
        "sizes": _list(statement.sizes),
        "horizon": [float(end) for end in statement.horizon],
        "control_box": {
            "lower": _list(statement.control_box[0]),
            "upper": _list(statement.control_box[1]),
        },
        "state_box": {
            "lower": _or_none(statement.state_box[0]),
            "upper": _or_none(statement.state_box[1]),
        },
        "offset": float(statement.offset),
        "sense": float(statement.sense),
    }


def _instruction(instruction: Instruction) -> Instruction:
    """Return an instruction whose input is split into t and x."""
    if instruction[0] != "x":
        return instruction
    entry = int(instruction[1])
    return ["t", 0] if entry == 0 else ["x", entry - 1]


def _tube(tube: Tube) -> dict[str, object]:
    return {
        "directions": np.asarray(tube.directions, dtype=np.float64).tolist(),
        "times": _list(tube.times),
        "levels": np.asarray(tube.levels, dtype=np.float64).tolist(),
    }


def _step(step: Step) -> dict[str, object]:
    polynomial = step.polynomial
    return {
        "polynomial": {
            "middle": _list(polynomial.middle),
            "half": _list(polynomial.half),
            "exponents": np.asarray(polynomial.exponents, dtype=np.int64).tolist(),
            "coefficients": _list(polynomial.coefficients),
        },
        "slack": float(step.slack),
        "end_slack": None if step.end_slack is None else float(step.end_slack),
        "boxes": int(step.boxes),
    }


def _list(values: Array) -> list[float]:
    return [float(value) for value in np.ravel(values)]


def _or_none(bounds: Array) -> list[float | None]:
    """Return bounds with None in place of infinity, which JSON does not have."""
    return [value if np.isfinite(value) else None for value in _list(bounds)]
