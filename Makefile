# The two commands of the README are `make demo` and `make test`; each sets up what it needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# A file of versions and hashes (.ci/pin): these files are installed then, and no others.
PINS ?=

.PHONY: setup demo check test nightly test-autopilot docs results lint clean
.DELETE_ON_ERROR:

setup: $(READY)

$(READY): pyproject.toml $(PINS)
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "maxjax needs Python 3.11 or newer; set PYTHON=python3.x")'
	$(PYTHON) -m venv $(VENV)
ifneq ($(PINS),)
	$(BIN)/python -m pip install --quiet --require-hashes --requirement $(PINS)
	$(BIN)/python -m pip install --quiet --no-deps --editable .
else
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[viz,view,las,e57,geotiff,gis,docs,dev]'
	@# Some peers come as source only: without a compiler they are left out, and the tests that need them say so.
	$(BIN)/python -m pip install --quiet --editable '.[bench]' || echo 'bench: peers left out, see above'
	@# ROS 2 has wheels for some platforms only.
	$(BIN)/python -m pip install --quiet --editable '.[ros2]' || echo 'ros2: left out, see above'
endif
	touch $@

demo: setup
	$(BIN)/maxjax demo --out demo

# After each step: lint, and what needs no large program (tests/conftest.py).
check: lint
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not large and not nightly and not docs'

# Before a change is proposed: every property, and a small run of every experiment and benchmark.
test: setup
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not nightly and not docs' --durations 40

# Once a day: what takes long as well, and all that experiments and benchmarks claim at a small size.
nightly: setup
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not docs'

# Ten missions by an autopilot in software, at the address AUTOPILOT (tests/link/test_real_autopilot.py).
test-autopilot: setup
	AUTOPILOT='$(AUTOPILOT)' $(BIN)/python -m pytest -n 0 -rs tests/link/test_real_autopilot.py

# Warnings are errors; pages with code are executed, and a cell that fails, fails the build.
docs: setup
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	$(BIN)/python docs/site/links.py build/docs
	$(BIN)/python -m pytest tests/docs

results: setup
	$(BIN)/python -m experiments.report
	$(BIN)/python -m benchmarks.measured

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) demo build dist
