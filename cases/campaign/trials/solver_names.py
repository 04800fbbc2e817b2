"""Names of solvers with options, for `compare`.

    lshade                        a population search (any of `swarmstart list`)
    lshade[size=60]               with settings, by the keys of a scenario's search
    lshade[size=60]+ipopt[max_iterations=50]
                                  the same with a part of the budget, then IPOPT from
                                  there, with its own options
    solve                         what `swarmstart run` does with a scenario, and
                                  `swarmstart.solve` with a problem; search= and lanes=
                                  replace the search and the number of random starts
    repeated-ipopt                IPOPT from random starts until the budget is spent;
                                  the best: the null hypothesis
    multistart+ipopt              local solves of many random starts at once, then IPOPT
    memetic+ipopt                 L-SHADE with local solves of many points at once, then
                                  IPOPT
    ipopt, fatrop, sqpmethod      an NLP solver once, from zero controls; any that this
                                  CasADi has, after a + too
    scipy-de, pygmo-de, cmaes     searches of other packages (PEERS), each with options
    python-control                its solve_ocp on the same grid, from zero controls
    acknowledged, waiting, hearsay  the rules of a swarm, in flights of swarms alone
    NAME                          a solver that an installed package announces in the
                                  entry points swarmstart.solvers (own_solver.py)

A name is read into its canonical form, with sorted options and values as JSON, so that
two spellings are one solver. Nothing heavy is imported before an option is read.
"""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any, Literal

from swarmstart.cases.campaign.trials.peer_names import PEERS, installed_solvers
from swarmstart.cases.format.document import meant, printable
from swarmstart.cases.format.foreign_solvers import reaches_beyond
from swarmstart.cases.format.registry import RULES, SEARCHES, SOLVE
from swarmstart.errors import MissingPackageError, SwarmstartError

IPOPT, REPEATED = "ipopt", "repeated-ipopt"
NULL_HYPOTHESIS = REPEATED
"""Solver that a global search has to beat."""
SEARCHED = tuple(name for name in SEARCHES if name != "none")
Family = Literal["search", "peer", "control", "nlp", "repeated", "solve", "own", "rule"]
_MANY = "repeated-"
_NAME = re.compile(r"[A-Za-z0-9_-]+")
_OPTION = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*")
_PLUGINS = ("ipopt", "fatrop", "sqpmethod", "feasiblesqpmethod", "qrsqp", "blocksqp",
            "uno", "alpaqa", "bonmin", "snopt", "knitro", "worhp", "madnlp",
            "sleqp")  # fmt: skip
_BEFORE = re.compile(rf"\bmultistart-(?=(?:{'|'.join(_PLUGINS)})\b)")
"""Beginning of names that begin with "repeated-" now."""
_OF_PART = frozenset({"name", "warm_start", "when"})
"""Keys of a scenario's search that do not concern a single plan."""
NO_OPTIONS: Mapping[str, str] = MappingProxyType({})
LONGEST = 1000
"""Largest number of characters of a name."""


