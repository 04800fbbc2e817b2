"""Names of solvers with options: read, made canonical, refused in words."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

from swarmstart.cases.campaign.trials.solver_names import (
    NULL_HYPOTHESIS,
    UnknownSolverError,
    plugins,
    solver_of,
    solvers_of,
)
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.errors import MissingPackageError, SwarmstartError


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("lshade[size=60]+ipopt", "lshade[size=60]+ipopt"),
        (" lshade[ size = 60 ,memory=6] ", "lshade[memory=6,size=60]"),
        ("de[F=1/2]", "de[F=0.5]"),
        ("cpso[velocity_max=[1, 2]]", "cpso[velocity_max=[1.0,2.0]]"),
        ("ipopt[tol=1e-3]", "ipopt[tol=0.001]"),
        ("ipopt[mu_strategy='adaptive']", "ipopt[mu_strategy=adaptive]"),
        ("scipy-de[popsize=10]+fatrop", "scipy-de[popsize=10]+fatrop"),
    ],
)
def test_two_spellings_are_one_solver(text: str, name: str) -> None:
    solver = solver_of(text)
    assert solver.name == name
    assert solver_of(name) == solver


def test_names_are_split_at_commas_outside_of_brackets() -> None:
    found = solvers_of("a,b".replace("a", "lshade[size=60,memory=6]+ipopt"). replace(
        "b", "de, lshade[memory=6,size=60]+ipopt"
    ))  # fmt: skip
    assert [one.name for one in found] == ["lshade[memory=6,size=60]+ipopt", "de"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("lshad", "did you mean 'lshade'"),
        ("lshade[siz=3]", "did you mean 'size'"),
        ("lshade[name=de]", "expected a known option, found 'name'"),
        ("lshade[size=60", r"expected options such as name\[key=value\]"),
        ("lshade[size=1,size=2]", "each once; found 'size=2'"),
        ("lshade[size]", "each once; found 'size'"),
        ("lshade+ipop", "did you mean 'ipopt'"),
        ("lshade+ipopt+ipopt", "an NLP solver after one"),
        ("ipopt+de", "expected a search with an NLP solver after it"),
        ("solve[lane=3]", "did you mean 'lanes'"),
        ("solve[lanes=abc]", 'lanes to be an integer from 0 to 100000, found "abc"'),
        ("solve[lanes=-1]", "lanes to be an integer from 0"),
        ("solve[search=des]", "did you mean 'de'"),
        ("solve+ipopt", "expected a search with an NLP solver after it"),
        ("ipopt[max_iterations=0]", "must be an integer of at least 1, got 0"),
        ("ipopt[nonsense=1]", "No such IPOPT option: nonsense"),
        ("sqpmethod[max_ite=1]", "did you mean 'max_iter'"),
        ("scipy-de[popsiz=3]", "did you mean 'popsize'"),
        ("scipy-de[popsize=0]", "popsize to be an integer of at least 1; found 0"),
        ("pygmo-pso[omega=NaN]", "omega to be a number of at least 0"),
        ("ipopt[hsllib=x.so]", "neither name files nor run programs"),
        ("sqpmethod[jit=true]", "neither name files nor run programs"),
        ("repeated-none", "expected a solver: one of"),
        ("x" * 2000, "at most 1000 characters"),
    ],
)
def test_what_is_no_solver_is_refused(text: str, said: str) -> None:
    with pytest.raises(UnknownSolverError, match=said):
        solver_of(text)


def test_settings_of_a_search_are_refused_in_the_words_for_a_scenario() -> None:
    with pytest.raises(InvalidScenarioError) as of_name:
        solver_of("lshade[size=2]")
    with pytest.raises(InvalidScenarioError) as of_file:
        resolve(
            read_document("double_integrator"),
            search="lshade",
            assignments=["search.size=2"],
        )
    words = "expected search.size to be null or an integer of at least 4; found 2"
    assert str(of_name.value).endswith(words) and str(of_file.value).endswith(words)


@pytest.mark.parametrize("text", ["lshade[size=1e400]", "lshade[size=[]]", "de[F={}]"])
def test_forged_values_are_errors_of_this_package(text: str) -> None:
    with pytest.raises(SwarmstartError):
        solver_of(text)


def test_an_old_name_is_read_as_the_new_one_with_a_hint() -> None:
    old, new = solver_of("multistart-fatrop"), solver_of("repeated-fatrop")
    assert old == new and not new.hint
    words = "the solver multistart-fatrop is called repeated-fatrop now"
    assert old.hint == f"{words} (more: docs/messages.md#renamed)"


def test_no_two_names_differ_by_a_hyphen_and_a_plus() -> None:
    """Such as multistart-ipopt and multistart+ipopt did."""
    with pytest.raises(UnknownSolverError) as error:
        solver_of("?")
    listed = str(error.value).partition("one of ")[2].partition(", or")[0].split(", ")
    polished = [f"{name}+{plugin}" for name in listed for plugin in plugins()]
    bare = [name.replace("-", "+") for name in (*listed, *polished)]
    assert len(listed) > 20 and len({*bare}) == len(bare)


def test_the_null_hypothesis_is_a_solver() -> None:
    assert solver_of(NULL_HYPOTHESIS).family == "repeated"
    assert not solver_of(NULL_HYPOTHESIS).is_deterministic
    assert solver_of("fatrop").is_deterministic
    assert not solver_of("solve").is_deterministic


def test_a_peer_that_is_missing_is_named_with_its_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match="pip install pygmo"):
        solver_of("pygmo-de")


def test_names_alone_import_nothing_heavy() -> None:
    code = (
        "import sys; from swarmstart.cases.campaign.trials import solver_names as s;"
        "s.solvers_of('lshade,de,solve');"
        "print([m for m in ('numpy', 'casadi', 'scipy', 'pygmo') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"
