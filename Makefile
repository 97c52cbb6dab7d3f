# Two commands do the set-up: `make demo` and `make test`.

SHELL := /bin/bash
.DEFAULT_GOAL := help
NODE_IS_THERE := process.exit(process.versions.node.split(".")[0] >= 20 ? 0 : 1)
.PHONY: help demo dashboard wheel test test-python test-llm test-otlp bench bench-peers soak fmt lint deny sqlx check-cargo check-python check-node

help: ## What there is
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

demo: check-cargo ## A built-in learner trains against the curriculum: about 45 s on two cores, after the build
	@# What it did is looked at in the dashboard; without Node there is none, and its page says so.
	@if node -e '$(NODE_IS_THERE)' 2>/dev/null; then $(MAKE) --no-print-directory dashboard; fi
	cargo run --release --locked -p orchestrator --bin sparring -- demo

dashboard: check-node ## The dashboard's files, which the next build of the binary takes in
	cd dashboard && npm ci --no-audit --no-fund --loglevel=error && npm run build

wheel: check-cargo check-python ## Two wheels into target/wheels: sparring (the environments) and sparring-server (the program)
	scripts/python-venv
	@if node -e '$(NODE_IS_THERE)' 2>/dev/null; then $(MAKE) --no-print-directory dashboard; fi
	cd python && ../target/python-venv/bin/maturin build --release --strip --locked --out ../target/wheels
	cd python/server && SQLX_OFFLINE=true ../../target/python-venv/bin/maturin build --release --strip --locked --out ../../target/wheels

# From empty it takes less time and disk without what the next build would take from this one.
test: export CARGO_INCREMENTAL ?= 0
test: check-cargo check-python dashboard lint ## Everything that is checked before a change lands
	scripts/openenv-venv
	# The binary with the tests: built by itself it would be all of it once more, with other features of its dependencies.
	SQLX_OFFLINE=true cargo build --workspace --locked --tests --bin sparring
	SQLX_OFFLINE=true SPARRING_BINARY="$(CURDIR)/target/debug/sparring" cargo test --workspace --locked
	$(MAKE) --no-print-directory test-python
	scripts/chromium
	cd dashboard && npm run check && npm test && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" npm run test:browser

test-python: check-cargo check-python ## The Python wheel: against Gymnasium's and PettingZoo's own tests, typed, and its stubs current
	scripts/python-venv
	scripts/python-stubs --check
	cd python && ../target/python-venv/bin/ruff check . && ../target/python-venv/bin/ruff format --check . \
		&& ../target/python-venv/bin/mypy && ../target/python-venv/bin/pytest

test-llm: check-cargo check-python ## A small real language model, served here, designs layouts: MODEL=any.gguf
	scripts/test-llm $(MODEL)

bench: check-cargo ## Benchmarks: measured, goal, ratio (on an idle machine)
	cargo build --release --locked -p orchestrator -p bench
	cargo run --release --locked -p bench

soak: check-cargo ## Kills a server under trainers for two hours (MINUTES=120) and prints the ledger of what they were told
	cargo build --release --locked -p orchestrator -p bench
	cargo run --release --locked -p bench -- survival --minutes $(or $(MINUTES),120)

bench-peers: check-cargo check-python ## openenv-core's server beside ours, and KESSLER_ENV=path to a copy of the public environment
	scripts/openenv-venv
	cargo build --release --locked -p orchestrator -p bench
	target/openenv-venv/bin/python bench/peers.py --sparring target/release/sparring --bench target/release/bench \
		--kessler-env "$(KESSLER_ENV)"

test-otlp: check-cargo check-python ## Spans reach an OpenTelemetry collector, with the feature otlp
	scripts/test-otlp

fmt: check-cargo ## Format the code
	cargo fmt --all

lint: check-cargo ## Formatting and clippy, warnings refused
	cargo fmt --all -- --check
	SQLX_OFFLINE=true cargo clippy --workspace --all-targets --all-features --locked -- -D warnings

deny: check-cargo ## Bans, licences and sources of dependencies (installs cargo-deny if it is missing)
	@command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	cargo deny check bans licenses sources

sqlx: check-cargo ## Write .sqlx anew, after a change of SQL or migrations
	scripts/sqlx

check-cargo:
	@command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs, version 1.95 or newer." >&2; exit 2; }

check-node:
	@node -e '$(NODE_IS_THERE)' 2>/dev/null || { echo "Node is missing or too old: the dashboard is built with it; install Node 20.19 or newer, with npm." >&2; exit 2; }

check-python:
	@command -v python3 >/dev/null || { echo "Python 3 is missing: the README's trainer is run as a test; install python3 (3.10 or newer)." >&2; exit 2; }
