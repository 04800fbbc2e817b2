"""Write all shipped hard problems anew: `python -m swarmstart.cases.hard`."""

from pathlib import Path

from swarmstart.cases.hard.families import SHIPPED, shipped_text

if __name__ == "__main__":
    for name in SHIPPED:
        file = Path(__file__).parent / "problems" / f"{name}.yaml"
        file.write_text(shipped_text(name), encoding="utf-8")
