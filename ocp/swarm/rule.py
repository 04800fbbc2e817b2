"""Rule by which vehicles replace plans that they have committed to, and never collide.

Vehicle i has a committed plan P_i and at most one candidate C_i. It broadcasts both,
and which candidates of others it accepts; messages may be late, lost, doubled, or out
of order.

    (a) i proposes C_i if C_i is clear of what i has heard last from the others.
    (b) j accepts C_i if C_i is clear of P_j and C_j now. If C_j alone is in the way and
        gives way, j withdraws C_j for good first.
    (c) i commits to C_i (P_i := C_i) when each j either has accepted C_i, or is known
        to have committed to its final plan (see d) and C_i is clear of that plan. Or i
        withdraws C_i for good. It must have done one of the two before C_i parts from
        P_i.
    (d) A plan may be a vehicle's final one: the vehicle proposes nothing once it has
        committed to that plan.

Claim: committed plans are clear of each other at all times.

Proof. Let i commit to C_i at t. If i has heard that j has committed to its final plan,
that plan is P_j(t) by (d), and clear of C_i by (c). Otherwise j has accepted C_i at
s <= t, and P_j(t) is one of three plans: P_j(s); or C_j(s), if j kept that candidate;
both are clear of C_i by (b). Or, third, a plan that j proposed after s and committed to
by t. When j committed to it, i had not committed to its final plan, by (d), since C_i
was still its candidate at t. So j needed i's acceptance, which i gave at some s' in
(s, t]. C_i was i's candidate then, since j had accepted it before, at s. By (b), P_j(t)
is clear of C_i.

So (a) and the messages heard decide how often vehicles agree, never whether they
collide; the same holds for the order in which candidates give way, which may change at
will. A vehicle may forget all but its committed plan and the number of its next
candidate, since candidates may always be withdrawn. It may also fall silent for ever;
unless it has committed to its final plan, the others then keep their committed plans.
The plan of a vehicle that leaves counts as clear of every plan (`GONE` in plans.py).
What is needed: all vehicles are known, they agree on the time, no number of a candidate
is used twice, and a message is what its sender sent.

Source of the parts: Tordesillas and How (2022), MADER, IEEE Transactions on Robotics
38, and Kondo et al. (2023), Robust MADER, ICRA (checks against committed plans and
candidates, with a bound on delays, which this rule does not need).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.machine_code import Count, kernel
from swarmstart.ocp.swarm.plans import GONE, Plans, may_meet

Flags = NDArray[np.bool_]
NONE = -1
"""Number of a candidate that does not exist."""

WAITING, COMMITTED, WITHDRAWN = range(3)
"""Results of `settle`."""


class Members(NamedTuple):
    """Memories of n vehicles; each reads and writes its own row only.

    Attributes:
        committed: Rows of their committed plans, shape (n,).
        candidate: Rows of their candidates, or NONE, shape (n,).
        accepted: [j, i]: candidate of i that j accepts, or NONE, shape (n, n).
        number: [j, i]: number of i's newest message that j has, shape (n, n); -1: none.
        heard_committed: [j, i]: committed plan of i in that message, shape (n, n).
        heard_candidate: [j, i]: candidate of i in that message, shape (n, n).
        heard_accepted: [j, i]: candidate of j that i accepts in that message, shape (n,
            n).
    """

    committed: Count
    candidate: Count
    accepted: Count
    number: Count
    heard_committed: Count
    heard_candidate: Count
    heard_accepted: Count


def members_at(rows: Count) -> Members:
    """Return memories of vehicles with committed plans that have heard nothing yet.

    Args:
        rows: Rows of their committed plans, shape (n,).
    """
    n = rows.size
    none = np.full((n, n), NONE, np.int64)
    return Members(
        committed=np.array(rows, np.int64),
        candidate=np.full(n, NONE, np.int64),
        accepted=none,
        number=none.copy(),
        heard_committed=none.copy(),
        heard_candidate=none.copy(),
        heard_accepted=none.copy(),
    )


@kernel
def hear(j: int, i: int, number: int, message: Count, members: Members) -> None:
    """Let vehicle j keep a message of i if it is newer than what it has of i.

    Args:
        j: Number of the receiver.
        i: Number of the sender.
        number: Number of the message, larger than those of i's earlier ones.
        message: i's committed plan, its candidate, and the candidate of j that i
            accepts, shape (3,).
        members: The vehicles; row j is written.
    """
    if number > members.number[j, i]:
        members.number[j, i] = number
        members.heard_committed[j, i] = message[0]
        members.heard_candidate[j, i] = message[1]
        members.heard_accepted[j, i] = message[2]


@kernel
def answer(
    j: int, step: int, radius: float, rank: Count, members: Members, plans: Plans
) -> bool:
    """Let vehicle j accept candidates that it has heard of, by rule (b) of the module.

    It accepts a candidate C_i of vehicle i that is clear of its committed plan and of
    its own candidate C_j. If only C_j is in the way and gives way, j withdraws it. The
    result says whether C_j was withdrawn.

    Args:
        j: Number of the vehicle.
        step: Number of the present time.
        radius: Least distance of two plans [m], scaled.
        rank: C_j gives way to C_i if rank[i] < rank[j], shape (n,).
        members: The vehicles; row j is written.
        plans: All plans of the vehicles, each a row.
    """
    withdrew = False
    for i in range(members.committed.size):
        heard = members.heard_candidate[j, i]
        if i == j or heard in (NONE, members.accepted[j, i]):
            continue
        if may_meet(heard, members.committed[j], step, radius, plans):
            continue
        own = members.candidate[j]
        if own != NONE and may_meet(heard, own, step, radius, plans):
            if not rank[i] < rank[j]:
                continue
            members.candidate[j] = NONE
            withdrew = True
        members.accepted[j, i] = heard
    return withdrew


@kernel
def is_clear(
    i: int, plan: int, step: int, radius: float, members: Members, plans: Plans
) -> bool:
    """Return whether vehicle i may propose a plan, by rule (a) of the module.

    The plan must be clear of all plans and candidates of others that i has heard last.
    Nothing is written.

    Args:
        i: Number of the vehicle.
        plan: Row of the plan.
        step: Number of the present time.
        radius: Least distance of two plans [m], scaled.
        members: Memories of the vehicles.
        plans: All plans of the vehicles, each a row.
    """
    for j in range(members.committed.size):
        if j == i:
            continue
        if members.number[i, j] < 0:  # Nothing is known of it.
            return False
        if may_meet(plan, members.heard_committed[i, j], step, radius, plans):
            return False
        heard = members.heard_candidate[i, j]
        if heard != NONE and may_meet(plan, heard, step, radius, plans):
            return False
    return True


@kernel
def settle(
    i: int, now: tuple[int, bool], radius: float, members: Members, plans: Plans,
    is_last: Flags,
) -> int:  # fmt: skip
    """Commit vehicle i to its candidate or withdraw it, by rule (c) of the module.

    It commits if each other vehicle has accepted the candidate, has left, or is known
    to have committed to its last plan, of which the candidate is clear. Otherwise it
    waits, or withdraws the candidate if that is about to part from the committed plan.
    The result is COMMITTED, WAITING or WITHDRAWN.

    Args:
        i: Number of the vehicle.
        now: Number of the present time, and whether it is the last one before the
            vehicle's candidate parts from its committed plan.
        radius: Least distance of two plans [m], scaled.
        members: The vehicles; row i is written.
        plans: All plans of the vehicles, each a row.
        is_last: Whether each plan is the last one of its vehicle, shape (rows,).
    """
    step, is_parting = now
    candidate = members.candidate[i]
    if candidate == NONE:
        return WITHDRAWN
    agreed = True
    for j in range(members.committed.size):
        if j == i or members.heard_accepted[i, j] == candidate:
            continue
        heard = members.heard_committed[i, j]
        agreed &= heard == GONE or (
            heard >= 0
            and is_last[heard]
            and not may_meet(candidate, heard, step, radius, plans)
        )
    if agreed:
        members.committed[i] = candidate
    if agreed or is_parting:
        members.candidate[i] = NONE
    if agreed:
        return COMMITTED
    return WITHDRAWN if is_parting else WAITING
