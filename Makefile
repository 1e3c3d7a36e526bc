# make demo   enroll two people from the sample clips and swap one into the other's video
# make test   run the tests on all cores; PYTEST_ARGS="-k swap --numprocesses=0" chooses otherwise
# make test-fast  run the tests that are not marked slow, in a minute or two
# make lint   check formatting, lint, types, and that the generated docs are up to date
# make bench  run the benchmarks (takes longer)
# make docs   regenerate docs/cli.md and the pictures
# make clean  remove everything that the other targets made
#
# Each target creates what it needs: a virtual environment, and software OpenGL where the package manager allows it.

PYTHON ?= python3
VENV ?= .venv
PYTEST_ARGS ?=
BENCH_ARGS ?=

PY := $(VENV)/bin/python
READY := $(VENV)/.ready
GL := $(VENV)/.gl

PARALLEL := --numprocesses=auto --dist=loadfile --no-loadscope-reorder

.DEFAULT_GOAL := help
.PHONY: help demo test test-fast lint bench docs clean

# What is compiled is kept, whatever the environment says: tests start the program many times.
test test-fast: export PYTHONDONTWRITEBYTECODE =

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

demo: $(READY) $(GL)
	@mkdir -p out
	$(VENV)/bin/guise demo -o out/demo --force

test: $(READY) $(GL)
	$(PY) -m pytest $(PARALLEL) $(PYTEST_ARGS)

test-fast: $(READY) $(GL)
	$(PY) -m pytest $(PARALLEL) -m "not slow" $(PYTEST_ARGS)

lint: $(READY)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	sh .ci/types $(PY) .mypy_cache/tree
	$(PY) docs/make_cli.py --check

bench: $(READY) $(GL)
	$(PY) -m benchmarks.run_all $(BENCH_ARGS)

docs: $(READY) $(GL)
	$(PY) docs/make_cli.py
	$(PY) docs/make_pictures.py

$(READY): pyproject.toml setup.py $(wildcard render/native/*) .ci/make-venv
	sh .ci/make-venv "$(PYTHON)" "$(VENV)"
	@touch $@

# Made only where GL works, so that a computer without it is asked again the next time.
$(GL): $(READY) .ci/software-gl
	@sh .ci/software-gl $(PY) $@

clean:
	rm -rf $(VENV) out build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
