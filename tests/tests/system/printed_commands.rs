//! Every shell command that README and docs print is run as printed, or is listed with the reason why not.
//!
//! A page's commands run in order, in a folder of their own, beside a server on a free port. The server has a run `my-run` with
//! results, failures and a feed; for the page about evaluations it has three of them.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::json;
use system_tests::mock_llm::{HOLD_ACTION, chat_response};
use system_tests::{ServerProcess, sparring_binary, wait_until};
use wiremock::matchers::{method, path};
use wiremock::{Mock, MockServer};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Beginnings of lines that this test does not run, each with the reason.
const NOT_RUN: [(&str, &str); 34] = [
    ("make ", "builds; `make test` is the command that runs this test"),
    (". .venv/bin/activate", "python/tests/test_docs.py makes and uses the environment"),
    ("python examples/first_trainer.py", "python/tests/test_docs.py runs the trainer of the README"),
    ("python examples/sb3_ppo.py", "python/tests/trainers runs the example"),
    ("python examples/scanning_", "python/tests/trainers and python/tests/heavy run the examples"),
    ("python examples/grpo_in_process.py", "python/tests/heavy runs the example with a small model"),
    ("python examples/feed_nats.py", "tests/tests/system/feed_stream runs the example beside a NATS server"),
    ("torchrun ", "needs two GPUs"),
    ("python -m sparring.experiments", "python/tests/trainers runs the commands with small budgets"),
    ("pip install", "the wheels are on no package index; python/tests/test_docs.py compares the extras"),
    ("export PIP_FIND_LINKS", "a variable of pip"),
    ("cargo build --profile dist", "builds for minutes"),
    ("cargo run --profile dist", "measures for minutes; `make bench` runs it"),
    ("target/dist/bench ", "measures for minutes; a test of bench compares figures"),
    ("valgrind ", "needs Valgrind, and counts instructions for minutes"),
    ("sudo ", "needs root and systemd"),
    ("echo 'SPARRING_LLM_KEY=…' | sudo", "needs root"),
    ("docker ", "needs a container engine"),
    ("SPARRING_SNAPSHOTS=write ", "writes files of the repository; `make test-browser` compares them"),
    ("kubectl ", "needs a cluster; python/tests/test_deployments.py validates the manifests"),
    ("podman ", "needs a container engine; scripts/test-container runs one"),
    ("uv pip install", "python/tests/heavy installs the package"),
    ("vf-eval ", "python/tests/heavy runs the commands with a small model"),
    ("head$ ", "needs several machines; python/tests/heavy runs the example on one"),
    ("all$ ", "needs several machines"),
    ("other$ ", "needs several machines"),
    ("nats-server ", "tests/tests/system/remote_workers runs one in a temporary folder"),
    ("nginx ", "tests/tests/system/shards runs nginx with the configuration"),
    ("sparring serve --bind 10.0.0.", "tests/tests/system/shards runs both servers on free ports"),
    (
        "sparring token create ppo --role trainer --db ",
        "tests/tests/system/shards stores a token of another server",
    ),
    ("sparring serve --nats ", "tests/tests/system/remote_workers runs the command on a free port"),
    ("sparring worker --nats ", "tests/tests/system/remote_workers runs the command"),
    ("sparring workers", "tests/tests/system/remote_workers runs the command"),
    ("llama-server ", "needs a model; `make test-llm` runs one"),
];

/// Returns the pages with shell commands, relative to the repository.
fn pages() -> Vec<PathBuf> {
    let mut pages = vec![PathBuf::from("README.md"), PathBuf::from("CONTRIBUTING.md")];
    for folder in ["docs", "docs/guides", "docs/reference", "docs/worlds"] {
        for entry in fs::read_dir(Path::new(ROOT).join(folder)).unwrap() {
            let path = Path::new(folder).join(entry.unwrap().file_name());
            if path.extension().is_some_and(|extension| extension == "md") {
                pages.push(path);
            }
        }
    }
    pages.retain(|page| !commands(page).is_empty());
    pages.sort();
    pages
}

/// Returns the commands of a page. A line that ends with a backslash continues.
fn commands(page: &Path) -> Vec<String> {
    let text = fs::read_to_string(Path::new(ROOT).join(page)).unwrap();
    let mut commands = Vec::new();
    let mut rest = text.as_str();
    while let Some((_, block_and_rest)) = rest.split_once("```sh\n") {
        let (block, after) = block_and_rest.split_once("```").unwrap();
        rest = after;
        let joined = block.replace("\\\n", " ");
        commands.extend(joined.lines().map(str::trim).filter(is_command).map(str::to_owned));
    }
    commands
}

