"""A controller as the text of C files: its functions, tables and header.

The parts that are the same for all problems stand in controller.c, whose places
(`@PLACE@`) are filled here.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from swarmstart.export.controller.c_functions import CFile
from swarmstart.export.controller.c_writer import c_number, c_table
from swarmstart.export.controller.numbers import (
    CLOSE,
    FIRST_MU,
    LITTLE,
    TURNS,
    WARM_MU,
)
from swarmstart.export.controller.posed import PosedController
from swarmstart.ocp.answer.plan import JUMP
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS
from swarmstart.ocp.lanes.interior_kernels import WILD
from swarmstart.ocp.lanes.solver import RHO

_SWEEP = ("last", "backward", "start", "along", "aim")
_TRIAL = ("move", "trial", "verdict", "keep")
_HELPERS = {
    "bits_of": """static bits_t bits_of(real value)
{
  bits_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}
""",
    "number_of": """static real number_of(bits_t bits)
{
  real value;
  memcpy(&value, &bits, sizeof value);
  return value;
}
""",
    "shifted_right": """/* Arithmetic, which C leaves to the compiler. */
static bits_t shifted_right(bits_t bits, bits_t count)
{
  const bits_t sign = bits >> (8 * sizeof bits - 1);
  return (bits >> count) | (sign ? ~(~(bits_t)0 >> count) : 0);
}
""",
    "square_root": "static real square_root(real v) { return @sqrt@(v); }\n",
    "floor_of": "static real floor_of(real v) { return @floor@(v); }\n",
    "ceiling_of": "static real ceiling_of(real v) { return @ceil@(v); }\n",
    "absolute": "static real absolute(real v) { return @fabs@(v); }\n",
    "with_sign_of": (
        "static real with_sign_of(real v, real sign) { return @copysign@(v, sign); }\n"
    ),
    "smaller": (
        "static real smaller(real a, real b) { return a < b || b != b ? a : b; }\n"
    ),
    "larger": (
        "static real larger(real a, real b) { return a > b || b != b ? a : b; }\n"
    ),
}

_HUGE = 1e300
_KINDS = {"double": "double", "single": "float"}
"""Precision -> the type of its numbers in C."""
_STATUS = """/* Status of a step. */
enum {
  NAME_PLANNED = 0,  /* a local optimum, from the shifted last plan */
  NAME_LINEAR = 1,   /* the linear law, inside the terminal set */
  NAME_SEARCHED = 2, /* the best of the seeded starts */
  NAME_SHIFTED = 3,  /* the shifted last plan: nothing better was found */
  NAME_INVALID = 4   /* the same, since a number given was not finite */
};
"""
_DECLARED = """/* Begins anew. A memory must be reset before its first step. */
void NAME_reset(NAME_memory *m);

/* Writes the control for the coming interval into u, always finite and within its
   bounds, and returns the status. */
int NAME_step(NAME_memory *m, const NAME_real x[NAME_NX]@GIVEN@,
              NAME_real u[NAME_NU]);

/* The state after an interval, as the controller predicts it. */
void NAME_model(const NAME_real x[NAME_NX], const NAME_real u[NAME_NU]@GIVEN@,
                NAME_real after[NAME_NX]);
"""
_REMEMBERED = """  for (i = STATED; i < NX; ++i) {
    here[i] = m->remembered[i - STATED];
  }
"""
_KEEP = """  for (i = STATED; i < NX; ++i) {
    m->remembered[i - STATED] = m->path[i];
  }
"""
_KEEP_INVALID = """    /* What remembers controls does not depend on the state. */
    real after[NX], cost, broken;
    for (i = 0; i < NX; ++i) {
      here[i] = i < STATED ? 0 : m->remembered[i - STATED];
    }
    f_interval(here, m->plan, m->p, SIGNALS(0), after, &cost, &broken);
    m->operations += OPERATIONS_f_interval;
    for (i = STATED; i < NX; ++i) {
      m->remembered[i - STATED] = after[i];
    }
