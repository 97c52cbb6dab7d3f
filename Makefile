# `make demo` shows the project, `make test` runs all checks, and `make help` lists all targets.

SHELL := /bin/bash
.DEFAULT_GOAL := help
# Exit status 0 if Node is new enough to build the dashboard.
NODE_CHECK := process.exit(process.versions.node.split(".")[0] >= 20 ? 0 : 1)
# Builds the tests, the binary and the Python module together: separate builds would compile dependencies once more with other features.
BUILD_TESTS := SQLX_OFFLINE=true cargo build --workspace --locked --tests --lib --bin sparring && scripts/python-native
# Builds packages, and meanwhile the dashboard, which the next build includes. Without Node it is not built, and its page says so.
build_with_dashboard = if node -e '$(NODE_CHECK)' 2>/dev/null; then $(MAKE) --no-print-directory dashboard; fi & dashboard=$$!; \
	cargo build --locked $(1) && wait $$dashboard && cargo build --locked $(1) || { kill $$dashboard 2>/dev/null; exit 1; }
.PHONY: help demo venv dashboard wheel wheel-environments test test-prerequisites test-clients test-python test-browser test-trainers test-heavy test-wheels container test-container test-llm test-otlp fuzz bench bench-peers bench-python soak dist fmt lint deny sqlx check-style check-cargo check-clippy check-python check-node update-check

help: ## List the targets
	@grep -E '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

demo: check-cargo ## Train a built-in learner with the curriculum: about 45 s on two cores, after the build
	@$(call build_with_dashboard,-p cli --bin sparring)
	cargo run --locked -p cli --bin sparring -- demo

venv: check-cargo check-python ## Create .venv with the Python package and the program `sparring`, for trainers in Python
	@$(call build_with_dashboard,-p cli -p sparring-python --bin sparring --lib)
	scripts/venv .venv
	@echo 'Activate it: . .venv/bin/activate'

dashboard: check-node ## Build the dashboard, which the next build of the binary includes
	cd dashboard && npm ci --no-audit --no-fund --loglevel=error && npm run build

wheel: wheel-environments ## Build two wheels in target/wheels: sparring (environments) and sparring-server (the program)
	@if node -e '$(NODE_CHECK)' 2>/dev/null; then $(MAKE) --no-print-directory dashboard; fi
	cd python/server && SQLX_OFFLINE=true ../../target/python-venv/bin/maturin build --profile dist --strip --locked --out ../../target/wheels

wheel-environments: check-cargo check-python
	scripts/python-venv
	cd python && ../target/python-venv/bin/maturin build --profile dist --strip --locked --out ../target/wheels

# A build from scratch takes less time and disk without the files for incremental compilation.
test test-python test-browser test-trainers test-heavy: export CARGO_INCREMENTAL ?= 0
# clippy-driver compiles the tests and lints them in one pass; a separate `cargo clippy` would compile all dependencies once more,
# which takes minutes. `make lint` also checks code behind features.
test test-python test-browser test-trainers test-heavy: export RUSTC_WORKSPACE_WRAPPER := clippy-driver
test test-python test-browser test-trainers test-heavy: export CLIPPY_ARGS := -Dwarnings
test: check-cargo check-clippy check-python check-node ## Run all checks that a change must pass
	cargo fmt --all -- --check
	@# While the compiler works, packages are downloaded and the tests that need no binary run.
	@$(MAKE) --no-print-directory test-prerequisites & prerequisites=$$!; \
		$(BUILD_TESTS) && wait $$prerequisites || { kill $$prerequisites 2>/dev/null; exit 1; }
	@# Two tests per core: many of them wait, for timeouts and for processes that they start.
	SQLX_OFFLINE=true SPARRING_BINARY="$(CURDIR)/target/debug/sparring" \
		RUST_TEST_THREADS=$${RUST_TEST_THREADS:-$$((2 * $$(getconf _NPROCESSORS_ONLN)))} cargo test --workspace --locked
	@# Both wait for servers and pages, so that they share two cores well.
	@$(MAKE) --no-print-directory -j2 test-clients test-browser