fn is_command(line: &&str) -> bool {
    !line.is_empty() && !line.starts_with('#')
}

fn is_run(command: &str) -> bool {
    !NOT_RUN.iter().any(|(beginning, _)| command.starts_with(beginning))
}

#[test]
fn commands_that_are_not_run_are_printed_somewhere() {
    let all: Vec<String> = pages().iter().flat_map(|page| commands(page)).collect();
    for (beginning, reason) in NOT_RUN {
        assert!(all.iter().any(|command| command.starts_with(beginning)), "{beginning}: {reason}");
    }
    let tested: BTreeSet<&str> = TESTED.into_iter().collect();
    let with_commands: BTreeSet<String> = pages()
        .iter()
        .filter(|page| commands(page).iter().any(|command| is_run(command)))
        .map(|page| page.display().to_string())
        .collect();
    assert_eq!(with_commands.iter().map(String::as_str).collect::<BTreeSet<_>>(), tested);
}

macro_rules! pages_run {
    ($($test:ident: $page:literal,)*) => {
        /// Pages whose commands a test runs.
        const TESTED: [&str; [$($page),*].len()] = [$($page),*];
        $(
            #[tokio::test(flavor = "multi_thread")]
            async fn $test() {
                run_page($page).await;
            }
        )*
    };
}

pages_run! {
    readme_commands_run: "README.md",
    first_run_commands_run: "docs/guides/first-run.md",
    choose_a_curriculum_commands_run: "docs/guides/choose-a-curriculum.md",
    evaluate_commands_run: "docs/guides/evaluate.md",
    export_onnx_commands_run: "docs/guides/export-onnx.md",
    language_models_commands_run: "docs/guides/language-models.md",
    operations_commands_run: "docs/guides/operations.md",
    train_trl_commands_run: "docs/guides/train-trl.md",
    train_verifiers_commands_run: "docs/guides/train-verifiers.md",
    data_commands_run: "docs/reference/data.md",
    design_language_commands_run: "docs/reference/design-language.md",
    design_language_docking_commands_run: "docs/reference/design-language-docking.md",
    design_language_tasking_commands_run: "docs/reference/design-language-tasking.md",
    evidence_commands_run: "docs/reference/evidence.md",
    openenv_commands_run: "docs/reference/openenv.md",
    strategies_commands_run: "docs/reference/strategies.md",
    trajectories_commands_run: "docs/reference/trajectories.md",
}

