# Every target does its own set-up: `make demo` and `make test` work in a fresh clone with python3 and make only.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# One BLAS thread a process: small matrices, and several processes on few cores.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Nor is every process to compile every module anew, whatever the machine's images say.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test coverage lowest verify lint types docs bag clean

demo: $(READY)
	$(BIN)/tbm-monitor demo

# Files in parallel, the longest first, on one worker more than there are cores: tests of nodes wait for one another.
# Each worker has a ROS domain of its own.
PARALLEL := --numprocesses=$(shell expr $$(nproc) + 1) --dist=loadfile --no-loadscope-reorder

# Compiled once before: processes that compile at the same time may differ in the last bit, which a test would find.
COMPILED = bin/tbm-monitor simulate --duration 0.05 > /dev/null

test: $(READY)
	$(VENV)/$(COMPILED)
	$(BIN)/python -m pytest $(PARALLEL)

# The same tests, and which lines none of them runs; processes that tests start are counted, compiled kernels are not.
coverage: $(READY)
	$(VENV)/$(COMPILED)
	$(BIN)/python -m pytest $(PARALLEL) --cov --cov-report=term-missing:skip-covered

# The lowest versions that setup.py allows, all together, in an environment of their own: model, comparison, import
# and nodes.
LOWEST := $(VENV)-lowest
# Compiled code of its own: two versions of numba in one folder may read what the other has written.
lowest: export NUMBA_CACHE_DIR = $(abspath $(LOWEST))/numba
lowest: $(LOWEST)/.ready
	$(LOWEST)/$(COMPILED)
	$(LOWEST)/bin/python -m pytest $(PARALLEL) test/gsa/test_basis_over_inputs.py test/gsa/test_compare_recording.py \
		test/msgs/test_import.py test/ros/test_load_node.py test/ros/test_dynamics_node.py

# What takes minutes: every verification in full.
verify: $(READY)
	$(BIN)/python -m pytest -m verify

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(READY)
	$(BIN)/mypy

# The pages, in build/docs/; a warning is an error.
docs: $(READY)
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

bag: $(READY)
	$(BIN)/python bags/make_field_dz101.py
	$(BIN)/python bags/make_story_dz101.py

# After the other environment: two installations at once would write the same description of the package.
$(LOWEST)/.ready: setup.py .ci/lowest.py | $(READY)
	$(PYTHON) -m venv $(LOWEST)
	$(PYTHON) .ci/lowest.py > $(LOWEST)/constraints.txt
	$(LOWEST)/bin/python -m pip install --quiet --constraint $(LOWEST)/constraints.txt \
		--editable ".[cluster,import,live]" pytest pytest-xdist hypothesis mcap-ros2-support psutil
	touch $@

$(READY): setup.py
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version) if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[test,docs]"
	touch $@

clean:
	rm -rf $(VENV) $(LOWEST) build dist *.egg-info tbm_demo tbm_run
