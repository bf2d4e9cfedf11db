# Two commands set everything up: `make demo` and `make test`. Both install first if needed.
.DEFAULT_GOAL := help
SHELL := /bin/bash
PYTHON ?= python3
SEED ?= 0
PORT ?= 8080
JOBS ?= 3
VENV := .venv
BIN := $(VENV)/bin
# --max-worker-restart 0: otherwise the run hangs after a worker has crashed.
TEST = $(BIN)/pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder --max-worker-restart 0
KERNELS := $(shell grep -rl --include='*.py' numba services)
export MUJOCO_GL ?= egl
# The services are hundreds of processes in the tests: each would compile all its modules again.
unexport PYTHONDONTWRITEBYTECODE

help: ## show this
	@grep -hE '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

install: $(VENV)/.kernels ## virtual environment with everything in it, kernels compiled

$(VENV)/.installed: pyproject.toml constraints.txt scripts/install.sh
	PYTHON="$(PYTHON)" scripts/install.sh $(VENV)
	@touch $@

# All anew when one has changed: numba does not see which kernels of other files call it.
$(VENV)/.kernels: $(VENV)/.installed $(KERNELS)
	@find services -name '*.nb[ic]' -delete
	@echo "compiling the kernels: a minute"
	@$(BIN)/python -m helios_eval.kernel_compilation
	@touch $@

ros2-env: ## environment with ROS 2's rclpy from pip, in .venv-ros2 (Linux on x86-64)
	PYTHON="$(PYTHON)" scripts/install_ros2.sh .venv-ros2

ros2-interfaces: $(VENV)/.installed ros2-env ## ROS interfaces that pip does not have (needs gcc, cmake)
	$(BIN)/helios ros2 build-interfaces build/ros2

demo: install ## a language task in a simulated home: make demo SEED=3
	$(BIN)/python -m helios_eval.demo --seed $(SEED) --port $(PORT)

lint: $(VENV)/.installed ## format, lint, types, import rules, generated files
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python scripts/generate_proto.py --check
	$(BIN)/python -m scripts.generate_sdk --check

test: install browser ## the tests, without the long ones
	$(TEST) -m "not slow and not long"

check: install browser lint ## everything that CI runs: lint and all tests but the slow ones
	$(TEST) -m "not slow"

docs: $(VENV)/.installed ## the documentation as a site, in site/index.html
	$(BIN)/sphinx-build -W --keep-going -q -d .sphinx docs site

browser: ## Chromium for the tests of the dashboard, where apt can be used; without it they are skipped
	scripts/install_browser.sh

lock: ## newest allowed versions of all packages, in constraints.txt (some minutes)
	$(PYTHON) scripts/lock_versions.py

sbom: $(VENV)/.installed ## bill of materials of what users install (CycloneDX), in sbom.cdx.json
	rm -rf .sbom && $(PYTHON) -m venv .sbom
	.sbom/bin/python -m pip install --quiet --constraint constraints.txt '.[all,tracing]'
	$(BIN)/cyclonedx-py environment .sbom --pyproject pyproject.toml --output-file sbom.cdx.json
	$(BIN)/python -m scripts.check_sbom sbom.cdx.json
	rm -rf .sbom

proto: $(VENV)/.installed ## generate the Python modules of the messages
	$(BIN)/python scripts/generate_proto.py

.PHONY: help install ros2-env ros2-interfaces demo docs lint test check browser lock sbom proto
