"""`swarmstart check`: is this scenario valid, in all its variants."""

from swarmstart.cases.format.scenario import (
    Flaw,
    InvalidScenarioError,
    read_document,
    resolve,
)
from swarmstart.cases.kinds.flight import flight_of


def check(name_or_path: str) -> str:
    """Return one sentence on a valid scenario.

    Every variant is laid over, validated and built, so that what passes also runs.

    Args:
        name_or_path: The name of a shipped scenario or a path.

    Raises:
        SwarmstartError: With what is wrong.
    """
    document = read_document(name_or_path)
    flaws: dict[Flaw, None] = {}  # What both variants share is said once.
    variants = document.data.get("variants")
    names: list[str | None] = [*variants] if isinstance(variants, dict) else [None]
    for variant in names or [None]:
        try:
            resolved = resolve(document, variant=variant)
            flight_of(resolved.kind.pose(resolved.scenario), resolved.scenario)
        except InvalidScenarioError as error:
            flaws |= dict.fromkeys(error.flaws)
    if flaws:
        raise InvalidScenarioError([*flaws])
    listed = ", ".join(filter(None, names))
    return f"{document.name}: valid" + (f" ({listed})" if listed else "")
