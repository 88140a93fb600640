# Everything runs in .venv, which `make` sets up again when pyproject.toml or constraints.txt changes.
PYTHON ?= python3
VENV := .venv
READY := $(VENV)/.ready
TESTED := $(VENV)/.ready-test
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
BIN := $(VENV)/bin
LIMITER_TESTS := tests/controller/limiter/test_edges.py tests/controller/limiter/test_parts.py \
	tests/controller/limiter/test_limiter.py tests/controller/limiter/test_doubted_states.py
# Files of other tools in every dialect and with every damage, by what they hold.
INPUT_TESTS := tests/test_encodings.py tests/trepid/files/test_decoding.py tests/trepid/recording/test_csv_file.py \
	tests/sim_harness/world/opendrive lab/tests/bench/foreign \
	tests/trepid/recording/test_reader.py tests/trepid/recording/test_chunks.py tests/vehicle/cameras/test_files.py \
	tests/trepid/images \
	tests/perception/net/test_session.py tests/perception/lead/test_boxes.py tests/perception/lead/test_picture.py \
	tests/learning/dataset/test_sources.py tests/learning/dataset/test_build_cli.py tests/learning/dataset/test_export.py \
	tests/vehicle/actuators/can/test_dbc.py tests/vehicle/actuators/can/test_invalid_values.py \
	tests/vehicle/actuators/can/test_multiplexed.py tests/cockpit/calibration/test_camera_info.py \
	tests/cockpit/rulebook/test_fcl.py tests/trepid/processes/test_endpoint.py \
	tests/cockpit/footage/test_sources.py tests/trepid/test_clock.py
# By file name: importing all test files would take longer than these tests.
PROCESS_TESTS = $(shell grep -rl mark.processes tests lab/tests --include=test_*.py)
SMOKE_TESTS = $(shell grep -rl mark.smoke tests lab/tests --include=test_*.py)
LONG_TESTS = $(shell grep -rl mark.long tests lab/tests --include=test_*.py)
SUITE_TESTS = $(shell grep -rl mark.suite tests --include=test_*.py)

# The wheel of casadi holds most libraries two or three times, which are symbolic links elsewhere.
define LINK_COPIES
import filecmp, sysconfig
from pathlib import Path
kept = {}
for path in sorted(Path(sysconfig.get_path("platlib"), "casadi").glob("lib*.so*")):
    first = kept.setdefault(path.stat().st_size, path)
    if not first.samefile(path) and filecmp.cmp(first, path, shallow=False):
        link = path.with_suffix(".link")
        link.unlink(missing_ok=True)  # of an interrupted run
        link.hardlink_to(first)
        link.replace(path)
endef
export LINK_COPIES

# Imported once at set-up, in two parts at once, so that their byte code is neither written by each process of the tests
# nor while a car drives.
define IMPORT_TESTS
for part in 'tests/[cdlpv]*' 'tests/[st]* lab/tests'; do \
	$(BIN)/python -m pytest --collect-only -qq -p no:cacheprovider -m 'not processes' $$part >/dev/null 2>&1 & \
done; wait
endef

# Keep byte code, also where the environment says otherwise: the tests start Python hundreds of times.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup drive test inputs long live suite wheel documented pythons docs lock release proof mutation lint train acados clean

help:
	@echo "make drive   set up and drive the circuit: every process over Zenoh (ARGS=... for trepid drive)"
	@echo "make test    set up and run the tests"
	@echo "make inputs  files of other tools: text, roads, recordings, videos, networks, tubs, DBC, cameras, rules; part of make test"
	@echo "make long    trainings, several drives in a test, the page in a browser: tests that make test omits"
	@echo "make live    every process of a live drive killed, frozen or left alone: the tests of this kind that make test omits"
	@echo "make suite   all scenarios against their expectations on the exact lane, and those under snow in pictures"
	@echo "make wheel   build wheel and sdist, install them, and use them from an empty folder"
	@echo "make documented  every command of the pages from the installed wheel, a folder for each page (ARGS='-k rc.md')"
	@echo "make pythons the wheel in an empty environment of each Python here, with the libraries of the package index"
	@echo "make docs    build the documentation site in out/site, with a check of its links"
	@echo "make lock    write requirements.lock from pyproject.toml and constraints.txt (needs uv)"
	@echo "make release check, build and tag the version of pyproject.toml; nothing is pushed"
	@echo "make proof   run the long tests: 100 runs on a loaded machine, a sweep on a Dask cluster that loses a worker"
	@echo "make mutation  mutate the limiter; its tests must fail at every mutation (15 min on two quiet cores)"
	@echo "make lint    ruff and mypy"
	@echo "make train   re-create the shipped CNN weights (installs torch into its own .venv-train)"
	@echo "make acados  the peer of trepid bench control-mpc (needs gcc)"
	@echo "make clean   remove the virtual environments"

