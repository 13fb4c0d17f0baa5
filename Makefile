# Set-up consists of steps. Each step leaves a file in the virtual environment, which make compares
# with the files that the step depends on. Therefore an interrupted step is repeated.

VENV = .venv
BIN = $(VENV)/bin
UV = VIRTUAL_ENV=$(VENV) $(BIN)/uv --quiet pip
# Half of the tests wait for other processes, so three test workers keep two cores busy.
DISTRIBUTE = --numprocesses=$(shell echo $$(( ($$(nproc) * 3 + 1) / 2 ))) --dist=loadgroup
PYTEST = $(BIN)/python -m pytest $(DISTRIBUTE) --durations=15
JAVASCRIPT = test/js/node_modules/.package-lock.json
VERSIONS = 3.10 3.11 3.12

# A sourced ROS installation or another virtual environment must not affect this one. With
# PYTHONDONTWRITEBYTECODE, every process would compile the packages again.
unexport PYTHONDONTWRITEBYTECODE PYTHONPATH PYTHONHOME VIRTUAL_ENV LD_LIBRARY_PATH PKG_CONFIG_PATH AMENT_PREFIX_PATH \
         CMAKE_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE

.NOTPARALLEL:
.PHONY: help setup dev demo test test-all test-pythons test-under-load lint bench validate \
        parts reference requirements upgrade clean always

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 24

setup:  ## create .venv with everything that the suite needs (PYTHON=... selects the Python)
	@+$(ONE_AT_A_TIME) $(VENV)/.interfaces $(VENV)/.package $(VENV)/.kernel

dev:  ## the same as setup, with everything that tests and checks need
	@+$(ONE_AT_A_TIME) $(VENV)/.interfaces $(VENV)/.package $(VENV)/.kernel $(VENV)/.dev $(JAVASCRIPT)

demo: setup  ## set up and run the demo: drop a part and request its aspects over ROS
	@$(BIN)/resting_aspects demo

test: dev  ## set up and run all tests except the slow ones
	@$(PYTEST) -m 'not slow'

test-all: dev  ## set up and run all tests, with more examples of each property
	@HYPOTHESIS_PROFILE=all $(PYTEST)

test-pythons:  ## run tests with each installed Python of 3.10, 3.11 and 3.12
	@+set -e; for version in $(VERSIONS); do \
	    if ! PYTHON=python$$version tools/setup/find_python > /dev/null; then \
	        echo "Python $$version is not tested"; continue; \
	    fi; \
	    $(MAKE) --no-print-directory PYTHON=python$$version VENV=.venv-$$version dev; \
	    echo "Python $$version:"; \
	    .venv-$$version/bin/python -m pytest $(DISTRIBUTE) --quiet -m 'not slow' test/part test/aspects test/statistics \
	        test/simulation test/cli test/nodes/test_get_distribution.py; \
	done

test-under-load: dev  ## run the tests twice, concurrently with six busy processes
	@+for n in 1 2 3 4 5 6; do while kill -0 $$$$ 2> /dev/null; do :; done & done; \
	    $(MAKE) test && $(MAKE) test

lint: dev  ## set up and run ruff, mypy and import-linter
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

bench: dev  ## run the benchmarks and write docs/explanation/bench.md
	PYTHONPATH=tools $(BIN)/python -m bench

validate: dev  ## validate the simulation and write docs/explanation/validation.md
	PYTHONPATH=tools $(BIN)/python -m validation

parts: setup  ## generate the example parts in config/parts
	$(BIN)/python tools/setup/make_parts.py

reference: dev  ## write the tables of docs/reference and the parameter file from the code
	$(BIN)/python tools/setup/reference.py

# One lock file for all supported Pythons. It names no index, so that a mirror can be used.
COMPILE = UV_CUSTOM_COMPILE_COMMAND='make requirements' $(UV) compile $(UPGRADE) \
    --universal --python-version 3.10 --no-emit-index-url
requirements: dev  ## pin the packages in requirements*.in; existing pins are kept
	$(COMPILE) requirements.in -o requirements.txt
	$(COMPILE) -c requirements.txt requirements-dev.in -o requirements-dev.txt

upgrade: UPGRADE = --upgrade
upgrade: requirements  ## pin the newest versions of all packages

clean:  ## remove everything that set-up, tests and runs created
	rm -rf .venv .venv-* build install log out .*_cache .hypothesis *.egg-info \
	    test/js/node_modules

# ---- the steps of set-up

ONE_AT_A_TIME = flock Makefile $(MAKE) --silent --no-print-directory

# Install the packages of a lock file. `uv pip sync` cannot be used: it would remove the modules of
# the ROS wheels, which also have metadata under a name that is in no lock file. During the
# installation, .requirements does not exist, see tools/setup/make_venv.
define install
	@echo "set-up: installing $(1)"
	@rm -f $(VENV)/.requirements
	@$(UV) install --no-deps --compile-bytecode --requirement $(1)
	@touch $(VENV)/.requirements
endef

$(VENV)/.made: always
	@tools/setup/make_venv $(VENV)

$(VENV)/.requirements: $(VENV)/.made requirements.txt
	$(call install,requirements.txt)

# An editable installation, so that the commands run the code in this folder.
$(VENV)/.package: setup.py setup.cfg pyproject.toml package.xml $(VENV)/.made \
        | $(VENV)/.requirements
	@$(UV) install --no-deps --no-build-isolation --editable .
	@touch $@

# The first drops compile the kernel, which is then kept in __pycache__. It depends on the version
# of Numba, too.
$(VENV)/.kernel: resting_aspects_ros/simulation/kernel.py \
        resting_aspects_ros/simulation/kernel_data.py requirements.txt $(VENV)/.package
	@echo "set-up: compiling the kernel"
	@$(BIN)/python -c "import resting_aspects_ros as ra; ra.drop(ra.load_part('tetrahedron'), drops=1)"
	@touch $@

$(VENV)/.dev: requirements-dev.txt $(VENV)/.made | $(VENV)/.requirements
	$(call install,requirements-dev.txt)
	@touch $@

$(VENV)/.interfaces: $(VENV)/.made requirements.txt tools/setup/build_interfaces \
        $(shell find resting_aspects_interfaces) | $(VENV)/.requirements
	@echo "set-up: building resting_aspects_interfaces"
	@tools/setup/build_interfaces $(VENV)
	@touch $@

# Without npm or a network, set-up continues, and the tests that need the packages are skipped.
$(JAVASCRIPT): test/js/package.json test/js/package-lock.json
	@npm ci --prefix test/js --ignore-scripts --no-audit --no-fund --no-update-notifier \
	    --fetch-retries=1 --fetch-retry-mintimeout=1000 --fetch-timeout=20000 \
	    > $(VENV)/npm.log 2>&1 \
	    || echo "set-up: npm failed, see $(VENV)/npm.log: tests in JavaScript are skipped"
