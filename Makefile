# Everything runs from .venv; the stamp file makes a second call install nothing.
# Another interpreter: make venv PYTHON=/path/to/python3.12

PYTHON ?= $(shell python3.11 -c '' 2>/dev/null && echo python3.11 || echo python3)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
REQUIREMENTS := requirements/constraints.txt requirements/omnisafe.txt

# The parts on which every other figure rests.
COVERED := envs/*,algorithms/corridor.py,algorithms/critical_acceleration.py,algorithms/safety_guard.py,bench/statistics/*
COVERAGE_MIN := 90

# One thread a process: oversubscribed OpenMP threads make small updates a hundred times slower.
export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help venv bench test check lint types coverage slow browser tables docs clean

help: ## List the targets.
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

venv: $(STAMP) ## Make .venv and install the project with its development tools.

$(STAMP): pyproject.toml $(REQUIREMENTS)
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check -c requirements/constraints.txt -e ".[dev,docs]"
	$(BIN)/python -m pip install --disable-pip-version-check --no-deps -r requirements/omnisafe.txt
	touch $@

bench: $(STAMP) ## Run every method on scenario b with the quick protocol and print the table.
	$(BIN)/bench run --algo all --scenario b --protocol quick

test: $(STAMP) ## Run the fast tests.
	$(BIN)/python -m pytest -n 2

check: lint types coverage ## All that a change must pass: ruff, mypy, fast tests, branch coverage.

lint: $(STAMP) ## Check style and format.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP) ## Check types.
	$(BIN)/mypy

# Coverage cannot see into compiled kernels, so the small tests among theirs run once more uncompiled.
coverage: $(STAMP) ## Run the fast tests and hold the branch coverage of the core.
	$(BIN)/python -m pytest -n 2 --cov --cov-report=
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n 2 -m kernels --cov --cov-append --cov-report=
	$(BIN)/coverage report --include='$(COVERED)' --fail-under=$(COVERAGE_MIN)

browser: $(STAMP) ## Run the report in a headless Chromium, which must be installed.
	$(BIN)/python -m pytest -m browser

slow: $(STAMP) ## Run the slow and the learning tests.
	$(BIN)/python -m pytest -m "slow or learning"

tables: $(STAMP) ## Draw tables, leaderboard, claims and plots again from the committed records.
	$(BIN)/bench tables
	$(BIN)/bench leaderboard
	$(BIN)/bench claims
	$(BIN)/bench plot
	$(BIN)/python -m paper_tables.readme

docs: $(STAMP) ## Build the documentation into site/: no network, and any warning or dead link is an error.
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

clean: ## Remove .venv, caches and build leftovers; records stay.
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .coverage .coverage.* build dist site *.egg-info
	find . -type d -name __pycache__ -prune -exec rm -rf {} +
