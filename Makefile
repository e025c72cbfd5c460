# Set-up, sample, tests and benchmarks. Everything that is built goes to a cache folder outside of
# this clone, apart from .venv and the compiled module, which git ignores.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

# The first Python that starts and is new enough.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out
export CARGO_TARGET_DIR ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/dressform/target
# One set of build settings for maturin and cargo, so that they share what they compile.
export PYO3_PYTHON := $(CURDIR)/$(BIN)/python
export PYO3_BUILD_EXTENSION_MODULE := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

RUST := Cargo.toml Cargo.lock python_bridge/Cargo.toml \
	$(shell find src python_bridge/src -name '*.rs' -o -name '*.wgsl')
OUTFIT := samples/outfits/casual_woman.usda
TARGETS := heavy_woman thin_woman

.PHONY: help
help: ## Say what there is.
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

.PHONY: sample
sample: $(TARGETS:%=$(OUT)/%.usda) ## Build, install into .venv, fit the sample outfit, write to out/.
	@echo
	@echo "The dressed sample: $(TARGETS:%=$(OUT)/%.usda)"
	@echo "Each is a small layer that refers to its character and to a crate file beside it; open it in"
	@echo "usdview, Blender or Omniverse. Its certificate stands in garment:certificate:* attributes."
	@echo "Pictures of it: make pictures"

# Exit code 1 says that a threshold was broken; the result is written all the same.
$(OUT)/%.usda: $(VENV)/.built samples/characters/%.usdc $(OUTFIT)
	@mkdir -p $(OUT)
	@echo "Fitting $(OUTFIT) to $*"
	@$(BIN)/dressform fit $(OUTFIT) samples/characters/$*.usdc -o $@ || [ $$? -eq 1 ]

.PHONY: pictures
pictures: $(TARGETS:%=$(OUT)/%.png) ## Draw the fitted sample (installs PyVista).

$(OUT)/%.png: $(OUT)/%.usda $(VENV)/.test-packages
	$(BIN)/dressform preview $< -o $@
	$(BIN)/dressform preview $< -o $(OUT)/$*-pattern.png --pattern

.PHONY: setup
setup: $(VENV)/.built ## Build the package and install it into .venv.

$(VENV)/.created:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/it" >&2; exit 2; }
	@command -v cargo > /dev/null || { echo "Rust is needed (cargo was not found)" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.packages: requirements.lock $(VENV)/.created
	$(BIN)/pip install --quiet --requirement requirements.lock
	@touch $@

$(VENV)/.test-packages: requirements-test.lock $(VENV)/.packages
	$(BIN)/pip install --quiet --requirement requirements-test.lock
	@touch $@

$(VENV)/.built: $(VENV)/.packages pyproject.toml $(RUST)
	VIRTUAL_ENV=$(CURDIR)/$(VENV) PATH="$(CURDIR)/$(BIN):$$PATH" maturin develop --release --locked --quiet
	@touch $@

.PHONY: test
test: test-system lint test-rust test-python ## Everything that continuous integration checks.

.PHONY: test-system
test-system: ## On Debian as root, install what the tests need (a software GPU, off-screen drawing).
	@if [ -f /etc/debian_version ] && [ "$$(id -u)" = 0 ]; then \
		sh .ci/install_mesa.sh && sh .ci/install_drawing.sh; \
	else echo "skipped: system packages (not Debian, or not root)"; fi

.PHONY: lint
lint: $(VENV)/.built $(VENV)/.test-packages ## Formats, lints, types, licences.
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets --locked --quiet -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python .ci/licenses.py

.PHONY: test-rust
test-rust: export DRESSFORM_REQUIRE_GPU := $(if $(CI),1,$(DRESSFORM_REQUIRE_GPU))
test-rust: ## The core's tests.
	cargo test --release --package dressform --locked --quiet

.PHONY: test-python
test-python: $(VENV)/.built $(VENV)/.test-packages ## The package's tests.
	$(BIN)/pytest

# Blender's wheel pins its numpy and brings its own USD: an environment and a process of its own.
VENV_DCC := .venv-dcc

$(VENV_DCC)/.packages: requirements-dcc.lock
	$(PYTHON) -m venv $(VENV_DCC)
	$(VENV_DCC)/bin/pip install --quiet --requirement requirements-dcc.lock
	@touch $@

.PHONY: test-dcc
test-dcc: $(VENV)/.built $(VENV)/.test-packages $(VENV_DCC)/.packages ## Against Blender's importer (Python 3.11; 400 MB).
	BLENDER_PYTHON=$(CURDIR)/$(VENV_DCC)/bin/python $(BIN)/pytest tests/dcc

.PHONY: bench
bench: $(VENV)/.built $(VENV)/.test-packages ## Benchmarks; with DRESSFORM_DATA, all pairs too.
	@if [ -d "$${DRESSFORM_DATA:-}" ]; then \
		mkdir -p $(OUT) && $(BIN)/python benches/meshes.py "$$DRESSFORM_DATA" $(OUT)/meshes.json; fi
	DRESSFORM_MESHES=$(OUT)/meshes.json RAYON_NUM_THREADS=1 cargo bench --package dressform --locked
	$(BIN)/python benches/transfer_speed.py $(OUT)/meshes.json
	@if [ -d "$${DRESSFORM_DATA:-}" ]; then \
		PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python benches/all_pairs.py "$$DRESSFORM_DATA" $(OUT)/pairs; \
		PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python benches/pattern.py "$$DRESSFORM_DATA"; \
	else echo "skipped: the table over all pairs (DRESSFORM_DATA names no folder)"; fi
	@if [ -d "$${DRESSFORM_DATA:-}" ] && [ -d "$${DRESSFORM_PEERS:-}" ]; then \
		$(BIN)/python benches/posed.py "$$DRESSFORM_DATA"; \
	else echo "skipped: weights in poses (DRESSFORM_DATA or DRESSFORM_PEERS names no folder)"; fi

.PHONY: pairs
pairs: $(VENV)/.built ## Fit every outfit of DRESSFORM_DATA to every character; the table goes into docs/.
	$(BIN)/python benches/all_pairs.py "$${DRESSFORM_DATA:?names no folder}" $(OUT)/pairs --table docs/pairs.md

.PHONY: lock
lock: $(VENV)/.test-packages ## Pin the newest versions of all Python packages.
	$(BIN)/pip-compile --quiet --strip-extras --allow-unsafe --no-emit-index-url --no-emit-find-links \
		--no-emit-trusted-host --output-file requirements.lock requirements.in
	$(BIN)/pip-compile --quiet --strip-extras --allow-unsafe --no-emit-index-url --no-emit-find-links \
		--no-emit-trusted-host --output-file requirements-test.lock requirements-test.in
	$(BIN)/pip-compile --quiet --strip-extras --allow-unsafe --no-emit-index-url --no-emit-find-links \
		--no-emit-trusted-host --output-file requirements-dcc.lock requirements-dcc.in

.PHONY: settings
settings: $(VENV)/.built $(VENV)/.test-packages ## Mirror the core's settings into Python.
	$(BIN)/python python_bridge/tools/mirror_settings.py
	$(BIN)/ruff format --quiet python_bridge/python/dressform/core_settings.py
