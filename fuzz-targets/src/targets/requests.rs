//! Requests to the server: frames and messages of sessions, columns, results, resets, JSON-RPC, words of queries, and bodies.

use std::cell::RefCell;
use std::io::Write;

use env_core::seed::MAX_USER_SEED;
use flate2::Compression;
use flate2::write::GzEncoder;
use orchestrator::http::fuzzing::{
    BodyFormat, Rejection, columns, cursor, event_kinds, receive, reset_request, results, rpc_method,
    session_message, time,
};
use orchestrator::sessions::vector::frame::{FRAME_VERSION, FrameCommand, FrameKind, FrameLayout, MAGIC};
use serde_json::{Value, json};
use strict_input::{InputLimits, ParsedInput, parse_json};

use crate::target::{Target, json_seeds, seeds_of, with_json, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("frame", frame, frame_seeds),
    Target::new("session_message", message, message_seeds),
    Target::new("columns_json", columns_json, column_seeds),
    Target::new("columns_messagepack", columns_messagepack, packed_column_seeds),
    Target::new("results", results_of_both, result_seeds),
    Target::new("reset_request", reset, reset_seeds),
    Target::new("rpc", rpc, rpc_seeds),
    Target::new("query_words", query_words, word_seeds),
    Target::new("body", body, body_seeds),
];

/// Layout of the frames in the tests.
const LAYOUT: FrameLayout =
    FrameLayout { envs: 3, agents: 2, action: 2, observation: 5, is_leased: true, has_finals: true };

/// A valid frame has exactly the bytes of its command.
fn frame(bytes: &[u8]) -> bool {
    let Ok(frame) = LAYOUT.parse(bytes) else { return false };
    let (length, data) = match frame.command {
        FrameCommand::Step(data) => {
            (LAYOUT.actions_bytes(), data.len() == LAYOUT.envs * LAYOUT.agents * LAYOUT.action * 4)
        }
        FrameCommand::Reset(data) => (LAYOUT.reset_bytes(), data.len() == LAYOUT.envs),
    };
    assert!(data && bytes.len() == length, "{frame:?}");
    true
}

/// A rejection is JSON of bounded length.
fn message(bytes: &[u8]) -> bool {
    with_text(bytes, |text| match session_message(text) {
        Ok(()) => true,
        Err(error) => {
            assert!(error.len() < 16 * 1024, "the error has {} bytes", error.len());
            serde_json::from_slice::<Value>(&error).expect("an error is JSON");
            false
        }
    })
}

/// Panics unless a rejection blames the client, in a message of bounded length.
fn assert_blames_client(rejection: &Rejection) {
    assert!((400..500).contains(&rejection.status), "{rejection:?}");
    assert!(rejection.message.len() < 16 * 1024, "the message has {} bytes", rejection.message.len());
}

/// Columns in JSON are what the strict parser of other requests accepts: an object without duplicate keys.
fn columns_json(bytes: &[u8]) -> bool {
    match columns(BodyFormat::Json, bytes) {
        Ok(columns) => {
            let limits = InputLimits { values: 1_000_000, keys: 1000 };
            let parsed = parse_json(bytes, limits).and_then(ParsedInput::finite);
            let value = parsed.expect("the strict parser accepts columns");
            assert!(value.is_object(), "columns are an object");
            let scores = value["score"].as_array().map_or(0, Vec::len);
            assert_eq!(columns.scores.len(), scores);
            assert!(columns.scores.iter().all(|score| score.is_finite()));
            true
        }
        Err(rejection) => {
            assert_blames_client(&rejection);
            false
        }
    }
}

/// Columns in MessagePack may be packed bytes.
fn columns_messagepack(bytes: &[u8]) -> bool {
    columns(BodyFormat::MessagePack, bytes).map_err(|rejection| assert_blames_client(&rejection)).is_ok()
}

/// Results have an episode each, or the whole body is rejected.
fn results_of_both(bytes: &[u8]) -> bool {
    let read = |format| match results(format, bytes) {
        Ok(_) => true,
        Err(rejection) => {
            assert_blames_client(&rejection);
            false
        }
    };
    let json = read(BodyFormat::Json);
    read(BodyFormat::MessagePack) || json
}

/// The seed of a reset is a user seed.
fn reset(bytes: &[u8]) -> bool {
    with_json(bytes, |value| match reset_request(&value) {
        Ok(request) => {
            assert!(request.seed.is_none_or(|seed| seed <= MAX_USER_SEED));
            true
        }
        Err(errors) => {
            assert!(errors.iter().all(|error| error["loc"].is_array()));
            false
        }
    })
}

/// A method of a request is the text in it.
fn rpc(bytes: &[u8]) -> bool {
    with_json(bytes, |value| {
        let Ok(method) = rpc_method(&value) else { return false };
        assert_eq!(value["method"], json!(method));
        true
    })
}

/// Cursors, lists of kinds and times. A cursor that is written again is parsed to itself.
fn query_words(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let cursor_text = cursor(text);
        if let Ok(written) = &cursor_text {
            assert_eq!(cursor(written).as_ref(), Ok(written), "the written cursor differs");
        }
        let kinds = event_kinds(text);
        let at = time(text);
        for rejection in
            [kinds.as_ref().err(), at.as_ref().err(), cursor_text.as_ref().err()].into_iter().flatten()
        {
            assert_blames_client(rejection);
        }
        cursor_text.is_ok() || kinds.is_ok() || at.is_ok()
    })
}

