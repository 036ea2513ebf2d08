# `make demo`: from nothing to the main result. `make test`: the same set-up, then every check and test.
# `make docs`: the documentation as a site in out/site.
PYTHON ?= python3
BIN := .venv/bin
# Compiled programs are kept in the user's cache folder: a second clone, or a second run, finds them there.
export JAX_COMPILATION_CACHE_DIR ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/clearance_jax
# Small arrays lose by threading inside one operation; the second core runs the second test process.
export XLA_FLAGS ?= --xla_cpu_multi_thread_eigen=false
# A file's tests share programs, and so stay in one process; the files that take longest begin.
PYTEST := $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: demo test tests quick nightly account check style types wheel lowest docs reference outputs gallery pictures notebooks pages viewer clean

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@

demo: .venv/installed
	mkdir -p out
	$(BIN)/clearance simulate clearance_jax/examples/joint5_velocity_1.toml -o out/joint5.nc --plot out/joint5.png
	$(BIN)/clearance simulate clearance_jax/examples/slider_crank.toml -o out/slider_crank.nc --plot out/slider_crank.png

check: style types

style: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/installed
	$(BIN)/pyright

# The library as users get it: the wheel, installed alone, reads a scene and solves it.
wheel: .venv/installed
	rm -rf out/wheel && mkdir -p out/wheel
	$(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir out/wheel .
	$(PYTHON) -m venv out/wheel/venv
	out/wheel/venv/bin/pip install --quiet --disable-pip-version-check out/wheel/*.whl
	cd out/wheel && venv/bin/clearance examples arm && venv/bin/clearance simulate arm.toml --t1 2ms -o arm.nc --plot arm.png

# With the lowest versions that pyproject.toml names (`uv` resolves them): the quick part of the tests.
lowest: .venv/installed
	$(PYTHON) -m venv out/lowest
	out/lowest/bin/pip install --quiet --disable-pip-version-check uv
	out/lowest/bin/uv pip install --quiet --python out/lowest/bin/python --resolution lowest-direct -e ".[dev]"
	out/lowest/bin/pytest -n 2 --dist loadfile --no-loadscope-reorder -m quick

# All tests but the slow ones, of which a tenth has its turn each day; then a tenth as users run: optimised, types
# unchecked, programs kept. pyright uses one core, and so runs beside them.
test: style
	$(MAKE) --no-print-directory --jobs 2 types tests

tests: .venv/installed
	$(PYTEST)
	CLEARANCE_TESTS=as-users $(PYTEST)

# A part of `make test`, in two minutes: laws, numerics, keys, messages, layers (files marked `quick`).
quick: check
	$(PYTEST) -m quick

# Every test, both ways; then a thousand random scenes by the library and by the second simulator (tests/second): hours.
# The scenes go on where they were ended.
nightly: .venv/installed
	$(PYTEST) --all
	CLEARANCE_TESTS=as-users $(PYTEST) --all
	$(BIN)/python -m tests.second --out out/second

# Where the suite's time goes, by file and by test: out/suite.md.
account: .venv/installed
	$(PYTEST) --account=out

docs: .venv/installed reference
	$(BIN)/sphinx-build -W --keep-going -q -b html docs out/site
	@echo "open out/site/index.html"

reference: .venv/installed
	$(BIN)/python docs/generate.py

# What long pages show below their code, kept in docs/outputs; `PAGES="wear.md"` runs these alone, `PAGES=all` all pages.
outputs: .venv/installed
	$(BIN)/python docs/_ext/outputs.py $(PAGES)

gallery: .venv/installed
	$(BIN)/python docs/gallery.py

pictures: .venv/installed
	$(BIN)/python docs/pictures.py

notebooks: .venv/installed
	$(BIN)/python docs/execute.py

# The script of `clearance view`, from viewer/src and three.js: into clearance_jax/viewer/static. It needs node and npm.
viewer:
	cd viewer && npm ci --no-audit --no-fund && npm run build

# Every benchmark page anew, one command after another: hours. out/pages.md has the time of each.
pages: .venv/installed
	$(BIN)/python -m experiments.pages

# Compiled programs stay: the next clone needs them. `rm -r ~/.cache/clearance_jax` removes them.
clean:
	rm -rf .venv out
