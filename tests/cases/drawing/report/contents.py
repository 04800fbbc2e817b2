"""Contents of comparisons, made up: the shape of the record, no solver's numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

NAMES = (
    "repeated-ipopt", "lshade+ipopt", "lshade", "de", "cpso", "ga", "pso", "jde",
    "memetic+ipopt", "ipopt", "cma[sigma=0.3]+ipopt", "random-search",
)  # fmt: skip
HOSTILE = (
    "<script>alert(1)</script>\"'`|\\_$%&#{}~^\x00\x07\u202eabc\u200f\ud800 "
    "]]> --> {{ 7*7 }} " + "x" * 5000
)


def content(  # noqa: PLR0913
    *,
    solvers: int = 4,
    scenarios: int = 2,
    seeds: int = 10,
    sense: int = 1,
    feasible: float = 0.9,
    flights: bool = False,
    nulls: bool = False,
    regression: bool = False,
    marks: int = 40,
) -> dict[str, Any]:
    """Return a content with schema 2."""
    rng = np.random.default_rng(7)
    names = NAMES[:solvers]
    parts = [
        _scenario(rng, k, names, seeds=seeds, sense=sense, feasible=feasible,
                  flights=flights, nulls=nulls, marks=marks)
        for k in range(scenarios)
    ]  # fmt: skip
    ratios = np.geomspace(1, 100, marks).tolist()
    curves = {}
    for k, name in enumerate(names):
        share = np.minimum(1, np.linspace(0.1, 1.2, marks) * (1 - 0.06 * k))
        curves[name] = {
            "share": share.tolist(),
            "low": (share * 0.85).tolist(),
            "high": np.minimum(1, share * 1.1).tolist(),
        }
    has_ranks = scenarios > 1 and not nulls
    return {
        "schema": 2,
        "record": "comparison",
        "headline": f"{names[0]} comes within 1 % of the best cost known in 9 of 10 "
        f"runs; no other is shown to be cheaper on any of {scenarios} scenarios.",
        "command": f"swarmstart compare passing_side --solvers {','.join(names)} "
        f"--seeds {seeds} --budget '4000evals|2s'",
        "budget": {"evaluations": 4000, "seconds": 2.0},
        "budget_text": "4000evals|2s",
        "seeds": list(range(seeds)),
        "near": [0.01, 0.0001],
        "date": "2026-11-23T11:30:00Z",
        "machines": [
            {"processor": "x86_64", "cores": 2, "system": "Linux 6.1",
             "python": "3.11.9"}
        ],
        "versions": {"swarmstart": "0.1.0", "casadi": "3.7.2", "numpy": "2.1.0"},
        "load_max": None if nulls else 3.2,
        "is_noisy": not nulls,
        "total_seconds": 1234.5,
        "solvers": [
            {"name": name, "title": f"what {name} is", "deterministic": name == "ipopt"}
            for name in names
        ],
        "scenarios": parts,
        "profile": {"quantity": "evaluations", "ratios": ratios, "curves": curves}
        if has_ranks
        else None,
        "ranks": [
            {"solver": name, "mean": 1.0 + k * 0.7, "low": max(1.0, 0.4 + 0.7 * k),
             "high": 1.8 + 0.8 * k}
            for k, name in enumerate(names)
        ]
        if has_ranks
        else [],
        "limits": [
            "One machine, busy with other work.",
            "The best cost known is only the best one found here.",
        ],
        "regression": _regression(parts, names) if regression else None,
    }  # fmt: skip


def hostile() -> dict[str, Any]:
    """Return a content whose every text of a user attacks the page."""
    given = content(solvers=3, scenarios=2, seeds=3, flights=False, regression=True)

    def attacked(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {
                (HOSTILE + k if key in ("curves", "versions") else k): attacked(v, k)
                for k, v in value.items()
            }
        if isinstance(value, list):
            return [attacked(one, key) for one in value]
        if isinstance(value, str) and key not in ("quantity", "verdict"):
            return HOSTILE + value
        return value

    return attacked(given)  # type: ignore[no-any-return]


def _bound(best: float, sense: int) -> dict[str, Any]:
    return {
        "value": best - 5,
        "kind": "proven",
        "gap": 5 / abs(best),
        "words": f"{sense * (best - 5):g} proven; the optimum is at most 5 away",
    }


def _scenario(  # noqa: PLR0913
    rng: np.random.Generator,
    place: int,
    names: tuple[str, ...],
    *,
    seeds: int,
    sense: int,
    feasible: float,
    flights: bool,
    nulls: bool,
    marks: int,
) -> dict[str, Any]:
    best = float(400 + 100 * place) * (1 if sense == 1 else -1)
    rows = [
        _row(rng, k, name, best=best, seeds=seeds, feasible=feasible,
             flights=flights, nulls=nulls, marks=marks)
        for k, name in enumerate(names)
    ]  # fmt: skip
    is_any = any(row["feasible"] for row in rows)
    time = np.linspace(0, 12, 61)
    return {
        "name": f"passing_side_{place}" if place else "passing_side",
        "title": "A vehicle passes a disc on the cheaper side.",
        "kind": "flight" if flights else "transfer",
        "variant": "",
        "of": "",
        "sense": sense,
        "best_cost": best if is_any and not nulls else None,
        "best_by": names[0] if is_any and not nulls else None,
        "known_cost": None if nulls else best,
        "known_from": "" if nulls else "an earlier run, results/x",
        "bound": None if nulls else _bound(best, sense),
        "rows": rows,
        "pairs": []
        if nulls
        else [
            {"a": a, "b": b, "p": 0.04, "effect": 0.7, "verdict": "no difference shown"}
            for k, a in enumerate(names)
            for b in names[k + 1 :]
        ],
        "answer": None
        if nulls or flights or not is_any
        else {
            "solver": names[0],
            "seed": 3,
            "plan": {
                "time": time.tolist(),
                "states": [np.sin(time + k).tolist() for k in range(4)],
                "controls": [np.sign(np.cos(time[:-1] * k)).tolist() for k in (1, 2)],
                "state_names": ["px", "py", "speed", "heading"],
                "control_names": ["acceleration", "turn rate"],
                "units": {"px": "m", "turn rate": "rad/s"},
            },
        },
    }


def _row(  # noqa: PLR0913
    rng: np.random.Generator,
    k: int,
    name: str,
    *,
    best: float,
    seeds: int,
    feasible: float,
    flights: bool,
    nulls: bool,
    marks: int,
) -> dict[str, Any]:
    runs = 1 if name == "ipopt" else seeds
    is_good = np.zeros(runs, bool) if nulls else rng.random(runs) < feasible
    gaps = rng.lognormal(-7 + 0.6 * k, 1.5, runs)
    near = [int(np.sum(is_good & (gaps <= share))) for share in (0.01, 0.0001)]
    evaluations = np.geomspace(10, 4000, marks)
    middle = best + abs(best) * (3 * (evaluations / 10) ** (-1.2 + 0.08 * k) + 1e-5)
    share = np.minimum(1, np.log10(evaluations) / 3.6 * (1 - 0.05 * k))

    def known(value: Any) -> Any:
        return None if nulls else value

    history = {
        "evaluations": evaluations.round().tolist(),
        "cost": {
            "low": (best + (middle - best) * 0.4).tolist(),
            "median": [None, *middle[1:].tolist()],
            "high": [None, None, *(best + (middle - best) * 2.2)[2:].tolist()],
        },
        "seconds": (evaluations * 1e-3).tolist(),
    }
    seconds = rng.lognormal(-0.5 + 0.15 * k, 0.3, runs)
    return {
        "solver": name,
        "deterministic": name == "ipopt",
        "runs": runs,
        "failed": ["stopped by the hard limit of 4 s"] if k == 2 else [],
        "cut": 1 if k == 3 else 0,
        "feasible": int(is_good.sum()),
        "claimed_feasible": int(is_good.sum()) + (1 if k == 1 else 0),
        "false_successes": 1 if k == 1 and not nulls else 0,
        "near": near,
        "near_intervals": None
        if runs == 1
        else [[max(0.0, n / runs - 0.2), min(1.0, n / runs + 0.15)] for n in near],
        "costs": [
            best + abs(best) * float(gap) if good else None
            for gap, good in zip(gaps, is_good, strict=True)
        ],
        "gaps": [
            float(gap) if good else None
            for gap, good in zip(gaps, is_good, strict=True)
        ],
        "claimed": [None if flights else best + abs(best) * float(gap) for gap in gaps],
        "seconds": [known(float(value)) for value in seconds],
        "build_seconds": [known(0.31)] * runs,
        "compile_seconds": [known(1.7)] * runs,
        "evaluations": [known(4000 + 10 * seed) for seed in range(runs)],
        "seconds_p50": known(float(np.median(seconds))),
        "seconds_p99": known(float(seconds.max())),
        "evaluations_median": known(4000 + 5 * k),
        "ert_evaluations": [known(5000.0 * (k + 1)), None],
        "ert_seconds": [known(2.5 * (k + 1)), None],
        "against_first": {"words": "", "p": None, "effect": None, "shift": None,
                          "verdict": ""}
        if k == 0
        else {"words": "cheaper in 3, costlier in 7 of 10 seeds", "p": known(0.32),
              "effect": known(0.7), "shift": known(0.12),
              "verdict": "no difference shown"},
        "history": None if flights or nulls else history,
        "ecdf": None
        if flights or nulls
        else {"evaluations": evaluations.tolist(), "share": share.tolist(),
              "low": (share * 0.8).tolist(),
              "high": np.minimum(1, share * 1.15).tolist()},
        "measures": {
            "separation m": {"low": 1.2, "median": 2.3, "high": 4.5, "undefined": 0},
            "settling time s": {"low": None, "median": None, "high": None,
                                "undefined": runs},
        }
        if flights
        else {},
        "step_seconds": {"p50": 0.01, "p99": 0.04, "max": 0.09, "dt": 0.1}
        if flights
        else None,
    }  # fmt: skip


def _regression(parts: list[dict[str, Any]], names: tuple[str, ...]) -> dict[str, Any]:
    verdicts = ("better", "same", "worse", "unknown")
    return {
        "against": "before/comparison.json",
        "margin": 0.1,
        "rows": [
            {"scenario": part["name"], "solver": name, "quantity": "success rate",
             "before": 0.8, "now": None if verdicts[k % 4] == "unknown" else 0.5,
             "verdict": verdicts[k % 4], "words": "8 of 10 before, 5 of 10 now"}
            for part in parts
            for k, name in enumerate(names)
        ],
        "is_regression": True,
    }  # fmt: skip
