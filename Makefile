# One command sets up and runs the main job (make run), one sets up and passes the tests (make test).
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready$(subst /,-,$(CURDIR))# a moved checkout needs its environment anew

.DEFAULT_GOAL := help
# Tests and sweeps start many a process that imports torch, Lightning or MLflow. Without bytecode on disk each compiles
# all of it again, which takes longer than what most of them are started for.
unexport PYTHONDONTWRITEBYTECODE

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## install everything into .venv

run: $(READY) ## train and test the main job: calibration on panoramas of a town that is rendered first; then a real photo of a known camera
	$(BIN)/python train.py task=calibration
	$(BIN)/python predict.py input=examples/photos/berlin.jpg output=outputs/photo
	$(BIN)/python examples/known_camera.py outputs/photo

test: $(READY) ## the test suite but its slow tests, on every core
	$(BIN)/python -m pytest -n auto -m "not slow"

test-all: $(READY) ## the whole test suite, on every core
	$(BIN)/python -m pytest -n auto

test-cluster: $(READY) ## sweeps on a SLURM of two nodes, on Ray, with PostgreSQL, all on this machine; installs Debian packages if you are root
	@{ command -v slurmctld && command -v sbatch && ls /usr/lib/postgresql; } >/dev/null 2>&1 || if [ "$$(id -u)" = 0 ]; \
	  then apt-get install -y --no-install-recommends slurm-wlm postgresql; \
	  else echo "Install them first: sudo apt-get install --no-install-recommends slurm-wlm postgresql"; exit 1; fi
	$(BIN)/python -m pytest -n 0 -m cluster --durations=0

lint: $(READY) ## style, types of the functional core, layers, length of the manual
	$(BIN)/ruff check . && $(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	@sh docs/ceiling.sh

sweep-demo: $(READY) ## a small sweep with its report: push-pull against convolution, 8 seeds, about 3 minutes
	$(BIN)/python train.py -m sweep=demo
	$(BIN)/python report.py sweep=demo

report: $(READY) ## the report of a sweep: make report SWEEP=demo
	$(BIN)/python report.py sweep=$(or $(SWEEP),demo)

worlds-gallery: $(READY) ## pictures of the town and the office for the docs, about 5 minutes
	$(BIN)/sextant data gallery folder=docs/worlds samples=16

dashboard: $(READY) ## bring the MLflow store up to date and open it on this machine
	$(BIN)/sextant dashboard

bench: $(READY) ## timings against what a user would pick instead, as ratios
	$(BIN)/python -m benchmarks

gpu-check: $(READY) ## tests and timings on a CUDA device, at most 8 minutes, written to results/benchmarks_gpu.md
	$(BIN)/python -m benchmarks.gpu_check

gpu-claims: $(READY) ## what a GPU would add to the board of claims, with its minutes; BLOCK=1 runs the first block
	@$(BIN)/python -m benchmarks.gpu_claims $(BLOCK)

docs: $(READY) ## docs/ and results/ as a site with the API reference: outputs/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

notebooks: $(READY) ## run the notebooks and store what they show, about two minutes
	PYTHONWARNINGS=ignore $(BIN)/jupyter-execute --inplace notebooks/*.ipynb

lock: $(READY) ## pin every dependency anew in requirements.lock
	$(BIN)/uv pip compile pyproject.toml --all-extras --universal --no-emit-index-url --no-header -q -o requirements.lock

clean: ## remove caches and the environment; outputs/ stays
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests benchmarks -name __pycache__ -prune -exec rm -rf {} +

$(READY): requirements.lock pyproject.toml
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip install --quiet --python $(BIN)/python -r requirements.lock
	$(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps --editable .
	touch $@

.PHONY: help setup run test test-all test-cluster lint sweep-demo worlds-gallery report dashboard bench gpu-check gpu-claims docs notebooks lock clean
