"""Claims judged over seeds: the runs that each claim needs, and its verdict.

    claims.yaml -> parts -> distinct runs (cells) -> measures -> verdicts

A part is a claim of a shipped scenario, a measure of its run with a bound of the part's
own, or a computation. The verdict of a claim is that of its parts together
(`verdicts.py`). claims.yaml contains the chapter's claims; the project's own
requirements are files of the same form.
"""

from __future__ import annotations

import importlib.resources
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.statistics import too_few
from swarmstart.cases.campaign.running.claims import assignments_of, claim_assignments
from swarmstart.cases.campaign.studies.verdicts import (
    Verdict,
    median_of,
    of_assumption,
    of_guarantee,
    paired_verdict,
    ratio,
    verdict_of_parts,
    verdict_of_seeds,
)
from swarmstart.cases.format.document import Document
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.format.parts import NonNegative, Number, Part
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.format.settings import Claim
from swarmstart.cases.format.yaml_reader import parse_yaml

FLOWN_BY = "swarmstart.cases.campaign.running.run:run_cell"


def cell_of_run(
    resolved: Resolved, seed: int, *, figures: bool = False, flown_by: str = FLOWN_BY
) -> Cell:
    """Return one run as a cell, that is, as a unit of work for a worker process.

    Args:
        resolved: The scenario.
        seed: The seed.
        figures: Whether figures are drawn, into the folder `figures` within the folder
            of the cell.
        flown_by: "module:function" that makes the run; the default one returns the
            measures.
    """
    # Figures show the title; without them, runs that differ in it are one cell.
    settings = dict(resolved.settings) if figures else resolved.anonymous_settings()
    variant = f" {resolved.variant}" if resolved.variant else ""
    return Cell(
        work=flown_by,
        job={
            "settings": settings,
            "variant": resolved.variant,
            "seed": seed,
            "figures": figures,
        },
        label=f"{resolved.scenario.name}{variant}, seed {seed}",
    )


class PartOfClaim(Part):
    """A part of a claim, with a verdict of its own; see the head of claims.yaml."""

    scenario: str = ""
    claim: str = ""
    variant: str = ""
    reading: str = ""
    basis: Literal["text", "physics", "ours"] = "text"
    beside: bool = False
    compute: str = ""
    text: str = ""
    measure: str = ""
    relation: Literal["<=", ">=", "<", ">", "=="] = "=="
    bound: Number | None = None
    width: NonNegative = 0.0
    when: Mapping[str, Any] = Field(default_factory=dict)
    against: Mapping[str, Any] | None = None
    share: Annotated[Number, Field(gt=0, le=1)] = 1.0
    over: Literal["every", "median"] = "every"
    seeded: list[str] = Field(default_factory=list)
    seeds: int = Field(default=3, ge=1)
    least: int = Field(default=1, ge=1)
    guarantee: bool = False
    tolerance: NonNegative | None = 0.25

    @model_validator(mode="after")
    def _one_of_both(self) -> PartOfClaim:
        if bool(self.scenario) == bool(self.compute) or (
            bool(self.measure) == bool(self.claim and self.scenario)
        ):
            raise ValueError(
                "expected scenario with claim or measure, or compute with measure"
            )
        return self


class ChapterClaim(Part):
    """A claim of the chapter, or of the project."""

    id: int
    text: str
    source: str = ""
    assumption: bool = False
    parts: list[PartOfClaim] = Field(min_length=1)
    expected: Verdict = Verdict.HOLDS
    because: str = ""

    @model_validator(mode="before")
    @classmethod
    def _written_out(cls, data: dict[str, Any]) -> object:
        """Add the common keys to all parts, and convert the expected verdict."""
        common = data.get("common", {})
        return {
            **{key: value for key, value in data.items() if key != "common"},
            "parts": [{**common, **part} for part in data.get("parts", [])],
            # Here, since a strict model takes no text for an enum.
            "expected": Verdict(data.get("expected", Verdict.HOLDS)),
        }


class ChapterFigure(Part):
    """A figure of the chapter, redrawn from one run: that of seed 0."""

    number: str
    title: str
    scenario: str
    search: str | None = None


