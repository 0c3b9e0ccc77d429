# `make panel` and `make test` do all their own set-up in .venv from the pinned constraints.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# Python of environments that packages with pins of their own are set up in.
ISAACLAB_PYTHON ?= python3.12
DM_CONTROL_PYTHON ?= $(PYTHON)
# Bytecode is kept, whatever the environment says: tests start many processes.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist worksteal
PIP := $(BIN)/python -m pip install --quiet --constraint constraints.txt

.PHONY: panel test test-slow lint docs notebooks bench published census isaaclab dm_control clean

panel: $(READY)
	@$(BIN)/integ-gym panel --out runs/panel

test: $(READY)
	$(PYTEST) -m "not slow" $(PYTEST_OPTIONS)

test-slow: $(READY)
	$(PYTEST) -m slow $(PYTEST_OPTIONS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(READY)
	@$(PIP) --group docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "Open runs/docs/index.html"

notebooks: $(READY)
	@$(PIP) --group notebooks
	$(BIN)/jupyter execute --inplace examples/notebooks/*.ipynb

bench: $(READY)
	@$(PIP) --group bench
	@mkdir -p runs/bench
	for name in env_throughput evidence_cost verification_cost reference_cost engines panel_cost trainer_equivalence claims executor_overhead; do \
	  $(BIN)/python benchmarks/$$name.py --json runs/bench/$$name.json || exit 1; \
	done

published: $(READY)
	@$(PIP) --group census

census: published
	@$(BIN)/integ-gym census --out runs/census

isaaclab: .isaaclab/.ready

dm_control: .dm_control/.ready

.isaaclab/.ready: constraints-isaaclab.txt
	@$(ISAACLAB_PYTHON) -c 'import sys; sys.exit("Isaac Lab needs Python 3.12, found " + sys.version.split()[0] + "; set ISAACLAB_PYTHON" if sys.version_info[:2] != (3, 12) else 0)'
	@echo "Setting up .isaaclab with Isaac Lab: 8 GB, once."
	@$(ISAACLAB_PYTHON) -m venv .isaaclab
	@.isaaclab/bin/python -m pip install --quiet --requirement constraints-isaaclab.txt
	@touch $@

.dm_control/.ready: constraints-dm_control.txt
	@$(DM_CONTROL_PYTHON) -c 'import sys; sys.exit("dm_control needs Python 3.11 or 3.12, found " + sys.version.split()[0] + "; set DM_CONTROL_PYTHON" if sys.version_info[:2] not in ((3, 11), (3, 12)) else 0)'
	@echo "Setting up .dm_control with dm_control and its own MuJoCo."
	@$(DM_CONTROL_PYTHON) -m venv .dm_control
	@.dm_control/bin/python -m pip install --quiet --requirement constraints-dm_control.txt
	@touch $@

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("integ-gym needs Python 3.11 or newer, found " + sys.version.split()[0] + "; set PYTHON=python3.11" if sys.version_info < (3, 11) else 0)'
	@echo "Setting up $(VENV) with the pinned packages; this takes a few minutes once."
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) pip setuptools
	@$(PIP) torch
	@$(PIP) --editable ".[all]" --group dev
	@touch $(READY)

clean:
	rm -rf $(VENV) .isaaclab .dm_control build dist *.egg-info
