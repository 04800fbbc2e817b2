"""`swarmstart check`: is this scenario valid, in all its variants."""

from swarmstart.cases.format.document import printable
from swarmstart.cases.format.scenario import (
    Flaw,
    InvalidScenarioError,
    read_document,
    resolve,
)
from swarmstart.cases.kinds.flight import flight_of


def check(name_or_path: str) -> str:
    """Return one sentence on a valid scenario.

    Every variant is laid over, validated and built, so that what passes also runs; a
    file of the user's is never run.

    Args:
        name_or_path: The name of a shipped scenario or a path.

    Raises:
        SwarmstartError: With what is wrong.
    """
    document = read_document(name_or_path)
    flaws: dict[Flaw, None] = {}  # What both variants share is said once.
    variants = document.data.get("variants")
    not_run: dict[str, None] = {}
    names: list[str | None] = [*variants] if isinstance(variants, dict) else [None]
    for variant in names or [None]:
        try:
            resolved = resolve(document, variant=variant)
            if resolved.code is None:
                flight_of(resolved.posed(), resolved.scenario)
            else:
                not_run[f"; {printable(str(resolved.code))} was not run"] = None
        except InvalidScenarioError as error:
            flaws |= dict.fromkeys(error.flaws)
    if flaws:
        raise InvalidScenarioError([*flaws])
    listed = ", ".join(filter(None, names))
    valid = f"{document.name}: valid" + (f" ({listed})" if listed else "")
    return valid + "".join(not_run)
