//! Ids, words and blobs of the database.

use std::fmt::{Debug, Display};
use std::str::FromStr;
use std::sync::LazyLock;

use env_core::log::{ActionLog, Precision};
use env_core::{Bracket, EpisodeOutcome};
use orchestrator::results::columns::table::{self, Columns};
use orchestrator::rollouts::packed_group;
use orchestrator::tokens::{Token, redact};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;
use store::compacted_leases::CompactedLease;
use store::fuzzing::{
    PackedLeases, pack_leases, pack_log, pack_outcomes, unpack_leases, unpack_log, unpack_outcomes,
};
use store::ids::{DesignRequestId, EpisodeId, EvaluationId, LayoutId, LeaseId, RunId};
use store::run_tags::RunTag;

use crate::target::{Target, seeds_of, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("ids", ids, id_seeds),
    Target::new("words", words, word_seeds),
    Target::new("token", token, token_seeds),
    Target::new("stored_log", stored_log, stored_log_seeds),
    Target::new("stored_bracket", stored_bracket, bracket_seeds),
    Target::new("compacted_leases", compacted_leases, compacted_seeds),
    Target::new("stored_columns", stored_columns, column_seeds),
    Target::new("stored_group", stored_group, group_seeds),
];

/// An id has one notation: its text is the text that was parsed.
fn ids(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let lease = text.parse::<LeaseId>();
        if let Ok(id) = &lease {
            assert!(id.number > 0);
        }
        let accepted = [
            has_one_notation::<RunId>(text),
            has_one_notation::<LeaseId>(text),
            has_one_notation::<EpisodeId>(text),
            has_one_notation::<LayoutId>(text),
            has_one_notation::<DesignRequestId>(text),
            has_one_notation::<EvaluationId>(text),
            has_one_notation::<RunTag>(text),
        ];
        accepted.contains(&true)
    })
}

fn has_one_notation<T: FromStr<Err: Display> + Display>(text: &str) -> bool {
    match text.parse::<T>() {
        Ok(parsed) => {
            assert_eq!(parsed.to_string(), text, "two texts are the same id");
            true
        }
        Err(error) => {
            let length = error.to_string().len();
            assert!(length < 2048, "the error has {length} bytes");
            false
        }
    }
}

/// A word is the value's own word, in the database and in JSON.
fn words(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let accepted = [
            is_word::<store::columns::ClaimState>(text),
            is_word::<store::curriculum::LevelMoveKind>(text),
            is_word::<store::design_requests::DesignerKind>(text),
            is_word::<store::design_requests::RequestOrigin>(text),
            is_word::<store::design_requests::RequestState>(text),
            is_word::<store::episodes::EpisodeState>(text),
            is_word::<store::evaluations::EvaluationState>(text),
            is_word::<store::events::EventKind>(text),
            is_word::<store::groups::GroupRole>(text),
            is_word::<store::groups::GroupState>(text),
            is_word::<store::layouts::LayoutKind>(text),
            is_word::<store::layouts::LayoutState>(text),
            is_word::<store::layouts::RetirementReason>(text),
            is_word::<store::leases::Disclosure>(text),
            is_word::<store::leases::LeaseForm>(text),
            is_word::<store::leases::LeaseStatus>(text),
            is_word::<store::leases::Purpose>(text),
            is_word::<store::role::Role>(text),
            is_word::<store::run_warnings::WarningKind>(text),
            is_word::<store::runs::RunStatus>(text),
        ];
        accepted.contains(&true)
    })
}

fn is_word<T: FromStr + Display + Debug + PartialEq + Serialize + DeserializeOwned>(text: &str) -> bool {
    let Ok(value) = text.parse::<T>() else { return false };
    assert_eq!(value.to_string(), text);
    assert_eq!(serde_json::from_value::<T>(json!(value)).expect("a word is JSON"), value);
    true
}

/// A token has the text that was parsed, and is redacted in any text.
fn token(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let redacted = redact(text);
        assert!(redact(&redacted) == redacted, "a second redaction changes the text");
        let Some(token) = Token::parse(text) else { return false };
        assert!(token.id > 0);
        assert_eq!(token.expose(), text);
        assert!(!redacted.contains(token.expose()), "the token is not redacted");
        true
    })
}

/// A stored log is the same after it is packed and unpacked again.
fn stored_log(bytes: &[u8]) -> bool {
    let Ok(log) = unpack_log(bytes) else { return false };
    let again = unpack_log(&pack_log(&log)).expect("a packed log is valid");
    assert_eq!(again.encode(), log.encode(), "the packed log differs");
    true
}

fn plan() -> &'static ActionLog {
    static PLAN: LazyLock<ActionLog> = LazyLock::new(|| ActionLog::new(2, Precision::F64));
    &PLAN
}

/// A stored bracket is the same after it is packed and unpacked again.
fn stored_bracket(bytes: &[u8]) -> bool {
    let Ok(bracket) = unpack_outcomes(bytes, plan()) else { return false };
    let packed = pack_outcomes(&bracket).expect("a bracket has a JSON form");
    assert_eq!(unpack_outcomes(&packed, plan()).expect("a packed bracket is valid"), bracket);
    true
}

