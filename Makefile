# lightwell: `make demo` runs the main job on a built-in scene, `make test-fast` the quick tests, `make test` the tests, `make
# test-all` those marked slow too.
# Each sets up what it needs.

VENV := .venv
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check -q

PYTEST_MARKS ?= not slow

.PHONY: setup demo test test-fast test-all test-python test-web viewer docs check-links live-pages release lint style benchmarks clean

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@tools/make-venv.sh $(VENV)
	@echo "lightwell: installing into $(VENV)"
	@$(PIP) install --no-compile -e .
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	@$(PIP) install --no-compile -e ".[test]"
	@touch $@

demo: setup
	@$(VENV)/bin/lightwell demo

# The last line is "N passed, N failed, N skipped" over Python and web; above it is a table of seconds. Types are checked beside
# the tests.
test: style web/node_modules/.installed
	@$(VENV)/bin/python tools/run_tests.py --marks "$(PYTEST_MARKS)" $(if $(REPORTS),--reports "$(REPORTS)")

# For work: the checks of the code and the tests that trace and train nothing, at most 90 s.
FAST := tests/core tests/graph tests/asset tests/report tests/test_rooms.py tests/test_files.py tests/test_limits.py \
  tests/test_exr.py tests/test_interrupts.py tests/test_isolated.py tests/test_serve.py tests/test_tests.py
test-fast: lint
	$(VENV)/bin/python -m pytest -x -n 2 $(FAST)

# Everything: the tests marked slow as well (long fuzzing, kills). REPORTS=FOLDER keeps the logs and reports of the rooms.
test-all:
	LIGHTWELL_LONG_TESTS=1 $(MAKE) test PYTEST_MARKS=

# One half of `make test`.
test-python: $(VENV)/.installed-test web/node_modules/.installed
	@$(VENV)/bin/python tools/run_tests.py --marks "$(PYTEST_MARKS)" --room python

test-web: $(VENV)/.installed web/node_modules/.installed
	@$(VENV)/bin/python tools/run_tests.py --room web

# The web tests and the tests of written assets (gltf-validator) need Node >= 20 and a Chromium.
web/node_modules/.installed: web/package-lock.json
	@tools/ensure-node.sh
	cd web && npm ci --no-audit --no-fund
	@tools/find-chromium.sh --install >/dev/null
	@tools/find-glslang.sh --install >/dev/null
	@touch $@

# Rebuild the page that ships in the wheel (needs Node; the built page is kept in the repository).
viewer: web/node_modules/.installed
	cd web && npm run build

$(VENV)/.installed-docs: $(VENV)/.installed
	@$(PIP) install --no-compile -e ".[docs]"
	@touch $@

# The site, in docs/_build/html. Warnings are errors: a link that leads nowhere fails the build.
docs: $(VENV)/.installed-docs
	$(VENV)/bin/python -m sphinx -W --keep-going -q -b html -c docs . docs/_build/html

# Links to other sites, which the build does not ask. Needs a network.
check-links: $(VENV)/.installed-docs
	$(VENV)/bin/python -m sphinx -W --keep-going -q -b linkcheck -c docs . docs/_build/links

# Pages of baked built-in scenes for the site: about ten minutes, then `make docs`.
live-pages: setup
	$(VENV)/bin/python tools/live_pages.py cornell two-rooms courtyard --no-pictures

$(VENV)/.installed-release: $(VENV)/.installed
	@$(PIP) install --no-compile -e ".[release]"
	@touch $@

# Everything that is published, in dist/: nothing is uploaded.
release: $(VENV)/.installed-release web/node_modules/.installed
	$(VENV)/bin/python tools/release.py

lint: style
	$(VENV)/bin/mypy

style: $(VENV)/.installed-test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

benchmarks: setup
	$(VENV)/bin/python benchmarks/main_job.py

clean:
	rm -rf $(VENV) web/node_modules docs/_build docs/_live dist out demo
