# Every job installs what the job needs: a fresh clone needs nothing but Python 3.11 to 3.14 and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Modules are compiled when they are first imported, and kept: compiling all at once takes a minute.
INSTALL := -m pip install --disable-pip-version-check --no-compile
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help check-site check-links check-docker run task-pages test test-extras test-released test-lowest test-faults slow lint format typecheck bench-sim bench-vector bench-train compare leaderboard search coverage paper ceilings unseen figures failures scores verify-submission release-agents docs clean
.DEFAULT_GOAL := help

help:  ## show the jobs
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 19

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(INSTALL) --quiet -c constraints.txt -e '.[dev]'
	@touch $@

# What running needs, without the tools of development; whoever has these has it already.
$(VENV)/.running: pyproject.toml constraints.txt
	@echo "installing usbench with PyTorch, Stable-Baselines3, Numba and 50 other packages into $(VENV): 1.8 GB there with"
	@echo "PyTorch's CPU build (README), some 7 GB with CUDA's libraries; minutes, as the network allows. Nothing else changes."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(INSTALL) -c constraints.txt -e '.[guide]'
	@touch $@

run: $(if $(wildcard $(STAMP)),$(STAMP),$(VENV)/.running)  ## train DQN on the probe-plane task and show what it learnt
	@echo "training takes 3 to 6 minutes on one core; Ctrl-C keeps what is done, and make run goes on from there."
	$(BIN)/usbench run --algo dqn --task pp
	@echo "usbench is $(BIN)/usbench here."

# One process per core and one thread per process: more threads would wait for each other.
test: $(STAMP)  ## run the tests (without the slow ones)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow and not faults and not site" -n auto --dist worksteal

# Without these packages the tests that need them are skipped.
test-extras: $(STAMP)  ## install what some tests need beside the package: Weights & Biases, RL Baselines3 Zoo, ultrasound-metrics
	$(BIN)/python $(INSTALL) --quiet -c constraints.txt -e '.[dev,wandb]'
	$(BIN)/python $(INSTALL) --quiet --no-deps \
		-r tests/rl_zoo3.txt -r tests/ultrasound_metrics.txt

slow: $(STAMP)  ## run the slow tests (learning, timing)
	$(BIN)/python -m pytest -m slow

test-released: $(STAMP)  ## play the trained agents of the package whose frames have to be simulated (5 minutes)
	$(BIN)/python -m pytest -m slow tests/test_released.py

# PyTorch is that of constraints.txt.
$(VENV)-lowest/.installed: $(STAMP) tests/lowest.py
	$(PYTHON) -m venv $(VENV)-lowest
	$(BIN)/python tests/lowest.py > $(VENV)-lowest/versions.txt
	grep -E '^(torch|pytest|pytest-xdist|hypothesis)==' constraints.txt >> $(VENV)-lowest/versions.txt
	$(VENV)-lowest/bin/python $(INSTALL) --quiet -r $(VENV)-lowest/versions.txt
	@touch $@

# Old versions are used in ways of which others warn, and figures are those of one matplotlib.
test-lowest: $(VENV)-lowest/.installed  ## run some tests with the lowest versions that pyproject.toml allows, in .venv-lowest (Python 3.11)
	$(VENV)-lowest/bin/python $(INSTALL) --quiet --no-deps -e .
	OMP_NUM_THREADS=1 $(VENV)-lowest/bin/python -m pytest -m "not slow" -o filterwarnings=default -n auto --dist worksteal \
		--ignore tests/results/test_leaderboard_committed.py tests/agents tests/cli tests/compare tests/datasets \
		tests/guide tests/records tests/results tests/watch tests/envs/observation tests/envs/vector

test-faults: $(STAMP)  ## kill, corrupt, interrupt and starve trials (minutes long; as root also full disks)
	$(BIN)/python -m pytest -m faults -s tests/faults

lint: $(STAMP)  ## check style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: $(STAMP)  ## put the code into the project's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

typecheck: $(STAMP)  ## check the types (mypy --strict) on an installed copy
	rm -rf build/typecheck build/lib build/bdist.*
	$(BIN)/python $(INSTALL) --quiet --no-deps --no-build-isolation \
		--target build/typecheck .
	$(BIN)/mypy --no-incremental build/typecheck/usbench

