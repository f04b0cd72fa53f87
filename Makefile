# make demo    install into .venv and measure the bundled OpenDroneMap cloud
# make test    everything that must pass: lint, format, types, import contracts, and the tests on
#              Python 3.9 and 3.13 with the versions of .ci/constraints-*.txt
# make test-newest   the tests with today's newest versions of everything, in .venv-newest
# make lock    write .ci/constraints-*.txt anew: today's newest versions that each Python can have
# make test-live   the tests that take a real server: NODEODM_URL=http://... (docs/servers.md)
# make test-webodm   clicks in a real WebODM: WEBODM_URL, WEBODM_USER, WEBODM_PASSWORD (docs/webodm.md)
# make plugin  build the WebODM plugin: dist/volcalc-offline.zip and dist/volcalc.zip (docs/webodm.md)
# make fuzz    2,000 damaged inputs given to the real command (RUNS=n SEED=n; tests/fuzz/run.py)
# make coverage   the tests once more, with the lines that none of them reaches
# make lint    the checks that need no test run        make format   let ruff mend what it can
# make clean   remove what these made
#
# PYTHON=/path/to/python3 chooses the interpreter (3.9 or newer) of the demo and the plugin, PYTHON313
# and PYTHON39 those of the tests, JOBS=n the number of test workers (4 by default, for two
# processors: many tests wait for servers and browsers).

PYTHON ?= python3
JOBS ?= 4

PIP := -m pip --disable-pip-version-check --quiet
VENV := .venv
DEV := .venv-dev
OLD := .venv39
NEWEST := .venv-newest

# $(1): a version. A pyenv shim may be on PATH without that Python behind it, so each has to answer.
find_python = $(shell for p in python$(1) $(HOME)/.pyenv/versions/$(1)[.-]*/bin/python$(1) \
	"$$(pyenv root 2>/dev/null)"/versions/$(1)[.-]*/bin/python$(1); do \
	"$$p" -c 'import sys, ensurepip, venv; "%d.%d" % sys.version_info[:2] == "$(1)" or sys.exit(1); \
	print(sys.executable)' 2>/dev/null && break; done)

# The newest Python that is tested, or the newest there is; and the oldest, with the exact pins of
# WebODM, its web framework included.
ifndef PYTHON313
PYTHON313 := $(or $(call find_python,3.13),$(call find_python,3.12),$(call find_python,3.11),$(PYTHON))
endif
ifndef PYTHON39
PYTHON39 := $(call find_python,3.9)
endif
OLD_PINS := numpy==1.26.2 scipy==1.11.3 Django==2.2.27 djangorestframework==3.13.1

