# make demo: set up and fly the simulator; make test: set up and run the checks; make test-full: the long flights too.
# Second runs skip finished set-up.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CLIP := runs/clip

.PHONY: setup demo clip test test-full lint format clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 10) <= v < (3, 14) else \
	"uavfollow needs Python 3.10 to 3.13, this is %d.%d; try: make PYTHON=python3.11 ..." % v)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

demo: $(STAMP)
	$(BIN)/uavfollow sim --out runs/demo

clip: $(STAMP)
	$(BIN)/python -m sitl.clip --out $(CLIP)
	$(BIN)/uavfollow track $(CLIP)/clip.mp4 --truth $(CLIP)/groundtruth_rect.txt --out runs/track-clip

test: lint
	$(BIN)/python -m pytest -m "not slow"

test-full: lint
	$(BIN)/python -m pytest

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) runs build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