/// Runs the commands of a page in one shell, so that variables last from one command to the next.
async fn run_page(page: &'static str) {
    let llm = MockServer::start().await;
    let respond = Mock::given(method("POST")).and(path("/v1/chat/completions"));
    respond.respond_with(chat_response(HOLD_ACTION)).mount(&llm).await;
    let folder = tempfile::tempdir().unwrap();
    let server = start_server(folder.path(), &llm.uri()).await;
    if page == "docs/guides/evaluate.md" {
        run_evaluations(&server).await;
    }
    let mut script = "set -euo pipefail\n".to_owned();
    if page == "docs/guides/operations.md" {
        // The page assumes a first token, which an administrator created with sudo.
        script += "TOKEN=$(sparring token create me --role admin)\n";
    }
    if page == "docs/guides/first-run.md" {
        script += "sparring demo --exit --episodes 192\n";
    }
    for command in commands(Path::new(page)).iter().filter(|command| is_run(command)) {
        script += &format!("echo 'printed: {}' >&2\n", command.replace('\'', "'\\''"));
        script += &command
            .replace("http://127.0.0.1:8700", &format!("http://{}", server.address()))
            .replace("http://localhost:8000", &format!("http://{}", server.address()))
            .replace("http://127.0.0.1:8080", &llm.uri())
            .replace("/var/lib/sparring/", &format!("{}/", folder.path().display()))
            .replace("/backups/", &format!("{}/backups/", folder.path().display()));
        script.push('\n');
    }
    script += "wait\n";
    write_programs(folder.path());
    let search_path = format!("{}/bin:{}", folder.path().display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("bash");
    shell.args(["-c", &script]).current_dir(folder.path()).env("PATH", search_path).stdin(Stdio::null());
    for variable in ["SPARRING_URL", "SPARRING_DB", "SPARRING_TOKEN", "SPARRING_LOG", "SPARRING_LLM_KEY"] {
        shell.env_remove(variable);
    }
    let out = tokio::task::spawn_blocking(move || shell.output().unwrap()).await.unwrap();
    let [stdout, stderr] = [&out.stdout, &out.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(out.status.success(), "{page}: {stdout}\n{stderr}");
}

/// Starts a server with a run `my-run`, whose feed is full.
async fn start_server(folder: &Path, llm: &str) -> ServerProcess {
    let policies = write_policies(folder);
    let options =
        ["--policy-url", &format!("{llm}/v1"), "--policy-model", "my-model", "--policy-folder", &policies];
    let server = ServerProcess::start_with_options(&folder.join("sparring.sqlite3"), &options);
    let api = server.api();
    let run = json!({"strategy": "ladder", "id": "my-run", "tasks": ["kessler/survival"], "group_size": 2, "placement": false});
    let _ = api.post("/v1/runs", run).await.expect(201);
    let policy = json!({"policy": "hold", "max_unacknowledged_groups": 32});
    let _ = api.send_json("PUT", "/v1/runs/my-run/policy", policy).await.expect(200);
    wait_until("the feed is full and failures are known", async || {
        let policy = api.get("/v1/runs/my-run/policy").await.expect(200);
        let failures = api.get("/v1/runs/my-run/failures?task=kessler/survival").await.expect(200);
        policy["feed"]["full"] == true
            && failures["failures"].as_array().is_some_and(|failures| !failures.is_empty())
    })
    .await;
    server
}

/// Runs three evaluations to their end.
async fn run_evaluations(server: &ServerProcess) {
    let api = server.api();
    for _ in 0..3 {
        let evaluation = json!({"policy": "hold", "suite": "docking-heldout-v1"});
        let _ = api.post("/v1/evaluations", evaluation).await.expect(201);
    }
    wait_until("the evaluations are complete", async || {
        let evaluations = api.get("/v1/evaluations").await.expect(200);
        evaluations["evaluations"].as_array().unwrap().iter().all(|row| row["state"] == "complete")
    })
    .await;
}

/// Writes the policy files that the documentation names, and returns the folder of the server's files.
fn write_policies(folder: &Path) -> String {
    let policies = folder.join("policies");
    fs::create_dir(&policies).unwrap();
    let model = Path::new(ROOT).join("tests/fixtures/onnx/tracks_continuous.onnx");
    for file in [folder.join("model.onnx"), folder.join("policy.onnx"), policies.join("model.onnx")] {
        fs::copy(&model, file).unwrap();
    }
    policies.display().to_string()
}

/// Writes programs that replace those of the search path: `sparring serve` stops when it serves, the demo is short, curl fails on a problem, and the
/// date is that of the documentation.
fn write_programs(folder: &Path) {
    let binary = sparring_binary().display();
    let programs = [
        (
            "sparring",
            format!(
                r#"if [[ "${{1:-}} ${{2:-}}" == "demo --json" ]]; then exec {binary} "$@" --episodes 192; fi
if [[ "${{1:-}}" != serve ]]; then exec {binary} "$@"; fi
export SPARRING_BIND=127.0.0.1:0
[[ " $* " == *" --db "* ]] || export SPARRING_DB="$(mktemp -d)/serve.sqlite3"
coproc server {{ exec {binary} "$@"; }}
pid=$server_PID
read -r line <&"${{server[0]}}"
[[ "$line" == "Sparring serves at http"*"://127.0.0.1:"* ]]
kill -INT "$pid"
wait "$pid" || [[ $? == 130 ]]"#
            ),
        ),
        ("curl", "PATH=\"${PATH#*:}\" exec curl --fail-with-body --silent --show-error \"$@\"".to_owned()),
        ("date", "echo 2026-11-22".to_owned()),
    ];
    let certificate = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    fs::write(folder.join("fullchain.pem"), certificate.cert.pem()).unwrap();
    fs::write(folder.join("key.pem"), certificate.signing_key.serialize_pem()).unwrap();
    let bin = folder.join("bin");
    fs::create_dir(&bin).unwrap();
    fs::create_dir(folder.join("backups")).unwrap();
    for (name, body) in programs {
        let path = bin.join(name);
        fs::write(&path, format!("#!/usr/bin/env bash\nset -euo pipefail\n{body}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }
}
