# Everything runs in a virtual environment of its own, .venv, with the versions of requirements-lock.txt.
# Needed beforehand: Python 3.11 or later, make, and a way to PyPI.

PYTHON ?= python3
VENV := .venv
KERNEL_PROCESSES ?= 2
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

# One thread a process: the tests share the cores, and the planner's matrices are too small to gain from more.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# What is compiled is kept, also where an environment forbids it: the tests start many programs, and run twice.
export PYTHONDONTWRITEBYTECODE =

.DEFAULT_GOAL := help
.PHONY: help demo dist docs test test-kernel test-machines lint lint-types lint-rules format lock clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1: /p' $(MAKEFILE_LIST)

demo: $(INSTALLED)  ## plan a built-in scenario; writes ./demo/
	$(BIN)/scp-planner demo

docs: $(INSTALLED)  ## build the documentation into site/
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Types take a core for as long as all that is beside them. What the tests with the other kernel compile serves the others.
test: $(INSTALLED)  ## lint, type check and run the tests
	$(MAKE) --no-print-directory --jobs=2 lint-types lint-rules test-kernel KERNEL_PROCESSES=1
	$(BIN)/pytest -n 2 --dist worksteal

# What one processor computes another computes with a different last digit, as its kernel of OpenBLAS sums in another
# order. So tests of numbers, marked `numerics`, run with a second kernel. Prescott is the one that every x86-64
# processor can run and none of today takes by itself; it differs most, having neither AVX nor fused multiply-add.
# They are those of computations, and of single plans: drives and programs are left out, for time, and so are two of
# three in each file; test-machines runs all. Skipped, and told, where it cannot run.
test-kernel: $(INSTALLED)  ## run a third of the tests of numbers with another kernel of OpenBLAS
	$(BIN)/python tools/machines.py --variant kernel-prescott -- -q -n $(KERNEL_PROCESSES) -m "numerics and not slow" --one-in 3

# Takes hours. A part: make test-machines ARGUMENTS='--variant load --variant oldest -- tests/test_export.py'
test-machines: $(INSTALLED)  ## run the tests as on other machines; ARGUMENTS='--list' tells which
	$(BIN)/python tools/machines.py $(ARGUMENTS)

# Needs an hour, and PyPI. A part: make dist ARGUMENTS='-- -q tests/trips'
dist: $(INSTALLED)  ## build wheel and sdist into dist/, install both where nothing is, test the sdist; ARGUMENTS: pytest's
	$(BIN)/python tools/dist.py dist $(ARGUMENTS)

lint: $(INSTALLED)  ## ruff, mypy, layers of imports, and shapes, units and errors in docstrings
	$(MAKE) --no-print-directory --jobs=2 lint-types lint-rules

lint-types: $(INSTALLED)  # takes as long as all others, on a core of its own
	$(BIN)/mypy

lint-rules: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/python docs/check_docstrings.py

format: $(INSTALLED)  ## lay out the code and mend what ruff can
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock:  ## pin anew what pyproject.toml asks for
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/pip install --quiet uv
	$(VENV)-lock/bin/uv pip compile pyproject.toml --extra plot --extra docs --extra dev --universal --upgrade --generate-hashes \
	    --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" --quiet \
	    --output-file requirements-lock.txt
	rm -rf $(VENV)-lock

clean:  ## remove the environment and the caches
	rm -rf $(VENV) $(VENV)-lock $(VENV)-machines demo dist site .mypy_cache .pytest_cache .ruff_cache .hypothesis

$(INSTALLED): pyproject.toml requirements-lock.txt
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed; try: make PYTHON=python3.11") if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements-lock.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@
