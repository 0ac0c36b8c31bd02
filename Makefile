# make setup, make demo, make test: all a user needs. make check is what CI runs before the tests.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
KERNELS := $(VENV)/.kernels

.PHONY: setup ouster demo test check fuzz docs docs-serve lock clean

setup: $(KERNELS)

$(STAMP): requirements-dev.lock pyproject.toml tools/system-libraries.sh
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || \
		{ echo "Python 3.11 is needed: make setup PYTHON=/path/to/python3.11"; exit 1; }
	sh tools/system-libraries.sh $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-dev.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

$(KERNELS): $(STAMP) $(shell find services/sensors services/mapper shared/kernel.py shared/deskew.py shared/depth_points.py -name '*.py')
	find services shared -name '*.nb[ic]' -delete  # numba does not see what changed in a kernel that another calls
	$(BIN)/python -m services.sensors.compile_kernels
	$(BIN)/python -m services.mapper.compile_kernels
	touch $@

# What reads an Ouster's pcap, in an environment of its own: its pins break the main one
OUSTER := .venv-ouster
ouster: $(OUSTER)/.installed

$(OUSTER)/.installed: requirements-ouster.lock
	$(PYTHON) -m venv $(OUSTER)
	$(OUSTER)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-ouster.lock
	touch $@

demo: setup
	$(BIN)/hyrecro demo

test: setup
	$(BIN)/python -m pytest

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest tests/unit tests/contract

# Every reader, guided by coverage: `python -m fuzz --help` for more runs, or one reader
fuzz: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check atheris==3.0.0
	$(BIN)/python -m fuzz --runs 20000 --seconds 20

# The site: into out/site, or shown on loopback while it is written. What is made from code: python -m tools.docs
docs docs-serve: export NO_MKDOCS_2_WARNING = 1
docs: setup
	$(BIN)/mkdocs build --strict

docs-serve: setup
	$(BIN)/mkdocs serve

# requirements.lock is what runs (the image), requirements-dev.lock the same and what checks it (.venv)
COMPILE := uv pip compile --quiet --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate
lock:
	$(COMPILE) --output-file requirements.lock pyproject.toml
	$(COMPILE) --constraint requirements.lock --extra dev --output-file requirements-dev.lock pyproject.toml
	echo ouster-sdk==1.0.1 | $(COMPILE) --output-file requirements-ouster.lock -

clean:
	rm -rf $(VENV) $(OUSTER) build *.egg-info .mypy_cache .ruff_cache .hypothesis
