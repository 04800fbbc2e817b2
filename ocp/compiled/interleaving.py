"""How many vectors of individuals go through a kernel side by side.

A processor starts two vector operations a cycle but has each result only some cycles
later. Where every operation of a tape waits for the one before it, as in the steps of
an integrator of one equation, it idles; a second and a third vector of individuals fill
the gaps. Where a tape has much to do at a time, they only crowd the registers.
"""

from collections.abc import Iterable

from swarmstart.tape import Tape

# (instructions, cycles until the result is there), round numbers for recent x86 cores;
# a division keeps its unit busy as long as this many instructions take.
SIMPLE = (1, 4)
COSTS = {
    "div": (24, 24),
    "inv": (24, 24),
    "sqrt": (32, 30),
    "sin": (15, 70),
    "cos": (15, 70),
    "exp": (22, 75),
    "log": (50, 100),
    "tanh": (85, 160),
    "atan": (75, 110),
    "atan2": (110, 140),
    "pow": (140, 330),
    "constpow": (140, 330),
}
FREE = ("constant", "input", "neg", "twice")
STARTED_A_CYCLE = 2
LOOK_AHEAD = 1.7
"""How far beyond one operation after the other a core gets by itself."""
MOST = 4


def side_by_side(tapes: Iterable[Tape], *, registers: int) -> int:
    """Return 1, 2 or 4: how many times a vector's lanes a kernel should take at once.

    Args:
        tapes: What the kernel computes, one after the other.
        registers: Registers that one vector needs.
    """
    tapes = tuple(tapes)
    busy = sum(_work(tape) for tape in tapes) * registers / STARTED_A_CYCLE
    waiting = sum(_depth(tape) for tape in tapes)
    times = 1
    while times < MOST and waiting > LOOK_AHEAD * times * busy:
        times *= 2
    return times


def _cost(operation: str) -> tuple[int, int]:
    return (0, 0) if operation in FREE else COSTS.get(operation, SIMPLE)


def _work(tape: Tape) -> int:
    return sum(_cost(node.operation)[0] for node in tape.nodes)


def _depth(tape: Tape) -> int:
    """Return the cycles of the longest chain of operations."""
    ready: list[int] = []
    for node in tape.nodes:
        known = () if node.operation == "input" else node.arguments
        begin = max((ready[a] for a in known), default=0)
        ready.append(begin + _cost(node.operation)[1])
    return max(ready, default=0)
