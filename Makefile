.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test test-slow coverage format figures docs clean

# Any Python from 3.11 on will do: rm -rf .venv && make setup PYTHON=/path/to/python
PYTHON ?= $(shell for p in python3.11 python3; do $$p -c '' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
INSTALLED := .venv/installed
# A file's tests share what they compiled, so files are dealt out whole. More processes would take 4 GB each.
ABREAST := --numprocesses 2 --dist loadfile --no-loadscope-reorder

help: ## List the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1|\2/p' $(MAKEFILE_LIST) | awk -F'|' '{printf "%-16s %s\n", $$1, $$2}'

setup: $(INSTALLED) ## Create .venv with the locked packages (the other targets do this by themselves)

demo: $(INSTALLED) ## Show the diagnosis on an example and save its report under out/demo
	$(BIN)/jbridge demo --out out/demo

test: $(INSTALLED) ## Check style and types, then run the tests that are not slow
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy jbridge
	$(BIN)/pytest -m "not slow" $(ABREAST)

test-slow: $(INSTALLED) ## Run the slow tests
	$(BIN)/pytest -m slow $(ABREAST)

coverage: $(INSTALLED) ## Report which branches the tests that are not slow run: half an hour, in one process
	$(BIN)/coverage run -m pytest -q -m "not slow"
	$(BIN)/coverage html --quiet --directory out/coverage/html
	$(BIN)/coverage report --sort=cover

format: $(INSTALLED) ## Format the code and sort its imports
	$(BIN)/ruff check --select I --fix
	$(BIN)/ruff format

figures: $(INSTALLED) ## Redraw all figures from their saved data, and the README's from a run of the demo
	$(BIN)/jbridge demo --quiet --out out/demo && cp out/demo/figures/signals-holdout-holdout-1.png figures/demo.png
	$(BIN)/python experiments/concealed/run.py --figures
	$(BIN)/python experiments/real_rigs/run.py --figures
	$(BIN)/python experiments/real_rigs/planted.py --figures
	$(BIN)/python experiments/benchmark/run.py --figures
	$(BIN)/python experiments/memory.py --figures
	$(BIN)/python experiments/mutation.py --figures
	$(BIN)/python experiments/paper/run.py --figures
	$(BIN)/python experiments/throughput/throughput.py --figures
	$(BIN)/python experiments/throughput/gpu.py --figures
	$(BIN)/python experiments/gradients.py --figures
	$(BIN)/python experiments/random_rollouts.py --figures
	$(BIN)/python experiments/throughput/cost.py --figures
	$(BIN)/python experiments/tuning/run.py --figures
	$(BIN)/python experiments/tuning/from_recordings.py --figures
	$(BIN)/python experiments/export_cost.py --figures
	$(BIN)/python docs/tables.py

docs: $(INSTALLED) ## Build the documentation's site into out/site
	$(BIN)/python -m pip install --quiet --requirement docs/requirements.lock
	$(BIN)/mkdocs build --quiet --strict
	@echo "out/site/index.html"

clean: ## Remove outputs and caches (delete .venv as well to start anew)
	rm -rf out build dist .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# The project's own build backend is locked too, hence no isolation.
$(INSTALLED): pyproject.toml requirements.lock
	@test -n "$(PYTHON)" || { echo "jbridge needs Python 3.11 or newer, but neither python3.11 nor python3 runs here" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; v = sys.version.split()[0]; sys.exit(None if sys.version_info >= (3, 11) else "jbridge needs Python 3.11 or newer, but $(PYTHON) is " + v + "; try make PYTHON=/path/to/python3.11")'
	@echo "setting up .venv; this takes a minute or two"
	@"$(PYTHON)" -m venv .venv || { echo "$(PYTHON) cannot make environments; on Debian and Ubuntu, install python3-venv" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@
