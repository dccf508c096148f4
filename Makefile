# Two commands do everything: `make demo` and `make test`. `make docs` builds the site, `make dist` what is published.
# All set up a .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
SITE_STAMP := $(VENV)/.installed-site
JOBS ?= 2

# Tests and tools begin a hundred processes, which would spend most of their time on compiling the modules they import.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test docs dist lint types unit oldest verification setup accuracy lock clean

demo: setup
	$(BIN)/vofem run examples/cantilever.toml --output output/cantilever --snapshot
	$(BIN)/vofem run examples/cantilever_from_mesh.toml --output output/cantilever_from_mesh

# The type checker, which uses one core only, runs beside the tests.
test: lint
	$(MAKE) --no-print-directory --jobs=2 types unit

# The site, into site/index.html: the pages of docs/, a gallery of examples/ and the reference. Warnings are errors.
docs: $(SITE_STAMP)
	$(BIN)/python tools/site_pages.py
	PYTHONPATH=tools NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --clean
	@echo "wrote site/index.html"

# Wheel and sdist, into dist/.
dist: $(SITE_STAMP)
	rm -rf dist
	$(BIN)/python -m build --quiet --outdir dist
	$(BIN)/python -m twine check --strict dist/*

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/mypy

# Whole modules go to the workers, in the order of tests/conftest.py. Each worker has a core and needs no more threads.
unit: setup
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder --max-worker-restart=0

# Compiled code with the oldest numba that pyproject.toml allows, beside the other packages of the lock.
oldest: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --no-deps --upgrade --target build/oldest \
		numba==0.61.0 llvmlite==0.44.0 numpy==2.1.3
	PYTHONPATH=build/oldest NUMBA_CACHE_DIR=build/oldest/cache $(BIN)/python -m pytest -n 0 -p no:cacheprovider \
		-k 'at_once or borrowed or (events_of and both_ways)' tests/test_compiled_cache.py tests/test_kernel_modes.py

# Run the whole catalogue, a minute or two, and write the tables of the docs.
verification: setup
	$(BIN)/vofem verify --markdown docs/verification.md

# docs/accuracy.md and its figures anew, with all other programs that are installed (.venv/bin/pip install -e .[bench]).
accuracy: setup
	OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/accuracy_page.py

setup: $(STAMP)

# Modules are compiled when they are first imported: most of the files of these packages never are.
$(STAMP): pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "vofem needs Python 3.11 or newer: make PYTHON=python3.11 ...")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $(STAMP)

# What only `make docs` and `make dist` need.
$(SITE_STAMP): $(STAMP) requirements-site.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -r requirements-site.lock
	touch $(SITE_STAMP)

# Resolve the ranges of pyproject.toml anew and write down what was found.
lock:
	rm -rf build/lock && $(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check '.[dev]'
	{ echo '# Written by `make lock`: the versions that `make test` was run with.'; \
	  build/lock/bin/python -m pip freeze --exclude vofem; } > requirements.lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check '.[docs,dist]'
	{ echo '# Written by `make lock`: what `make docs` and `make dist` need beside requirements.lock.'; \
	  build/lock/bin/python -m pip freeze --exclude vofem | grep -vxFf requirements.lock; } > requirements-site.lock

clean:
	rm -rf $(VENV) build dist site output *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
