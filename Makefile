# Each target does its own set-up in .venv from the pinned constraints, and installs what it needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
LIGHT := $(VENV)/.panel
TORCH := $(VENV)/.train
READY := $(VENV)/.ready
INSTALL := .ci/install $(BIN)/python
# Python of environments that packages with pins of their own are set up in.
ISAACLAB_PYTHON ?= python3.12
DM_CONTROL_PYTHON ?= $(PYTHON)
# Those that have summaries.
ATLASES := $(patsubst docs/atlas/%/,%,$(wildcard docs/atlas/*/))
# Published experiments on pages of their own, each in blocks that resume.
TABLES := simulation_tools stop_damping learned_engines learned_periods
# Those whose figures the paper shows.
PAPER_TABLES := learned_engines simulation_tools
# Bytecode is kept, whatever the environment says: tests start many processes.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist worksteal

.PHONY: panel train test test-slow lint docs notebooks bench tables atlas-figures paper-figures published census isaaclab dm_control moto trackers clean

panel: $(LIGHT)
	@$(BIN)/integ-gym panel --out runs/panel

train: $(TORCH)
	@$(BIN)/python train/ppo.py --integrator explicit_euler --dt 0.05 $(TRAIN_OPTIONS)

test: $(READY)
	$(PYTEST) -m "not slow" $(PYTEST_OPTIONS)

test-slow: $(READY) moto trackers
	$(PYTEST) -m slow $(PYTEST_OPTIONS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(READY)
	@$(INSTALL) --group docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "Open runs/docs/index.html"

notebooks: $(READY)
	@$(INSTALL) --group notebooks
	$(BIN)/jupyter execute --inplace examples/notebooks/*.ipynb

bench: $(READY)
	@$(INSTALL) --group bench
	@mkdir -p runs/bench
	for name in startup env_throughput evidence_cost verification_cost reference_cost engines panel_cost trainer_equivalence executor_overhead; do \
	  $(BIN)/python benchmarks/$$name.py --json runs/bench/$$name.json || exit 1; \
	done
	$(BIN)/python benchmarks/bounds.py runs/bench

tables: $(READY)
	@for name in $(TABLES); do \
	  $(BIN)/python benchmarks/tables/$$name.py --out runs/tables/$$name $(TABLES_OPTIONS) || exit 1; \
	done

atlas-figures: $(LIGHT)
	@for name in $(ATLASES); do \
	  $(BIN)/integ-gym atlas specs/atlas/$$name.toml --summaries docs/atlas/$$name --publish docs/atlas/$$name/figures || exit 1; \
	done

paper-figures: $(READY)
	@mkdir -p runs/paper
	@$(BIN)/python benchmarks/panel_tables.py docs/quick_panel_run.json.gz --figure runs/paper/heatmap
	@cp runs/paper/heatmap.png docs/images/heatmap.png
	@for name in $(PAPER_TABLES); do \
	  $(BIN)/python benchmarks/tables/$$name.py --out docs/tables/$$name --figure runs/paper/$$name && \
	  cp runs/paper/$$name.png docs/tables/$$name/figure.png || exit 1; \
	done

published: $(READY)
	@$(INSTALL) --group census

census: published
	@$(BIN)/integ-gym census --out runs/census

isaaclab: .isaaclab/.ready

dm_control: .dm_control/.ready

moto: .moto/.ready

trackers: .trackers/.ready

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

.moto/.ready: constraints-moto.txt
	@echo "Setting up .moto with an S3-compatible server for tests."
	@$(PYTHON) -m venv .moto
	@.moto/bin/python -m pip install --quiet --requirement constraints-moto.txt
	@touch $@

.trackers/.ready: constraints-trackers.txt
	@echo "Setting up .trackers with Weights & Biases and MLflow for a test."
	@$(PYTHON) -m venv .trackers
	@.trackers/bin/python -m pip install --quiet --requirement constraints-trackers.txt
	@touch $@

# Each step of the set-up adds to the one before, in the same .venv.
$(LIGHT): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("integ-gym needs Python 3.11 or newer, found " + sys.version.split()[0] + "; set PYTHON=python3.11" if sys.version_info < (3, 11) else 0)'
	@echo "Setting up $(VENV) for panels: 1.2 GB, once."
	@$(PYTHON) -m venv $(VENV)
	@$(INSTALL) --editable ".[panel,render]"
	@touch $@

$(TORCH): $(LIGHT)
	@echo "Adding stable-baselines3 and torch to $(VENV), once."
	@$(INSTALL) --editable ".[panel,render,train]"
	@touch $@

$(READY): $(TORCH)
	@echo "Adding the engines and what tests take to $(VENV): 4 GB, once."
	@$(INSTALL) --editable ".[all]" --group dev
	@touch $@

clean:
	rm -rf $(VENV) .isaaclab .dm_control .moto .trackers build dist *.egg-info