# esdiva has no release for Python 3.13 and later: without esdiva the benchmark leaves the ratio out and says so.
$(VENV)/.bench: $(STAMP)
	-$(BIN)/python $(INSTALL) --quiet -c constraints.txt -e '.[bench]'
	@touch $@

$(VENV)/.docs: $(STAMP)
	$(BIN)/python $(INSTALL) --quiet -c constraints.txt -e '.[docs]'
	@touch $@

docs: $(VENV)/.docs  ## build the site into build/docs, the notebooks run anew; a warning is an error
	rm -rf docs/api
	$(BIN)/sphinx-build --quiet --fresh-env --fail-on-warning --keep-going -d build/doctrees docs build/docs

check-site: docs  ## build the site, check its links, and seven of its pages in Chromium, light and dark (axe-core)
	$(BIN)/python -m pytest -m "site and not links" tests/site

check-links: docs  ## build the site, check its links, and ask other sites for every page that ours name
	$(BIN)/python -m pytest -m site tests/site/test_links.py

check-docker:  ## build the image of the Dockerfile and run the tests in it (needs Docker)
	docker build --tag usbench .
	docker run --rm usbench

compare: $(STAMP)  ## run what is missing of the paper's grid for every algorithm (many hours), write runs/leaderboard.md
	$(BIN)/usbench compare

leaderboard: $(STAMP)  ## write leaderboard.md, its figures and docs/paper.md again, from leaderboard_files/, search/, docs/ends.csv and tables/one-frame/ alone
	$(BIN)/usbench leaderboard --search search
	$(BIN)/python benchmarks/paper.py

search: $(STAMP)  ## choose hyperparameters by the protocol (many hours): of all rows, or of one by make search ALGO=ppo
	$(BIN)/usbench search $(if $(ALGO),--algo $(ALGO))

bench-sim: $(VENV)/.bench  ## accuracy and speed of the simulator, as a table
	$(BIN)/python benchmarks/simulator.py

bench-vector: $(STAMP)  ## steps per second of every task, with 1 and 16 environments, as a table
	$(BIN)/python benchmarks/vector.py

bench-train: $(STAMP)  ## time and memory that training takes, beside plain scripts, as a table
	$(BIN)/python benchmarks/training.py

coverage: $(STAMP)  ## how often the leaderboard's intervals hold the truth, by simulation (half an hour)
	$(BIN)/python benchmarks/intervals.py

paper: $(STAMP)  ## write docs/paper.md, the paper's results beside ours, from leaderboard_files/, docs/ends.csv and tables/one-frame/ alone
	$(BIN)/python benchmarks/paper.py

task-pages: $(STAMP)  ## write the page and the moving picture of every task into docs/environments (some minutes)
	$(BIN)/python benchmarks/task_pages.py

ceilings: $(STAMP)  ## the largest scores that an agent's knowledge allows (half an hour)
	$(BIN)/python benchmarks/ceilings.py

figures: $(STAMP)  ## draw the figures of docs/physics.md and print the widths of a point
	$(BIN)/python benchmarks/figures.py

failures: $(STAMP)  ## show which poses look alike and how the episodes of the trials in runs/ end
	$(BIN)/python benchmarks/failures.py --figure docs/look_alikes.png

unseen: $(STAMP)  ## what helps on phantoms never seen, and how many phantoms and steps it takes (days), as tables
	$(BIN)/python benchmarks/unseen.py

scores: $(STAMP)  ## train the paper's agent on both tasks with 4 seeds (some 15 minutes) and print the scores
	$(BIN)/python benchmarks/scores.py

verify-submission: $(STAMP)  ## check a submission's trials from their records: make verify-submission SUBMISSION=folder
	$(BIN)/usbench submit $(or $(SUBMISSION),submission) --check

release-agents: $(STAMP)  ## build the trained agents that come with the package again: make release-agents TRIALS="runs more"
	$(BIN)/python benchmarks/release_agents.py $(TRIALS)

clean:  ## remove the environment, builds and caches (runs/ stays)
	rm -rf $(VENV) $(VENV)-lowest build dist docs/api __pycache__ *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find usbench envs agents benchmarks docs tests -name __pycache__ -type d -prune -exec rm -rf {} +