# What the tests run with: a version of each package, for each Python (make lock).
LOCK = .ci/constraints-$(1).txt
DEV_VERSION := $(shell "$(PYTHON313)" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
DEV_LOCK := $(wildcard $(call LOCK,$(DEV_VERSION)))

# Tests run side by side; threads of the linear algebra beside them would only wait for each other.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Hundreds of tests start the command: it is compiled once, as an installed one is.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo plugin test test-newest test-live test-webodm fuzz lock lint lint39 format suite suite39 \
	broker say say39 coverage clean environments
ifndef SIDE_BY_SIDE
.NOTPARALLEL:
endif
.DELETE_ON_ERROR:

demo: $(VENV)/.ready
	$(VENV)/bin/quantify-client demo --out demo-out
	@echo "The report: $(CURDIR)/demo-out/report.html"
	@echo "To measure something of yours:  . $(VENV)/bin/activate  and then  quantify-client --help"

plugin: $(VENV)/.ready
	$(VENV)/bin/quantify-client plugin --out dist

# Installing and checking types keep one processor busy each.
test: say say39
	@$(MAKE) --no-print-directory -j3 SIDE_BY_SIDE=1 lint lint39 $(BROKER)
	@$(MAKE) --no-print-directory suite
	@$(MAKE) --no-print-directory -j2 SIDE_BY_SIDE=1 suite39 broker

SUITE = -m pytest -n $(JOBS) --dist worksteal --durations=10

environments: $(DEV)/.ready $(if $(PYTHON39),$(OLD)/.ready)

lint: $(DEV)/.ready
	$(DEV)/bin/ruff check .
	$(DEV)/bin/ruff format --check .
	$(DEV)/bin/mypy
	$(DEV)/bin/lint-imports
	@# Compiles the tests once: each worker of the suite would do it for itself, and tells what fails.
	MPLBACKEND=Agg $(DEV)/bin/python -m pytest --collect-only -q > /dev/null || true

format: $(DEV)/.ready
	$(DEV)/bin/ruff check --fix .
	$(DEV)/bin/ruff format .

suite: $(DEV)/.ready
	MPLBACKEND=Agg $(DEV)/bin/python $(SUITE) $(if $(PYTHON39),-m "not webodm_python")

test-newest:
	$(call need_python,$(PYTHON313))
	$(call install,$(NEWEST),$(PYTHON313),-e ".[dev]")
	$(NEWEST)/bin/python -m pip freeze --exclude-editable
	MPLBACKEND=Agg $(NEWEST)/bin/python $(SUITE)

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

say:
ifeq ($(DEV_LOCK),)
	@echo "Tested with $(PYTHON313) ($(DEV_VERSION)) and today's newest packages, not with those of" \
	  "$(call LOCK,3.13): no Python 3.13 with venv was found (PATH, pyenv);" \
	  "'pyenv install 3.13' or PYTHON313=/path/to/python3.13 brings it."
else
	@echo "Tested with $(PYTHON313) and the packages of $(DEV_LOCK)."
endif

ifneq ($(PYTHON39),)
say39:
	@echo "The suite also runs on $(PYTHON39) with $(OLD_PINS), but for what takes long" \
	  "and tells no more on a second Python (marker: one_python); the plugin's server runs there" \
	  "alone (webodm_python)."

lint39: $(OLD)/.ready
	$(OLD)/bin/mypy

suite39: $(OLD)/.ready
	@# What a failed assertion held is told above: here it would be compiled for each worker.
	MPLBACKEND=Agg $(OLD)/bin/python $(SUITE) --assert=plain -m "not one_python" \
	  --hypothesis-profile second_python
else
say39:
	@echo "No Python 3.9 with venv found (PATH, pyenv): the run with $(OLD_PINS) is left out;" \
	  "'pyenv install 3.9' or PYTHON39=/path/to/python3.9 brings it back."

lint39 suite39:
endif

# Celery as WebODM has it lives with no newer setuptools, so it has an environment of its own.
BROKER_PINS := celery==4.4.0 kombu==4.6.7 redis==3.2.0 vine==1.3.0 "importlib_metadata<5" \
	"setuptools<58" pytest

ifneq ($(and $(PYTHON39),$(shell command -v redis-server)),)
BROKER := .venv-broker/.ready

broker: $(BROKER)
	.venv-broker/bin/python -m pytest --noconftest -p no:cacheprovider tests/plugin/test_broker.py

$(BROKER): Makefile
	$(call install,.venv-broker,$(PYTHON39),$(BROKER_PINS))
	@touch $@
else
broker:
	@echo "No Python 3.9 or no redis-server found: the plugin's tests of the broker are left out;" \
	  "'sudo apt install redis-server' brings it."
endif

# In a throw-away environment for each Python; names and versions only, not where they came from.
lock:
	$(call need_python,$(PYTHON39))
	$(call need_python,$(PYTHON313))
	$(call lock,3.9,$(PYTHON39),$(OLD_PINS))
	$(call lock,$(DEV_VERSION),$(PYTHON313))

clean:
	rm -rf $(VENV) $(DEV) $(OLD) $(NEWEST) .venv-broker demo-out build dist *.egg-info .coverage .coverage.*
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

# $(1): the environment, made anew; $(2): its Python; $(3): what to install. pip before 21.3 cannot
# install editable projects. What is used is compiled as it is used, not all there is.
define install
@echo "Installing into $(1) (a minute or two) ..."
@"$(2)" -m venv --clear $(1)
@{ $(1)/bin/python $(PIP) install "pip>=21.3" && $(1)/bin/python $(PIP) install --no-compile $(3); } || { \
  echo "make: installing into $(1) failed, see above: is there a network connection?" >&2; exit 1; }
endef

# $(1): the version of $(2), a Python; $(3): what is given beforehand.
define lock
@echo "Asking for the newest packages for Python $(1) (a minute or two) ..."
@made="$$(mktemp -d)" && trap 'rm -rf "$$made"' EXIT && "$(2)" -m venv "$$made" && \
  "$$made/bin/python" $(PIP) install "pip>=21.3" && \
  "$$made/bin/python" $(PIP) install -e ".[dev]" $(3) && \
  { echo "# Written by 'make lock': what the tests run with on Python $(1)." && \
    "$$made/bin/python" -m pip freeze --exclude-editable; } > "$$made/lock" && \
  cp "$$made/lock" $(call LOCK,$(1)) && echo "$(call LOCK,$(1))"
endef

$(VENV)/.ready: pyproject.toml
	$(call need_python,$(PYTHON))
	$(call install,$(VENV),$(PYTHON),-e .)
	@touch $@

$(DEV)/.ready: pyproject.toml $(DEV_LOCK)
	$(call need_python,$(PYTHON313))
	$(call install,$(DEV),$(PYTHON313),-e ".[dev]" $(addprefix -c ,$(DEV_LOCK)))
	@touch $@

$(OLD)/.ready: pyproject.toml $(call LOCK,3.9)
	$(call install,$(OLD),$(PYTHON39),-e ".[dev]" -c $(call LOCK,3.9))
	@touch $@
