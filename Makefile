# Every target sets up what it needs: Python 3.11 or later and make are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
JOBS ?= 2
OUT ?= runs

.PHONY: help setup bench bench-quick test check results clean

help:
	@echo "make bench        the whole study, into $(OUT)/paper"
	@echo "make bench-quick  a part of it in under two minutes, into $(OUT)/quick"
	@echo "make test         linter, type checker and tests"
	@echo "make check        linter and type checker"
	@echo "make results      copy the study's tables and figures to results/paper"
	@echo "make clean        remove the virtual environment and caches, keep runs"

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed: make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

setup: $(VENV)/.installed

bench: setup
	$(BIN)/olne-bench run paper --out $(OUT)/paper --jobs $(JOBS)

bench-quick: setup
	$(BIN)/olne-bench run quick --out $(OUT)/quick --jobs $(JOBS)

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

test: check
	$(BIN)/python -m pytest

results:
	mkdir -p results/paper
	cp -r $(OUT)/paper/leaderboard.csv $(OUT)/paper/trials.parquet $(OUT)/paper/figures results/paper/

clean:
	rm -rf $(VENV) *.egg-info .pytest_cache .mypy_cache .ruff_cache
