"""All cases, made once."""

import pytest

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.catalogue import all_cases


@pytest.fixture(scope="session")
def cases() -> list[Case]:
    return all_cases()