class Chapter(Part):
    """Claims that are replicated, and their runs."""

    schema_version: Literal[1] = Field(alias="schema")
    flown_by: str = FLOWN_BY
    variants: Mapping[str, str] = Field(default_factory=dict)
    claims: list[ChapterClaim]
    figures: list[ChapterFigure] = Field(default_factory=list)
    page: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class PlannedPart:
    """A part of a claim with the runs (cells) that judge it.

    Attributes:
        part: The part.
        claim: Claim of the scenario that the part names. If the part is a computation,
            or states a measure of its own, the claim is made from the part.
        variant: The variant that is run; empty if there are no variants.
        reason: Reason why the measure can be undefined, as in `claims.holds`.
        cells: For each seed one run (cell), or two runs, the first of which is compared
            with the second.
        commands: Commands that make these runs, without the seed.
    """

    part: PartOfClaim
    claim: Claim
    variant: str
    reason: str
    cells: tuple[tuple[Cell, ...], ...]
    commands: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class JudgedPart:
    """Measurements for a part of a claim, and the verdict.

    Attributes:
        planned: The part with its cells.
        values: Measures, or ratios of pairs, in the order of the seeds; one for each
            seed without a failed run.
        pairs: The two measures of each pair; empty if nothing is compared.
        verdict: The verdict on the part.
        test: Words on the verdict: the statistical test, the number of supporting runs,
            or the reason why the part is not judged; may be empty.
        failures: Reasons why runs failed.
    """

    planned: PlannedPart
    values: tuple[Measure, ...]
    pairs: tuple[tuple[Measure, Measure], ...] = ()
    verdict: Verdict
    test: str = ""
    failures: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class JudgedClaim:
    """A claim with its verdict.

    Attributes:
        claim: The claim.
        parts: Its parts, judged.
        verdict: The verdict of all parts together.
    """

    claim: ChapterClaim
    parts: tuple[JudgedPart, ...]
    verdict: Verdict

    @property
    def is_expected(self) -> bool:
        """True if no run failed and the verdict is "not judged" or the expected one."""
        # Its verdict is "not judged", as with too few runs.
        if any(part.failures for part in self.parts):
            return False
        return self.verdict in (self.claim.expected, Verdict.NOT_JUDGED)


def chapter() -> Chapter:
    """Return the chapter's claims and figures, from claims.yaml."""
    file = importlib.resources.files("swarmstart.cases.chapter") / "claims.yaml"
    return claims_in(file.read_bytes(), name="claims.yaml")


def claims_in(content: bytes, *, name: str) -> Chapter:
    """Return a file's claims; the file can name code, so it must be of this package."""
    return Chapter.model_validate(parse_yaml(content, name=name).data)


def planned(
    chapter: Chapter, claim: ChapterClaim, *, seeds: int | None
) -> list[PlannedPart]:
    """Return a claim's parts with their runs (cells).

    Args:
        chapter: The chapter.
        claim: One of its claims.
        seeds: Number of runs of each random part; None means the number in claims.yaml.
    """
    return [_planned_part(chapter, part, seeds) for part in claim.parts]


def _planned_part(
    chapter: Chapter, part: PartOfClaim, seeds: int | None
) -> PlannedPart:
    if part.compute:
        cell = Cell(work=part.compute, job={}, label=part.text)
        return PlannedPart(
            part=part,
            claim=_own_claim(part),
            variant="",
            reason="",
            cells=((cell,),),
            commands=(part.compute,),
        )
    variant = part.variant or chapter.variants.get(part.scenario)
    base = _resolved(part.scenario, variant)
    claim = (
        _own_claim(part)
        if part.measure
        else next(c for c in base.scenario.claims if c.id == part.claim)
    )
    sets = [claim_assignments(claim, base.settings)]
    if claim.against is not None:
        sets.append(sets[0] + assignments_of(claim.against))
    # A part with one seed has no chance in it, and needs no more.
    count = part.seeds if seeds is None or part.seeds == 1 else seeds
    drawn = drawn_by_key(chapter)
    cells = []
    for seed in range(count):
        seeded = tuple(f"{key}={seed}" for key in part.seeded)
        runs = (_resolved(part.scenario, variant, given + seeded) for given in sets)
        pair = (cell_of_run(run, seed, flown_by=chapter.flown_by) for run in runs)
        # A run that a figure needs is not done twice, but once with its figures.
        cells.append(tuple(drawn.get(cell.key, cell) for cell in pair))
    return PlannedPart(
        part=part,
        claim=claim,
        variant=base.variant,
        reason=base.kind.undefined_of(base.scenario).get(claim.measure, ""),
        cells=tuple(cells),
        commands=tuple(_command(part.scenario, variant, given) for given in sets),
    )


