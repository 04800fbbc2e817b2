# Everything happens in .venv, which is made on the first call; see the README for what
# the two commands expand to.
PYTHON ?= python3
VENV := .venv
INSTALLED := $(VENV)/.installed
INSTALLED_TO_TEST := $(VENV)/.installed-to-test
INSTALL := $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable

# The slowest tests are listed, so that it is seen what makes the suite long.
TESTS := $(VENV)/bin/python -m pytest -q -n auto --dist loadfile --no-loadscope-reorder \
	--durations 60 --durations-min 4

ROOMS := machine_code ocp heuristics terminal_set export simulators cases *.py

.PHONY: run test test-long lint docs clean

run: $(INSTALLED)
	$(VENV)/bin/swarmstart run formation_v

test: $(INSTALLED_TO_TEST)
	$(TESTS) -m "not long"

test-long: $(INSTALLED_TO_TEST)
	$(TESTS) -m long

lint: $(INSTALLED_TO_TEST)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/codespell
	# Comprehensions, conditional expressions, and/or count: at most 20 (grade C).
	@! $(VENV)/bin/radon cc --show-complexity --min D $(ROOMS) | grep .
	cd .dev && ../$(VENV)/bin/lint-imports --config ../pyproject.toml
	$(VENV)/bin/mypy

docs: $(INSTALLED_TO_TEST)
	rm -rf build/site
	$(VENV)/bin/python -m sphinx -q -W --keep-going -j auto -b html docs build/site
	@echo "open build/site/index.html"

.dev/swarmstart:  # In a clone it is there; an unpacked release has no links.
	mkdir -p .dev
	ln -s .. .dev/swarmstart

$(INSTALLED): pyproject.toml | .dev/swarmstart
	$(PYTHON) -c "import sys; sys.version_info >= (3, 11) or sys.exit('swarmstart needs Python 3.11 or newer; found ' + sys.version.split()[0] + '. Try: make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) .
	touch $(INSTALLED)

$(INSTALLED_TO_TEST): $(INSTALLED)
	$(INSTALL) '.[dev]'
	touch $(INSTALLED_TO_TEST)

clean:
	rm -rf $(VENV) build dist results
