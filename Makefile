# Every target sets up what it needs: Python 3.11 or later and make are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
JOBS ?= 2
# Work runs in as many processes as there are jobs; threads of a linear algebra library inside
# each would only get in each other's way.
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
OUT ?= runs

.PHONY: help setup bench bench-quick gate perf test check results clean

help:
	@echo "make bench        both studies, into $(OUT)/paper and $(OUT)/highway"
	@echo "make bench-quick  a part of it in under two minutes, into $(OUT)/quick, and its limits"
	@echo "make gate         whether the paper's study keeps its limits"
	@echo "make perf         speed of the solvers against others"
	@echo "make test         linter, type checker and tests"
	@echo "make check        linter and type checker"
	@echo "make results      copy the studies' tables and figures to results/"
	@echo "make clean        remove the virtual environment and caches, keep runs"

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed: make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

setup: $(VENV)/.installed

bench: setup
	$(BIN)/olne-bench run paper --out $(OUT)/paper --jobs $(JOBS)
	$(BIN)/olne-bench run highway --out $(OUT)/highway --jobs $(JOBS)

bench-quick: setup
	$(BIN)/olne-bench run quick --out $(OUT)/quick --jobs $(JOBS)
	$(BIN)/olne-bench gate $(OUT)/quick

gate: setup
	$(BIN)/olne-bench gate $(OUT)/paper

perf: setup
	$(BIN)/python scripts/perf.py

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

test: check
	$(BIN)/python -m pytest --numprocesses $(JOBS)

# What the repository keeps of the studies: tables, pictures, and the page where it has fewer bytes.
PAGE_LIMIT := 1500000

results: setup
	$(BIN)/olne-bench report $(OUT)/paper
	for study in paper highway; do \
		mkdir -p results/$$study/figures && \
		cp $(OUT)/$$study/leaderboard.csv $(OUT)/$$study/trials.parquet results/$$study/ && \
		cp $(OUT)/$$study/figures/*.png results/$$study/figures/ && \
		rm -f results/$$study/index.html && \
		find $(OUT)/$$study -maxdepth 1 -name index.html -size -$(PAGE_LIMIT)c -exec cp {} results/$$study/ \; || exit 1; \
	done
	cp $(OUT)/paper/figures/*.svg results/paper/figures/
	du -sk results | awk '{ if ($$1 > 10240) { print "results/ has " $$1 " KiB; at most 10 MiB are kept"; exit 1 } }'

clean:
	rm -rf $(VENV) *.egg-info .pytest_cache .mypy_cache .ruff_cache