def _command(name: str, variant: str | None, assignments: Sequence[str]) -> str:
    words = ["swarmstart", "run", name]
    words += ["--variant", variant] if variant else []
    for text in assignments:
        words += ["--set", text]
    return shlex.join(words)


def _own_claim(part: PartOfClaim) -> Claim:
    """Return the claim of a part that names no claim of a scenario."""
    names = "text", "measure", "relation", "bound", "width", "when", "against", "share"
    own = {name: getattr(part, name) for name in names}
    return Claim(id="-", source="", **own)


@cache
def _resolved(
    name: str,
    variant: str | None,
    assignments: tuple[str, ...] = (),
    search: str | None = None,
) -> Resolved:
    return resolve(
        _document(name), variant=variant, search=search, assignments=assignments
    )


@cache
def _document(name: str) -> Document:
    return read_document(name)


def figure_cells(chapter: Chapter) -> list[Cell]:
    """Return the runs of the figures, in their order."""
    return [
        cell_of_run(_of_figure(chapter, figure), 0, figures=True)
        for figure in chapter.figures
    ]


def drawn_by_key(chapter: Chapter) -> dict[str, Cell]:
    """Return the runs that draw figures, by the keys of the same runs without figures.

    Runs are cells, units of work for a worker process; a key is the hash of a cell.
    """
    bare = [cell_of_run(_of_figure(chapter, f), 0).key for f in chapter.figures]
    return dict(zip(bare, figure_cells(chapter), strict=True))


def _of_figure(chapter: Chapter, figure: ChapterFigure) -> Resolved:
    variant = chapter.variants.get(figure.scenario)
    return _resolved(figure.scenario, variant, search=figure.search)


def judged(
    claim: ChapterClaim,
    parts: Sequence[PlannedPart],
    outcomes: Mapping[str, Outcome],
) -> JudgedClaim:
    """Return the verdict on a claim from its finished cells."""
    found = tuple(_judged_part(part, outcomes) for part in parts)
    verdict = verdict_of_parts([part.verdict for part in found])
    if claim.assumption:
        verdict = of_assumption(verdict)
    return JudgedClaim(claim=claim, parts=found, verdict=verdict)


def _judged_part(planned: PlannedPart, outcomes: Mapping[str, Outcome]) -> JudgedPart:
    claim = planned.claim
    found = [[outcomes[cell.key] for cell in pair] for pair in planned.cells]
    failures = tuple(o.failure for pair in found for o in pair if o.failure)
    complete = [
        tuple(_measured(outcome, claim.measure) for outcome in pair)
        for pair in found
        if not any(o.failure for o in pair)
    ]
    pairs = tuple((pair[0], pair[1]) for pair in complete if len(pair) > 1)
    values = tuple(
        ratio(pair[0], pair[1], reason=planned.reason) if len(pair) > 1 else pair[0]
        for pair in complete
    )
    verdict, test = Verdict.NOT_JUDGED, "a run failed"
    if not failures:
        verdict, test = _verdict(planned, values)
    return JudgedPart(
        planned=planned,
        values=values,
        pairs=pairs,
        verdict=verdict,
        test=test,
        failures=failures,
    )


def _measured(outcome: Outcome, measure: str) -> Measure:
    value: Measure = (outcome.result or {})["measures"][measure]
    return value


def _verdict(planned: PlannedPart, values: Sequence[Measure]) -> tuple[Verdict, str]:
    part, claim = planned.part, planned.claim
    if part.beside:
        return Verdict.BESIDE, ""
    if len(values) < part.least or not values:
        return Verdict.NOT_JUDGED, too_few(len(values), "run", part.least)
    if claim.against is not None and part.seeds > 1:
        ratios = [v for v in values if isinstance(v, float)]
        if len(ratios) < len(values):
            return Verdict.NOT_JUDGED, f"not defined: {planned.reason}"
        verdict, test = paired_verdict(ratios, claim.relation, claim.bound)
    else:
        if part.over == "median":
            values = [median_of(values, reason=planned.reason)]
        verdict, test = verdict_of_seeds(
            values,
            claim.relation,
            claim.bound,
            width=claim.width,
            share=claim.share,
            reason=planned.reason,
        )
    return of_guarantee(verdict, test) if part.guarantee else (verdict, test)


def cells_of(parts: Sequence[PlannedPart]) -> Iterator[Cell]:
    """Yield all cells of parts."""
    for part in parts:
        for pair in part.cells:
            yield from pair