"""
_STARTS = """
/* The controls of a seeded start, linear between its knots. */
static void take_start(memory_t *m, int number)
{
  int k, i;
  for (k = 0; k < N; ++k) {
    const int left = k * (KNOTS - 1) / (N - 1);
    const int right = left + 1 < KNOTS ? left + 1 : left;
    const real part = (real)(k * (KNOTS - 1) - left * (N - 1)) / (real)(N - 1);
    for (i = 0; i < NU; ++i) {
      const real a = start_knots[(number * KNOTS + left) * NU + i];
      const real b = start_knots[(number * KNOTS + right) * NU + i];
      m->start[k * NU + i] = clipped(a + part * (b - a), u_lower[i], u_upper[i]);
    }
  }
}
"""
_SET = """
static int is_inside(const real x[NX])
{
  real value = 0;
  int i, j;
  for (i = 0; i < NX; ++i) {
    real row = 0;
    for (j = 0; j < NX; ++j) {
      row += set_matrix[i * NX + j] * (x[j] - x_reference[j]);
    }
    value += (x[i] - x_reference[i]) * row;
  }
  return value <= set_level[0];
}

/* The plan of the linear law u = u_reference - gain (x - x_reference). */
static void follow_law(memory_t *m, const real x[NX])
{
  real here[NX], after[NX], cost, broken;
  int k, i, j;
  memcpy(here, x, sizeof here);
  for (k = 0; k < N; ++k) {
    for (i = 0; i < NU; ++i) {
      real u = u_reference[i];
      for (j = 0; j < NX; ++j) {
        u -= gain[i * NX + j] * (here[j] - x_reference[j]);
      }
      m->plan[k * NU + i] = clipped(u, u_lower[i], u_upper[i]);
    }
    f_interval(here, m->plan + k * NU, m->p, SIGNALS(k), after, &cost, &broken);
    m->operations += OPERATIONS_f_interval + 2 * NX * NU;
    memcpy(here, after, sizeof here);
  }
}
"""
_LINEAR = """  if (is_inside(here)) {
    follow_law(m, here);
    best = rolled(m, here, m->plan, m->path);
    m->is_begun = 1;
    m->cost = best.cost;
    m->size = best.size;
    m->violation = best.violation;
    memcpy(u, m->plan, NU * sizeof u[0]);
    m->status = NAME_LINEAR;
    return NAME_LINEAR;
  }
"""
_RESCUE = """  if (!m->is_begun || !(warm & OPTIMAL) || !(best.violation <= TOLERANCE)
      || best.cost - m->cost > larger(JUMP * best.size, NOISE)) {
    for (i = 0; i < STARTS; ++i) {
      take_start(m, i);
      if (tried(m, here, m->start, 0, FIRST_MU, 0, &best) & BETTER) {
        status = NAME_SEARCHED;
      }
    }
  }
