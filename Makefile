# make demo    install into .venv and measure the bundled OpenDroneMap cloud
# make test    everything that must pass: lint, format, types, import contracts, tests, Python 3.9
# make test-live   the tests that take a real server: NODEODM_URL=http://... (docs/servers.md)
# make test-webodm   clicks in a real WebODM: WEBODM_URL, WEBODM_USER, WEBODM_PASSWORD (docs/webodm.md)
# make plugin  build the WebODM plugin: dist/volcalc.zip and dist/volcalc-offline.zip (docs/webodm.md)
# make fuzz    2,000 damaged inputs given to the real command (RUNS=n SEED=n; tests/fuzz/run.py)
# make coverage   the tests once more, with the lines that none of them reaches
# make lint    the checks that need no test run        make format   let ruff mend what it can
# make clean   remove what these made
#
# PYTHON=/path/to/python3 chooses the interpreter (3.9 or newer), JOBS=n the number of test workers
# (3 by default, for two processors: many tests wait for servers and browsers).

PYTHON ?= python3
JOBS ?= 3

PIP := -m pip --disable-pip-version-check --quiet
VENV := .venv
DEV := .venv-dev
OLD := .venv39

# The oldest Python and the exact pins of WebODM, its web framework included. A pyenv shim may be on
# PATH without a 3.9 behind it, so each candidate has to answer.
PYTHON39 ?= $(shell for p in python3.9 $(HOME)/.pyenv/versions/3.9*/bin/python3.9 \
	"$$(pyenv root 2>/dev/null)"/versions/3.9*/bin/python3.9; do \
	"$$p" -c 'import sys, ensurepip, venv; sys.version_info[:2] == (3, 9) or sys.exit(1); \
	print(sys.executable)' 2>/dev/null && break; done)
OLD_PINS := numpy==1.26.2 scipy==1.11.3 Django==2.2.27 djangorestframework==3.13.1

# Tests run side by side; threads of the linear algebra beside them would only wait for each other.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo plugin test fuzz test-live test-webodm lint lint39 format suite suite39 say39 coverage clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

demo: $(VENV)/.ready
	$(VENV)/bin/quantify-client demo --out demo-out
	@echo "The report: $(CURDIR)/demo-out/report.html"

plugin: $(VENV)/.ready
	$(VENV)/bin/python -c "from pathlib import Path; \
	  from quantify_client.plugin_build import build_plugin; \
	  [print(build_plugin(Path('dist'), offline=o)) for o in (False, True)]"

test: say39 lint lint39 suite suite39

lint: $(DEV)/.ready
	$(DEV)/bin/ruff check .
	$(DEV)/bin/ruff format --check .
	$(DEV)/bin/mypy
	$(DEV)/bin/lint-imports

format: $(DEV)/.ready
	$(DEV)/bin/ruff check --fix .
	$(DEV)/bin/ruff format .

suite: $(DEV)/.ready
	MPLBACKEND=Agg $(DEV)/bin/python -m pytest -n $(JOBS) --dist worksteal

test-live: $(DEV)/.ready
	@test -n "$(NODEODM_URL)" || { echo "make: NODEODM_URL is not set: give the address of a NodeODM" \
	  "or ClusterODM on a machine of yours, NODEODM_URL=http://127.0.0.1:3000 say" >&2; exit 1; }
	$(DEV)/bin/python -m pytest -v tests/jobs/test_live.py

test-webodm: $(DEV)/.ready
	@test -n "$(WEBODM_URL)" || { echo "make: WEBODM_URL, WEBODM_USER and WEBODM_PASSWORD are not set:" \
	  "give a WebODM of yours whose plugin volcalc may be replaced (docs/webodm.md)" >&2; exit 1; }
	$(DEV)/bin/python -m pytest -v tests/panel/test_live.py tests/jobs/test_webodm_live.py

fuzz: $(DEV)/.ready
	$(DEV)/bin/python tests/fuzz/run.py --runs $(or $(RUNS),2000) --seed $(or $(SEED),1)

coverage: $(DEV)/.ready
	MPLBACKEND=Agg $(DEV)/bin/python -m pytest -n $(JOBS) --cov

ifneq ($(PYTHON39),)
say39:
	@echo "The suite also runs on $(PYTHON39) with $(OLD_PINS), but for what takes long" \
	  "and tells no more on a second Python (marker: one_python)."

lint39: $(OLD)/.ready
	$(OLD)/bin/mypy

suite39: $(OLD)/.ready
	MPLBACKEND=Agg $(OLD)/bin/python -m pytest -n $(JOBS) --dist worksteal -m "not one_python"
else
say39:
	@echo "No Python 3.9 with venv found (PATH, pyenv): the run with $(OLD_PINS) is left out;" \
	  "'pyenv install 3.9' or PYTHON39=/path/to/python3.9 brings it back."

lint39 suite39:
endif

clean:
	rm -rf $(VENV) $(DEV) $(OLD) demo-out build dist *.egg-info .coverage .coverage.*
	rm -rf .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find quantify_client tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# Debian and Ubuntu keep ensurepip in a package of its own; without it "python3 -m venv" fails half
# way, so ask first.
define need_python
@command -v "$(1)" >/dev/null || { echo "make: $(1) not found:" \
  "'sudo apt install python3 python3-venv', or make PYTHON=/path/to/python3" >&2; exit 1; }
@"$(1)" -c 'import sys; sys.exit(sys.version_info < (3, 9))' || { echo "make: $$("$(1)" -V) is too" \
  "old, 3.9 or newer is needed: make PYTHON=/path/to/a/newer/python3" >&2; exit 1; }
@"$(1)" -c 'import ensurepip, venv' 2>/dev/null || { echo "make: $(1) cannot make virtual" \
  "environments: 'sudo apt install" \
  "$$("$(1)" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')'" >&2; exit 1; }
endef

# $(1): the environment, $(2): what to install. pip before 21.3 cannot install editable projects.
define install
@echo "Installing into $(1) (a minute or two the first time) ..."
@{ $(1)/bin/python $(PIP) install "pip>=21.3" && $(1)/bin/python $(PIP) install $(2); } || { \
  echo "make: installing into $(1) failed, see above: is there a network connection?" >&2; exit 1; }
@touch $@
endef

$(VENV)/.ready: pyproject.toml
	$(call need_python,$(PYTHON))
	@"$(PYTHON)" -m venv $(VENV)
	$(call install,$(VENV),-e .)

$(DEV)/.ready: pyproject.toml
	$(call need_python,$(PYTHON))
	@"$(PYTHON)" -m venv $(DEV)
	$(call install,$(DEV),-e ".[dev]")

$(OLD)/.ready: pyproject.toml
	@"$(PYTHON39)" -m venv $(OLD)
	$(call install,$(OLD),-e ".[dev]" $(OLD_PINS))
