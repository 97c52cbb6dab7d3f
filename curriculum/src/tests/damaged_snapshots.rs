//! Tests of snapshots that the database damaged: they are rejected, or the curriculum continues without a panic.

use serde_json::Value;

use super::*;

#[test]
fn snapshot_without_room_for_an_event_is_rejected() {
    let snapshot =
        Curriculum::new(4, Settings::ladder(vec![TaskPlan::standard("kessler/survival").unwrap()]))
            .unwrap()
            .snapshot();
    let damaged = Snapshot { next_seq: u64::MAX, ..snapshot };
    assert!(matches!(Curriculum::restore(4, damaged), Err(RestoreError::State { .. })));
}

#[test]
fn huge_counters_of_a_snapshot_do_not_overflow() {
    for strategy in StrategyKind::ALL {
        let mut curriculum =
            Curriculum::new(4, with_placement(&[SURVIVAL, RENDEZVOUS]).with_strategy(strategy)).unwrap();
        continue_run(&mut curriculum, 150);
        let snapshot = curriculum.snapshot();
        for huge in [u64::MAX, u64::from(u32::MAX)] {
            let count = integers(&mut snapshot.state.clone()).len();
            // Buffers repeat the same fields.
            let restored = (0..count.min(500)).filter(|&which| {
                let mut damaged = snapshot.clone();
                *integers(&mut damaged.state)[which] = huge.into();
                Curriculum::restore(4, damaged).is_ok_and(|mut curriculum| {
                    continue_run(&mut curriculum, 8);
                    true
                })
            });
            let restored = restored.count();
            assert!(restored > 0 || count == 0 || huge == u64::MAX, "{strategy}: {restored} of {count}");
        }
    }
}

/// Proposes and reports groups, and describes the state after each.
fn continue_run(curriculum: &mut Curriculum, groups: u32) {
    for group in 0..groups {
        let proposed = curriculum.propose();
        let outcome = outcome_of(&proposed, 4, if group % 3 == 0 { 4 } else { group % 4 });
        if outcome.evidence.is_some() {
            curriculum.open_slots(&[slot_of(&outcome)]);
        }
        curriculum.observe(&outcome);
    }
    let _ = (curriculum.status(), curriculum.mastery(), curriculum.explain());
}

/// All integers of a JSON value.
fn integers(value: &mut Value) -> Vec<&mut Value> {
    match value {
        Value::Number(number) if number.is_u64() => vec![value],
        Value::Array(items) => items.iter_mut().flat_map(integers).collect(),
        Value::Object(fields) => fields.values_mut().flat_map(integers).collect(),
        _ => Vec::new(),
    }
}
