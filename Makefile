# `make paper` regenerates the study, `make test` runs the tests; both set up their own environment in .venv.
# `make test-extras` runs the tests that need the optional extras or a browser, and the longest, `make docs` builds the pages
# into results/docs, `make validate` identifies public recordings, from the folder DATA or downloaded,
# `make install` and `make extras` set up the environment alone.
PYTHON ?= python3
VENV ?= .venv
CONSTRAINTS ?= constraints.txt

BIN := $(VENV)/bin
# What is used is compiled when it is first used, and kept: half of an installation's work would be to compile all the rest.
# The package, once installed, is not built again with its extras.
ifdef UV
# By uv at this path, in a third of pip's time.
ENVIRONMENT := $(UV) venv --quiet --seed --allow-existing --python $(PYTHON)
PIP := $(UV) pip install --quiet --python $(BIN)/python -c $(CONSTRAINTS)
else
ENVIRONMENT := $(PYTHON) -m venv
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c $(CONSTRAINTS)
endif
unexport PYTHONDONTWRITEBYTECODE
# A file's tests share what is costly to make, so they stay with one worker; `tests/conftest.py` says which come first.
PARALLEL := --numprocesses auto --dist loadfile --no-loadscope-reorder
# Only the model files of these packages are read, so they come without what their code needs.
MODELS := example-robot-data robosuite dm_control
# Tests marked `slow` fuzz, identify persons and arms from files to answers, count statistics of hundreds of trials, or need a
# browser; those marked `extras` skip without the extras.
INSTALLED := $(VENV)/installed-$(basename $(notdir $(CONSTRAINTS)))

.PHONY: paper test test-extras check docs readme validate install extras clean

paper: $(INSTALLED)
	$(BIN)/python -m experiments

test: $(INSTALLED)
	$(BIN)/python -m pytest $(PARALLEL) $(or $(TESTS),-m "not slow")

test-extras: extras
	$(BIN)/python -m pytest $(PARALLEL) -m "slow or extras"

check: $(INSTALLED)
	$(PIP) ruff mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(INSTALLED)-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "The pages are in results/docs; open index.html."

readme: $(INSTALLED)
	$(BIN)/python -m docs.tools.pages

validate: $(INSTALLED)
	$(BIN)/python -m experiments.validate $(or $(DATA:%=--data %),$(if $(MULTICONTACT_DATA),,--fetch))

install: $(INSTALLED)

extras: $(INSTALLED)-extras

clean:
	rm -rf $(VENV) build dist *.egg-info results

# Once it is there, the pages are built without a network.
$(INSTALLED)-docs: $(INSTALLED)
	$(PIP) "multicontact[docs]"
	touch $@

$(INSTALLED)-extras: $(INSTALLED)
	$(PIP) "multicontact[symbolic,peers,completion,formats,notebook,rerun,xacro,docs]"
	$(PIP) --no-deps $(MODELS)
	touch $@

$(INSTALLED): pyproject.toml ident/model/blocks.c ident/model/kernels.h $(CONSTRAINTS)
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and \
		'Python 3.11 or newer is needed, $(PYTHON) is older: use make PYTHON=python3.12, say.')"
	$(ENVIRONMENT) $(VENV)
	$(PIP) -e ".[test]"
	touch $@
