//! `sparring play` against OpenEnv servers: episodes, output and faults. This file has the helpers of these tests.

mod episodes;
mod faults;
mod openenv_server;

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use system_tests::mock_llm::API_KEY;
use system_tests::sparring_binary;

/// Returns the command-line arguments for a model endpoint.
pub(crate) fn endpoint_args(uri: &str) -> String {
    format!("--api-base-url {uri}/v1 --model mock")
}

/// Exit code and output of a `sparring play` command.
#[derive(Debug)]
pub(crate) struct PlayOutput {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    pub(crate) transcript: Vec<Value>,
}

impl PlayOutput {
    /// Returns the lines of stdout that start with `prefix`.
    pub(crate) fn lines(&self, prefix: &str) -> Vec<&str> {
        self.stdout.lines().filter(|line| line.starts_with(prefix)).collect()
    }

    /// Returns the records of the transcript with this type.
    pub(crate) fn records(&self, kind: &str) -> Vec<&Value> {
        self.transcript.iter().filter(|record| record["type"] == kind).collect()
    }
}

/// Runs `sparring play` against a server, with the API key in the environment, and checks that no output has the key.
pub(crate) async fn play(env_url: &str, args: &str) -> PlayOutput {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("transcript.jsonl");
    let mut command = Command::new(sparring_binary());
    for name in ["API_BASE_URL", "MODEL_NAME", "API_KEY", "ENV_URL", "SPARRING_LOG"] {
        command.env_remove(name);
    }
    command.env("HF_TOKEN", API_KEY).args(["play", "--env-url", env_url, "--out"]).arg(&out);
    command.args(args.split_whitespace());
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    read_output(output, &out)
}

fn read_output(output: Output, out: &Path) -> PlayOutput {
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let transcript = std::fs::read_to_string(out).unwrap_or_default();
    let (stdout, stderr) = (text(output.stdout), text(output.stderr));
    for text in [&stdout, &stderr, &transcript] {
        assert!(!text.contains(API_KEY), "the output has the key: {text}");
    }
    let transcript = transcript.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    PlayOutput { code: output.status.code(), stdout, stderr, transcript }
}