/// A body is accepted, or the client is blamed. The first byte chooses the content type and whether the body is compressed.
fn body(bytes: &[u8]) -> bool {
    thread_local! {
        static RUNTIME: RefCell<tokio::runtime::Runtime> =
            RefCell::new(tokio::runtime::Builder::new_current_thread().enable_time().build().expect("a runtime starts"));
    }
    let Some((flags, bytes)) = bytes.split_first() else { return false };
    let content_type = ["application/json", "application/msgpack", "a/b+json; charset=x", "text/plain"]
        [usize::from(flags & 3)];
    let received =
        RUNTIME.with_borrow(|runtime| runtime.block_on(receive(content_type, flags & 4 > 0, bytes)));
    received.map_err(|status| assert!((400..500).contains(&status), "status {status}")).is_ok()
}

fn frame_seeds() -> Vec<Vec<u8>> {
    let frame = |kind: FrameKind, length: usize| {
        let mut bytes =
            [&MAGIC[..], &FRAME_VERSION.to_le_bytes(), &(kind as u16).to_le_bytes(), &7_u32.to_le_bytes()]
                .concat();
        bytes.extend((LAYOUT.envs as u32).to_le_bytes());
        bytes.resize(length, 1);
        bytes
    };
    vec![frame(FrameKind::Actions, LAYOUT.actions_bytes()), frame(FrameKind::Reset, LAYOUT.reset_bytes())]
}

fn message_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!({"type": "open", "version": 2, "seed": 1, "task": "kessler/survival", "params": {"debris": 3},
            "physics": {"contact": "swept"}}),
        json!({"type": "open", "version": 2, "id": 3, "scenario": {"task": "docking/single", "seed": 4}}),
        json!({"type": "open", "run": "run", "lease_id": "1-aaaaaa", "group_id": "g", "group_size": 2, "policy_version": 0,
            "episode_id": "ep_1-aaaaaa_0"}),
        json!({"type": "open", "seed": 1, "vector": {"envs": 2, "autoreset": "next_step", "observe": "tracks", "threats": 4,
            "look_ahead": 9, "task": "survival"}}),
        json!({"type": "open", "vector": {"envs": 64, "autoreset": "disabled", "observe": "all", "bodies": 20}}),
        json!({"type": "step", "id": 1, "action": {"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]}}),
    ])
}

fn column_values() -> [Value; 2] {
    [
        json!({"policy_version": 1, "score": [0.5, -0.25, 1], "failed": [0, 1, 0], "steps": [50, 60, 0]}),
        json!({"score": [1e-3], "failed": null}),
    ]
}

fn column_seeds() -> Vec<Vec<u8>> {
    json_seeds(column_values())
}

fn packed_column_seeds() -> Vec<Vec<u8>> {
    let packed = |value: &Value| rmp_serde::to_vec(value).expect("a value has a MessagePack form");
    let mut seeds: Vec<Vec<u8>> = column_values().iter().map(packed).collect();
    // {"score": two numbers in eight bytes, "steps": two in eight bytes, "failed": two in two bytes}
    let mut bytes = vec![0x83];
    for (name, column) in [
        ("score", &[0_u8, 0, 0, 63, 0, 0, 128, 63][..]),
        ("steps", &[1, 0, 0, 0, 2, 0, 0, 0]),
        ("failed", &[0, 1]),
    ] {
        bytes.push(0xa0 | name.len() as u8);
        bytes.extend(name.as_bytes());
        bytes.extend([0xc4, column.len() as u8]);
        bytes.extend(column);
    }
    seeds.push(bytes);
    seeds
}

fn result_seeds() -> Vec<Vec<u8>> {
    let result = json!({"episode": "ep_1-aaaaaa_0", "status": "finished", "policy_version": 1,
        "metrics": {"temperature": 0.5, "tokens_in": 3, "truncated": false},
        "actions": {"steps": [[], [[0, 0.1, -0.2]]], "precision": "f32", "stopped": "too_late"}});
    let failed = json!({"episode": "ep_1-aaaaaa_1", "status": "failed", "reason": "out of memory"});
    let body = json!({"policy_version": 2, "results": [result, failed, {"episode": "x"}]});
    let mut seeds = json_seeds([body.clone(), json!({"results": []})]);
    seeds.push(rmp_serde::to_vec(&body).expect("a value has a MessagePack form"));
    seeds
}

fn reset_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!({"seed": "1_0", "episode_id": "x", "task": "survival", "params": {"debris": "3"}, "physics": {"contact": "swept"}}),
        json!({"task": 1, "run": "run", "lease_id": "1-aaaaaa", "group_id": "g", "group_size": 2.0, "policy_version": true}),
        json!({"scenario": {"task": "kessler/survival", "seed": 4}, "seed": null}),
    ])
}

fn rpc_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "burn", "arguments": {"burns": []}}}),
        json!({"jsonrpc": "2.0", "id": "a", "method": "openenv/session/create", "params": null}),
    ])
}

fn word_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "50.run-a",
        "-1.",
        "9223372036854775807.a.b",
        "move, warning",
        "run",
        "2026-01-31T12:00:00Z",
        "2026-01-31T12:00:00.123456789+05:30",
        "2026-01-31 12:00:00-00:00",
    ])
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut writer = GzEncoder::new(Vec::new(), Compression::default());
    writer.write_all(content).expect("memory can be written");
    writer.finish().expect("memory can be written")
}

fn body_seeds() -> Vec<Vec<u8>> {
    let json = br#"{"a": [1, 2.5, "x"], "b": null}"#;
    let packed = rmp_serde::to_vec(&json!({"a": [1, 2.5, "x"]})).expect("a value has a MessagePack form");
    let flagged = |flags: u8, content: &[u8]| [&[flags][..], content].concat();
    vec![
        flagged(0, json),
        flagged(1, &packed),
        flagged(2, b"\xef\xbb\xbf[1]"),
        flagged(4, &gzip(json)),
        flagged(4, &[gzip(&json[..9]), gzip(&json[9..])].concat()),
        flagged(5, &gzip(&packed)),
    ]
}
