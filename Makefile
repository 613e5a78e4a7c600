# Each target sets up what it needs; only Python (3.11 or later) has to be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := $(shell find ballscrew solver plant controllers fmus orchestration stability measurement gallery -name '*.py' -o -name '*.[ch]' -o -name '*.csv' -o -name '*.jinja' -o -name '*.json' -o -name 'page.md') pyproject.toml

.PHONY: demo check test test-ci docs prove tools lint pages bench wheels pythons clean

# The package is installed, not linked: what runs and is tested is what a user gets.
$(VENV)/installed: $(SOURCES) constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt "setuptools>=77" wheel
	rm -rf build  # what an earlier version left there would be installed, too
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --no-deps --force-reinstall .
	$(BIN)/python -m pip install --quiet --constraint constraints.txt "ballscrew[test]"
	test -n "$$(command -v cc)$$(command -v gcc)$$(command -v clang)" || \
	  $(BIN)/python -m pip install --quiet --constraint constraints.txt "ballscrew[native]"
	touch $@

# What linters and the tests of CI need beside that.
$(VENV)/ci: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt "ballscrew[ci]"
	touch $@

demo: $(VENV)/installed
	$(BIN)/ballscrew export --out out/fmus
	$(BIN)/ballscrew run --controller iol --out out/iol
	$(BIN)/ballscrew run --controller nctf --out out/nctf
	$(BIN)/ballscrew swap --controllers iol nctf pid --out out/swap

# What one runs while one works: two minutes of tests, of the parts that all others stand on.
check: lint
	$(PYTEST) -q -m "not ci and not prove" \
	  tests/solver tests/plant tests/controllers tests/measurement/records \
	  tests/orchestration/master/test_step_choice.py tests/test_conformance.py tests/test_layout.py

# Tests have three tiers, by two markers: these convince a stranger that all of it works, those
# marked `ci` run in CI as well, and those marked `prove` take hours.
PYTEST := $(BIN)/pytest -n 2 --dist loadgroup
test: $(VENV)/installed
	$(PYTEST) -m "not ci and not prove"

test-ci: $(VENV)/ci
	$(PYTEST) -m "ci and not prove"

lint: $(VENV)/ci
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	cd docs && ../$(BIN)/mypy --config-file ../pyproject.toml -p ballscrew
	$(BIN)/python -m cogapp --check $(PAGES)

# Numbers and tables on the pages, from the stored proofs.
PAGES = $(shell grep -l '\[\[\[cog' README.md docs/*.md docs/proof/*.md proofs/*.md)
pages: $(VENV)/ci
	$(BIN)/python -m cogapp -r $(PAGES)

docs: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt "ballscrew[docs]"
	$(BIN)/sphinx-build -W --keep-going -q -b html docs out/docs

prove: $(VENV)/ci
	$(PYTEST) -m prove
	$(BIN)/python proofs/runner.py interrupts --workers 1
	$(BIN)/python proofs/runner.py trusted_loops networks fuzz identification variational exchange \
	  diagnosis_rule thesis emps tro2021 own_records practice swap_study

# Tools of others, each in an environment of its own that pip fills. FLAGS=--quick is what CI runs.
tools: $(VENV)/ci
	$(BIN)/python proofs/runner.py tools made_by_others modelica $(FLAGS)

# In an environment of their own, with the programs that they compare with.
PEERS := .venv-peers/bin/python
bench: $(VENV)/installed
	test -x $(PEERS) || $(PYTHON) -m venv .venv-peers
	$(PEERS) -m pip install --quiet --constraint constraints.txt "setuptools>=77" wheel
	$(PEERS) -m pip install --quiet --constraint constraints.txt --no-deps --force-reinstall .
	$(PEERS) -m pip install --quiet --constraint constraints.txt "ballscrew[test,dask]" -r benchmarks/peers.txt
	$(PEERS) benchmarks

# One for each platform, compiled here by ziglang; `WHEELS=win64` makes one.
WHEELS ?= linux64 win64 darwin64 aarch64-linux aarch64-windows aarch64-darwin
wheels: $(VENV)/ci
	for target in $(WHEELS); do \
	  $(BIN)/python -m build --wheel --no-isolation -C target=$$target --outdir out/wheels . || exit 1; \
	done

# The wheel under every other Python that is found, see the script.
pythons: $(VENV)/ci
	$(BIN)/python .ci/pythons.py

clean:
	rm -rf $(VENV) .venv-peers build out *.egg-info
