.DEFAULT_GOAL := help

PYTHON ?= python3.11
BIN := .venv/bin
# Errors only. Modules are compiled when they are first imported: all at once take 90 s more.
PIP := -qq --disable-pip-version-check --no-compile -c constraints.txt
NEEDS := HIDE-SEEK needs Python 3.11 with its venv module. On Debian: \
	apt-get install git make python3.11 python3.11-venv (elsewhere: make setup PYTHON=/path/to/python3.11)

.PHONY: help setup run test check gates reproduce lock clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-9s  %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: .venv/.warm ## Create .venv with everything in it; does nothing when it is up to date

run: setup ## Start the server on http://127.0.0.1:8000; on first start it evaluates the policies that come along
	$(BIN)/hide serve

test: check ## Set up, check, then test; LONG=1 runs the long tests too
	$(BIN)/pytest -n 2 --dist loadgroup --durations=10 -m "not gpu$(if $(LONG),, and not long)"

check: setup ## Lint, format, types, import rules
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

gates: setup ## Run every gate on every episode and record the result
	OPENBLAS_CORETYPE=Haswell $(BIN)/python -m hide_tasks.gates

reproduce: setup ## Repeat the study: data, trainings, evaluations, tables; TINY=1: the same in minutes
	$(BIN)/python -m docs.reproduce $(if $(TINY),--tiny) $(ARGS)

# The release of torch is fixed in pyproject.toml, so resolving it along cannot pull another one.
lock: ## Resolve every dependency anew and write constraints.txt
	rm -rf build/lock && $(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet hatchling '.[seek,minilm,dask,gymnasium,lerobot,postgres,dev]'
	{ echo '# Every version an installation may use. Written by `make lock`.'; \
	  build/lock/bin/pip freeze --exclude hide-seek 2>/dev/null | sed 's/+.*//'; } > build/constraints.txt
	mv build/constraints.txt constraints.txt && rm -rf build/lock

clean: ## Remove everything that setup, checks and tests leave behind
	rm -rf .venv .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys, ensurepip, venv; assert sys.version_info[:2] == (3, 11)' 2>/dev/null \
		|| { echo '$(NEEDS)' >&2; exit 1; }
	@echo 'Installing into .venv; the first time this takes a few minutes.'
	$(PYTHON) -m venv .venv
	$(BIN)/pip install $(PIP) hatchling
	$(BIN)/pip install $(PIP) --no-build-isolation -e '.[seek,dask,gymnasium,lerobot,postgres,dev]'
	@touch $@

# Kernels are compiled before several processes want them at the same time.
.venv/.warm: .venv/.installed $(wildcard hide_tasks/bullet/*.py)
	@find hide_tasks -name '*.nb[ci]' -delete # numba does not notice a change in another file
	$(BIN)/python -m hide_tasks.bullet.warm
	@touch $@
