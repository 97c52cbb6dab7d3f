//! Stored curricula and suites: settings, snapshots, events, and files of suites.

use std::sync::LazyLock;

use curriculum::{Curriculum, CurriculumEvent, Settings, Snapshot, StoredSettings, StrategyKind, TaskPlan};
use evaluation::suite::file::{built_in, parse_suite, write_suite};
use evaluation::suite::{Suite, SuiteGroup};
use serde_json::{Value, json};

use crate::target::{Target, json_seeds};

pub(super) const TARGETS: &[Target] = &[
    Target::new("settings", settings, settings_seeds),
    Target::new("snapshot", snapshot, snapshot_seeds),
    Target::new("curriculum_events", curriculum_events, event_seeds),
    Target::new("suite_file", suite_file, suite_seeds),
];

/// Seed of the runs.
const RUN_SEED: u64 = 7;

/// Settings that are valid are the same after they are stored and read again.
fn settings(bytes: &[u8]) -> bool {
    let Ok(stored) = serde_json::from_slice::<StoredSettings>(bytes) else { return false };
    let Ok(settings) = Settings::try_from(stored) else { return false };
    let written = serde_json::to_string(&settings).expect("settings have a JSON form");
    let again = serde_json::from_str::<Settings>(&written);
    assert_eq!(again.expect("stored settings are valid"), settings, "the stored settings differ");
    true
}

/// A restored curriculum stores the same snapshot again, and it can explain itself. If its counters are those of a possible run, it
/// can also propose.
fn snapshot(bytes: &[u8]) -> bool {
    let Ok(stored) = serde_json::from_slice::<Snapshot>(bytes) else { return false };
    let Ok(mut curriculum) = Curriculum::restore(RUN_SEED, stored) else { return false };
    let snapshot = curriculum.snapshot();
    let again = Curriculum::restore(RUN_SEED, snapshot.clone()).expect("a written snapshot is valid");
    assert_eq!(again.snapshot(), snapshot, "the snapshot differs");
    let _ = (curriculum.status(), curriculum.mastery(), curriculum.explain());
    let _ = (curriculum.propose(), curriculum.propose());
    true
}

/// Events are replayed up to the first that contradicts the curriculum; an event is the same after it is written again.
fn curriculum_events(bytes: &[u8]) -> bool {
    let Ok(events) = serde_json::from_slice::<Vec<CurriculumEvent>>(bytes) else { return false };
    let written = serde_json::to_vec(&events).expect("events have a JSON form");
    assert_eq!(
        serde_json::from_slice::<Vec<CurriculumEvent>>(&written).expect("written events are valid"),
        events
    );
    let mut curriculum = new_curriculum(StrategyKind::Ladder);
    (0..).zip(&events).all(|(seq, event)| curriculum.replay_event(seq, event).is_ok())
}

/// A suite has one serialized form. The input's hash is replaced by the right one, so that the parser reads on.
fn suite_file(bytes: &[u8]) -> bool {
    const HASH_LINE: &str = "\n\"hash\":\"";
    let mut text = String::from_utf8_lossy(bytes).into_owned();
    let _ = parse_suite(text.as_bytes());
    if let Some(end) = text.rfind(HASH_LINE) {
        text.truncate(end + 1);
        let hash = blake3::hash(text.as_bytes()).to_hex();
        text.push_str(&format!("\"hash\":\"{hash}\"}}\n"));
    }
    let Ok(loaded) = parse_suite(text.as_bytes()) else { return false };
    let written = write_suite(&loaded.suite).expect("a suite has a JSON form");
    let again = parse_suite(written.as_bytes()).expect("a written suite is valid");
    assert_eq!(again.suite, loaded.suite, "the written suite differs");
    true
}

fn plans() -> Vec<TaskPlan> {
    let plan = |id| TaskPlan::standard(id).expect("the task exists");
    ["kessler/survival", "docking/single"].map(plan).to_vec()
}

fn settings_of(strategy: StrategyKind) -> Option<Settings> {
    let mut stored = serde_json::to_value(Settings::ladder(plans())).ok()?;
    stored["strategy"] = json!(strategy);
    stored["strategy_settings"] = json!({});
    // Short tables, so that mutations hit other fields too.
    stored["tasks"]
        .as_array_mut()?
        .iter_mut()
        .filter_map(|plan| plan["rows"].as_array_mut())
        .for_each(|rows| rows.truncate(2));
    serde_json::from_value(stored).ok()
}

fn new_curriculum(strategy: StrategyKind) -> Curriculum {
    static SETTINGS: LazyLock<Vec<(StrategyKind, Settings)>> = LazyLock::new(|| {
        let settings = |strategy| Some((strategy, settings_of(strategy)?));
        StrategyKind::ALL.into_iter().filter_map(settings).collect()
    });
    let (_, settings) =
        SETTINGS.iter().find(|(kind, _)| *kind == strategy).expect("every strategy has settings");
    Curriculum::new(RUN_SEED, settings.clone()).expect("the settings are valid")
}

fn settings_seeds() -> Vec<Vec<u8>> {
    json_seeds(StrategyKind::ALL.into_iter().filter_map(settings_of).map(|settings| json!(settings)))
}

fn snapshot_seeds() -> Vec<Vec<u8>> {
    let snapshot = |strategy| {
        let mut curriculum = new_curriculum(strategy);
        let _ = (curriculum.propose(), curriculum.propose());
        json!(curriculum.snapshot())
    };
    json_seeds(StrategyKind::ALL.map(snapshot))
}

fn event_seeds() -> Vec<Vec<u8>> {
    let mut curriculum = new_curriculum(StrategyKind::Ladder);
    let proposed = [curriculum.propose().proposal, curriculum.propose().proposal];
    let proposal = &proposed[0];
    let slot = json!({"proposal": 0, "lease": 1, "task": proposal.task, "level": proposal.level, "epoch": proposal.epoch,
        "role": proposal.role});
    let outcome = json!({"proposal": 0, "task": proposal.task, "level": proposal.level, "epoch": proposal.epoch,
        "role": proposal.role, "contested": true, "finished": 2, "successes": 1, "usable": true, "mean_score": 0.5,
        "mean_skill": null});
    let event = |name: &str, data: Value| json!({"event": name, "data": data});
    let proposals: Vec<Value> = proposed.iter().map(|proposal| event("proposed", json!(proposal))).collect();
    let mut all = proposals.clone();
    all.extend([
        event("opened", json!([slot])),
        event("outcome", outcome),
        event("withdrawn", json!([slot])),
    ]);
    all.extend([
        json!({"event": "evidence_restarted"}),
        event("settings", json!(settings_of(StrategyKind::Uniform))),
    ]);
    json_seeds([json!(proposals), json!(all)])
}

fn suite_seeds() -> Vec<Vec<u8>> {
    let seed = |name| {
        let Suite { name, planner, created_by, groups } =
            built_in(name).expect("the suite exists").suite.clone();
        let first = |group: SuiteGroup| SuiteGroup { entries: group.entries[..1].to_vec(), ..group };
        let groups = groups.into_iter().take(1).map(first).collect();
        write_suite(&Suite { name, planner, created_by, groups })
            .expect("a suite has a JSON form")
            .into_bytes()
    };
    vec![seed("kessler-heldout-v2"), seed("docking-heldout-v1"), seed("tasking-heldout-v1")]
}
