"""Newton's step of the interior-point lanes, and the measures of a point.

The recursion over intervals is compared with the dense system of the whole NLP, which
is made from the functions that IPOPT is given.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.interior import FIRST_RHO, Instances, _Chunk
from swarmstart.ocp.lanes.interior_newton import SUMS, TOPS
from swarmstart.ocp.lanes.interior_parts import Place
from swarmstart.ocp.lanes.interior_verdict import AIMED, ROUNDING, _Ends, _Judged
from swarmstart.ocp.lanes.kernels import Kernel
from swarmstart.ocp.nlp.nlp_assembly import inputs_of
from swarmstart.tests.ocp.lanes.dense import Barrier, Point, Rows
from swarmstart.tests.ocp.lanes.interior_problems import every_kind, posed

pytestmark = pytest.mark.usefixtures("compiler")

M, N, NX = 12, 4, 2
PLACES = "interval", "end", "begin"


class Case:
    """`every_kind` at random points, one for each lane.

    Attributes:
        numbers: What kernels read, by name, a column for each lane.
    """

    def __init__(self) -> None:
        """Start lanes, and move all that they keep by chance."""
        self.lanes = posed(every_kind()).lanes
        rng = np.random.default_rng(5)
        x0 = np.vstack([rng.uniform(-0.5, 0.5, M), np.zeros(M)])
        self.instances = Instances(x0, rng.uniform(1, 9, (1, M)), np.zeros((0, M)))
        self.made = self.lanes._made_for(False)
        self.shared = self.lanes._posed(self.instances)
        self.chunk = _Chunk(
            self.made, self.shared, self.instances, rng.uniform(-1, 1, (2, N, M)),
            rng.uniform(-0.5, 0.5, (1, M)), None, 1e-2, FIRST_RHO,
        )  # fmt: skip
        self.numbers = self._drawn(rng)
        heights = {name: self.place(name).walls.height for name in PLACES}
        program = self.lanes._program
        limits = program.limits(self.shared.sizes)
        self.barrier = Barrier(program, limits, Rows(**heights, nx=NX, N=N))
        self.sweep()

    def place(self, name: str) -> Place:
        """Return a part of the problem."""
        found = getattr(self.made.places, name)
        assert isinstance(found, Place)
        return found

    def _drawn(self, rng: np.random.Generator) -> dict[str, Array]:
        numbers = dict(self.chunk._numbers)
        bent = np.tile([0.03, 10.0], M // 2)
        for name in PLACES:
            prefix, count = ("", N) if name == "interval" else (f"{name}.", 1)
            # So little that slacks stay between their limits.
            for key, part in (("w", 1e-3), ("z", 0.5)):
                shape = numbers[f"{prefix}{key}"].shape
                factors = 1 + part * rng.uniform(-1, 1, shape)
                numbers[f"{prefix}{key}"] = numbers[f"{prefix}{key}"] * factors
            height = self.place(name).walls.height
            numbers[f"{prefix}m"] = bent * rng.normal(size=(count * height, M))
        xa = numbers["xa"] + 1e-3 * rng.normal(size=numbers["xa"].shape)
        numbers |= {
            "xa": xa,
            "x": np.vstack([numbers["x0"], xa[:-NX]]),
            "end": xa[-NX:],
        }
        numbers["lam"] = bent * rng.normal(size=(N * NX, M))
        numbers["mu"] = np.geomspace(1e-1, 1e-4, M)[None]
        numbers["rho"] = rng.uniform(1, 20, (1, M))
        numbers["delta"] = np.tile([0.0, 0.5, 5.0], M // 3)[None]
        zero = np.zeros((1, M))
        return numbers | {
            "nothing": zero, "theta": zero + 1e-9, "theta_least": zero + 1.0,
            "delta_last": zero, "sweeps": zero,
        }  # fmt: skip

    def evaluate(self, kernels: Sequence[Kernel]) -> None:
        """Evaluate some kernels, each of which adds its numbers."""
        for kernel in kernels:
            self.numbers |= self.chunk._evaluated(kernel, self.numbers)

    def sweep(self) -> None:
        """Compute the step of all lanes."""
        kernels = self.made.kernels
        self.evaluate(
            [kernels.last, kernels.backward, kernels.start, kernels.along, kernels.aim]
        )

    def point(self, lane: int, numbers: dict[str, Array] | None = None) -> Point:
        """Return the point of a lane as one of the dense problem."""
        at = {k: v[:, lane] for k, v in (numbers or self.numbers).items()}
        sizes = self.shared.sizes
        program = self.lanes._program
        q = program.arguments(
            self.instances.x0[:, lane], self.instances.parameters[:, lane],
            np.zeros(0), sizes,
        )  # fmt: skip
        return Point(
            barrier=self.barrier, q=q, v=self.variables(at), m=self.multipliers(at),
            z=self.duals(at), mu=at["mu"][0], rho=at["rho"][0], delta=at["delta"][0],
            unit=at["end.unit"][0],
        )  # fmt: skip

    def variables(self, at: dict[str, Array], d: str = "") -> Array:
        """Return v, or its step, of a lane."""
        u, xa = at[f"{d}u"].reshape(N, -1), at[f"{d}xa"].reshape(N, -1)
        return np.concatenate([
            np.hstack([u, xa]).ravel(), at[f"{d}y"],
            at[f"{d}w"], at[f"{d}end.w"], at[f"{d}begin.w"],
        ])  # fmt: skip

    @staticmethod
    def multipliers(at: dict[str, Array], d: str = "") -> Array:
        """Return the multipliers of a lane in the order of the NLP's rows."""
        lam, m = at[f"{d}lam"].reshape(N, -1), at[f"{d}m"].reshape(N, -1)
        inner = np.hstack([lam, m]).ravel()
        return np.concatenate([inner, at[f"{d}end.m"], at[f"{d}begin.m"]])

    def duals(self, at: dict[str, Array], d: str = "") -> tuple[Array, Array]:
        """Return the duals of lower and upper bounds of v of a lane."""
        nu = inputs_of(self.lanes.problem)
        own = [np.zeros((2, N, nu + NX)), np.zeros((2, 0)), np.zeros((2, 1))]
        inner = list[Array]()
        for name, found in zip(PLACES, own, strict=True):
            prefix, count = ("", N) if name == "interval" else (f"{name}.", 1)
            walls = self.place(name).walls
            each = at[f"{d}{prefix}z"].reshape(count, -1)
            both = np.zeros((2, count, walls.pairs.size))
            for k, (entry, sign) in enumerate(
                zip(walls.pairs.of, walls.pairs.sign, strict=True)
            ):
                both[int(sign < 0), :, entry] = each[:, k]
            # Those of an interval are (xa, u), those of the NLP (u, xa).
            order = [*range(NX, NX + nu), *range(NX)] if name == "interval" else [0]
            size = walls.own.size
            found[...] = both[:, :, :size][:, :, order[:size]].reshape(found.shape)
            inner.append(both[:, :, size:].reshape(2, -1))
        low, high = np.hstack([own[0].reshape(2, -1), *own[1:], *inner])
        return low, high


