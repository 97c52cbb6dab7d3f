//! `sparring db check`: changed successes, skills, level moves, curriculum events and snapshots, with and without `--deep`.

use std::path::Path;

use serde_json::json;
use system_tests::ServerProcess;

use super::{damage_copy, db, output_text, serve_compacted_run};

/// Trains until the level has moved twice, and stops the server, which stores a snapshot.
async fn train_until_moves(file: &Path) {
    let server = ServerProcess::start(file);
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "seed": 77, "group_size": 2, "placement": false, "target": "mastery",
                          "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    for _ in 0..60 {
        let lease = api.lease("run", json!({"groups": 16})).await;
        let _ = api.report("run", lease.results("heuristic")).await;
        let moves = api.get("/v1/runs/run/level_moves").await.expect(200);
        if moves["moves"].as_array().unwrap().len() >= 2 {
            assert_eq!(server.terminate(), Some(0));
            return;
        }
    }
    panic!("no two level moves in 60 leases");
}

/// Damage that the check without `--deep` finds.
const SHALLOW: [(&str, &str); 7] = [
    ("UPDATE episodes SET success = 1 - success", "wrong counters of episodes: run run counts "),
    (
        "UPDATE episodes SET success = 1 - success WHERE (lease, number) = (SELECT lease, number FROM episodes WHERE success = 1)",
        "wrong counts of groups: group ",
    ),
    ("UPDATE episodes SET skill = skill / 2 - 0.25 WHERE skill IS NOT NULL", "replays to the skill"),
    (
        "DELETE FROM curriculum_events WHERE seq = 40",
        "missing curriculum events: run run lacks 1 of its events",
    ),
    ("DELETE FROM curriculum_events WHERE seq > 100", "missing curriculum events: run run lacks its last "),
    (
        "DELETE FROM curriculum_events WHERE seq < 3",
        "missing curriculum events: run run lacks its first 3 events",
    ),
    (
        "DELETE FROM level_moves WHERE seq = (SELECT max(seq) FROM level_moves)",
        "wrong level moves: run run lacks the last level move of kessler/survival",
    ),
];

/// Damage that only a replay of everything finds.
const DEEP: [(&str, &str); 7] = [
    // A success and a failure are exchanged, and all counts with them.
    (
        "CREATE TEMP TABLE a AS SELECT lease, number FROM episodes WHERE success = 1 AND number % 2 = 0 LIMIT 1;
         CREATE TEMP TABLE b AS SELECT lease, number FROM episodes WHERE success = 0 LIMIT 1;
         UPDATE episodes SET success = 1 - success WHERE (lease, number) IN (SELECT * FROM a UNION SELECT * FROM b);
         UPDATE groups SET successes = (SELECT sum(success) FROM episodes e
             WHERE e.lease = groups.lease AND e.number / 2 = groups.number)",
        "wrong successes: ep_",
    ),
    ("DELETE FROM level_moves", "wrong level moves: run run lacks the level move of kessler/survival by event "),
    ("DELETE FROM level_moves WHERE seq = (SELECT min(seq) FROM level_moves)", "wrong level moves: "),
    ("UPDATE level_moves SET evidence = json_set(evidence, '$.sentence', 'No reason.')", " of run run differs"),
    (
        "INSERT INTO level_moves SELECT run, seq + 1, task, kind, from_level, to_level, evidence, at FROM level_moves",
        "no event of run run causes its level move of kessler/survival by event ",
    ),
    (
        "UPDATE curriculum_snapshots SET body = json_set(body, '$.since', json_object('kessler/survival', 1))",
        "wrong snapshots: the snapshot of run run before event ",
    ),
    ("DELETE FROM curriculum_events WHERE seq = 40", "of run run cannot be replayed"),
];

#[tokio::test(flavor = "multi_thread")]
async fn deep_check_finds_each_kind_of_change() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    train_until_moves(&file).await;
    for args in [["check"].as_slice(), &["check", "--deep"]] {
        let checked = db(&file, args);
        assert_eq!(checked.status.code(), Some(0), "{}", output_text(&checked));
    }
    let cases = SHALLOW.iter().map(|case| (case, ["check", "--replay", "2000"].as_slice()));
    for ((damage, found), args) in cases.chain(DEEP.iter().map(|case| (case, ["check", "--deep"].as_slice())))
    {
        let checked = db(&damage_copy(&file, damage).await, args);
        let text = output_text(&checked);
        assert!(checked.status.code() == Some(1) && text.contains(found), "{damage}: {text}");
        let labels: Vec<&str> = text.lines().filter_map(|line| Some(line.split_once(": ")?.0)).collect();
        let mut kinds = labels.clone();
        kinds.dedup();
        assert_eq!(labels, kinds, "each kind of damage is one line: {text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn deep_check_accepts_compacted_runs() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    assert_eq!(serve_compacted_run(&file).await.terminate(), Some(0));
    let checked = db(&file, &["check", "--deep"]);
    assert_eq!(checked.status.code(), Some(0), "{}", output_text(&checked));
}
