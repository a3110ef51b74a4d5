# On a fresh machine with git, make and Python >= 3.11 (with venv and pip): `make run`, `make test`.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: run check test verdicts nightly lint docs pictures bench experiments figures export-check release clean

run: .venv/ready ## the main job: fly, break, watch, report, into out/
	$(BIN)/gtmbench run --out out --force

check: .venv/ready ## the main job's figures against their baseline; fails where one is worse
	$(BIN)/gtmbench check

test: .venv/ready ## every test but those of the night; those that need a viewer skip by name where there is none; bytecode is kept, for its many processes
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal

verdicts: .venv/ready ## every log of the corpus of verdicts, and every draw of its oracles, with whole certificates
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m "" tests/verdicts

MINUTES ?= 60
nightly: .venv/ready ## looks for more than tests do, with other seeds every day: fuzzing, ordeals, every test, mutants of a room, damaged logs, oracles of verdicts; all run, whatever fails
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check atheris
	seed=$$(( $$(date +%s) / 86400 )); failed=; for each in \
	  "tests.fuzz --minutes $(MINUTES) --seed $$seed" "tests.ordeals writes --tries 600 --seed $$seed" \
	  "tests.ordeals kills --tries 60 --seed $$seed" "tests.ordeals flips --tries 60 --seed $$seed" "tests.ordeals writers --tries 30 --seed $$seed" \
	  "tests.mutation --reach" "tests.mutation --seed $$seed"; \
	do echo "== $$each"; OPENBLAS_NUM_THREADS=1 $(BIN)/python -m $$each || failed="$$failed; $$each"; done; \
	GTMBENCH_DAMAGED=200 GTMBENCH_SEED=$$seed GTMBENCH_ORACLES=$$seed OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest \
	  -q -m "" tests/intake/test_every_log_hostile.py tests/intake/test_intake_hostile.py tests/verdicts/test_metamorphic.py tests/verdicts/test_drawn_flights.py || failed="$$failed; pytest"; \
	test -z "$$failed" || { echo "found something:$$failed"; exit 1; }

lint: .venv/ready ## style, types, layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	PYTHONPATH=experiments $(BIN)/lint-imports

docs: .venv/ready ## the documentation, into out/docs (open out/docs/index.html); no network, a warning is an error
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m sphinx -a -W --keep-going -q -b html -d out/doctrees docs out/docs

pictures: .venv/ready ## the pictures of README, site and guides, drawn anew; a few minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/pictures.py

experiments: .venv/ready ## every printed result and figure of the dissertation; rewrites the table in docs/reference/dissertation.md
	$(BIN)/python experiments

figures: .venv/ready ## figures of README and docs, filled in from the results of experiments
	$(BIN)/python experiments/figures.py

kinds: .venv/ready ## what other files say of the kinds of faults: names, lists, scenarios, rows of tables, the picture
	$(BIN)/python -m tests.project.kinds
	$(BIN)/python experiments/fault_gallery.py --out docs/reference

export-check: .venv/ready ## an exported monitor on qemu's Cortex-M4: flash, memory, instructions a call; says what to install where a tool is missing
	OPENBLAS_NUM_THREADS=1 $(BIN)/python experiments/on_board.py --check

release: .venv/release ## the files of a release into dist/, tried as strangers will: three Pythons, lowest and newest dependencies (20 minutes)
	$(BIN)/python -m tests.release

bench: .venv/bench ## ratios, measured in one process on one thread; into bench.json and docs/reference/measured.md
	$(BIN)/python -m tests.benchmarks

.venv/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("gtmbench needs Python >= 3.11; try: make PYTHON=python3.12 run" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

.venv/release: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[release]'
	touch $@

.venv/bench: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]' && touch $@ \
	  || echo "peers are missing; the table names them"

clean:
	rm -rf .venv .venv-bench-* out build dist
