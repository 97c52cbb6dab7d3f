//! `sparring mcp`: the Model Context Protocol on stdin and stdout, for agents that start their tools as programs.
//!
//! Each line of the input is a message, which goes to `POST /mcp` of a server; the crate `cli` starts one if none is named. All
//! messages belong to one session with one episode.

use std::io::{BufRead, Write};

use anyhow::Context;
use clap::ArgMatches;
use clap::parser::ValueSource;
use env_core::{SEED_REQUIREMENT, Seed};
use serde_json::{Map, Value, json};
use tokio::sync::mpsc;

use super::api::{ApiClient, CaArgs};
use super::interrupt::StopSignal;
use super::names;

/// Path of the protocol.
const PATH: &str = "/mcp";
/// Header that names the session of a request.
const SESSION_HEADER: &str = "mcp-session-id";
/// Number of messages that are read ahead.
const MAX_READ_AHEAD: usize = 16;

/// Serve the tools of an episode to an agent over stdin and stdout (Model Context Protocol).
///
/// Agents for desktops start this program as an MCP server. The agent reads the telemetry, fires thrusters and lets time pass
/// until the episode is over; the process has one episode, which ends with the input, Ctrl-C or SIGTERM. Without --url the
/// episode runs in this process; with --url it runs on a server, and with --run it belongs to the curriculum of a run, which
/// receives the outcome.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Example of an agent's configuration:
  {\"mcpServers\": {\"sparring\": {
    \"command\": \"sparring\", \"args\": [\"mcp\", \"--task\", \"rendezvous\"]}}}")]
pub struct Args {
    /// Base URL of a running server, such as http://127.0.0.1:8700; SPARRING_TOKEN has the token [default: run the episode here]
    #[arg(long, value_name = "URL")]
    pub url: Option<String>,
    /// File of certificate authorities for an https URL.
    #[command(flatten)]
    pub ca: CaArgs,
    /// Task, such as survival or docking/single [default: survival]
    #[arg(long, value_name = "TASK", value_parser = names::parse_task)]
    task: Option<String>,
    /// Seed of the scenario, from 0 to 2^51 − 1 [default: random]
    #[arg(long, value_name = "SEED", value_parser = parse_seed)]
    seed: Option<u64>,
    /// Run of the server at --url whose curriculum proposes the scenario and receives the outcome; it excludes --task and --seed
    #[arg(long, value_name = "RUN", conflicts_with_all = ["task", "seed"])]
    run: Option<String>,
}

fn parse_seed(text: &str) -> Result<u64, String> {
    let seed = text.parse().map_err(|_| SEED_REQUIREMENT.to_owned())?;
    Seed::user(seed).map(|_| seed).map_err(|error| error.reason())
}

impl Args {
    /// Ignores a run of the configuration file beside a task or a seed of the command line.
    pub fn apply_precedence(&mut self, matches: &ArgMatches) {
        let is_on_line = |flag: &str| matches.value_source(flag) == Some(ValueSource::CommandLine);
        if (is_on_line("task") || is_on_line("seed")) && !is_on_line("run") {
            self.run = None;
        }
    }

    /// Checks that a run has the URL of its server, which can be in the configuration file.
    ///
    /// # Errors
    /// Returns an error if the URL is missing.
    pub fn check(&self) -> anyhow::Result<()> {
        match (&self.run, &self.url) {
            (Some(run), None) => anyhow::bail!("--run {run} needs --url URL"),
            _ => Ok(()),
        }
    }

    /// Returns the fields of the reset that begins the episode.
    fn reset_fields(&self) -> Value {
        let mut fields = Map::new();
        if let Some(run) = &self.run {
            fields.insert("run".to_owned(), json!(run));
            return Value::Object(fields);
        }
        fields.insert("task".to_owned(), json!(self.task.as_deref().unwrap_or("survival")));
        if let Some(seed) = self.seed {
            fields.insert("seed".to_owned(), json!(seed));
        }
        Value::Object(fields)
    }
}

/// Answers the messages of stdin on stdout until the end of the input, Ctrl-C or SIGTERM.
///
/// # Errors
/// Returns an error if the server cannot be reached or rejects the episode, or if stdout cannot be written.
pub async fn serve(args: &Args, api: &ApiClient) -> anyhow::Result<()> {
    let (lines, mut received) = mpsc::channel(MAX_READ_AHEAD);
    // A thread of its own: a read from stdin cannot be cancelled, and must not delay the end of the program.
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().split(b'\n').map_while(Result::ok) {
            if lines.blocking_send(line).is_err() {
                return;
            }
        }
    });
    let mut stop_signal = StopSignal::install()?;
    let session = open_session(args, api).await?;
    loop {
        let line = tokio::select! {
            line = received.recv() => line,
            signal = stop_signal.received() => signal.map(|_| None)?,
        };
        let Some(line) = line else { break };
        let Some(answer) = answer(api, &session, &line).await else { continue };
        let mut out = std::io::stdout().lock();
        serde_json::to_writer(&mut out, &answer)?;
        out.write_all(b"\n").and_then(|()| out.flush()).context("stdout cannot be written")?;
    }
    let close = request("openenv/session/close", &json!({"session_id": session}));
    let _: Value = api.post(PATH, &close).await?;
    Ok(())
}

/// Opens a session and begins its episode; returns the id of the session.
async fn open_session(args: &Args, api: &ApiClient) -> anyhow::Result<String> {
    let created: Value = api.post(PATH, &request("openenv/session/create", &args.reset_fields())).await?;
    match created.pointer("/result/session_id").and_then(Value::as_str) {
        Some(session) => Ok(session.to_owned()),
        None => {
            let reason = created.pointer("/error/message").and_then(Value::as_str);
            anyhow::bail!("the episode cannot begin: {}", reason.unwrap_or("the server has no session"))
        }
    }
}

fn request(method: &str, params: &Value) -> Value {
    json!({"jsonrpc": "2.0", "id": 0, "method": method, "params": params})
}

/// Returns the answer to one line; `None` for an empty line and a message that expects none.
async fn answer(api: &ApiClient, session: &str, line: &[u8]) -> Option<Value> {
    if line.iter().all(u8::is_ascii_whitespace) {
        return None;
    }
    let message: Value = match serde_json::from_slice(line) {
        Ok(message) => message,
        Err(error) => return Some(error_response(&Value::Null, -32700, &format!("Parse error: {error}"))),
    };
    // Notifications have no effect on the server, and it sends no requests that a response could answer.
    let is_request = message.get("method").is_some() && message.get("id").is_some();
    if message.is_object() && !is_request {
        return None;
    }
    let id = message.get("id").cloned().unwrap_or_default();
    let sent = api.post_with_header(PATH, SESSION_HEADER, session, &message).await;
    Some(sent.unwrap_or_else(|error| error_response(&id, -32000, &format!("{error:#}"))))
}

fn error_response(id: &Value, code: i64, message: &str) -> Value {
    json!({"jsonrpc": "2.0", "id": id, "error": {"code": code, "message": message}})
}