/// Compacted leases are the same after they are packed and unpacked again. An input is the length of the lease rows in two bytes,
/// the lease rows and the body.
fn compacted_leases(bytes: &[u8]) -> bool {
    let Some((length, rest)) = bytes.split_first_chunk::<2>() else { return false };
    let (rows, body) = rest.split_at(usize::from(u16::from_le_bytes(*length)).min(rest.len()));
    let Ok(leases) = unpack_leases("run", rows, body) else { return false };
    let PackedLeases { lease_rows, body } = pack_leases(&leases).expect("leases have a MessagePack form");
    let again = unpack_leases("run", &lease_rows, &body).expect("packed leases are valid");
    // A number that is not finite may not be equal to itself.
    assert_eq!(format!("{again:?}"), format!("{leases:?}"), "the packed leases differ");
    true
}

/// Stored columns are the same after they are encoded and decoded again.
fn stored_columns(bytes: &[u8]) -> bool {
    let Ok(columns) = table::decode(bytes) else { return false };
    let encoded = columns.encode().expect("columns can be compressed");
    let again = table::decode(&encoded).expect("encoded columns are valid");
    assert_eq!(again.digest(), columns.digest(), "the encoded columns differ");
    true
}

/// A group of the trajectory feed unpacks to at most the given number of bytes.
fn stored_group(bytes: &[u8]) -> bool {
    const MAX_BYTES: usize = 4096;
    let Ok(json) = packed_group::unpack(bytes, MAX_BYTES) else { return false };
    assert!(json.len() <= MAX_BYTES);
    true
}

fn id_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "run-1_a",
        "east.run-1_a",
        "east.layout-7",
        "east.eval-7",
        "42-x7k2p9",
        "ep_42-x7k2p9_3",
        "layout-7",
        "ask-7",
        "eval-7",
        "team.a:1",
        "9223372036854775807-aaaaaa",
        "ep_1-aaaaaa_999999999",
    ])
}

fn word_seeds() -> Vec<Vec<u8>> {
    let words = [
        store::events::EventKind::WORDS,
        store::leases::LeaseStatus::WORDS,
        store::layouts::RetirementReason::WORDS,
        store::role::Role::WORDS,
    ];
    words.concat().into_iter().map(|word| word.as_bytes().to_vec()).collect()
}

fn token_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        &format!("sparring_7_{}", "0a".repeat(32)),
        &format!("sparring_9223372036854775807_{}", "F".repeat(64)),
    ])
}

fn log(steps: usize) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    for step in 0..steps {
        log.push_entry(step as u32 % 3, &[0.25, -0.5]);
        log.end_step();
    }
    log
}

fn stored_log_seeds() -> Vec<Vec<u8>> {
    vec![pack_log(&log(1)), pack_log(&log(40))]
}

fn bracket_seeds() -> Vec<Vec<u8>> {
    let outcome = EpisodeOutcome {
        score: 0.5,
        total_reward: -1.5,
        steps: 60,
        lost: 1,
        goal: Some(0.25),
        fuel_used: 2.0,
        time_s: None,
    };
    let bracket = |plans: usize| Bracket {
        planner_version: 1,
        panel: vec![outcome; plans],
        floor: 0.25,
        reference: outcome,
        reference_plan: plan().clone(),
    };
    [1, 12].map(|plans| pack_outcomes(&bracket(plans)).expect("a bracket has a JSON form")).to_vec()
}

fn compacted_seeds() -> Vec<Vec<u8>> {
    let row = json!({"id": 3, "id_suffix": "aaaaaa", "purpose": "train", "form": "groups", "status": "closed", "groups": 1,
        "group_size": 2, "policy_version": 0, "ttl_ms": 1000, "created_at": 5, "expires_at": 6, "owner": null});
    let episode = json!({"number": 0, "state": "finished", "score": 0.5, "skill": null, "success": true, "policy_version": 1,
        "after_ms": 20});
    let lease = |status: &str| {
        let mut row = row.clone();
        row["status"] = json!(status);
        let lease = json!({"row": row, "claim": {"state": "accepted", "episodes": 2, "failed": 0}, "groups": [
            {"number": 0, "task": "kessler/survival", "level": 1, "role": "frontier", "layout": null, "contested": true,
                "episodes": [episode, episode]}]});
        serde_json::from_value::<CompactedLease>(lease)
    };
    let leases: Vec<CompactedLease> =
        store::leases::LeaseStatus::WORDS.iter().filter_map(|status| lease(status).ok()).collect();
    assert!(!leases.is_empty(), "the lease is not valid: {:?}", lease("closed"));
    let seed = |leases: &[CompactedLease]| {
        let PackedLeases { lease_rows, body } = pack_leases(leases).expect("leases have a MessagePack form");
        let length = u16::try_from(lease_rows.len()).expect("the rows are short");
        [&length.to_le_bytes()[..], &lease_rows, &body].concat()
    };
    vec![seed(&leases[..1]), seed(&[]), seed(&vec![leases[0].clone(); 30])]
}

fn column_seeds() -> Vec<Vec<u8>> {
    let columns = |scores: Vec<f32>, failed, steps| Columns { scores, failed, steps };
    let all = [
        columns(vec![0.5, 0.25], vec![false, true], vec![50, 60]),
        columns(vec![0.1; 100], Vec::new(), Vec::new()),
        columns(Vec::new(), Vec::new(), Vec::new()),
    ];
    all.iter().map(|columns| columns.encode().expect("columns can be compressed")).collect()
}

/// Frames of zstd without compression, as `zstd` writes them.
fn group_seeds() -> Vec<Vec<u8>> {
    let group = "{\"group\": 1, \"episodes\": [{}, {}, {}]}";
    let head = [0x28, 0xb5, 0x2f, 0xfd, 0x20, group.len() as u8];
    let block = (group.len() as u32) << 3 | 1;
    vec![[&head[..], &block.to_le_bytes()[..3], group.as_bytes()].concat()]
}