# The tests of the Python package, then those of training with torch, which is a download of hundreds of megabytes.
test-clients: test-python
	@if [[ -n "$$SPARRING_TRAINERS" ]]; then $(MAKE) --no-print-directory test-trainers; fi

test-browser: check-cargo check-clippy check-node ## Test the dashboard in Chromium against real servers (after `make dashboard`)
	scripts/chromium
	scripts/nats
	scripts/nginx
	$(BUILD_TESTS)
	cd dashboard && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" npm run test:browser

# Downloads the packages of the tests, and runs the tests that need no binary.
test-prerequisites: check-python dashboard
	cd dashboard && npm run check && npm test
	scripts/openenv-venv
	scripts/python-venv
	scripts/chromium
	scripts/nginx
	scripts/nats
	@if [[ -n "$$SPARRING_TRAINERS" ]]; then scripts/sb3-venv; fi

test-python: check-cargo check-clippy check-python ## Test the Python package, with the checkers of Gymnasium and PettingZoo, ruff and mypy
	scripts/python-venv
	scripts/nats
	scripts/python-client --check
	$(BUILD_TESTS)
	cd python && ../target/python-venv/bin/ruff check . && ../target/python-venv/bin/ruff format --check . \
		&& ../target/python-venv/bin/mypy \
		&& SPARRING_BINARY="$(CURDIR)/target/debug/sparring" ../target/python-venv/bin/pytest --numprocesses 2 --dist loadfile

test-trainers: check-cargo check-clippy check-python ## Test training with Stable-Baselines3 and the built-in PPO (downloads torch)
	scripts/python-venv
	scripts/sb3-venv
	$(BUILD_TESTS)
	@# One thread per library: more threads than cores, together with the server's, slow each other down.
	cd python && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 \
		../target/sb3-venv/bin/pytest -o addopts= -o filterwarnings=default -p no:cacheprovider --durations=5 tests/trainers

test-heavy: export SPARRING_LONG_TESTS := 1
test-heavy: check-cargo check-clippy check-python ## Run the long forms of tests, and test RLlib, TRL, Stable-Baselines3 and ONNX with the newest torch, verifiers, loggers and the notebook (downloads about 8 GB; run by hand)
	scripts/python-venv
	scripts/heavy-venv
	scripts/verifiers-venv
	$(BUILD_TESTS)
	SQLX_OFFLINE=true SPARRING_BINARY="$(CURDIR)/target/debug/sparring" cargo test --workspace --locked
	cd python && for tests in trainers heavy; do SPARRING_BINARY="$(CURDIR)/target/debug/sparring" PYTHONPATH=. OMP_NUM_THREADS=1 \
		../target/heavy-venv/bin/pytest -o addopts= -o filterwarnings=default -p no:cacheprovider --durations=5 tests/$$tests \
		--ignore-glob='*/test_verifiers*.py' || exit 1; done
	@# verifiers has dependencies of its own, which do not fit those of RLlib and TRL.
	cd python && SPARRING_BINARY="$(CURDIR)/target/debug/sparring" ../target/verifiers-venv/bin/pytest -o addopts= \
		-o filterwarnings=default -p no:cacheprovider --durations=5 tests/heavy/test_verifiers.py tests/heavy/test_verifiers_commands.py

test-wheels: check-python ## Test both wheels on every Python at hand, without Rust (as root also on Debian's Pythons, about 300 MB of download; run by hand)
	scripts/test-wheels

container: dist ## Build the container image without a daemon or an image registry: target/container/sparring.tar (as root, with Debian's packages)
	scripts/container

test-container: container ## Test the container image with Podman: its entry point, a volume, SIGTERM (as root; run by hand)
	scripts/test-container

test-llm: check-cargo check-python ## Test the designer with a small language model on this machine: MODEL=FILE.gguf
	scripts/test-llm $(MODEL)