setup: $(TESTED)

$(READY): pyproject.toml constraints.txt
	@echo "== setting up $(VENV) (once; pip packages only)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(PIP) -e .
	@$(BIN)/python -c "$$LINK_COPIES"
	@touch $(READY)
	@echo "== $(VENV) is ready to drive"

# The laboratory without its dependencies: the peers of its benchmarks take 250 MB, which no test needs. Packages are
# sought once, for driving and for tests. Byte code is written where it is used: compiling all would take a minute.
$(TESTED): pyproject.toml constraints.txt lab/pyproject.toml
	@echo "== setting up $(VENV) for driving and for tests (once; pip packages only)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(PIP) --no-compile -e '.[test]'
	@$(BIN)/python -c "$$LINK_COPIES"
	@$(PIP) --no-deps --no-build-isolation -e lab
	@$(IMPORT_TESTS)
	@touch $(READY) $(TESTED)
	@echo "== $(VENV) is ready to drive and to test"

drive: $(READY)
	@echo "== trepid drive $(ARGS)"
	@$(BIN)/python -m trepid drive $(ARGS)

test: $(TESTED)
	@echo "== pytest $(ARGS)"
ifdef ARGS
	@$(BIN)/python -m pytest $(ARGS)
else
	@$(BIN)/python -m pytest -n 3 --dist worksteal -m "not processes and not long and not proof and not suite and not wheel"
	@$(BIN)/python -m pytest -m "processes and smoke" $(SMOKE_TESTS)
endif

inputs: $(TESTED)
	@$(BIN)/python -m pytest -q $(INPUT_TESTS)

long: $(TESTED)
	@echo "== pytest -m long"
	@$(BIN)/python -m pytest -n 3 --dist worksteal -m "long and not processes and not proof" $(LONG_TESTS) $(ARGS)

live: $(TESTED)
	@echo "== pytest -m processes"
	@$(BIN)/python -m pytest -m "processes and not smoke and not proof" $(or $(FILES),$(PROCESS_TESTS)) $(ARGS)

suite: $(TESTED)
	@echo "== pytest -m suite"
	@$(BIN)/python -m pytest -n 2 --dist worksteal -m suite $(SUITE_TESTS) $(ARGS)

wheel: $(TESTED)
	@echo "== pytest -m wheel"
	@$(BIN)/python -m pytest -m wheel tests/test_wheel.py $(ARGS)

documented: $(TESTED)
	@echo "== pytest -m wheel, the commands of the pages"
	@$(BIN)/python -m pytest -m wheel tests/test_wheel_pages.py $(ARGS)

pythons: $(TESTED)
	@echo "== pytest -m proof, the Pythons of this machine"
	@$(BIN)/python -m pytest -m proof -rPs tests/test_wheel_versions.py $(ARGS)

docs: $(TESTED)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "== the site is out/site/index.html (search: $(BIN)/python -m mkdocs serve)"

lock:
	@echo '# The light install with the versions of constraints.txt, for pip and uv: `make lock` writes it.' > requirements.lock
	@uv pip compile pyproject.toml --universal --python-version 3.11 -c constraints.txt --generate-hashes \
	    --no-annotate --no-header --no-emit-index-url --no-emit-find-links --quiet >> requirements.lock

release:
	@.ci/release

proof: $(TESTED)
	@$(PIP) -e '.[proof]'
	@echo "== coverage of the limiter by its own tests"
	@EXAMPLES=100 $(BIN)/python -m pytest $(LIMITER_TESTS) --cov=controller.limiter --cov-branch --cov-fail-under=100
	@echo "== pytest -m proof"
	@$(BIN)/python -m pytest -m proof $(ARGS)

# Continues after an interruption; the tests must kill every mutant.
mutation: $(TESTED)
	@$(PIP) -e '.[proof]'
	@EXAMPLES=100 $(BIN)/mutmut run --max-children 2
	@mkdir -p out; $(BIN)/mutmut results | tee out/mutation.txt; test ! -s out/mutation.txt

lint: $(TESTED)
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy

train:
	@test -x .venv-train/bin/python || $(PYTHON) -m venv .venv-train
	@.venv-train/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[train]'
	@.venv-train/bin/python -m trepid train-lane $(ARGS)

# The wheel of acados contains another casadi, so it stays out of .venv.
acados:
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --target .venv-acados comma-deps-acados==0.2.2.post92

clean:
	rm -rf $(VENV) .venv-train .venv-acados
