# Two commands do the set-up: `make demo` and `make test`.

SHELL := /bin/bash
.DEFAULT_GOAL := help
NODE_IS_THERE := process.exit(process.versions.node.split(".")[0] >= 20 ? 0 : 1)
# The binary and the Python module with the tests: by themselves they would be all of it once more, with other features of dependencies.
BUILD_TESTS := SQLX_OFFLINE=true cargo build --workspace --locked --tests --lib --bin sparring && scripts/python-native
.PHONY: help demo dashboard wheel test fetched test-python test-trainers test-heavy test-llm test-otlp bench bench-peers bench-python soak dist fmt lint deny sqlx check-style check-cargo check-clippy check-python check-node

help: ## What there is
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

demo: check-cargo ## A built-in learner trains against the curriculum: about 45 s on two cores, after the build
	@# What it did is looked at in the dashboard; without Node there is none, and its page says so.
	@if node -e '$(NODE_IS_THERE)' 2>/dev/null; then $(MAKE) --no-print-directory dashboard; fi
	cargo run --release --locked -p cli --bin sparring -- demo

dashboard: check-node ## The dashboard's files, which the next build of the binary takes in
	cd dashboard && npm ci --no-audit --no-fund --loglevel=error && npm run build

wheel: check-cargo check-python ## Two wheels into target/wheels: sparring (the environments) and sparring-server (the program)
	scripts/python-venv
	@if node -e '$(NODE_IS_THERE)' 2>/dev/null; then $(MAKE) --no-print-directory dashboard; fi
	cd python && ../target/python-venv/bin/maturin build --release --strip --locked --out ../target/wheels
	cd python/server && SQLX_OFFLINE=true ../../target/python-venv/bin/maturin build --release --strip --locked --out ../../target/wheels

# From empty it takes less time and disk without what the next build would take from this one.
test test-python test-trainers test-heavy: export CARGO_INCREMENTAL ?= 0
# Clippy is the compiler, saying more. As a command of its own it would have all dependencies compiled for it, which is minutes; here
# it is what compiles the tests. `make lint` looks at what is behind features, too.
test test-python test-trainers test-heavy: export RUSTC_WORKSPACE_WRAPPER := clippy-driver
test test-python test-trainers test-heavy: export CLIPPY_ARGS := -Dwarnings
test: check-cargo check-clippy check-python check-node ## Everything that is checked before a change lands
	cargo fmt --all -- --check
	@# What is fetched comes while the compiler works, and what needs no binary is tested meanwhile.
	@$(MAKE) --no-print-directory fetched & fetching=$$!; \
		$(BUILD_TESTS) && wait $$fetching || { kill $$fetching 2>/dev/null; exit 1; }
	SQLX_OFFLINE=true SPARRING_BINARY="$(CURDIR)/target/debug/sparring" cargo test --workspace --locked
	@# torch is hundreds of megabytes, so that not everybody who runs the tests should have to fetch it. Either takes one core.
	@$(MAKE) --no-print-directory -j2 test-python $(if $(SPARRING_TRAINERS),test-trainers)
	cd dashboard && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" npm run test:browser

fetched: check-python dashboard
	cd dashboard && npm run check && npm test
	scripts/openenv-venv
	scripts/python-venv
	scripts/chromium
	@if [[ -n "$$SPARRING_TRAINERS" ]]; then scripts/sb3-venv; fi

test-python: check-cargo check-clippy check-python ## The Python wheel: against Gymnasium's and PettingZoo's own tests, and typed
	scripts/python-venv
	scripts/python-client --check
	$(BUILD_TESTS)
	cd python && ../target/python-venv/bin/ruff check . && ../target/python-venv/bin/ruff format --check . \
		&& ../target/python-venv/bin/mypy && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" ../target/python-venv/bin/pytest

test-trainers: check-cargo check-clippy check-python ## Stable-Baselines3 and the learner in one file learn through the curriculum (fetches torch)
	scripts/python-venv
	scripts/sb3-venv
	$(BUILD_TESTS)
	@# More threads than cores wait for each other: the server has one of its own.
	cd python && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 \
		../target/sb3-venv/bin/pytest -o addopts= -o filterwarnings=default -p no:cacheprovider --durations=5 tests/trainers

test-heavy: check-cargo check-clippy check-python ## RLlib, TRL and the notebook, on small models (fetches about seven gigabytes; run by hand)
	scripts/python-venv
	scripts/heavy-venv
	$(BUILD_TESTS)
	cd python && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" PYTHONPATH=. OMP_NUM_THREADS=1 \
		../target/heavy-venv/bin/pytest -o addopts= -o filterwarnings=default -p no:cacheprovider --durations=5 tests/heavy

test-llm: check-cargo check-python ## A small real language model, served here, designs layouts: MODEL=any.gguf
	scripts/test-llm $(MODEL)

bench: check-cargo ## Benchmarks: measured, goal, ratio (on an idle machine)
	cargo build --release --locked -p cli -p bench
	cargo run --release --locked -p bench

soak: check-cargo ## Kills a server under trainers for two hours (MINUTES=120) and prints what was acknowledged and stored
	cargo build --release --locked -p cli -p bench
	cargo run --release --locked -p bench -- crash --minutes $(or $(MINUTES),120)

bench-peers: check-cargo check-python ## openenv-core's server beside ours, and KESSLER_ENV=path to a copy of the public environment
	scripts/openenv-venv
	cargo build --release --locked -p cli -p bench
	target/openenv-venv/bin/python bench/peers.py --sparring target/release/sparring --bench target/release/bench \
		--kessler-env "$(KESSLER_ENV)"

bench-python: wheel ## Stepping from Python beside the compiled batch, and what a curriculum costs; KESSLER_ENV as above
	cargo build --release --locked -p cli
	scripts/bench-venv
	target/bench-venv/bin/python bench/python.py --sparring target/release/sparring --kessler-env "$(KESSLER_ENV)"

test-otlp: check-cargo check-python ## Spans reach an OpenTelemetry collector, with the feature otlp
	scripts/test-otlp

dist: check-cargo dashboard ## The binary to ship: target/dist/sparring, with its symbols in sparring.debug
	scripts/dist

fmt: check-cargo ## Format the code
	cargo fmt --all

lint: check-cargo check-clippy check-style ## Formatting, clippy, style and import circles
	cargo fmt --all -- --check
	SQLX_OFFLINE=true cargo clippy --workspace --all-targets --all-features --locked -- -D warnings

deny: check-cargo ## Unused dependencies, and bans, licences and sources of the others (installs cargo-deny and cargo-machete)
	@command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	@command -v cargo-machete >/dev/null || cargo install --locked cargo-machete
	cargo deny check bans licenses sources
	cargo machete

sqlx: check-cargo ## Write .sqlx anew, after a change of SQL or migrations
	scripts/sqlx

check-style: check-python ## Names, prose and layout (CONTRIBUTING.md), and import circles between files
	scripts/check-style --self-test
	scripts/check-style
	scripts/check-circles

check-cargo:
	@command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs, version 1.95 or newer." >&2; exit 2; }

check-clippy:
	@command -v clippy-driver >/dev/null || { echo "Clippy is missing: rustup component add clippy rustfmt" >&2; exit 2; }

check-node:
	@node -e '$(NODE_IS_THERE)' 2>/dev/null || { echo "Node is missing or too old: the dashboard is built with it; install Node 20.19 or newer, with npm." >&2; exit 2; }

check-python:
	@command -v python3 >/dev/null || { echo "Python 3 is missing: the README's trainer is run as a test; install python3 (3.10 or newer)." >&2; exit 2; }
