# `make` alone lists the targets. Needed: make, and a Python >= 3.11 (or any python3 with pip: see scripts/bootstrap).
# Extra arguments go through ARGS, as in: make test ARGS="-k scara -x"

ARGS ?=
SHELL := /bin/sh

# Robotics set-ups (ROS) put whole package trees on PYTHONPATH, whose pytest plugins would join our test runs.
# What is set here would make every process compile the sources anew.
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE
# `pip install --user` is refused inside an environment, so that such a default must not reach it.
export PIP_USER := 0

# Without a network: `make wheels TO=DIR` where there is one, then WHEELS=DIR for any target that installs, and for
# .ci/run. pip then takes packages from that folder alone; their hashes are checked as always.
ifdef WHEELS
export PIP_NO_INDEX := 1
export PIP_FIND_LINKS := $(abspath $(WHEELS))
endif

.PHONY: help venv demo reproduce test lint format bench verify figures tables targets benchmark docs release lock wheels clean
.DEFAULT_GOAL := help

help: ## Show these targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' Makefile

venv: .venv/.installed ## Make or update the environment, .venv

.venv/.installed: pyproject.toml requirements/dev.txt
	@scripts/bootstrap .venv

.venv-3.11/.installed: pyproject.toml requirements/dev.txt
	@scripts/bootstrap .venv-3.11 3.11

demo: .venv/.installed ## Run the paper's examples, and take an arm from its URDF to a certificate and C
	@scripts/demo $(ARGS)

reproduce: .venv/.installed ## Reproduce all results of the paper and say where the report is
	@.venv/bin/slidax reproduce --out reproduction $(ARGS)

test: .venv/.installed ## Run the tests
	@.venv/bin/python -m pytest $(ARGS)

# All linters run, also after one has failed, so that one run shows everything.
lint: .venv/.installed ## Check style, types and layers; changes nothing
	@failed=; \
	.venv/bin/ruff check . || failed="$$failed ruff-check"; \
	.venv/bin/ruff format --check . || failed="$$failed ruff-format"; \
	.venv/bin/mypy || failed="$$failed mypy"; \
	.venv/bin/lint-imports --no-logo || failed="$$failed lint-imports"; \
	.venv/bin/python scripts/check-words src tests scripts examples benchmarks || failed="$$failed check-words"; \
	if [ -n "$$failed" ]; then echo "make lint: failed:$$failed" >&2; exit 1; fi

format: .venv/.installed ## Put the code in order
	@.venv/bin/ruff check --fix-only --quiet .
	@.venv/bin/ruff format .

bench: .venv/.installed ## Measure, and write benchmarks/PERFORMANCE.md
	@.venv/bin/python -m benchmarks $(ARGS)

figures: .venv/.installed ## Renew the figures of the documentation, with the tables near them
	@mkdir -p docs/figures
	@.venv/bin/python examples/01_run_a_scenario.py docs/figures/tracking-error.svg
	@.venv/bin/python scripts/measure $(ARGS)

tables: .venv/.installed ## Renew the tables of schemes as printed, in docs/benchmark-of-schemes.md
	@.venv/bin/python scripts/measure choosing

targets: .venv/.installed ## Build and run the exported step on every target that is here, and renew docs/targets.md
	@.venv/bin/python -m benchmarks.targets $(ARGS)

benchmark: .venv/.installed ## Benchmark the schemes, and renew the table in docs/benchmark-of-schemes.md
	@.venv/bin/python scripts/measure benchmark $(ARGS)

docs: .venv/.installed .venv-docs/.installed ## Run the code of all pages, and build the documentation site, site/
	@.venv/bin/python scripts/build-site $(ARGS)

# The builder needs nothing of slidax: it has its own environment, as small as its packages.
.venv-docs/.installed: requirements/docs.txt .venv/.installed
	@.venv/bin/python -m venv --clear .venv-docs
	@.venv-docs/bin/python -m pip install -qq --disable-pip-version-check --require-hashes -r requirements/docs.txt
	@touch $@

# The second run of the tests has the oldest Python, and with it the oldest jax, that pyproject.toml allows. The wheel
# is tried in an environment of its own, away from the sources, where a data file left out of it is missed. Last, since it
# takes half an hour, every certificate is held against as many random cases as docs/certificates tells of.
verify: .venv/.installed .venv-3.11/.installed ## Test on both Pythons, the long tests too, try the wheel and the bounds
	@.venv/bin/python -m pytest -m "full or not full"
	@.venv-3.11/bin/python -m pytest
	@rm -rf dist .venv-wheel
	@.venv/bin/python -m build --no-isolation --outdir dist .
	@.venv/bin/python -m venv .venv-wheel
	@.venv-wheel/bin/python -m pip install -qq --require-hashes -r requirements/run.txt
	@.venv-wheel/bin/python -m pip install -qq --no-deps dist/*.whl
	@.venv-wheel/bin/python -m pip check
	@cd .venv-wheel && bin/slidax run example-4.1 --json > run.json && bin/python -m json.tool run.json > /dev/null
	@cd .venv-wheel && bin/slidax reproduce --out reproduction
	@.venv/bin/python scripts/measure soundness
	@echo "make verify: all passed"

release: .venv/.installed ## Rehearse a release: build, judge, install and run it; uploads nothing
	@.venv/bin/python scripts/release --untagged $(ARGS)

# Keeps the pins that still fit; to renew them all: make lock ARGS=--upgrade
# uv has its own environment, since nothing but this target needs it. The pins of run.txt follow those of dev.txt.
LOCK = .venv-lock/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock"
COMPILE = $(LOCK) pyproject.toml
# All but cuda, which is for machines with a card.
EXTRAS = --extra parquet --extra frame --extra native --extra robots --extra trajectories --extra view \
	--extra studies --extra cluster --extra fmu --extra log --extra linear --extra studio
lock: .venv-lock/bin/uv ## Renew requirements/*.txt after a change in pyproject.toml
	@mkdir -p requirements
	@$(COMPILE) --group dev $(EXTRAS) --output-file requirements/dev.txt $(ARGS)
	@$(COMPILE) --constraint requirements/dev.txt --output-file requirements/run.txt $(ARGS)
	@$(LOCK) --group docs --constraint requirements/dev.txt --output-file requirements/docs.txt $(ARGS)
	@echo uv | $(LOCK) - --output-file requirements/uv.txt $(ARGS)
	@echo "requirements/dev.txt, run.txt, docs.txt and uv.txt are up to date."

.venv-lock/bin/uv: requirements/uv.txt
	@python=$$(scripts/bootstrap --find) && "$$python" -m venv --clear .venv-lock
	@.venv-lock/bin/python -m pip install -qq --require-hashes -r requirements/uv.txt
	@touch $@

wheels: .venv-lock/bin/uv ## Download the locked packages into the folder TO, for machines without a network
	@test -n "$(TO)" || { echo "say where: make wheels TO=DIR" >&2; exit 2; }
	@.venv-lock/bin/python -m pip download -q --require-hashes -r requirements/dev.txt --dest "$(TO)"
	@echo "The packages are in $(TO): make test WHEELS=$(TO), or WHEELS=$(TO) .ci/run"

clean: ## Remove everything that make made
	@rm -rf .venv .venv-3.11 .venv-wheel .venv-lock .venv-docs .venv-release .python build demo dist reproduction site
	@rm -rf .pytest_cache .hypothesis .mypy_cache .ruff_cache .import_linter_cache
	@find src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true
