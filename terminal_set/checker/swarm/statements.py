"""The statements of a certificate of a swarm's flight, proven again one by one.

No code is shared with the program that made the certificate: neither the test of the
rule by which vehicles commit to plans nor the test of distances. A refusal names
vehicles and steps.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from swarmstart.terminal_set.checker.findings import (
    Deadline,
    Finding,
    TimeIsUpError,
    Verdict,
)
from swarmstart.terminal_set.checker.swarm.certificate_file import (
    STATEMENTS,
    Certificate,
    Plan,
    Tube,
)
from swarmstart.terminal_set.checker.swarm.separation import separated

Steps = NDArray[np.int64]
BEGINS, APART, CLEARANCE, ACCEPTED = STATEMENTS


class RefusedError(Exception):
    """A statement is false, or is not proven."""


def findings(certificate: Certificate, *, seconds: float) -> Iterator[Finding]:
    """Judge a certificate, statement by statement.

    Args:
        certificate: The statements of the file.
        seconds: Time for all statements [s].

    Yields:
        A finding for each statement; after a refusal no more.
    """
    deadline = Deadline.after(seconds)
    held = _held(certificate)
    try:
        for statement, check in (
            (BEGINS, _check_beginnings),
            (APART, _check_distances),
            (CLEARANCE, _check_clearances),
            (ACCEPTED, _check_acceptances),
        ):
            check(certificate, held, deadline)
            yield Finding(Verdict.PROVED, statement)
    except RefusedError as error:
        yield Finding(Verdict.REFUSED, f"{statement}: {error}")
    except TimeIsUpError:
        text = "the rest: time was up before it could be judged"
        yield Finding(Verdict.UNDECIDED, text)


def verdict(certificate: Certificate) -> str:
    """Return the verdict in words, if all statements hold."""
    return (
        f"no two of {certificate.vehicles} vehicles that follow their plans come "
        f"nearer than {certificate.distance:.6g} in scaled positions, for ever"
    )


Held = list[list[Plan]]
"""For each vehicle the plans that it was committed to, in order."""


def _held(certificate: Certificate) -> Held:
    held: Held = [[] for _ in range(certificate.vehicles)]
    for plan in sorted(
        (one for one in certificate.plans if one.committed), key=lambda one: one.ended
    ):
        held[plan.vehicle].append(plan)
    return held


def _check_beginnings(certificate: Certificate, held: Held, deadline: Deadline) -> None:
    """Check that no commitment makes a jump, and that none comes after its parting."""
    for number, plans in enumerate(held):
        deadline.check()
        if plans[0].tube.first > 0:
            raise RefusedError(f"vehicle {number} has no plan at the start")
        for before, after in itertools.pairwise(plans):
            reason = _break(before, after, certificate.ticks)
            if reason:
                step = after.ended // certificate.ticks
                raise RefusedError(f"vehicle {number} at step {step}: {reason}")


def _break(before: Plan, after: Plan, ticks: int) -> str:
    """Return why a plan does not go on from the one before; empty if it does."""
    step = after.ended // ticks
    if before.ended >= after.ended:
        return "two plans are committed to at once"
    if max(before.tube.first, after.tube.first) > min(step, after.tube.first):
        return "a plan begins later"
    if after.ended + 1 > after.parting * ticks:
        return "the plan is committed to after it parts from the one before"
    steps = np.arange(after.tube.first, after.parting + 1)
    (old, its), (new, other) = before.tube.at(steps), after.tube.at(steps)
    if not (old == new).all() or not (its[:-1] == other[:-1]).all():
        return "the plan leaves the one before earlier than they part"
    return ""


def _end(certificate: Certificate) -> int:
    """Return a step from which on all plans and obstacles stay in place."""
    tubes = [plan.tube for plan in certificate.plans if plan.committed]
    tubes += [tube for _, tube in certificate.obstacles]
    return max(certificate.steps, *(tube.last for tube in tubes))


def _tubes(certificate: Certificate, held: Held) -> Iterator[tuple[int, list[Tube]]]:
    """Yield each step with the tubes that are followed until the next."""
    places = [0] * len(held)
    for step in range(_end(certificate) + 1):
        for number, plans in enumerate(held):
            while places[number] + 1 < len(plans):
                # Both plans are the same until they part, which is a step later.
                if plans[places[number] + 1].ended >= (step + 1) * certificate.ticks:
                    break
                places[number] += 1
        yield (
            step,
            [plans[place].tube for plans, place in zip(held, places, strict=True)],
        )


def _pieces(tubes: list[Tube], step: int) -> tuple[NDArray[np.float64], ...]:
    """Return beginnings, ends and bulges of the pieces from a step on."""
    steps = np.array([step, step + 1])
    at = [tube.at(steps) for tube in tubes]
    samples = np.array([one for one, _ in at])
    return samples[:, 0], samples[:, 1], np.array([bulges[0] for _, bulges in at])


def _check_distances(certificate: Certificate, held: Held, deadline: Deadline) -> None:
    """Check all pairs of vehicles in all steps, the last of which is for ever."""
    one, other = np.triu_indices(certificate.vehicles, 1)
    for step, tubes in _tubes(certificate, held):
        deadline.check()
        begins, ends, bulges = _pieces(tubes, step)
        apart = separated(
            begins[one] - begins[other],
            ends[one] - ends[other],
            certificate.distance + bulges[one] + bulges[other],
        )
        if not apart.all():
            worst = int(np.flatnonzero(~apart)[0])
            raise RefusedError(
                f"vehicles {one[worst]} and {other[worst]} at step {step}"
            )


def _check_clearances(certificate: Certificate, held: Held, deadline: Deadline) -> None:
    """Check all vehicles against all obstacles in all steps."""
    if not certificate.obstacles:
        return
    clearances = np.array([clearance for clearance, _ in certificate.obstacles])
    obstacles = [tube for _, tube in certificate.obstacles]
    if any(tube.first > 0 for tube in obstacles):
        raise RefusedError("an obstacle has no path at the start")
    for step, tubes in _tubes(certificate, held):
        deadline.check()
        begins, ends, bulges = _pieces(tubes, step)
        come, go, theirs = _pieces(obstacles, step)
        apart = separated(
            begins[:, None] - come,
            ends[:, None] - go,
            clearances + bulges[:, None] + theirs,
        )
        if not apart.all():
            vehicle, obstacle = np.argwhere(~apart)[0]
            raise RefusedError(
                f"vehicle {vehicle} and obstacle {obstacle} at step {step}"
            )


def _check_acceptances(
    certificate: Certificate, held: Held, deadline: Deadline
) -> None:
    """Check that each commitment was accepted by all, and that they might accept it.

    No acceptance is needed of a vehicle that had committed to its last plan before.
    """
    proposed: Held = [[] for _ in range(certificate.vehicles)]
    for plan in certificate.plans:
        proposed[plan.vehicle].append(plan)
    for plan in certificate.plans[certificate.vehicles :]:
        if not plan.committed:
            continue
        for other, tick in enumerate(plan.accepted):
            deadline.check()
            if other == plan.vehicle:
                continue
            who = f"the plan of vehicle {plan.vehicle} of tick {plan.proposed}"
            known = _known(plan, tick, proposed[other], held[other])
            if known is None:
                raise RefusedError(f"{who} was not accepted in time by {other}")
            inside, since = known
            if not _clear(plan, inside, since // certificate.ticks, certificate):
                raise RefusedError(f"{who} is in the way of vehicle {other}")


def _known(
    plan: Plan, tick: int | None, proposed: list[Plan], held: list[Plan]
) -> tuple[list[Plan], int] | None:
    """Return another vehicle's plans of which a plan must be clear, and from when.

    None if that vehicle has not accepted it in time, and may have proposed later.

    Args:
        plan: The plan, which is committed to.
        tick: Tick of the acceptance, if there was one.
        proposed: All plans of the other vehicle.
        held: Plans that the other vehicle was committed to.
    """
    # A message takes a tick at least, there and back.
    if tick is not None and plan.proposed < tick < plan.ended:
        return [one for one in proposed if _is_known(one, held, tick)], tick
    if all(one.ended < plan.ended for one in proposed):
        return held[-1:], plan.ended
    return None


def _is_known(one: Plan, held: list[Plan], tick: int) -> bool:
    """Return whether a plan was committed to or a candidate when another was accepted.

    A vehicle accepts before it commits in the same tick; a candidate that it withdraws
    then may have given way.
    """
    if one.committed:
        latest = [p for p in held if p.ended < tick]
        if latest and latest[-1] is one:
            return True
    if not one.proposed < tick:
        return False
    return one.ended > tick or (one.ended == tick and one.committed)


def _clear(plan: Plan, others: list[Plan], step: int, certificate: Certificate) -> bool:
    """Return whether a plan is clear of others from a step on, for ever."""
    if any(one.tube.first > step for one in (plan, *others)):
        return False
    last = max(one.tube.last for one in (plan, *others))
    steps = np.arange(step, max(step, last) + 2)
    place, bulge = plan.tube.at(steps)
    for other in others:
        its, its_bulge = other.tube.at(steps)
        apart = separated(
            (place - its)[:-1],
            (place - its)[1:],
            (certificate.distance + bulge + its_bulge)[:-1],
        )
        if not apart.all():
            return False
    return True
