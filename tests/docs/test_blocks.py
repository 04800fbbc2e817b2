"""Blocks are found on a page, and printed output is compared."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmstart.tests.docs.blocks import blocks_of
from swarmstart.tests.docs.comparing import differences

PAGE = """# Title

Save as `mine.yaml`:

```yaml
kind: problem
```

A call

```python
print(1)
```

prints

    1
    ...

- a list

<!-- not run: it needs a cluster -->
```python
raise SystemExit
```
"""


def test_blocks_are_found_with_what_stands_before_them(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    yaml, call, output, excluded = blocks_of(page)
    assert (yaml.language, yaml.file, yaml.line) == ("yaml", "mine.yaml", 5)
    assert (call.language, call.text, call.file) == ("python", "print(1)\n", "")
    assert output.is_output and output.text == "1\n...\n"
    assert excluded.excluded == "it needs a cluster"


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("cost 36.713", "cost  36.7121\n"),
        ("[1. 2.]", "[1. 2.]"),
        ("first\n...\nlast", "first\nsecond\nlast"),
        ("a ... of 3", "a share of 3"),
        ("1e-08", "1.1e-08"),
    ],
)
def test_output_agrees(shown: str, printed: str) -> None:
    assert differences(shown, printed) == []


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("cost 36.713", "cost 36.72"),
        ("3 of 4", "2 of 4"),
        ("first\nlast", "first"),
        ("first\n...\nlast", "first\nsecond"),
        ("a word", "another word"),
    ],
)
def test_output_differs(shown: str, printed: str) -> None:
    assert differences(shown, printed)
