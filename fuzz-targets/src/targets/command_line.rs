//! Texts that the command line reads: its arguments, its configuration file, files of actions, and answers of servers.

use std::sync::LazyLock;

use cli::fuzzing::{bind_address, config_file, token_lifetime};
use commands::fuzzing::{actions_file, arguments, events, server_message, server_urls};
use commands::{llm_args, names, options};
use env_core::{ActionLog, Recipe, Scenario, Seed};
use job_queue::nats::NatsUrl;
use llm_policy::judging::parse_judge;
use serde_json::json;

use crate::target::{Target, json_seeds, seeds_of, with_json, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("arguments", all_arguments, argument_seeds),
    Target::new("bind", bind, bind_seeds),
    Target::new("server_address", server_address, address_seeds),
    Target::new("nats_url", nats_url, nats_url_seeds),
    Target::new("config", config, config_seeds),
    Target::new("event_stream", event_stream, event_seeds),
    Target::new("server_message", message, message_seeds),
    Target::new("actions_file", actions, action_seeds),
];

/// Every argument keeps its documented range, and an option is written as it was read.
fn all_arguments(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let option = options::parse(text);
        if let Ok(option) = &option {
            assert_eq!(option.to_string(), text, "the written option differs");
        }
        let temperature = llm_args::parse_temperature(text);
        if let Ok(temperature) = temperature {
            assert!((0.0..=5.0).contains(&temperature), "{temperature}");
        }
        let lifetime = token_lifetime(text);
        if let Ok(Some(seconds)) = lifetime {
            assert!(seconds >= 0, "{seconds}");
        }
        let accepted = [
            option.is_ok(),
            temperature.is_ok(),
            lifetime.is_ok(),
            names::parse_task(text).is_ok(),
            parse_judge(text).is_ok(),
            arguments(text) > 0,
        ];
        accepted.contains(&true)
    })
}

/// The text of an address is an address.
fn bind(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok(address) = bind_address(text) else { return false };
        let again = bind_address(&address).expect("the written address is valid");
        assert_eq!(bind_address(&again).as_ref(), Ok(&again), "the written address differs");
        true
    })
}

/// Both URLs of a server lead to the same URLs, and a socket's path ends in `/ws`.
fn server_address(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok((base, socket)) = server_urls(text) else { return false };
        assert_eq!(server_urls(&base), Ok((base.clone(), socket.clone())), "{text:?}");
        assert!(base.starts_with("http") && socket.starts_with("ws") && socket.ends_with("/ws"), "{text:?}");
        assert!(!socket.contains(['?', '#']), "{socket:?} has a query or a fragment");
        true
    })
}

/// The shown URLs of NATS servers have no user, lead to the same servers, and are shown in the same way.
fn nats_url(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let Ok(url) = text.parse::<NatsUrl>() else { return false };
        let shown = url.to_string();
        assert!(!shown.contains('@'), "{shown:?} has a user");
        assert_eq!(shown.parse::<NatsUrl>().map(|again| again.to_string()), Ok(shown), "{text:?}");
        true
    })
}

fn nats_url_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "nats://10.0.0.5:4222",
        "tls://user:secret@nats.example.com",
        "host",
        "nats://[::1]:1, tls://token@b",
    ])
}

/// An error of a configuration file names the file.
fn config(bytes: &[u8]) -> bool {
    with_text(bytes, |text| match config_file(text) {
        Ok(()) => true,
        Err(error) => {
            assert!(error.starts_with("sparring.toml"), "{error}");
            false
        }
    })
}

/// A stream has the same events whatever its chunks are.
fn event_stream(bytes: &[u8]) -> bool {
    let whole = events(std::iter::once(bytes));
    assert_eq!(events(bytes.chunks(3)), whole, "the chunks change the events");
    !whole.is_empty()
}

/// A message has an observation, or an error without control characters.
fn message(bytes: &[u8]) -> bool {
    with_text(bytes, |text| match server_message(text) {
        Ok(step) => {
            assert!(step.observation.is_object());
            true
        }
        Err(error) => {
            assert!(!error.chars().any(char::is_control), "{error:?}");
            false
        }
    })
}

/// A log of a file is the same after it is encoded and decoded.
fn actions(bytes: &[u8]) -> bool {
    static SCENARIO: LazyLock<Scenario> = LazyLock::new(|| {
        let task = env_core::task("kessler/survival").expect("the task exists");
        Scenario::new(Recipe::new(task).expect("a task has defaults"), Seed::new(7).expect("7 is a seed"))
    });
    with_json(bytes, |value| {
        let Ok(log) = actions_file(&SCENARIO, value) else { return false };
        assert_eq!(ActionLog::decode(&log.encode()).as_ref(), Ok(&log), "the decoded log differs");
        true
    })
}

fn argument_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "contact=swept",
        "kessler:gravity=j2",
        "kessler/survival:contact=swept",
        "0.7",
        "90d",
        "2 weeks",
        "12h30m",
        "never",
        "P1DT2H",
        "survival",
        "docking/single",
        "llm",
        "true",
        "info,hyper=debug",
        "fuel=20",
        "max_staleness=2",
        "suite-v1",
        "60",
    ])
}

fn bind_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "127.0.0.1:8700",
        "[::1]:80",
        "::1",
        "[fe80::1]",
        ":0",
        "8700",
        "localhost",
        "localhost:8700",
        "10.0.0.1",
    ])
}

fn address_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "http://127.0.0.1:8700",
        "wss://example.org/sparring/",
        "ws://[::1]:80/a/b",
        "https://host:1/x%3Fy@z",
    ])
}

fn config_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "db = \"training.sqlite3\"\n\n[serve]\nbind = \"0.0.0.0:8700\"\nport = 80\n\n[token.create]\nexpires = \"30d\"\n",
        "a.b = [1, 2.5, true, 1979-05-27T07:32:00Z]\nc = '''x\ny'''\nd = {e = \"\\u00e9\", f = 0xff}\n[[g]]\nh = inf\n",
    ])
}

fn event_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "id: 7\n\n: alive\n\nid: 8\nevent: move\ndata: {\"to\": 3}\n\nevent: gap\ndata: {\ndata: }\n\n",
        "data:1\n\ndata\ndata: \"é\"\n\nid\nretry: 5\ndata: null\n\n",
    ])
}

fn message_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!({"type": "observation", "data": {"observation": {"satellites": []}, "reward": 0.5, "done": false}}),
        json!({"type": "observation", "data": {"observation": {}, "reward": null}}),
    ])
}

fn action_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!([[], [[0, 0.1, -0.2]]]),
        json!({"steps": [[], [[0, 0.1, -0.2]]], "precision": "f32", "stopped": "too_long"}),
    ])
}
