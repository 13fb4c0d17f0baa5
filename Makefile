# Set-up goes in steps. Each leaves a file in the virtual environment, which make compares with the
# files that the step depends on; so a step that was interrupted is repeated.

VENV = .venv
BIN = $(VENV)/bin
UV = VIRTUAL_ENV=$(VENV) $(BIN)/uv --quiet pip
# Half of the tests wait for other processes: three test workers keep two cores busy.
DISTRIBUTE = --numprocesses=$(shell echo $$(( ($$(nproc) * 3 + 1) / 2 ))) --dist=loadgroup
PYTEST = $(BIN)/python -m pytest $(DISTRIBUTE) --durations=15
JAVASCRIPT = test/js/node_modules/.package-lock.json
VERSIONS = 3.10 3.11 3.12

# An installed ROS that is sourced, or another virtual environment, must not leak into this one.
# PYTHONDONTWRITEBYTECODE would make every process compile the packages again.
unexport PYTHONDONTWRITEBYTECODE PYTHONPATH PYTHONHOME VIRTUAL_ENV LD_LIBRARY_PATH PKG_CONFIG_PATH AMENT_PREFIX_PATH \
         CMAKE_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE

.NOTPARALLEL:
.PHONY: help setup dev demo test test-all test-pythons test-under-load lint bench validate \
        estimators parts requirements upgrade clean always

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 24

setup:  ## make .venv with all that the suite needs (make PYTHON=... chooses the Python)
	@+$(ONE_AT_A_TIME) $(VENV)/.interfaces $(VENV)/.package

dev:  ## the same, and what tests and checks need
	@+$(ONE_AT_A_TIME) $(VENV)/.interfaces $(VENV)/.package $(VENV)/.dev $(JAVASCRIPT)

demo: setup  ## set up and run the main job: drop a part and ask for its aspects over ROS
	@$(BIN)/resting_aspects demo

test: dev  ## set up and run all tests but the slow ones
	@$(PYTEST) -m 'not slow'

test-all: dev  ## set up and run all tests, with more examples of each property
	@HYPOTHESIS_PROFILE=all $(PYTEST)

test-pythons:  ## run tests with each Python of 3.10, 3.11 and 3.12 that is installed
	@+set -e; for version in $(VERSIONS); do \
	    if ! PYTHON=python$$version tools/find_python > /dev/null; then \
	        echo "Python $$version is not tested"; continue; \
	    fi; \
	    $(MAKE) --no-print-directory PYTHON=python$$version VENV=.venv-$$version dev; \
	    echo "Python $$version:"; \
	    .venv-$$version/bin/python -m pytest $(DISTRIBUTE) --quiet -m 'not slow' test/core \
	        test/simulation test/cli test/nodes/test_get_distribution.py; \
	done

test-under-load: dev  ## run the tests twice while six busy processes run beside them
	@+for n in 1 2 3 4 5 6; do while kill -0 $$$$ 2> /dev/null; do :; done & done; \
	    $(MAKE) test && $(MAKE) test

lint: dev  ## set up and run ruff and mypy
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: dev  ## time what has to be fast; writes out/bench.json and docs/explanation/bench.md
	$(BIN)/python tools/bench.py

validate: setup  ## hold the drops to themselves and to measurements, and write docs/explanation/validation.md
	$(BIN)/python tools/validate.py

estimators: setup  ## hold the analytic methods to measurements and drops, and write docs/explanation/estimators.md
	$(BIN)/python tools/estimators.py

parts: setup  ## make the example parts in config/parts again
	$(BIN)/python tools/make_parts.py

# One lock for all Pythons that are allowed; no index named, so that a mirror can be used.
COMPILE = UV_CUSTOM_COMPILE_COMMAND='make requirements' $(UV) compile $(UPGRADE) \
    --universal --python-version 3.10 --no-emit-index-url
requirements: dev  ## pin the versions of what requirements*.in name; other pins stay
	$(COMPILE) requirements.in -o requirements.txt
	$(COMPILE) -c requirements.txt requirements-dev.in -o requirements-dev.txt

upgrade: UPGRADE = --upgrade
upgrade: requirements  ## pin the newest versions of all

clean:  ## remove everything that set-up, tests and runs made
	rm -rf .venv .venv-* build install log out .*_cache .hypothesis *.egg-info \
	    test/js/node_modules

# ---- the steps of set-up

ONE_AT_A_TIME = flock Makefile $(MAKE) --silent --no-print-directory

# Install what a lock file names. Not with `uv pip sync`, which also removes the modules of the ROS
# wheels: they carry a second description of themselves, under a name that no lock file has.
# While packages are installed, .requirements is missing: see tools/make_venv.
define install
	@echo "set-up: installing $(1)"
	@rm -f $(VENV)/.requirements
	@$(UV) install --no-deps --compile-bytecode --requirement $(1)
	@touch $(VENV)/.requirements
endef

$(VENV)/.made: always
	@tools/make_venv $(VENV)

$(VENV)/.requirements: $(VENV)/.made requirements.txt
	$(call install,requirements.txt)

# Editable: the commands run the code of this folder.
$(VENV)/.package: setup.py setup.cfg pyproject.toml package.xml $(VENV)/.made \
        | $(VENV)/.requirements
	@$(UV) install --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/.dev: requirements-dev.txt $(VENV)/.made | $(VENV)/.requirements
	$(call install,requirements-dev.txt)
	@touch $@

$(VENV)/.interfaces: $(VENV)/.made requirements.txt tools/build_interfaces \
        $(shell find resting_aspects_interfaces) | $(VENV)/.requirements
	@echo "set-up: building resting_aspects_interfaces"
	@tools/build_interfaces $(VENV)
	@touch $@

# Without npm or a network, set-up goes on, and the tests that need this are skipped.
$(JAVASCRIPT): test/js/package.json test/js/package-lock.json
	@npm ci --prefix test/js --ignore-scripts --no-audit --no-fund --no-update-notifier \
	    --fetch-retries=1 --fetch-retry-mintimeout=1000 --fetch-timeout=20000 \
	    > $(VENV)/npm.log 2>&1 \
	    || echo "set-up: npm failed, see $(VENV)/npm.log: tests in JavaScript are skipped"
