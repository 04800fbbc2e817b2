"""Solvers of other packages that `compare` knows by name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, NamedTuple


class Peer(NamedTuple):
    """A solver of another package.

    Attributes:
        title: Description in a few words.
        minimize: "module:function" that runs the solver: a function of a `PeerTask` for
            a search, a function like `solve_ocp` for a solver of whole problems
            (peers.py).
        package: Package to import.
        pip: Name of the package for `pip install`.
        options: Options with their defaults, by the package's own names; None means the
            package's default.
        family: "peer" for a search; "control" for a solver of whole problems.
    """

    title: str
    minimize: str
    package: str
    pip: str
    options: Mapping[str, Any]
    family: Literal["peer", "control"] = "peer"


_PEERS = "swarmstart.cases.campaign.trials.peers:"
PEERS = {
    "scipy-de": Peer(
        "differential evolution of SciPy",
        f"{_PEERS}scipy_de",
        "scipy",
        "scipy",
        {"popsize": 15, "strategy": "best1bin", "mutation": None,
         "recombination": 0.7, "tol": 0.01, "init": "latinhypercube"},
    ),
    "pygmo-de": Peer(
        "differential evolution of pagmo",
        f"{_PEERS}pygmo_de",
        "pygmo",
        "pygmo",
        {"size": 20, "F": 0.8, "CR": 0.9, "variant": 2, "ftol": 1e-6, "xtol": 1e-6},
    ),
    "pygmo-de1220": Peer(
        "self-adaptive differential evolution of pagmo (de1220)",
        f"{_PEERS}pygmo_de1220",
        "pygmo",
        "pygmo",
        {"size": 20, "variant_adptv": 1, "ftol": 1e-6, "xtol": 1e-6},
    ),
    "pygmo-pso": Peer(
        "particle swarm of pagmo",
        f"{_PEERS}pygmo_pso",
        "pygmo",
        "pygmo",
        {"size": 20, "omega": 0.7298, "eta1": 2.05, "eta2": 2.05, "max_vel": 0.5,
         "variant": 5, "neighb_type": 2, "neighb_param": 4},
    ),
    "pygmo-cmaes": Peer(
        "covariance matrix adaptation of pagmo",
        f"{_PEERS}pygmo_cmaes",
        "pygmo",
        "pygmo",
        {"size": 20, "sigma0": 0.5, "ftol": 1e-6, "xtol": 1e-6},
    ),
    "cmaes": Peer(
        "covariance matrix adaptation of the package cmaes, restarted with twice the "
        "population",
        f"{_PEERS}cmaes_ipop",
        "cmaes",
        "cmaes",
        {"size": None, "sigma": 0.3},
    ),
    "python-control": Peer(
        "control.optimal.solve_ocp, shooting with SLSQP from zero controls",
        f"{_PEERS}solve_ocp",
        "control",
        "control",
        {"method": "SLSQP", "maxiter": None},
        family="control",
    ),
}  # fmt: skip
"""Solvers of other packages by name."""
SOLVER_GROUP = "swarmstart.solvers"
"""Group of entry points in which another package announces a solver of its own."""


@cache
def installed_solvers() -> dict[str, EntryPoint]:
    """Return the solvers that other installed packages announce, not imported."""
    return {point.name: point for point in entry_points(group=SOLVER_GROUP)}
