# `make demo` and `make test` are all a newcomer needs; both prepare the environment first.
#
#   make demo    a generated scene is trained, evaluated and drawn: demo/output/
#   make test    the tests of the package, on the CPU
#   make test-quick  those that take a second at most and train nothing (a minute)
#   make test-lab  the tests of lab/, where the project measures itself
#   make fuzz    the properties again and again, with new examples each time (10 minutes; FUZZ_MINUTES=60)
#   make test-avx2  the quick tests of what computes, as on a processor that has AVX2 and no more
#   make test-pythons  the tests on Python 3.10, 3.11 and 3.12, each in an environment of its own
#   make bench   backends and training steps timed, one table in outputs/bench.md (15 minutes)
#   make stability  hard cases, kills, broken lines, a long run: outputs/stability.md (2 hours)
#   make gpu     on a machine with a GPU: parity, step time, waits, training, tests; docs/results/gpu.md (10 minutes, and compiling)
#   make docs    the site of docs/ in outputs/site; a broken link is an error (make env docs: with all options)
#   make viewer  fetches and bundles what draws a scene in a page, by npm, into desplat_ns/tools/scene/viewer
#   make smoke   every table of the paper end to end on generated scenes, on the CPU (4 minutes of one core)
#   make check   ruff, pyright, tests: green on every commit
#   make clean   removes what was built (make distclean: the environment as well)
#
# Settings: VENV=folder  PYTHON=interpreter (3.10 to 3.12)  PYTEST_ARGS='-k name'  DEMO_ARGS='--steps 500'
#           PYTHONS_TESTED='3.10 3.12'  BENCH_ARGS='--quick'  STABILITY_ARGS='--only catalogue'
# UV= (empty) uses pip although uv is installed.

VENV ?= .venv
UV ?= $(shell command -v uv 2>/dev/null)
PYTHONS = $(or $(PYTHON),python3.11 python3.12 python3.10 python3)
PYTEST_ARGS ?=
DEMO_ARGS ?=
BENCH_ARGS ?=
STABILITY_ARGS ?=
SMOKE_ARGS ?=
FUZZ_MINUTES ?= 10
PYTHONS_TESTED ?= 3.10 3.11 3.12

PY := $(VENV)/bin/python
# Of tests/: where a processor's instructions can decide how a test ends.
COMPUTING := backend distractors evaluation gaussians photo_tourism cameras separation survey training
COMPUTING += stability test_layers.py test_same_bits.py
# One process for each core, four at most, and torch on one thread in each.
PYTEST := OMP_NUM_THREADS=1 $(PY) -m pytest -n auto --maxprocesses 4 --dist worksteal
STAMP := $(VENV)/.installed
DOCS_VENV := $(VENV)-docs
DOCS_STAMP := $(DOCS_VENV)/.installed

# Waiting OpenMP threads sleep instead of spinning: spinning makes a busy machine several times slower.
export OMP_WAIT_POLICY ?= passive
# The checks need nothing from the network.
export PYRIGHT_PYTHON_IGNORE_WARNINGS ?= 1
# Python keeps what it compiled: else each process that a test starts compiles nerfstudio anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo bench docs fuzz gpu smoke stability viewer test test-quick test-lab test-avx2 test-pythons check
.PHONY: lint clean distclean env help
.DEFAULT_GOAL := help

help:
	@sed -n '3,/^$$/s/^# \{0,1\}//p' Makefile

env: $(STAMP)

# On the CPU everywhere: compiling kernels for a GPU takes longer than the demo.
demo: $(STAMP)
	CUDA_VISIBLE_DEVICES= $(PY) demo/run.py $(DEMO_ARGS)

bench: $(STAMP)
	$(PY) -m lab.bench $(BENCH_ARGS)

stability: $(STAMP)
	$(PY) -m lab.stability $(STABILITY_ARGS)

gpu: $(STAMP)
	$(PY) -m lab.gpu

# What the options mean is read from the package; without it the page says so.
docs: $(DOCS_STAMP)
	@if test -e $(STAMP); then $(PY) -m lab.options; \
	else test -e docs/reference/options.md || printf -- '---\norphan: true\n---\n\n# Options\n\n%s\n' \
	    'This page is written where the package is installed: `make env docs`.' >docs/reference/options.md; fi
	$(DOCS_VENV)/bin/python -m sphinx -W --keep-going -q -b html docs outputs/site
	@echo "==> outputs/site/index.html"