@pytest.fixture(scope="module")
def case() -> Case:
    """Some lanes at random points, with their steps."""
    return Case()


def column(case: Case, lane: int) -> dict[str, Array]:
    return {name: one[:, lane] for name, one in case.numbers.items()}


def right(case: Case) -> list[int]:
    """Return the lanes whose step is one of descent."""
    return np.flatnonzero(case.numbers["wrong"][0] <= 0).tolist()


def test_step_is_wrong_exactly_if_the_reduced_hessian_is_not_positive(
    case: Case,
) -> None:
    wrong = case.numbers["wrong"][0] > 0
    least = np.array([case.point(lane).reduced.min() for lane in range(M)])
    np.testing.assert_array_equal(wrong, least <= 0)
    assert 3 <= wrong.sum() <= M - 5


def test_step_solves_the_dense_system_of_the_whole_problem(case: Case) -> None:
    for lane in right(case):
        at, point = column(case, lane), case.point(lane)
        step, after = point.newton
        size = np.abs(step).max()
        np.testing.assert_allclose(
            case.variables(at, "d."), step, rtol=1e-6, atol=1e-7 * size
        )
        np.testing.assert_allclose(
            case.multipliers(at) + case.multipliers(at, "d."), after,
            rtol=1e-6, atol=1e-7 * np.abs(after).max(),
        )  # fmt: skip
        np.testing.assert_allclose(at["d.x0"], [0, at["d.y"][0]])
        np.testing.assert_array_equal(at["d.end"], at["d.xa"][-NX:])


def test_duals_and_lengths_go_with_the_step(case: Case) -> None:
    for lane in right(case):
        at, point = column(case, lane), case.point(lane)
        for found, wanted, z in zip(
            case.duals(at, "d."), point.dual_steps, point.z, strict=True
        ):
            has = z > 0
            np.testing.assert_allclose(
                found[has], wanted[has], rtol=1e-5, atol=1e-6 * np.abs(found).max()
            )
        primal, dual = point.longest
        assert at["aim.alpha"][0] == pytest.approx(primal, rel=1e-5)
        assert at["aim.alpha_dual"][0] == pytest.approx(dual, rel=1e-5)
        gain = point.barrier_slope @ point.newton[0]
        assert at["aim.gain"][0] == pytest.approx(gain, rel=1e-5)


def test_wrong_step_is_not_tried_but_bent_more(case: Case) -> None:
    wrong = case.numbers["wrong"][0] > 0
    delta, after = case.numbers["delta"][0], case.numbers["aim.delta"][0]
    np.testing.assert_array_equal(case.numbers["aim.tries"][0], ~wrong)
    np.testing.assert_array_equal(after[~wrong], delta[~wrong])
    assert (after[wrong] > delta[wrong]).all()
    assert (case.numbers["aim.alpha"][0, wrong] == 0).all()


