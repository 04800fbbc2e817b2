"""Texts about problems in Python: those about problems in YAML, with another template.

Imports nothing heavy, so that `swarmstart list` is quick.
"""

from dataclasses import replace

from swarmstart.cases.kinds.problem.stated.names import WORDS as OF_PROBLEMS

WORDS = replace(
    OF_PROBLEMS,
    kind="swarmstart.cases.kinds.python.kind:KIND",
    title="any system, built by a function in a Python file of your own",
    templates={"python.yaml": "", "python.py.txt": ".py"},
    runs_code=True,
)