class UnknownSolverError(SwarmstartError, LookupError):
    """A solver is unknown, or it does not have a given option."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Solver:
    """A solver of one planning problem.

    Attributes:
        name: Canonical name: options sorted, values as JSON.
        title: Description in a few words.
        family: Key of the function that runs it.
        search: A key of SEARCHES, as in a scenario; "none" if the solver has no search
            of this package; "" if the scenario's own search is used.
        polished: False for a search of this package without an NLP solver after it, and
            for a rule of swarms; else true.
        peer: A key of PEERS, the solvers of other packages; empty for all others.
        plugin: The NLP solver, by its name in CasADi; empty if the solver has none.
        options: Options of the search or the peer, sorted; values as JSON.
        polish_options: Options of the NLP solver.
        hint: Sentence on a name that has changed; empty if it has not.
    """

    name: str
    title: str
    family: Family
    search: str = "none"
    polished: bool = True
    peer: str = ""
    plugin: str = ""
    options: tuple[tuple[str, Any], ...] = ()
    polish_options: tuple[tuple[str, Any], ...] = ()
    hint: str = field(default="", compare=False)

    @property
    def is_deterministic(self) -> bool:
        """Return whether every seed gives the same answer."""
        return self.family in ("nlp", "control")


def solver_of(text: str) -> Solver:
    """Return the solver that `compare` knows by a name, with options in brackets.

    Raises:
        UnknownSolverError: If no solver has that name, or the solver does not have a
            given option.
        MissingPackageError: If the solver's package is not installed.
        SwarmstartError: If the value of an option is invalid.

    Example:
        >>> solver_of("lshade[size = 60, archive_rate=2]+ipopt").name
        'lshade[archive_rate=2.0,size=60]+ipopt'
    """
    if len(text) > LONGEST:
        raise UnknownSolverError(
            f"expected the name of a solver of at most {LONGEST} characters, "
            f"found {len(text)}"
        )
    parts = list(_split(text.strip(), "+"))
    heads = [_head(part, text) for part in parts]
    if len(heads) > 2:  # noqa: PLR2004 - a search and a polish
        raise UnknownSolverError(
            f"expected a search, and an NLP solver after one +; found {_quoted(text)}"
        )
    (name, options), polish = heads[0], heads[1] if len(heads) > 1 else None
    now = renamed(name)
    solver = _first(now, options, text)
    if now != name:
        from swarmstart.ocp.common import Paragraph

        told = f"the solver {name} is called {now} now"
        solver = replace(solver, hint=f"{told} (more: {Paragraph.RENAMED})")
    if polish is not None:
        solver = _with_polish(solver, *polish, text)
    return solver


def solvers_of(text: str) -> list[Solver]:
    """Return the solvers that a text names, with commas between; each solver once.

    Args:
        text: Text such as "de,lshade[size=60,memory=6]+ipopt"; commas in brackets
            separate options.

    Raises:
        UnknownSolverError: If a solver is unknown; further errors as in `solver_of`.
    """
    found = [solver_of(part.strip()) for part in _split(text, ",")]
    return list({solver.name: solver for solver in found}.values())


def plugins() -> list[str]:
    """Return those NLP solvers of the list `_PLUGINS` that this CasADi has."""
    return [name for name in _PLUGINS if _is_plugin(name)]


def _is_plugin(name: str) -> bool:
    from swarmstart.ocp.nlp import has_solver

    return bool(_NAME.fullmatch(name)) and has_solver(name)


def _split(text: str, at: str) -> Iterator[str]:
    """Yield the parts of a text between marks outside of brackets."""
    depth, begin = 0, 0
    for place, mark in enumerate(text):
        # Values can have brackets, too.
        depth += (mark in "[{") - (mark in "]}")
        if mark == at and depth <= 0:
            yield text[begin:place]
            begin = place + 1
    yield text[begin:]


def _head(part: str, text: str) -> tuple[str, dict[str, str]]:
    """Return name and options of "name[key=value,...]"."""
    name, bracket, rest = part.strip().partition("[")
    options: dict[str, str] = {}
    if bracket:
        if not rest.endswith("]"):
            raise UnknownSolverError(
                f"expected options such as name[key=value]; found {_quoted(text)}"
            )
        for one in _split(rest[:-1], ","):
            key, equals, value = (piece.strip() for piece in one.partition("="))
            if not (equals and value and _OPTION.fullmatch(key)) or key in options:
                raise UnknownSolverError(
                    f"expected options such as name[key=value], each once; found "
                    f"{_quoted(one.strip())} in {_quoted(text)}"
                )
            options[key] = value
    return name.strip(), options


def _first(name: str, options: Mapping[str, str], text: str) -> Solver:
    """Return the solver that a name begins with."""
    if name in SEARCHED:
        given = _search_options(name, options, text)
        title = SEARCHES[name].title
        return Solver(
            name=_canonical(name, given),
            title=title,
            family="search",
            search=name,
            polished=False,
            options=given,
        )
    if name in PEERS:
        given = _peer_options(name, options, text)
        title = PEERS[name].title
        return Solver(
            name=_canonical(name, given),
            title=title,
            family=PEERS[name].family,
            peer=name,
            polished=True,
            options=given,
        )
    if name == SOLVE:
        given = _solve_options(options, text)
        return Solver(
            name=_canonical(SOLVE, given),
            title="what run does with a scenario, and ss.solve with a problem",
            family="solve",
            search=dict(given).get("search", ""),
            options=given,
        )
    if name in RULES:
        _require_known(options, (), text)
        return Solver(name=name, title=RULES[name], family="rule", polished=False)
    plugin = name.removeprefix(_MANY)
    if plugin == "none" or not _is_plugin(plugin):
        # After all others, none of which another package replaces.
        if name in installed_solvers():
            return own_solver(name, installed_solvers()[name].module, options, text)
        raise UnknownSolverError(
            f"expected a solver: one of {', '.join(_known())}, or a search with "
            f"+ipopt; found {_quoted(text)}{_hint(name, _known())}"
        )
    given = _nlp_options(plugin, options, text)
    is_many = name.startswith(_MANY)
    return Solver(
        name=_canonical(name, given),
        title=f"{plugin} from random starts, again and again"
        if is_many
        else f"{plugin} once, from zero controls",
        family="repeated" if is_many else "nlp",
        plugin=plugin,
        polish_options=given,
    )


def own_solver(
    name: str, module: str, options: Mapping[str, str] = NO_OPTIONS, text: str = ""
) -> Solver:
    """Return a solver of a user's own, which is a function (own_solver.py).

    Raises:
        UnknownSolverError: If options are given.
    """
    if options:
        raise UnknownSolverError(
            f"expected {name} without options: it is a function; found {_quoted(text)}"
        )
    return Solver(name=name, title=f"a solver of {module}", family="own", search="")


def _with_polish(
    solver: Solver, plugin: str, options: Mapping[str, str], text: str
) -> Solver:
    """Return a search with an NLP solver after it."""
    if solver.family not in ("search", "peer") or not _is_plugin(plugin):
        known = plugins()
        raise UnknownSolverError(
            "expected a search with an NLP solver after it, such as lshade+ipopt "
            f"(here: {', '.join(known)}); found {_quoted(text)}{_hint(plugin, known)}"
        )
    given = _nlp_options(plugin, options, text)
    return Solver(
        name=f"{solver.name}+{_canonical(plugin, given)}",
        title=f"{solver.title}, then {plugin}",
        family=solver.family,
        search=solver.search,
        peer=solver.peer,
        polished=True,
        options=solver.options,
        plugin=plugin,
        polish_options=given,
    )


def renamed(text: str) -> str:
    """Return a text, such as an earlier comparison, with the present names of solvers.

    Example:
        >>> renamed("multistart-ipopt, multistart+ipopt")
        'repeated-ipopt, multistart+ipopt'
    """
    return _BEFORE.sub(_MANY, text)


Options = tuple[tuple[str, Any], ...]


def _solve_options(options: Mapping[str, str], text: str) -> Options:
    """Return another search and number of lanes than the scenario's own."""
    if not options:
        return ()
    from swarmstart.cases.format.settings import MOST_LANES

    _require_known(options, {"search", "lanes"}, text)
    values = {key: _value(value) for key, value in options.items()}
    search, lanes = values.get("search", "none"), values.get("lanes", 0)
    if search not in SEARCHES:
        raise UnknownSolverError(
            f"expected the name of a search, found {json.dumps(search)} in "
            f"{_quoted(text)}{_hint(str(search), [*SEARCHES])}"
        )
    is_count = isinstance(lanes, int) and not isinstance(lanes, bool)
    if not (is_count and 0 <= lanes <= MOST_LANES):
        raise UnknownSolverError(
            f"expected lanes to be an integer from 0 to {MOST_LANES}, found "
            f"{json.dumps(lanes)} in {_quoted(text)}"
        )
    return _sorted(values)