def test_measures_are_those_of_the_dense_problem(case: Case) -> None:
    """At the point after a part of the step."""
    alpha, alpha_dual = (0.7 * case.numbers[f"aim.{n}"] for n in AIMED[2:4])
    numbers = case.numbers
    case.numbers = numbers | {
        "alpha": alpha, "alpha_dual": alpha_dual, "nothing.x": np.zeros((NX, M)),
        "nothing.force": np.zeros((NX, M)), "nothing.sums": np.zeros((len(SUMS), M)),
        "nothing.tops": np.zeros((len(TOPS), M)),
    }  # fmt: skip
    case.evaluate([case.made.kernels.move, case.made.kernels.trial])
    ends = _Ends(case.made.places)
    known = {n: o for p in ("end", "begin") for n, o in case.place(p).known.items()}
    known = {n: o for n, o in known.items() if n not in ends.reads}
    symbols = {**ends.reads, **known}
    function = ca.Function("ends", [*symbols.values()], [ends.sums, ends.tops])
    shared = case.chunk._shared
    for lane in right(case):
        at = column(case, lane)
        given = [at.get(n, shared.get(n)) for n in symbols]
        found = np.concatenate([np.asarray(one).ravel() for one in function(*given)])
        moved = {
            name: one
            + (alpha_dual if name.split(".")[-1] == "z" else alpha)
            * case.numbers[f"d.{name}"]
            for name, one in case.numbers.items()
            if f"d.{name}" in case.numbers
        }
        wanted = case.point(lane, case.numbers | moved).measures()
        for name, number in zip((*SUMS, *TOPS), found, strict=True):
            assert number == pytest.approx(wanted[name], rel=1e-8, abs=1e-10), name
    case.numbers = numbers


@pytest.mark.parametrize(
    ("now", "trial", "taken", "extends"),
    [
        # By the cost: theta is small, and the slope is steep.
        ({"theta": 1e-9}, (1e-6, -0.6), True, False),
        ({"theta": 1e-9}, (1e-6, 0.1), False, False),
        # The slope leads up, so theta or phi must fall.
        ({"theta": 0.5, "gain": 1.0}, (0.4, 9.0), True, True),
        ({"theta": 0.5, "gain": 1.0}, (0.6, -1.0), True, True),
        ({"theta": 0.5, "gain": 1.0}, (0.6, 1.0), False, False),
        # Where theta is large a descent of the cost is one of the two ways.
        ({"theta": 5.0}, (4.0, 2.0), True, True),
        ({"theta": 5.0}, (6.0, 2.0), False, False),
        # The filter has a point that is as good in both.
        ({"theta": 0.5, "gain": 1.0, "filter_theta": 0.3, "filter_phi": -2.0},
         (0.4, -1.0), False, False),
        ({"theta": 0.5, "gain": 1.0, "filter_theta": 0.3, "filter_phi": -0.5},
         (0.4, -1.0), True, True),
        # Theta is never larger than a limit; nothing is taken with a step of 0.
        ({"theta": 5.0, "theta_most": 3.0}, (4.0, -1.0), False, False),
        ({"theta": 1e-9, "alpha": 0.0}, (1e-9, -1.0), False, False),
        # A start is taken if it is finite.
        ({"theta": 1e-9, "begun": 0.0}, (9.0, 9.0), True, False),
        ({"theta": 1e-9, "begun": 0.0}, (9.0, np.nan), False, False),
    ],
)  # fmt: skip
def test_trials_are_taken_as_the_filter_says(
    case: Case, now: dict[str, float], trial: tuple[float, float], taken: bool,
    extends: bool,
) -> None:  # fmt: skip
    """With phi = 0 before, and a change of -1 with the whole step, unless said."""
    ends = _Ends(case.made.places)
    judged = _Judged(ends, 1e-8, 100, 1, ROUNDING)
    theta, phi = ca.SX.sym("theta_new"), ca.SX.sym("phi_new")
    given = {
        "alpha": 0.5, "gain": -1.0, "theta_least": 1e-4, "theta_most": 1e4,
        "begun": 1.0, "filter_theta": 1e300, "filter_phi": 1e300, **now,
    }  # fmt: skip
    known = {n: o for p in ("end", "begin") for n, o in case.place(p).known.items()}
    symbols = {**known, **ends.reads}
    function = ca.Function(
        "accepted", [*symbols.values(), theta, phi], [*judged._accepted(theta, phi)]
    )
    numbers = [
        np.full(one.shape, given.get(name, 0.0)) for name, one in symbols.items()
    ]
    found = function(*numbers, *trial)
    assert [bool(one) for one in found] == [taken, extends]