"""


def preamble(precision: str, body: str, *, real: str = "") -> str:
    """Return includes, types and helpers that come before C functions.

    Args:
        precision: "double" or "single".
        body: Text of the functions; only helpers that it uses are returned.
        real: C type of the numbers; if empty, that of the precision.
    """
    bits = FORMATS[precision].bits
    suffix = {"double": "", "single": "f"}[precision]
    helpers = []
    for name, text in _HELPERS.items():
        if f"{name}(" in body:
            helpers.append(re.sub(r"@(\w+)@", rf"\g<1>{suffix}", text))
    lines = [
        "#include <math.h>", "#include <stdint.h>", "#include <string.h>", "",
        "#ifdef __FAST_MATH__",
        '#error "-ffast-math removes the tests for numbers that are not finite"',
        "#endif", "", f"typedef {real or _KINDS[precision]} real;",
        f"typedef uint{bits}_t bits_t;",
        "#define INFINITE ((real)INFINITY)", "#define NOT_A_NUMBER ((real)NAN)", "",
        *helpers,
    ]  # fmt: skip
    return "\n".join(lines)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ControllerText:
    """The text of a controller.

    Attributes:
        source: Text of NAME.c.
        header: Text of NAME.h.
        most_operations: Largest number of operations that one control step can take.
    """

    source: str
    header: str
    most_operations: int


def controller_text(
    name: str, one: PosedController, *, precision: str, iterations: int, remark: str
) -> ControllerText:
    """Return the text of a controller.

    Args:
        name: Name of the controller, a C identifier.
        one: The numbers and functions that the text is made of.
        precision: "double" or "single".
        iterations: Largest number of steps of a local solve.
        remark: Comment for the head of both files.

    Raises:
        UnknownOperationError: If an operation cannot be written in C.
    """
    return _Maker(name, one, precision, iterations, remark).text()


class _Maker:
    """The parts of the text."""

    def __init__(
        self,
        name: str,
        one: PosedController,
        precision: str,
        iterations: int,
        remark: str,
    ) -> None:
        """Write the functions of the problem."""
        self._name, self._one, self._remark = name, one, remark
        self._precision, self._form = precision, FORMATS[precision]
        self._turns = TURNS * iterations
        self._file = CFile(self._form, self._places())
        lane = one.lane
        for kernel_name, kernel in lane.kernels.items():
            self._file.add_kernel(f"k_{kernel_name}", kernel)
        steps = lane.steps
        self._file.add_function(steps.value, "f_step")
        self._file.add_function(steps.adjoint, "f_adjoint")
        self._file.add_function(steps.before, "f_before")
        if lane.pull is not None:
            self._file.add_function(lane.pull, "f_pull")
        self._file.add_function(one.interval, "f_interval")
        self._file.add_function(one.end, "f_end")
        if one.begin is not None:
            self._file.add_function(one.begin, "f_begin")

    def _places(self) -> dict[str, str]:
        """Return the C expression of each name's array."""
        lane, problem = self._one.lane, self._one.problem
        found = {name: f"c_{_plain(name)}" for name in lane.shared}
        last = problem.ns * (problem.nodes - 1)
        found |= {
            "interval.signals": "m->windows", "end.signals": f"(m->signals + {last})",
            "begin.signals": "m->signals",
        }  # fmt: skip
        for name in lane.rows:
            found[name] = f"m->lane.{_plain(name)}"
            if name.endswith(".parameters"):
                found[name] = "m->p"
        return found

    def text(self) -> ControllerText:
        """Return the files."""
        template = files(__package__).joinpath("controller.c").read_text("utf-8")
        for place, text in self._filled().items():
            template = template.replace(f"@{place}@", text)
        source = self._head(template) + template
        return ControllerText(
            source=source.replace("NAME", self._name),
            header=self._header().replace("NAME", self._name),
            most_operations=self._most_operations(),
        )

    def _head(self, body: str) -> str:
        """Return comments, includes and numbers of the source."""
        one, lane = self._one, self._one.lane
        problem, is_double = one.problem, self._precision == "double"
        numbers = {
            "N": problem.intervals, "NX": problem.model.nx, "NU": problem.model.nu,
            "INPUTS": lane.inputs, "STATED": one.stated, "NS": problem.ns,
            "CHECKS": problem.checks,
            "NZ": problem.model.nx + lane.inputs, "STEPS": lane.steps.count,
            "ALL_STEPS": self._steps, "ROWS": self._rows,
            "TURNS": self._turns, "STARTS": len(one.starts),
            "KNOTS": one.starts.shape[2],
            "LARGEST": self._number(_HUGE if is_double else 1e37),
            "TOLERANCE": self._number(problem.tolerance),
            "FIRST_MU": self._number(FIRST_MU), "WARM_MU": self._number(WARM_MU),
            "FIRST_RHO": self._number(RHO),
            "LEAST_UNIT": self._number(lane.least_unit[0]),
            "LEAST_SIZE": self._number(lane.least_unit[1]),
            "JUMP": self._number(JUMP), "NOISE": self._number(one.noise),
            "CLOSE": self._number(CLOSE), "WILD": self._number(WILD),
            "LITTLE": self._number(LITTLE[self._precision]),
            "HOLD": float(problem.dt).hex(),
            "OPERATIONS_START": f"{self._start_operations()}ul",
            "OPERATIONS_DERIVE": f"{self._derive_operations()}ul",
        }  # fmt: skip
        counted = {
            f"OPERATIONS_{name}": f"{count}ul"
            for name, count in self._file.operations.items()
        }
        defined = [
            f"#define {key} {value}" for key, value in (numbers | counted).items()
        ]
        signals = "(m->signals + (k) * CHECKS * NS)"
        defined.append(
            f"#define SIGNALS(k) {signals}"
            if problem.ns
            else "#define SIGNALS(k) m->signals"
        )
        lines = [
            self._remark, '#include "NAME.h"', "",
            preamble(self._precision, body, real="NAME_real"),
            "typedef NAME_memory memory_t;", "",
            "/* Cost of a plan, sum of the sizes of its parts, and its violation. */",
            "typedef struct { real cost, size, violation; } trial_t;", "",
        ]  # fmt: skip
        return "\n".join([*lines, *defined, "", ""])

    def _number(self, value: float) -> str:
        return c_number(value, self._form)

    def _filled(self) -> dict[str, str]:
        """Return the text of each place of controller.c, in the order of filling."""
        one = self._one
        return {
            "ELEMENTARY": "\n".join(one.text for one in self._file.common.values()),
            "TABLES": self._tables(),
            "FUNCTIONS": "\n".join(self._file.functions.values()),
            "KNOWN": self._known(),
            "BEGIN": ""
            if one.begin is None
            else "  f_begin(x, m->p, m->signals, &cost, &broken);\n"
            "  m->operations += OPERATIONS_f_begin;\n"
            "  found.cost += cost;\n  found.size += cost < 0 ? -cost : cost;\n"
            "  found.violation += broken;\n",
            "BLANK": self._blank(),
            "UNITS": self._units("1"),
            "UNIT": self._units("unit"),
            "NO_DUALS": "memset(m->lane.z, 0, sizeof m->lane.z);"
            if one.lane.rows.get("z") else "",
            "PULL": self._pull("m->lane.x + k * NX", "u", "m->lane.F + k * NX", ""),
            "PULL_NEW": self._pull(
                "x", "u", "m->lane.F_new + k * NX",
                " + alpha * m->lane.d_m[k * ROWS + i]",
            ),
            "TAKE_OVER": self._copies(one.lane.state, "next."),
            "AIM": self._copies(self._aimed(), "aim."),
            "APPEND": "    m->plan[(N - 1) * NU + i] = m->plan[(N - 2) * NU + i];\n"
            if one.append == "last"
            else "    m->plan[(N - 1) * NU + i] = u_zero[i];\n",
            "STARTS": _STARTS if len(one.starts) else "",
            "SET": _SET if one.terminal_set is not None else "",
            "LINEAR": _LINEAR if one.terminal_set is not None else "",
            "RESCUE": _RESCUE if len(one.starts) else "",
            "REMEMBERED": _REMEMBERED if one.remembered.size else "",
            "REMEMBERED_RESET": "  memcpy(m->remembered, remembered, "
            "sizeof m->remembered);\n" if one.remembered.size else "",
            "KEEP": _KEEP if one.remembered.size else "",
            "KEEP_INVALID": _KEEP_INVALID if one.remembered.size else "",
            "MODEL_GIVEN": self._given(),
            "MODEL": self._model(),
            "GIVEN": self._given(),
            "GIVEN_FINITE": self._finite(),
            "PASSED": self._passed(),
        }  # fmt: skip

    def _pull(self, x: str, u: str, after: str, step: str) -> str:
        """Return lines that put the costate behind the last step in place of lam."""
        if self._one.lane.pull is None:
            return ""
        has_rows = bool(self._one.lane.rows.get("m"))
        rows = f"m->lane.m[k * ROWS + i]{step}" if has_rows else "0"
        lines = [
            "    {",
            "      real pull[NX], mult[ROWS];",
            "      for (i = 0; i < ROWS; ++i) {",
            f"        mult[i] = {rows};",
            "      }",
            f"      f_pull({x}, {u}, mult, p, {after}, m->p,",
            f"             m->lane.interval_unit, c_interval_shared, {self._window()},",
            "             pull);",
            "      m->operations += OPERATIONS_f_pull + 2 * ROWS;",
            "      memcpy(p, pull, sizeof p);",
            "    }",
            "",
        ]
        return "\n".join(lines)

    def _window(self) -> str:
        return "m->windows + k * (CHECKS + 1) * NS" if self._one.problem.ns else "m->p"

    @property
    def _steps(self) -> int:
        """Number of steps of the integrator in an interval."""
        return self._one.lane.steps.count * self._one.problem.checks

    @property
    def _rows(self) -> int:
        """Number of rows of an interval, at least 1 for the size of an array."""
        rows = self._one.lane.rows.get("m", 0)
        return max(rows // self._one.problem.intervals, 1)

    def _derive_operations(self) -> int:
        """Return the operations of `derive`, besides those that follow the steps."""
        steps = self._one.problem.intervals * self._steps
        return steps * self._file.operations["f_before"]

    def _follow_operations(self) -> int:
        """Return the operations that follow the steps of all intervals."""
        steps = self._one.problem.intervals * self._steps
        return steps * (self._file.operations["f_step"] + 1)

    def _trial_operations(self) -> int:
        """Return the operations of `derive_trial`."""
        one, count = self._one, self._file.operations
        nz = one.problem.model.nx + one.lane.inputs
        step = count["f_adjoint"] + one.lane.inputs
        own = one.problem.intervals * (self._steps * step + 4 * nz + self._pulled())
        return own + self._follow_operations()

    def _pulled(self) -> int:
        """Return the operations of `f_pull` in one interval."""
        if self._one.lane.pull is None:
            return 0
        return self._file.operations["f_pull"] + 2 * self._rows

    def _aimed(self) -> list[str]:
        names = self._one.lane.rows
        return [n.removeprefix("aim.") for n in names if n.startswith("aim.")]

    def _copies(self, names: Sequence[str], prefix: str) -> str:
        rows = self._one.lane.rows
        return "".join(
            f"      memcpy(m->lane.{_plain(name)}, m->lane.{_plain(prefix + name)}, "
            f"sizeof m->lane.{_plain(name)});\n"
            for name in names
            if rows[name]
        )

    def _blank(self) -> str:
        lines, rows = [], self._one.lane.rows
        for name, value in self._one.lane.blank.items():
            for i in range(rows[name]):
                lines.append(f"  m->lane.{name}[{i}] = {self._large(value)};\n")
        return "".join(lines)

    def _large(self, value: float) -> str:
        return (
            "LARGEST" if value >= _HUGE and np.isfinite(value) else self._number(value)
        )

    def _units(self, value: str) -> str:
        return "".join(
            f"  m->lane.{_plain(name)}[0] = {value};\n"
            for name in self._one.lane.rows
            if name.endswith(".unit")
        )

    def _tables(self) -> str:
        one = self._one
        problem, sizes = one.problem, one.lane.sizes
        lower, upper = problem.control_limits
        tables = {
            f"c_{_plain(name)}": values
            for name, values in one.lane.shared.items()
            if not name.endswith(".signals")
            and (f"c_{_plain(name)}[" in self._uses() or name == "interval.shared")
        }
        tables |= {
            "size_x": sizes.states, "size_u": sizes.controls, "u_lower": lower,
            "u_upper": upper, "first_plan": one.first.T,
        }  # fmt: skip
        if one.append != "last":
            tables["u_zero"] = np.clip(0.0, lower, upper)
        if one.lane.weights.size:
            tables["row_weights"] = one.lane.weights
        if one.remembered.size:
            tables["remembered"] = one.remembered
        if len(one.starts):
            tables["start_knots"] = one.starts.transpose(0, 2, 1)
        if one.terminal_set is not None:
            s = one.terminal_set
            tables |= {
                "x_reference": s.x_ref, "u_reference": s.u_ref, "gain": s.K,
                "set_matrix": s.P, "set_level": np.array([s.alpha]),
            }  # fmt: skip
        return "".join(
            c_table(name, values, self._form) for name, values in tables.items()
        )

    def _uses(self) -> str:
        return "\n".join(self._file.functions.values())

    def _known(self) -> str:
        problem = self._one.problem
        lines = []
        if problem.model.np:
            lines.append("  memcpy(m->p, parameters, NP * sizeof m->p[0]);")
        if self._one.lane.weights.size:
            lines.append("  memcpy(m->p + NP, row_weights, sizeof row_weights);")
        if problem.ns:
            lines += [
                "  memcpy(m->signals, signals, sizeof m->signals);",
                "  {",
                "    int k;",
                "    for (k = 0; k < N; ++k) {",
                "      memcpy(m->windows + k * (CHECKS + 1) * NS, SIGNALS(k),",
                "             (CHECKS + 1) * NS * sizeof m->windows[0]);",
                "    }",
                "  }",
            ]
        text = "".join(f"{line}\n" for line in lines)
        return text.replace("NP", str(problem.model.np))

    def _given(self) -> str:
        problem = self._one.problem
        found = ", const real parameters[NAME_NP]" if problem.model.np else ""
        return found + (", const real signals[NAME_NS]" if problem.ns else "")

    def _passed(self) -> str:
        problem = self._one.problem
        first = "parameters" if problem.model.np else "0"
        return f"{first}, {'signals' if problem.ns else '0'}"

    def _finite(self) -> str:
        problem = self._one.problem
        found = " || !is_finite(parameters, NAME_NP)" if problem.model.np else ""
        return found + (" || !is_finite(signals, NAME_NS)" if problem.ns else "")

    def _model(self) -> str:
        """Return the body of one step of the model."""
        problem, one = self._one.problem, self._one
        weights = one.lane.weights.size
        count = max(problem.model.np + weights, 1)
        lines = [
            f"  real here[NX], next[NX], p[{count}], cost, broken;", "  int i;",
            "  memset(here, 0, sizeof here);", "  memset(p, 0, sizeof p);",
            "  for (i = 0; i < STATED; ++i) {", "    here[i] = x[i];", "  }",
        ]  # fmt: skip
        if problem.model.np:
            lines.append(f"  memcpy(p, parameters, {problem.model.np} * sizeof p[0]);")
        if weights:
            lines.append(
                f"  memcpy(p + {problem.model.np}, row_weights, sizeof row_weights);"
            )
        signals = "signals" if problem.ns else "p"
        lines += [
            f"  f_interval(here, u, p, {signals}, next, &cost, &broken);",
            "  for (i = 0; i < STATED; ++i) {", "    after[i] = next[i];", "  }",
        ]  # fmt: skip
        return "".join(f"{line}\n" for line in lines)

    def _start_operations(self) -> int:
        """Return the operations that scale a start, and its answer."""
        problem = self._one.problem
        return 4 * problem.intervals * problem.model.nu + 2 * problem.model.nx + 8

    def _most_operations(self) -> int:
        """Return the largest number of operations of a step."""
        one, count = self._one, self._file.operations
        problem = one.problem
        rolled = (
            (problem.intervals + 1) * (count["f_interval"] + 3) + count["f_end"] + 4
        )
        rolled += count.get("f_begin", 0)
        turn = sum(count[f"k_{name}"] for name in (*_SWEEP, *_TRIAL))
        turn += self._trial_operations() + self._derive_operations()
        turn += self._follow_operations()
        turn += problem.intervals * self._pulled()
        begin = count["k_first"] + count["k_finish"] + count["k_trial"]
        begin += count["k_move"] + self._trial_operations()
        begin += 2 * count["k_settle"]
        begin += 2 * problem.intervals * (count["f_interval"] + problem.model.nx)
        solved = begin + self._turns * turn + self._start_operations()
        starts = len(one.starts)
        nx, nu = problem.model.nx, problem.model.nu
        law = problem.intervals * (count["f_interval"] + 2 * nx * nu) + 2 * nx * nx
        return (1 + starts) * (solved + rolled) + rolled + law

    def _header(self) -> str:
        """Return the header."""
        one, lane, problem = self._one, self._one.lane, self._one.problem
        arrays = [
            f"    NAME_real {_plain(name)}[{count}];"
            for name, count in lane.rows.items()
            if count and not name.endswith(".parameters")
        ]
        N, nu, nx = problem.intervals, problem.model.nu, problem.model.nx
        windows = N * (problem.checks + 1) * problem.ns
        p = problem.model.np + lane.weights.size
        signals = problem.ns * problem.nodes
        lines = [
            self._remark, "#ifndef NAME_H", "#define NAME_H", "",
            f"typedef {_KINDS[self._precision]} NAME_real;", "",
            f"#define NAME_NX {one.stated}", f"#define NAME_NU {nu}",
        ]  # fmt: skip
        if problem.model.np:
            lines.append(f"#define NAME_NP {problem.model.np}")
        if signals:
            lines.append(f"#define NAME_NS {signals}")
        lines += [
            f"#define NAME_DT {problem.dt!r}",
            f"#define NAME_MOST_OPERATIONS {self._most_operations()}ull", "",
            _STATUS, "typedef struct {",
            f"  NAME_real plan[{N * nu}];  /* controls, one interval after another */",
            f"  NAME_real shifted[{N * nu}], found[{N * nu}];",
            f"  NAME_real start[{N * nu}], start_plan[{N * nu}];",
            f"  NAME_real path[{N * nx}], guess[{N * nx}], found_path[{N * nx}];",
            f"  NAME_real p[{max(p, 1)}], signals[{max(signals, 1)}];",
            f"  NAME_real windows[{max(windows, 1)}];",
            f"  NAME_real y[{(self._steps + 1) * nx}];",
            f"  NAME_real remembered[{max(one.remembered.size, 1)}];",
            "  NAME_real cost, size, violation; /* of the plan */",
            "  unsigned long iterations;        /* of the last step */",
            "  unsigned long long operations;   /* of the last step */",
            "  int is_begun, status;", "  struct {", *arrays, "  } lane;",
            "} NAME_memory;", "",
            *_DECLARED.replace("@GIVEN@", self._given().replace("real", "NAME_real"))
            .splitlines(), "", "#endif", "",
        ]  # fmt: skip
        return "\n".join(lines)


def _plain(name: str) -> str:
    """Return a name as a C identifier."""
    return name.replace(".", "_")
