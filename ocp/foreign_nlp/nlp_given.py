"""An NLP given by the user of another tool, as scalar SX expressions.

Functions that SX can only contain as calls (`cvodes`, a plain `rk`, interpolants) are
refused here: substituting through such a node ends the process (CasADi 3.8.2).
"""

from dataclasses import dataclass, field

import casadi as ca

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.nlp.nlp_sources import NlpSource, OptiSource, last_line


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GivenNlp:
    """Expressions of an NLP, independent of the form in which it was given.

    Attributes:
        x: Variables, SX of shape (nx, 1).
        p: Parameters, SX of shape (np, 1).
        f: The cost.
        g: The rows, of shape (ng, 1).
        source: The object that it was read from.
        rows: (x, p) -> g.
        cost: (x, p) -> f.
        jacobian: (x, p) -> the Jacobian of g, sparse.
        slopes: The Jacobian's expression.
    """

    x: ca.SX
    p: ca.SX
    f: ca.SX
    g: ca.SX
    source: OptiSource | NlpSource
    rows: ca.Function = field(init=False)
    cost: ca.Function = field(init=False)
    jacobian: ca.Function = field(init=False)
    slopes: ca.SX = field(init=False)

    def __post_init__(self) -> None:
        """Make the functions."""
        arguments = [self.x, self.p]
        slopes = ca.jacobian(self.g, self.x)
        object.__setattr__(self, "slopes", slopes)
        for name, value in (("rows", self.g), ("cost", self.f), ("jacobian", slopes)):
            object.__setattr__(self, name, ca.Function(name, arguments, [value]))

    def name(self, index: int) -> str:
        """Return the name of a variable for a message."""
        return self.source.name(index)

    def describe(self, row: int) -> str:
        """Return the description of a row of g for a message."""
        return f"constraint g[{row}]: {self.source.describe(row)}"


def read_nlp(source: OptiSource | NlpSource) -> GivenNlp:
    """Return an NLP as scalar SX expressions.

    Raises:
        InvalidProblemError: If it cannot be written in scalar SX.
    """
    function = source.function()
    try:
        expanded = function.expand()
    except RuntimeError as error:
        raise InvalidProblemError(
            "the NLP cannot be written in scalar SX, which the elimination of states "
            f"needs: {last_line(error)}"
        ) from error
    if expanded.find_functions():
        raise InvalidProblemError(
            "the NLP cannot be written in scalar SX, which the elimination of states "
            f"needs: it calls {_called(function)}; write the integrator's steps out "
            "(integrator('rk', ..., {'simplify': True}) does), and tables by "
            "casadi.pw_lin"
        )
    x = ca.SX.sym("x", function.numel_in(0))
    p = ca.SX.sym("p", function.numel_in(1))
    f, g = expanded(x, ca.reshape(p, function.size_in(1)))
    return GivenNlp(x=x, p=p, f=ca.densify(f), g=ca.densify(g), source=source)


def _called(function: ca.Function) -> str:
    """Return the names of called functions that are not plain expressions."""
    plain = ("MXFunction", "SXFunction", "Map", "MapSum", "MapAccum")
    inner = (f for f in function.find_functions() if f.class_name() not in plain)
    return ", ".join(sorted({f"{f.name()} ({f.class_name()})" for f in inner}))
