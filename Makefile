# One thread a process: tests and sweeps run side by side, and BLAS threads on top only slow them down.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

BIN := .venv/bin
READY := .venv/.ready
PYTEST := $(BIN)/python -m pytest -n auto --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help env report test slow blind fuzz hostile lint docs benchmarks lowest lock

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

env: $(READY)  ## prepare .venv (does nothing when up to date)

$(READY): pyproject.toml requirements.lock tools/env
	@PYTHON="$(PYTHON)" tools/env

report: $(READY)  ## write report/index.html for the two devices of the source paper
	$(BIN)/femnl report

test: $(READY)  ## all tests but the slow studies
	$(PYTEST) -m "not slow"

slow: $(READY)  ## the slow studies
	$(PYTEST) -m slow

blind: $(READY)  ## hide causes in hundreds of files and count what the diagnosis names (hours; goes on where it stopped)
	$(BIN)/python -m tests.blind.study build/blind
	$(BIN)/python -m tests.blind.realistic build/realistic
	$(BIN)/python -m tests.blind.imitations build/imitations
	$(BIN)/python -m tests.blind.chips build/chips --seed 6
	$(BIN)/python -m tests.blind.odd_devices build/odd_devices --seed 7
	$(BIN)/python -m tests.blind.linear_sweeps build/linear_sweeps --seed 8
	$(BIN)/python -m tests.blind.boards validation/blind.json weak=build/blind \
		realistic=build/realistic chips=build/chips odd_devices=build/odd_devices

fuzz: $(READY)  ## fuzz the readers for ten minutes (needs the extra fuzz)
	$(BIN)/python -m pytest -m slow tests/robust/test_fuzz.py

hostile: $(READY)  ## draw thousands of hostile inputs and count tracebacks, hangs and blow-ups of memory (an hour)
	$(BIN)/python -m tests.robust.hostile.study build/hostile 300 $$(date +%j000)

lint: $(READY)  ## ruff and mypy
	@status=0; for check in "ruff check ." "ruff format --check ." "mypy -n auto"; do echo "$$check"; $(BIN)/$$check || status=1; done; exit $$status

docs: $(READY)  ## build the documentation site, docs/_build/html
	$(BIN)/python -m sphinx -q -W --keep-going docs docs/_build/html

benchmarks: $(READY)  ## speed, memory and accuracy against peers, into validation/benchmarks.json
	$(BIN)/python benchmarks/run.py

lowest:  ## the tests with the lowest packages that pyproject.toml allows (needs uv)
	mkdir -p build
	uv pip compile pyproject.toml --extra test --extra fast --extra dask --resolution lowest-direct --python-version 3.11 --quiet --output-file build/lowest.txt
	uv venv --quiet --clear --python 3.11 build/lowest
	uv pip install --quiet --python build/lowest/bin/python -r build/lowest.txt
	build/lowest/bin/python -m pytest -n auto --dist worksteal -m "not slow"

lock:  ## pin the newest packages that pyproject.toml allows (needs uv)
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --upgrade --output-file requirements.lock
