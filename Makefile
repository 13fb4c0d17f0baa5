# What is set up, and when it is set up again, is decided in tools/setup_venv.py.

# An installed ROS that is sourced, or another virtual environment, must not leak into .venv.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV LD_LIBRARY_PATH PKG_CONFIG_PATH AMENT_PREFIX_PATH \
         CMAKE_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: help setup dev demo test test-all lint bench validate estimators parts requirements clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 20

setup:  ## make .venv with everything that the suite needs (make PYTHON=... chooses the Python)
	@tools/setup

dev: ## the same, and what tests and checks need
	@tools/setup dev

demo: setup  ## set up and run the main job: drop a part and ask for its aspects over ROS
	@.venv/bin/resting_aspects demo

# On all cores; test/conftest.py says which tests stay on one.
PYTEST = .venv/bin/python -m pytest --numprocesses=auto --dist=loadgroup --durations=15
test: dev  ## set up and run all tests but the slow ones
	@$(PYTEST) -m 'not slow'

test-all: dev  ## set up and run all tests, with more examples of each property
	@HYPOTHESIS_PROFILE=all $(PYTEST)

lint: dev  ## set up and run ruff and mypy
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy

bench: dev  ## time what has to be fast; writes out/bench.json and docs/bench.md
	.venv/bin/python tools/bench.py

validate: setup  ## hold the drops to themselves and to measurements, and write docs/validation.md
	.venv/bin/python tools/validate.py

estimators: setup  ## hold the analytic methods to measurements and drops, and write docs/estimators.md
	.venv/bin/python tools/estimators.py

parts: setup  ## make the example parts in config/parts again
	.venv/bin/python tools/make_parts.py

# One lock for all Pythons that are allowed; no index named, so that a mirror can be used.
COMPILE = UV_CUSTOM_COMPILE_COMMAND='make requirements' \
    .venv/bin/uv pip compile --quiet --upgrade --universal --python-version 3.10 --no-emit-index-url
requirements: dev  ## pin the newest versions of what requirements*.in name
	$(COMPILE) requirements.in -o requirements.txt
	$(COMPILE) -c requirements.txt requirements-dev.in -o requirements-dev.txt

clean:  ## remove everything that set-up, tests and runs made
	rm -rf .venv build install log out .*_cache .hypothesis *.egg-info test/js/node_modules
