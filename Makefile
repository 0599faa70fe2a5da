# Needs Python 3.10 to 3.14 and make, nothing else.
#   make demo     own environment, then the built-in clip is rendered and tracked; prints where the pictures are
#   make test     own environment, then style, types and the quick tests
#   make test-all the same with all tests: papers' statistics, every look at the pages
#   make docs     own environment, then the documentation as a site in site/
#   make lock     writes requirements.lock anew from pyproject.toml
#   PYTHON=python3.12 make demo    another Python;   VENV=/some/folder make demo    another place for the environment

PYTHON ?= python3
VENV ?= .venv
DEMO_OUT ?= demo-out
PYTEST_ARGS ?= -n 2 --dist worksteal
QUICK := not paper and not browser and not thorough
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CODE := .
TYPES := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/kinemode/types.tar
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# The tests start hundreds of processes, which would compile every source again where bytecode is not kept.
unexport PYTHONDONTWRITEBYTECODE

# What is known of types is kept for all checkouts, as compiled kernels are: mypy goes by the digests of the sources. It is
# one file put in its place at once, so that checkouts do not disturb each other; where it cannot be kept, it is not.
KEPT_TYPES = [ -e .mypy_cache ] || { mkdir .mypy_kept && tar -xf "$(TYPES)" -C .mypy_kept && mv .mypy_kept/.mypy_cache . ; \
	rm -rf .mypy_kept; } 2>/dev/null || true
KEEP_TYPES = { mkdir -p "$(dir $(TYPES))" && tar -cf "$(TYPES).$$$$" .mypy_cache && mv -f "$(TYPES).$$$$" "$(TYPES)" \
	|| rm -f "$(TYPES).$$$$"; } 2>/dev/null || true

.PHONY: help demo test test-all check docs format lock clean

help:
	@sed -n '2,7s/^# *//p' Makefile

demo: $(STAMP)
	$(BIN)/kinemode demo --out $(DEMO_OUT)

test: check
	$(BIN)/python -m pytest -m "$(QUICK)" $(PYTEST_ARGS)

test-all: check
	$(BIN)/python -m pytest $(PYTEST_ARGS)

docs: $(STAMP)
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs site

check: $(STAMP)
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)
	@$(KEPT_TYPES)
	$(BIN)/mypy
	@$(KEEP_TYPES)

format: $(STAMP)
	$(BIN)/ruff check --fix $(CODE)
	$(BIN)/ruff format $(CODE)

# The stamp is written last, so an interrupted installation starts over.
$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 10) <= v < (3, 15) else "kinemode needs Python 3.10 to 3.14, this is %d.%d: PYTHON=python3.12 make ..." % v)'
	@$(PYTHON) -m venv --clear $(VENV) || { echo "this Python cannot make environments; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@echo "installing into $(VENV), some minutes the first time ..."
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	@touch $(STAMP)

# --no-emit-index-url and the grep: the lock names versions and what their files hash to, never where they came from.
lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/python -m pip install --quiet uv
	$(VENV)-lock/bin/uv pip compile pyproject.toml --universal --python-version 3.10 --extra dev --quiet \
		--upgrade --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
		--output-file requirements.tmp
	{ echo '# Written by "make lock" for every supported Python and platform; change pyproject.toml instead.'; \
		grep -v -e '^-' -e '://' requirements.tmp; } > requirements.lock
	rm -rf requirements.tmp $(VENV)-lock

clean:
	rm -rf $(VENV) $(DEMO_OUT) .mypy_cache .ruff_cache .pytest_cache build dist
