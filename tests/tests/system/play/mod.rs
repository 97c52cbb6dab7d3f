//! What the tests of `sparring play` share: an OpenEnv server, a model's endpoint, and the command itself.

mod env;
mod faults;
mod flown;

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use system_tests::binary;
use system_tests::model::KEY;

/// The options that name a model's endpoint.
pub(crate) fn at(uri: &str) -> String {
    format!("--api-base-url {uri}/v1 --model mock")
}

/// How the command ended.
#[derive(Debug)]
pub(crate) struct Played {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    pub(crate) transcript: Vec<Value>,
}

impl Played {
    /// The lines of stdout that begin so.
    pub(crate) fn lines(&self, begin: &str) -> Vec<&str> {
        self.stdout.lines().filter(|line| line.starts_with(begin)).collect()
    }

    /// The records of the transcript of this type.
    pub(crate) fn records(&self, kind: &str) -> Vec<&Value> {
        self.transcript.iter().filter(|record| record["type"] == kind).collect()
    }
}

/// Runs `sparring play` on a server. The key is in the environment and must be nowhere in what comes of it.
pub(crate) async fn play(env: &str, more: &str) -> Played {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("transcript.jsonl");
    let mut command = Command::new(binary());
    for name in ["API_BASE_URL", "MODEL_NAME", "API_KEY", "ENV_URL", "SPARRING_LOG"] {
        command.env_remove(name);
    }
    command.env("HF_TOKEN", KEY).args(["play", "--env-url", env, "--out"]).arg(&out);
    command.args(more.split_whitespace());
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    told(output, &out)
}

fn told(output: Output, out: &Path) -> Played {
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let transcript = std::fs::read_to_string(out).unwrap_or_default();
    let (stdout, stderr) = (text(output.stdout), text(output.stderr));
    for told in [&stdout, &stderr, &transcript] {
        assert!(!told.contains(KEY), "the key is told: {told}");
    }
    let transcript = transcript.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    Played { code: output.status.code(), stdout, stderr, transcript }
}
