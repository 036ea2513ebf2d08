# `make demo`: from nothing to the main result. `make test`: the same set-up, then every check and test.
# `make docs`: the documentation as a site in out/site.
PYTHON ?= python3
BIN := .venv/bin
export JAX_COMPILATION_CACHE_DIR ?= $(CURDIR)/.jax_cache
# Small arrays lose by threading inside one operation; the second core runs the second test process.
export XLA_FLAGS ?= --xla_cpu_multi_thread_eigen=false

.PHONY: demo test check docs reference pictures notebooks clean

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@

demo: .venv/installed
	mkdir -p out
	$(BIN)/clearance simulate experiments/scenes/joint5_velocity_1.toml -o out/joint5.nc --plot out/joint5.png
	$(BIN)/clearance simulate experiments/scenes/slider_crank.toml -o out/slider_crank.nc --plot out/slider_crank.png

check: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/pyright

test: check
	$(BIN)/pytest -n 2

docs: .venv/installed reference
	$(BIN)/sphinx-build -W --keep-going -q -b html docs out/site
	@echo "open out/site/index.html"

reference: .venv/installed
	$(BIN)/python docs/generate.py

pictures: .venv/installed
	$(BIN)/python docs/pictures.py

notebooks: .venv/installed
	$(BIN)/python docs/execute.py

clean:
	rm -rf .venv out .jax_cache
