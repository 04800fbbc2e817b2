"""A small swarm, as a file and as a finished run."""

from pathlib import Path

import pytest

import swarmstart as ss

TEXT = """\
schema: 1
name: six
kind: swarm
title: Six vehicles
steps: 200
starts: {formation: circle, count: 6, radius_m: 1.5}
goals: {formation: opposite}
safe_distance_m: 0.35
obstacles: [{radius_m: 0.2, place_m: [0, 0, 0]}]
links: {most_delay: 3, loss: 0.3}
plant: {substeps: 2, disturbance_m_s2: 0.05}
"""


@pytest.fixture
def six(tmp_path: Path) -> Path:
    file = tmp_path / "six.yaml"
    file.write_text(TEXT, "utf-8")
    return file


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> ss.Run:
    folder = tmp_path_factory.mktemp("six")
    (folder / "six.yaml").write_text(TEXT, "utf-8")
    return ss.run(str(folder / "six.yaml"), seed=0)