bench: check-cargo ## Run the benchmarks: measured value, goal and ratio (on an idle machine)
	cargo build --profile dist --locked -p cli -p bench
	cargo run --profile dist --locked -p bench

soak: check-cargo ## Kill a server under load for two hours (MINUTES=120), then measure 10 000 runs, 2 000 slow clients and 10 GiB
	cargo build --release --locked -p cli -p bench
	cargo run --release --locked -p bench -- crash runs slow-clients large-database --minutes $(or $(MINUTES),120)

update-check: check-cargo check-node ## List newer versions of the pinned Python packages, crates and npm packages
	scripts/update-check

bench-peers: check-cargo check-python ## Compare the speed with openenv-core's server and the public environment (KESSLER_ENV=PATH), or with BSK-RL (BSK=1)
	cargo build --profile dist --locked -p cli -p bench
	@if [ -n "$(BSK)" ]; then \
		$(MAKE) --no-print-directory wheel-environments && scripts/bsk-venv && \
		target/bsk-venv/bin/pip install --quiet --disable-pip-version-check --force-reinstall --no-deps \
			target/wheels/sparring-*.whl && PYTHONPATH=scripts PYTHONDONTWRITEBYTECODE=1 \
			target/bsk-venv/bin/python bench/bsk_peers.py --bench target/dist/bench; \
	else \
		scripts/openenv-venv && target/openenv-venv/bin/python bench/peers.py --sparring target/dist/sparring \
			--bench target/dist/bench --kessler-env "$(KESSLER_ENV)"; \
	fi

bench-python: wheel ## Measure stepping from Python, and the cost of a curriculum (KESSLER_ENV=PATH as for bench-peers)
	cargo build --profile dist --locked -p cli
	scripts/bench-venv
	target/bench-venv/bin/python bench/python.py --sparring target/dist/sparring --kessler-env "$(KESSLER_ENV)"

fuzz: export TARGET ?=
fuzz: export RUNS ?= 10000000
fuzz: export COVERAGE ?=
fuzz: check-cargo ## Fuzz a parser, or all: TARGET=json RUNS=10000000; with COVERAGE=1 under libFuzzer (installs cargo-fuzz)
	scripts/fuzz

test-otlp: check-cargo check-python ## Test that spans reach an OpenTelemetry collector (feature otlp)
	scripts/test-otlp

dist: check-cargo dashboard ## Build the binary to ship, target/dist/sparring, with its symbols in sparring.debug
	scripts/dist

fmt: check-cargo ## Format the Rust code
	cargo fmt --all

lint: check-cargo check-clippy check-style ## Check formatting, clippy with all features, style and import circles
	cargo fmt --all -- --check
	SQLX_OFFLINE=true cargo clippy --workspace --all-targets --all-features --locked -- -D warnings

deny: check-cargo ## Check dependencies: unused ones, bans, licences, sources (installs cargo-deny and cargo-machete)
	@command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	@command -v cargo-machete >/dev/null || cargo install --locked cargo-machete
	cargo deny check bans licenses sources
	cargo machete

sqlx: check-cargo ## Regenerate .sqlx after a change of SQL or migrations
	scripts/sqlx

check-style: check-python ## Check names, prose and layout (CONTRIBUTING.md), and import circles between files
	scripts/check-style --self-test
	scripts/check-style
	scripts/check-circles

check-cargo:
	@command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs, version 1.95 or newer." >&2; exit 2; }

check-clippy:
	@command -v clippy-driver >/dev/null || { echo "Clippy is missing: rustup component add clippy rustfmt" >&2; exit 2; }

check-node:
	@node -e '$(NODE_CHECK)' 2>/dev/null || { echo "Node is missing or too old: install Node 20.19 or newer with npm to build the dashboard." >&2; exit 2; }

check-python:
	@command -v python3 >/dev/null || { echo "Python 3 is missing: install python3 (3.10 or newer) to run the tests." >&2; exit 2; }
