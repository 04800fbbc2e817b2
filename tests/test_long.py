"""The list of tests that take long."""

import re
from pathlib import Path

from swarmstart.tests.conftest import long_tests

ROOT = Path(__file__).parents[1]


def test_every_long_test_is_there_and_once() -> None:
    names = long_tests()
    assert len(set(names)) == len(names)
    for name in names:
        file, _, test = name.partition("::")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"def {re.escape(test.partition('[')[0])}\(", text), name