smoke: $(STAMP)
	CUDA_VISIBLE_DEVICES= OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(PY) -m lab.reproduce.smoke $(SMOKE_ARGS)

# Needs node and npm, which refuses what is not as lab/viewer/package-lock.json says.
viewer:
	cd lab/viewer && npm ci --ignore-scripts --no-audit --no-fund && npm run build

test: $(STAMP)
	$(PYTEST) $(PYTEST_ARGS)

test-quick: $(STAMP)
	$(PYTEST) -m "not slow" $(PYTEST_ARGS)

test-lab: $(STAMP)
	$(PYTEST) lab/tests $(PYTEST_ARGS)

# hypothesis prints the example that failed; the next run tries it first.
fuzz: $(STAMP)
	@ends=$$(( $$(date +%s) + 60 * $(FUZZ_MINUTES) )); \
	while [ $$(date +%s) -lt $$ends ]; do \
	    $(PY) -m pytest -m hypothesis --hypothesis-profile=fuzz $(or $(PYTEST_ARGS),tests lab/tests) || exit 1; \
	done

# Kernels are compiled anew for the other processor: three minutes, the first time.
test-avx2: $(STAMP)
	ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 NUMBA_CPU_NAME=haswell \
	NUMBA_CPU_FEATURES=+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt \
	    $(PYTEST) -m "not slow" $(wildcard $(addprefix tests/,$(COMPUTING))) $(PYTEST_ARGS)

test-pythons:
	@for version in $(PYTHONS_TESTED); do \
	    $(MAKE) env VENV=.venv-$$version PYTHON=python$$version && \
	    .venv-$$version/bin/python -m pytest tests lab/tests $(PYTEST_ARGS) || exit 1; \
	done

lint: $(STAMP)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(VENV)/bin/lint-imports --no-cache
	$(PY) -m pyright --pythonpath $(PY)

check: lint test test-lab

clean:
	rm -rf build dist *.egg-info demo/output demo/scene outputs .pytest_cache .ruff_cache .hypothesis
	find desplat_ns tests demo lab -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV) $(DOCS_VENV) .venv-3.*

# An environment of its own: the package is not needed, and is 9 GB. Sphinx needs Python 3.11.
$(DOCS_STAMP): docs/requirements.txt constraints.txt
	$(call environment,$(DOCS_VENV),11,120 MB; half a minute,-r docs/requirements.txt)
	@touch $@

# Written last, so that an interrupted installation is taken up again.
$(STAMP): pyproject.toml constraints.txt
	$(call environment,$(VENV),10,about 9 GB with torch's CUDA libraries; 1 to 10 minutes,-e '.[dev]')
	$(call install,$(VENV)) --no-deps $(OPENIMAGEIO)
	@touch $(STAMP)
	@echo "==> Ready: $(VENV)/bin/ns-train desplat --help"

SUPPORTED = >=3.$(2),<3.13

# Reads JPEG XL and JPEG 2000 as well. Without its requirement of numpy 2, which nuscenes-devkit
# does not allow and it does not need (docs/dev/environment.md).
OPENIMAGEIO = OpenImageIO==3.2.2.0

# Folder, least minor version of Python 3, size and time, what is installed.
ifneq ($(UV),)
install = "$(UV)" pip install --python $(1)/bin/python
define environment
@echo "==> Environment in $(1), with uv ($(3))"
@test -x $(1)/bin/python || "$(UV)" venv --quiet --python "$(or $(PYTHON),$(SUPPORTED))" $(1)
$(call install,$(1)) -c constraints.txt $(4)
endef
else
install = $(1)/bin/python -m pip install --disable-pip-version-check
define environment
@echo "==> Environment in $(1), with pip ($(3))"
@test -x $(1)/bin/python || for python in $(PYTHONS); do \
    "$$python" -c 'import sys; sys.exit(not (3, $(2)) <= sys.version_info < (3, 13))' 2>/dev/null \
        && echo "==> $$("$$python" --version)" && exec "$$python" -m venv $(1); \
done; \
test -x $(1)/bin/python || { echo "No Python from 3.$(2) to 3.12 among: $(PYTHONS). Install one, or name it:" \
    "make PYTHON=/path/to/python3.11"; exit 1; }
$(call install,$(1)) -c constraints.txt $(4)
endef
endif
