# Everything runs in .venv; `make` sets it up when pyproject.toml or constraints.txt changed.
PYTHON ?= python3
VENV := .venv
READY := $(VENV)/.ready
TESTED := $(VENV)/.ready-test
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
BIN := $(VENV)/bin
LIMITER_TESTS := tests/controller/limiter/test_edges.py tests/controller/limiter/test_parts.py tests/controller/limiter/test_limiter.py
# By name: to import all the others takes as long as a test.
PROCESS_TESTS := $(shell grep -rl mark.processes tests --include=test_*.py)

.PHONY: help setup drive test proof mutation lint train acados clean

help:
	@echo "make drive   set up and drive the circuit: every process over Zenoh (ARGS=... for trepid drive)"
	@echo "make test    set up and run the tests"
	@echo "make proof   run what takes minutes: 100 runs on a loaded machine, a sweep on a Dask cluster that loses a worker"
	@echo "make mutation  mutate the limiter: its tests must notice every change (15 min on two quiet cores)"
	@echo "make lint    ruff and mypy"
	@echo "make train   re-create the shipped CNN weights (installs torch into its own .venv-train)"
	@echo "make acados  the peer of trepid bench control-mpc (needs gcc)"
	@echo "make clean   remove the virtual environments"

setup: $(TESTED)

$(READY): pyproject.toml constraints.txt
	@echo "== setting up $(VENV) (once; pip packages only)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(PIP) -e .
	@touch $(READY)
	@echo "== $(VENV) is ready to drive"

$(TESTED): $(READY)
	@echo "== adding what the tests need"
	@$(PIP) -e '.[test]'
	@touch $(TESTED)
	@echo "== $(VENV) is ready to test"

drive: $(READY)
	@echo "== trepid drive $(ARGS)"
	@$(BIN)/python -m trepid drive $(ARGS)

test: $(TESTED)
	@echo "== pytest $(ARGS)"
ifdef ARGS
	@$(BIN)/python -m pytest $(ARGS)
else
	@$(BIN)/python -m pytest -n 2 -m "not processes and not proof"
	@$(BIN)/python -m pytest -m "processes and not proof" $(PROCESS_TESTS)
endif

proof: $(TESTED)
	@$(PIP) -e '.[proof]'
	@echo "== coverage of the limiter by its own tests"
	@$(BIN)/python -m pytest $(LIMITER_TESTS) --cov=controller.limiter --cov-branch --cov-fail-under=100
	@echo "== pytest -m proof"
	@$(BIN)/python -m pytest -m proof $(ARGS)

# Goes on where it was; every mutant must be killed, none is excused.
mutation: $(TESTED)
	@$(PIP) -e '.[proof]'
	@$(BIN)/mutmut run --max-children 2
	@mkdir -p out; $(BIN)/mutmut results | tee out/mutation.txt; test ! -s out/mutation.txt

lint: $(TESTED)
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy

train:
	@test -x .venv-train/bin/python || $(PYTHON) -m venv .venv-train
	@.venv-train/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[train]'
	@.venv-train/bin/python -m trepid train $(ARGS)

# acados's wheel brings a casadi of its own, so it stays out of .venv.
acados:
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --target .venv-acados comma-deps-acados==0.2.2.post92

clean:
	rm -rf $(VENV) .venv-train .venv-acados