def _search_options(name: str, options: Mapping[str, str], text: str) -> Options:
    """Return the settings of a search, checked like those of a scenario."""
    if not options:
        return ()
    from swarmstart.cases.format.scenario import search_of
    from swarmstart.cases.format.settings import search_part

    known = set(search_part(name).model_fields) - _OF_PART
    _require_known(options, known, text)
    part = search_of(name, options, told=printable(text))
    return _sorted({key: part[key] for key in options})


def _peer_options(name: str, options: Mapping[str, str], text: str) -> Options:
    """Return the options of a peer, each of its default's type."""
    peer = PEERS[name]
    # Found without an import, which takes long for some packages.
    if importlib.util.find_spec(peer.package) is None:
        raise MissingPackageError(
            f"{name} needs the package {peer.package}, which is not installed: "
            f"pip install {peer.pip}"
        )
    _require_known(options, peer.options, text)
    values = {key: _value(value) for key, value in options.items()}
    for key, value in values.items():
        _require_like(key, value, peer.options[key], text)
    resolve_name(peer.minimize)  # A broken package raises here.
    return _sorted(values)


def _require_like(key: str, value: Any, default: Any, text: str) -> None:
    """Raise if a value has another type than its default, or is negative."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(default, str):
        ok, what = isinstance(value, str), "text"
    elif isinstance(default, int) or key in ("size", "maxiter"):
        ok = isinstance(value, int) and is_number and 1 <= value < 2**31
        what = "an integer of at least 1"
    else:
        ok, what = is_number and 0.0 <= value < float("inf"), "a number of at least 0"
    if not ok:
        raise UnknownSolverError(
            f"expected {key} to be {what}; found {json.dumps(value)} in {_quoted(text)}"
        )


def _nlp_options(plugin: str, options: Mapping[str, str], text: str) -> Options:
    """Return the options of an NLP solver, which are checked by creating it."""
    # Here, since names alone are read without anything heavy.
    import casadi as ca

    from swarmstart.ocp.nlp import check_solver
    from swarmstart.silence import silenced

    values = {key: _value(value) for key, value in options.items()}
    for key, value in values.items():
        if reaches_beyond(key, value):
            raise UnknownSolverError(
                f"expected options that neither name files nor run programs, found "
                f"{key!r} in {_quoted(text)}"
            )
    if plugin != IPOPT:
        known = {*ca.nlpsol_options(plugin)}
        # CasADi lists the part before the point, as of fatrop.max_iter.
        _require_known({k.partition(".")[0]: v for k, v in values.items()}, known, text)
    given = _sorted(values)
    try:
        with silenced():
            check_solver(polish_of(plugin, dict(given)))
    except SwarmstartError as error:
        # The words of the solver only.
        said = str(error).rpartition("it says: ")[2]
        raise UnknownSolverError(
            f"expected options that {plugin} takes, found {_quoted(text)}: {said}"
        ) from error
    return given


def polish_of(plugin: str, options: Mapping[str, Any]) -> Any:
    """Return an NLP solver with options for a planner.

    Args:
        plugin: Name of the solver in CasADi.
        options: Options of the solver. For IPOPT these are `max_iterations` and
            `tolerance`, as in a scenario, and others by IPOPT's names; for other
            solvers they have the names of the plug-in.
    """
    from swarmstart.ocp import IpoptOptions, NlpOptions

    if plugin != IPOPT:
        return NlpOptions(plugin=plugin, options=dict(options))
    own = {k: v for k, v in options.items() if k in ("max_iterations", "tolerance")}
    others = {k: v for k, v in options.items() if k not in own}
    return IpoptOptions(**own, options=others)


def _require_known(options: Mapping[str, Any], known: Any, text: str) -> None:
    for key in options:
        if key not in known:
            names = sorted(known)
            hint = meant(key, names, otherwise=f"known: {', '.join(names)}")
            raise UnknownSolverError(
                f"expected a known option, found {key!r} in {_quoted(text)}; {hint}"
            )


def _value(text: str) -> Any:
    """Return the value of an option: a number, true, false or text."""
    try:
        value = json.loads(text)
    except ValueError:
        value = text.strip("'\"")
    # NaN, Infinity and 1e999 could not be written as JSON again.
    if isinstance(value, float) and not abs(value) < float("inf"):
        return text
    return value


def _sorted(values: Mapping[str, Any]) -> Options:
    return tuple(sorted(values.items()))


def _canonical(name: str, options: Options) -> str:
    told = ",".join(f"{key}={_written(value)}" for key, value in options)
    return f"{name}[{told}]" if options else name


def _written(value: Any) -> str:
    """Return a value as text that is read as the same value again."""
    if isinstance(value, str) and _OPTION.fullmatch(value) and _value(value) == value:
        return value
    return json.dumps(value, separators=(",", ":"))


def _known() -> list[str]:
    return [
        SOLVE,
        *SEARCHED,
        *plugins(),
        REPEATED,
        *PEERS,
        *RULES,
        *installed_solvers(),
    ]


def _hint(name: str, known: list[str]) -> str:
    hint = meant(name, known, otherwise="")
    return f"; {hint}" if hint else ""


def _quoted(text: str) -> str:
    return repr(printable(text))
