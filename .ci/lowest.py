"""Print the lowest version of every dependency that pyproject.toml allows, for pip."""

import re
import tomllib
from pathlib import Path

project = Path(__file__).resolve().parents[1] / "pyproject.toml"
dependencies = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
for requirement in dependencies["dependencies"]:
    match = re.fullmatch(r"([A-Za-z0-9_-]+)>=([0-9.]+)", requirement)
    if match is None:
        raise SystemExit(f"expected NAME>=VERSION, found {requirement!r}")
    print("==".join(match.groups()))
