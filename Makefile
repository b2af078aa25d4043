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

.PHONY: help setup bench bench-quick paper roads predictions field sensors submissions learners rl gate perf docs test check results clean

help:
	@echo "make bench        a part of the paper's study and of roads, into $(OUT)/paper and $(OUT)/roads"
	@echo "make paper        all of the paper's study, into $(OUT)/paper"
	@echo "make bench-quick  two players and a road, in half a minute, into $(OUT)/quick, and its limits"
	@echo "make roads        every estimator on HighwayEnv's roads, 50 draws each, into $(OUT)/roads: a night"
	@echo "make predictions  two estimators on these roads beside HighwayEnv's own drivers, into $(OUT)/predictions"
	@echo "make field        every estimator on every scenario, and several trajectories"
	@echo "make sensors      the paper's scenarios through five sensors, and the statistical limit"
	@echo "make submissions  check what was submitted, and write its page"
	@echo "make rl           train PPO among Nash traffic, into $(OUT)/rl"
	@echo "make gate         whether the paper's study keeps its limits"
	@echo "make perf         speed of the solvers against others"
	@echo "make docs         the documentation site, into site/; runs its tutorials"
	@echo "make test         linter, type checker and tests"
	@echo "make check        linter and type checker"
	@echo "make results      copy tables and figures of the studies in $(OUT) to results/"
	@echo "make clean        remove the virtual environment, the site and caches, keep runs"

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed: make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

# Some 5 GB, most of it PyTorch: only what trains, tests training or runs NashOpt waits for it.
$(VENV)/.learners: $(VENV)/.installed
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[rl,peers]"
	touch $@

setup: $(VENV)/.installed

learners: $(VENV)/.learners

# Ranks need some draws, and these take minutes. `make paper` and `make roads` go on with them.
PART = --seeds 7 \
	$(addprefix --scenario ,highway merge two_way roundabout intersection merging) \
	$(addprefix --estimator ,kkt_constrained map ridge kkt_residual uniform) \
	$(addprefix --sensor ,full partial) \
	$(addprefix --sigma ,0.05 0.5 0.0016 0.016)

bench: setup
	$(BIN)/olne-bench run paper --out $(OUT)/paper --jobs $(JOBS) --seeds 9
	$(BIN)/olne-bench run roads --out $(OUT)/roads --jobs $(JOBS) $(PART)

bench-quick: setup
	$(BIN)/olne-bench run quick --out $(OUT)/quick --jobs $(JOBS)
	$(BIN)/olne-bench gate $(OUT)/quick

paper: setup
	$(BIN)/olne-bench run paper --out $(OUT)/paper --jobs $(JOBS)

roads: setup
	$(BIN)/olne-bench run roads --out $(OUT)/roads --jobs $(JOBS)

# Samples come in one by one, and HighwayEnv's drivers are fitted to the first ten of 20.
predictions: setup
	$(BIN)/olne-bench run roads --kind streams --out $(OUT)/predictions --jobs $(JOBS) --rule fit_every=10 --no-figures \
		$(addprefix --scenario ,highway merge two_way roundabout intersection) \
		$(addprefix --estimator ,map kkt_constrained) --sensor full --sigma 0.2

field: setup
	$(BIN)/olne-bench run field --out $(OUT)/field --jobs $(JOBS)
	$(BIN)/olne-bench run several --out $(OUT)/several --jobs $(JOBS)
	$(BIN)/python scripts/several_trajectories.py $(OUT)/several

sensors: setup
	$(BIN)/olne-bench run sensors --out $(OUT)/sensors --jobs $(JOBS)
	$(BIN)/python scripts/sensors_claims.py --draws 200

submissions: setup
	rm -f results/submissions/index.html
	$(BIN)/olne-bench verify results/submissions/*/ --jobs $(JOBS) --page results/submissions/index.html

rl: $(VENV)/.learners
	$(BIN)/python scripts/train_ppo.py traffic --out $(OUT)/rl

gate: setup
	$(BIN)/olne-bench gate $(OUT)/paper

perf: setup
	$(BIN)/python scripts/perf.py

$(VENV)/.docs: $(VENV)/.installed
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	touch $@

# NO_MKDOCS_2_WARNING: Material says on every build what it thinks of another version of MkDocs.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo --no-cache

# One process more than there are jobs, as some tests wait for other processes or for a limit.
test: check
	$(BIN)/python -m pytest --numprocesses $$(($(JOBS) + 1)) --dist worksteal

results: setup
	$(BIN)/python scripts/keep_results.py $(abspath $(OUT))

clean:
	rm -rf $(VENV) site *.egg-info .pytest_cache .mypy_cache .ruff_cache
