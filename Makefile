# Two commands do everything: `make quickstart` and `make test`. Each sets up .venv when it has to.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# Recordings: the folder named by DSE_DATA, else the one beside the clone.
DSE_DATA ?= $(abspath $(wildcard ../shared/data))
export DSE_DATA

.PHONY: quickstart test setup lint format clean

quickstart: $(READY)
	@$(BIN)/dse run search_spaces/quickstart.yaml --format table

test: lint
	@.ci/browser "$(CURDIR)/$(VENV)/browser"
	$(BIN)/python -m pytest -n 2 --dist loadfile

setup: $(READY)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis

# The stamp is written last, so a broken set-up is tried again.
$(READY): pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt hatchling editables
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --no-build-isolation -e ".[test]"
	@touch $@
