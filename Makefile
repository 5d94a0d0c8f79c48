# Sets up .venv with everything, then runs what is asked. Needs python3 (>= 3.10), make and cargo.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
SOURCES := $(shell find crates -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock pyproject.toml

.PHONY: all demo test test-rust test-python check format bench clean

all: $(VENV)/.built

$(VENV)/.tools: pyproject.toml
	@command -v cargo >/dev/null || { \
	  echo "mapmeld: no Rust toolchain found (cargo). Install one from https://rustup.rs or with" \
	       "your system's packages (Debian: apt install cargo rustc), then run make again." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo "mapmeld: needs Python 3.10 or newer; choose one with 'make PYTHON=python3.12'" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PY) -m pip install --quiet --upgrade pip
	$(PY) -m pip install --quiet "maturin>=1.9,<2"
	@touch $@

# The package is editable: Python sources are used where they lie, the core is built in release mode.
# The stamp has the time from before the build: what is edited meanwhile is built the next time.
$(VENV)/.built: $(VENV)/.tools $(SOURCES)
	@touch $(VENV)/.building
	VIRTUAL_ENV=$(CURDIR)/$(VENV) $(VENV)/bin/maturin develop --release --quiet --extras dev
	@mv $(VENV)/.building $@

demo: $(VENV)/.built
	$(VENV)/bin/mapmeld demo -o demo_out

test: test-rust test-python test-ros

test-rust: $(VENV)/.built
	cargo test --quiet --workspace --exclude mapmeld-py

test-python: $(VENV)/.built
	$(PY) -m pytest

check: $(VENV)/.built
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

format: $(VENV)/.built
	cargo fmt --all
	$(VENV)/bin/ruff format .
	$(VENV)/bin/ruff check --fix .

bench: $(VENV)/.built
	cargo bench -p mapmeld-core
	$(PY) benchmarks/complexity.py

clean:
	rm -rf $(VENV) $(ROS_VENV) target demo_out

include ros/ros.mk
