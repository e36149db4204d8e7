# make demo   play a bag of keypoints into the node and show the result
# make check  run the fast tests: half a minute on two cores; the others start nodes, processes or browsers, or compute for long
# make test   run the whole test suite: about 6 minutes on two cores
# make live   run the tests with running nodes RUNS times (10), beside LOAD busy loops (0), and count the failures
# make fuzz   run the fuzz tests alone, with 100,000 new cases and more, then fuzz every decoder and file reader guided by
#             coverage (atheris), each for SECONDS; takes an hour
# make mutants   put faults into the code, one at a time, and count those that the tests notice; see CONTRIBUTING.md
# make messages  build the message packages that PyPI does not have (tf2_msgs, hri_msgs, ...), for the tests that need them;
#             PACKAGES=tf2_msgs builds that one
# Each target creates .venv on first use and installs what it needs (an extra of setup.py); ROS is not needed.
# PYTHON=python3.12 make test selects another Python. Bytecode is made of the modules that are used, in .venv.

PYTHON ?= python3
CORES := $(shell getconf _NPROCESSORS_ONLN)
VENV := .venv
SHARED := --dist loadgroup --no-loadscope-reorder
RUN := OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= PYTHONPYCACHEPREFIX=$(CURDIR)/$(VENV)/bytecode

.PHONY: demo check test live fuzz mutants messages lint clean
.NOTPARALLEL:

demo: $(VENV)/.installed-demo
	$(RUN) $(VENV)/bin/python -m lassokin_ros.demo.demo

check: $(VENV)/.installed-test
	$(RUN) $(VENV)/bin/python -m pytest -m "not slow" --numprocesses $(CORES) $(SHARED)

# A process more than cores: those that run nodes mostly wait for them. One that dies, as by a test that never ends
# (pyproject.toml), ends the run; pytest-xdist would repeat that test.
test: $(VENV)/.installed-test
	$(RUN) $(VENV)/bin/python -m pytest --numprocesses $$(($(CORES) + 1)) $(SHARED) --max-worker-restart 0

live: $(VENV)/.installed-test
	$(RUN) $(VENV)/bin/python test/support/live_runs.py --runs $(or $(RUNS),10) --load $(or $(LOAD),0) $(FILES)

fuzz: $(VENV)/.installed-fuzz
	$(RUN) LASSOKIN_FUZZ_CASES=$(or $(CASES),90000) $(VENV)/bin/python -m pytest test/msg_adapters/test_fuzz_adapters.py test/pipeline/test_fuzz_session.py test/pipeline/test_fuzz_sequences.py test/core/test_fuzz_tracker.py
	$(RUN) $(VENV)/bin/python test/fuzz/run.py --seconds $(or $(SECONDS),60)

mutants: $(VENV)/.installed-mutants
	$(RUN) $(VENV)/bin/python benchmarks/mutants.py --sample $(or $(SAMPLE),40) --seed $(or $(SEED),0) $(if $(ROOMS),--rooms $(ROOMS))

messages: $(VENV)/.installed-test $(VENV)/.installed-messages
	$(VENV)/bin/python test/support/installation/message_packages.py $(PACKAGES)

lint: $(VENV)/.installed-test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

clean:
	rm -rf $(VENV) build install log demo_output *.egg-info

$(VENV)/.installed-%: setup.py setup.cfg package.xml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	    { echo "Python 3.10 or newer is needed; choose one with: PYTHON=python3.12 make"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	    { echo "Python's venv module is incomplete; install it with: sudo apt install python3-venv"; exit 1; }
	test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[$*]'
	touch $@
