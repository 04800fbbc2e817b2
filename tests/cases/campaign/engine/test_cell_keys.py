"""Keys of cells: they change with all that determines a result, and only then."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from swarmstart.cases.campaign.engine import cell_keys
from swarmstart.cases.campaign.engine.cell_keys import key_of, modules_of_settings
from swarmstart.cases.campaign.studies.replication import cell_of_run
from swarmstart.cases.chapter import computations
from swarmstart.cases.format.registry import KINDS, SEARCHES, words_of
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.machine_code import fingerprints

RUN = "swarmstart.cases.campaign.running.run:run_cell"
SOLVE = "swarmstart.cases.campaign.trials.solvers:solve_cell"
JOB = {
    "settings": {"kind": "transfer", "search": {"name": "de"}},
    "solver": "de",
    "figures": False,
}
WORK = "swarmstart.tests.cases.campaign.campaign_work:square"


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    """Remove the hashes of other tests."""
    cell_keys._code.cache_clear()
    yield
    cell_keys._code.cache_clear()


def changes(
    monkeypatch: pytest.MonkeyPatch, module: str, work: str, job: dict[str, object]
) -> bool:
    """Return whether an edit of a module changes the key."""
    text = fingerprints.source(
        module
    )  # Fails for an unknown name, which would change nothing.
    before = key_of(work, job)
    cell_keys._code.cache_clear()
    with monkeypatch.context() as patch:
        source = fingerprints.source
        patch.setattr(
            fingerprints,
            "source",
            lambda name: text + b"\n# edited" if name == module else source(name),
        )
        after = key_of(work, job)
    cell_keys._code.cache_clear()
    return after != before


@pytest.mark.parametrize("work", [RUN, SOLVE])
@pytest.mark.parametrize(
    "module",
    [
        "swarmstart.cases.commands.actions.compare",
        "swarmstart.cases.commands.front.cli",
        "swarmstart.cases.drawing.drawing",
        "swarmstart.cases.drawing.problem_figures",
        "swarmstart.cases.campaign.judging.statistics",
        "swarmstart.cases.campaign.studies.library",
        "swarmstart.cases.campaign.engine.cells",
        "swarmstart.cases.campaign.studies.replication",
        "swarmstart.cases.kinds.transfer.figures",
        "swarmstart.cases.kinds.formation_flight.kind",
        "swarmstart.cases.kinds.problem.kind",
        "swarmstart.cases.kinds.close_formation.measures",
    ],
)
def test_an_edit_of_what_no_result_depends_on_leaves_the_key(
    monkeypatch: pytest.MonkeyPatch, module: str, work: str
) -> None:
    assert not changes(monkeypatch, module, work, JOB)


@pytest.mark.parametrize("work", [RUN, SOLVE])
@pytest.mark.parametrize(
    "module",
    [
        "swarmstart.ocp.answer.planner",
        "swarmstart.heuristics.searches.de",
        "swarmstart.machine_code.numba_kernels",
        "swarmstart.cases.kinds.transfer.kind",
        "swarmstart.cases.kinds.transfer.pose",
        "swarmstart.cases.kinds.flight",
    ],
)
def test_an_edit_of_what_the_result_depends_on_changes_the_key(
    monkeypatch: pytest.MonkeyPatch, module: str, work: str
) -> None:
    assert changes(monkeypatch, module, work, JOB)


def test_figures_count_where_they_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    module = "swarmstart.cases.drawing.drawing"
    assert changes(monkeypatch, module, RUN, {**JOB, "figures": True})


@pytest.mark.parametrize("kind", KINDS)
def test_no_kind_reaches_what_draws(kind: str) -> None:
    waiting, seen = [words_of(kind).kind.partition(":")[0]], set[str]()
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += fingerprints._imported(fingerprints.source(name))
    assert not [name for name in seen if ".drawing" in name or ".commands" in name]


def test_a_scenario_s_own_modules_are_those_of_its_kind_and_search() -> None:
    resolved = resolve(read_document("passing_side"))
    assert resolved.kind is not None
    settings = cell_of_run(resolved, 0).job["settings"]
    kind = words_of(settings["kind"]).kind.partition(":")[0]
    search = SEARCHES[settings["search"]["name"]].settings.partition(":")[0]
    assert search == "swarmstart.heuristics.searches.chaotic_pso"
    assert modules_of_settings(settings) == (kind, search)
    assert modules_of_settings({"kind": [], "search": None}) == ()


def test_computations_depend_on_the_shipped_scenarios(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    work = f"{computations.__name__}:input_levels"
    before, settled = key_of(work, {}), key_of(RUN, JOB)
    monkeypatch.setattr(cell_keys, "_shipped_scenarios", lambda: "edited")
    assert key_of(work, {}) != before
    assert key_of(RUN, JOB) == settled


def test_sources_are_read_once_for_many_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    source = fingerprints.source

    def noted(name: str) -> bytes:
        read.append(name)
        return source(name)

    monkeypatch.setattr(fingerprints, "source", noted)
    assert len({key_of(WORK, {"number": n}) for n in range(100)}) == 100
    assert len(read) == len(set(read)) > 0


def test_a_work_that_is_not_there_has_a_key_too() -> None:
    assert len(key_of("swarmstart.missing:nothing", {})) == 16
