"""Places and kinds of faults, and text that must not be changed."""

import ast

import pytest

from swarmstart.benchmarks.fault_places import applied, faults, line_of

BEFORE_AND_AFTER = [
    ("y = a + b", {"y = a - b"}),
    ("y = a / b", {"y = a * b"}),
    ("y -= b", {"y += b"}),
    ("y = -a", {"y = a"}),
    ("y = a < b", {"y = a >= b", "y = a <= b"}),
    ("y = a >= b", {"y = a < b", "y = a > b"}),
    ("y = a == b", {"y = a != b"}),
    ("y = a is not b", {"y = a is b"}),
    ("y = a not in b", {"y = a in b"}),
    ("y = a < b < c", {
        "y = a >= b < c", "y = a <= b < c", "y = a < b >= c", "y = a < b <= c",
    }),
    ("y = a and b", {"y = a or b"}),
    ("y = a or b or c", {"y = a and b or c", "y = a or b and c"}),
    ("y = not a", {"y =  a"}),
    ("y = 0", {"y = 1"}),
    ("y = 1.0", {"y = 0.0", "y = 2.0"}),
    ("y = 7", {"y = 14", "y = 3"}),
    ("y = 1e-9", {"y = 2e-09", "y = 5e-10"}),
    ("y = min(a)", {"y = max(a)"}),
    ("y = np.minimum", {"y = np.maximum"}),
    ("y = a.all()", {"y = a.any()"}),
    ("y = f(*a, **b)", set()),
    ("y = a ** b @ c", set()),
    ("y = a[b]  # 1 < 2", set()),
    ("y = (a  # - \n  - b)", {"y = (a  # - \n  + b)"}),
    ("y = 'ü' == a", {"y = 'ü' != a"}),
]  # fmt: skip


@pytest.mark.parametrize(("before", "after"), BEFORE_AND_AFTER)
def test_each_place_has_the_faults_of_its_token(before: str, after: set[str]) -> None:
    found = {applied(before, fault) for place in faults(before) for fault in place}
    assert found == after


@pytest.mark.parametrize(
    "text",
    [
        '"""1 + 1 < 2."""',
        "x: Literal[3]",
        "def f(x: Literal[3]) -> Literal[4]:\n    pass",
        'raise ValueError(f"expected {a + 1}", 2)',
        'y = f"{a - 1:.3g}"',
        "y = True",
        "y = 'a' + b",
        "y = [a] * b",
        "class A:\n    def __repr__(self):\n        return str(a + 1)",
    ],
)
def test_text_and_annotations_are_left_alone(text: str) -> None:
    assert faults(text) == []


def test_defaults_and_values_beside_annotations_are_changed() -> None:
    text = "def f(x: int = 0, *, y: int = 2):\n    z: float = a + b"
    assert len(faults(text)) == 3


def test_every_fault_is_another_program_and_on_the_line_said() -> None:
    text = "# ä\nif a < b and not c:\n    d = min(a, 3) * -2.5\n"
    for place in faults(text):
        for fault in place:
            changed = applied(text, fault)
            assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text))
            rows = zip(text.splitlines(), changed.splitlines(), strict=True)
            differ = [k for k, (one, other) in enumerate(rows, 1) if one != other]
            assert differ == [line_of(text, fault)]
