"""Digests of short runs and solves, to show that a change of shape changes no result.

    python benchmarks/same_bits.py --write before.json     before the change
    python benchmarks/same_bits.py --against before.json   after it

20 short runs, of the chapter's scenarios in both variants, and 30 solves. A
digest is that of every number of the answer, bit for bit, but for wall times. Digests
differ between machines and versions of the libraries, so they are not kept.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import swarmstart as ss
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.trajectory_arrays import trajectory_arrays

FLIGHTS = ("formation_v", "formation_obstacle", "close_formation", "reconfiguration")
"""Scenarios of the chapter, run in both variants, with two searches."""
SOLVED = (
    *("pendulum", "van_der_pol", "double_integrator", "passing_side", "bryson_denham"),
    *("catalyst_mixing", "two_reaction_reactor", "brachistochrone", "hypersensitive"),
    *("lotka_volterra_fishing", "goddard_rocket", "race_car", "two_stage_launch"),
    *("lynx_and_hares", "bifunctional_catalyst"),
)
SHORT = {"swap_5": 1, "two_drones": 3, "pendulum_on_cart": 4, "stirred_tank": 3}
TIMES = ("step_seconds", "seconds", "wall_s", "compile_seconds")


def digest(values: Mapping[str, Any]) -> str:
    """Return the digest of named arrays and numbers."""
    made = hashlib.sha256()
    for name in sorted(values):
        if not any(part in name for part in TIMES):
            array = np.asarray(values[name])
            made.update(f"{name} {array.shape} {array.dtype}".encode())
            made.update(array.tobytes() if array.dtype != object else b"")
    return made.hexdigest()[:16]


def runs() -> Iterator[tuple[str, str]]:
    """Yield name and digest of short runs."""
    for name in FLIGHTS:
        for variant in ("literal", "corrected"):
            for search in ("cpso", "lshade"):
                yield _run(f"{name} {variant} {search}", name, 2, variant, search)
    for name, steps in SHORT.items():
        yield _run(name, name, steps, None, None)


def _run(
    title: str, name: str, steps: int, variant: str | None, search: str | None
) -> tuple[str, str]:
    options: dict[str, Any] = {}
    if variant is not None:
        options["variant"] = variant
    if search is not None:
        options["search"] = search
    settings = {"steps": steps} if steps > 1 else {}
    run = ss.run(name, seed=1, settings=settings, **options)
    numbers = {key: value for key, value in run.measures.items() if value is not None}
    return title, digest({**trajectory_arrays(run.trajectory), **numbers})


def solves() -> Iterator[tuple[str, str]]:
    """Yield name and digest of solves."""
    for name in SOLVED:
        posed = first_problem(resolve(read_document(name)).posed())
        for seed in (0, 1):
            found = ss.solve(
                posed.problem, posed.x0, known=posed.known, seed=seed, lanes=16,
                budget=ss.Budget(evaluations=2000),
            )  # fmt: skip
            yield (
                f"{name} seed {seed}",
                digest(
                    {
                        "states": found.path.states,
                        "controls": found.controls,
                        "cost": found.cost,
                        "violation": found.violation,
                        "status": found.status.name,
                        "optima": [one.cost for one in found.optima],
                    }
                ),
            )


def main() -> int:
    """Compute the digests; write them, or compare them with those written before."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", type=Path, help="a JSON file to write")
    parser.add_argument("--against", type=Path, help="a JSON file to compare with")
    options = parser.parse_args()
    found = dict([*runs(), *solves()])
    print(f"{len(found)} digests")
    if options.write:
        options.write.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if not options.against:
        return 0
    before = json.loads(options.against.read_text(encoding="utf-8"))
    changed = [name for name in before if before[name] != found.get(name)]
    print("\n".join(["changed:", *changed]) if changed else "the same bits")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
