//! Tests of the fold: the same events lead to the same curriculum, from the start or from any snapshot.

use proptest::prelude::{Just, ProptestConfig, Strategy, any, prop, prop_assert_eq, prop_oneof, proptest};

use super::*;

/// Next step of a run.
#[derive(Debug, Clone, Copy)]
enum Step {
    Propose,
    /// Reports one of the groups in flight.
    Report {
        which: usize,
        finished: u32,
        successes: u32,
        lost: u32,
        contested: bool,
        usable: bool,
    },
    /// Withdraws one of the groups in flight.
    Withdraw(usize),
    Change(usize),
    RestartEvidence,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let report = (any::<usize>(), 0..9u32, 0..9u32, 0..2u32, any::<bool>(), prop::bool::weighted(0.9))
        .prop_map(|(which, finished, successes, lost, contested, usable)| Step::Report {
            which,
            finished,
            successes: if successes > 6 { 0 } else { finished },
            lost: if successes == 0 { lost } else { 0 },
            contested,
            usable,
        });
    let one = prop_oneof![
        40 => Just(Step::Propose),
        40 => report,
        1 => any::<usize>().prop_map(Step::Withdraw),
        1 => (0..VARIANTS).prop_map(Step::Change),
        1 => Just(Step::RestartEvidence),
    ];
    prop::collection::vec(one, 0..1200)
}

/// Number of settings that [`settings`] knows: four special ones, and one for each strategy.
const VARIANTS: usize = 4 + StrategyKind::ALL.len();

/// One of several settings.
fn settings(which: usize) -> Settings {
    let mut changed = with_placement(&[SURVIVAL, RENDEZVOUS]);
    if let Some(strategy) = which.checked_sub(4) {
        return changed.with_strategy(StrategyKind::ALL[strategy]);
    }
    match which {
        0 => {}
        1 => changed.tasks.truncate(1),
        2 => {
            let given = serde_json::from_str(r#"{"filled": 2, "replay": 1.0, "capacity": 6}"#).unwrap();
            let tuning = Hyperparameters::parse(StrategyKind::Accel, &given).unwrap();
            return Settings { hyperparameters: tuning, ..changed.with_strategy(StrategyKind::Accel) };
        }
        _ => {
            (changed.target, changed.placement) = (Target::Half, false);
            changed.tasks[0].default_params[0].1 = 30.0;
            changed.tasks[1].weight = 0.3;
        }
    }
    changed
}

/// A run, its events as JSON, and its snapshots before the first event and after each.
struct RecordedRun {
    curriculum: Curriculum,
    events: Vec<String>,
    snapshots: Vec<Snapshot>,
}

/// Runs the steps, starting with the settings `first`.
fn run_steps(seed: u64, first: usize, steps: &[Step]) -> RecordedRun {
    let mut curriculum = Curriculum::new(seed, settings(first)).unwrap();
    let (mut in_flight, mut events, mut snapshots) = (Vec::new(), Vec::new(), vec![curriculum.snapshot()]);
    let mut record = |curriculum: &Curriculum, event: &CurriculumEvent| {
        events.push(serde_json::to_string(event).unwrap());
        snapshots.push(curriculum.snapshot());
    };
    for step in steps {
        let event = match *step {
            Step::Propose => {
                let proposed = curriculum.propose();
                in_flight.push(proposed.clone());
                record(&curriculum, &CurriculumEvent::Proposed(proposed.proposal.clone()));
                if !is_slot(&proposed.proposal) {
                    continue;
                }
                let slots = vec![slot_of(&outcome_of(&proposed, 1, 0))];
                curriculum.open_slots(&slots);
                CurriculumEvent::Opened(slots)
            }
            Step::Report { .. } | Step::Withdraw(_) if in_flight.is_empty() => continue,
            Step::Report { which, finished, successes, lost, contested, usable } => {
                let proposed = in_flight.swap_remove(which % in_flight.len());
                let evidence =
                    is_slot(&proposed.proposal).then(|| interval(finished + lost, finished, successes));
                let outcome = GroupOutcome {
                    contested: contested || proposed.proposal.contested,
                    evidence,
                    usable,
                    mean_score: 0.1 + 0.2 * f64::from(successes),
                    ..outcome_of(&proposed, finished, successes)
                };
                curriculum.observe(&outcome);
                CurriculumEvent::Outcome(outcome)
            }
            Step::Withdraw(which) => {
                let proposed = in_flight.swap_remove(which % in_flight.len());
                let slots = vec![slot_of(&outcome_of(&proposed, 1, 0))];
                curriculum.withdraw_slots(&slots);
                CurriculumEvent::Withdrawn(slots)
            }
            Step::Change(which) => {
                curriculum.change_settings(settings(which)).unwrap();
                CurriculumEvent::Settings(settings(which).into())
            }
            Step::RestartEvidence => {
                curriculum.restart_evidence();
                CurriculumEvent::EvidenceRestarted
            }
        };
        record(&curriculum, &event);
    }
    RecordedRun { curriculum, events, snapshots }
}

fn replay_from(curriculum: &mut Curriculum, events: &[String], from: usize) {
    for (seq, event) in events.iter().enumerate().skip(from) {
        curriculum.replay_event(seq as u64, &serde_json::from_str(event).unwrap()).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_snapshot_and_its_later_events_restore_the_run(
        seed in any::<u64>(),
        first in 0..VARIANTS,
        steps in steps(),
        cut in any::<prop::sample::Index>(),
    ) {
        let RecordedRun { curriculum: original, events, snapshots } = run_steps(seed, first, &steps);

        let mut replayed = Curriculum::new(seed, settings(first)).unwrap();
        replay_from(&mut replayed, &events, 0);
        prop_assert_eq!(replayed.snapshot(), original.snapshot());

        let cut = cut.index(snapshots.len());
        let stored = serde_json::to_string(&snapshots[cut]).unwrap();
        let mut restored = Curriculum::restore(seed, serde_json::from_str(&stored).unwrap()).unwrap();
        replay_from(&mut restored, &events, cut);
        prop_assert_eq!(restored.snapshot(), original.snapshot());
        prop_assert_eq!(restored.mastery(), original.mastery());
        prop_assert_eq!(restored.status(), original.status());

        // The restored run continues as the original does, reasons included.
        let mut original = original.clone();
        for _ in 0..20 {
            prop_assert_eq!(restored.propose(), original.propose());
        }
    }
}

/// The run is long enough for placement, moves up and moves down.
#[test]
fn long_run_is_restored_at_every_stage() {
    let steps: Vec<Step> = (0..6000)
        .flat_map(|round: u32| {
            let successes = u32::from(!(3000..5000).contains(&round));
            let report =
                Step::Report { which: 0, finished: 1, successes, lost: 0, contested: true, usable: true };
            [Step::Propose, report]
        })
        .collect();
    let RecordedRun { curriculum: original, events, snapshots } = run_steps(4, 0, &steps);
    let status = original.status();
    assert!(status.iter().all(|task| task.placement_done && task.epoch > 8), "{status:?}");
    for cut in (0..snapshots.len()).step_by(997) {
        let mut restored = Curriculum::restore(4, snapshots[cut].clone()).unwrap();
        replay_from(&mut restored, &events, cut);
        assert_eq!(restored.snapshot(), original.snapshot());
    }
}

#[test]
fn other_seed_gives_other_proposals() {
    let first = |seed| {
        let mut curriculum = Curriculum::new(seed, with_placement(&[SURVIVAL, ECO, RENDEZVOUS])).unwrap();
        (0..50).map(|_| curriculum.propose().proposal.task).collect::<Vec<_>>()
    };
    assert_eq!(first(1), first(1));
    assert_ne!(first(1), first(2));
}

#[test]
fn snapshot_of_another_version_is_rejected() {
    for strategy in StrategyKind::ALL {
        let curriculum = Curriculum::new(1, with_placement(&[SURVIVAL]).with_strategy(strategy)).unwrap();
        let mut snapshot = curriculum.snapshot();
        let wanted = snapshot.version;
        snapshot.version += 1;
        let error = Curriculum::restore(1, snapshot).unwrap_err();
        assert_eq!(error, RestoreError::OtherVersion { strategy, found: wanted + 1, wanted });
    }
}

#[test]
fn invalid_snapshot_is_rejected() {
    let valid = Curriculum::new(1, with_placement(&[SURVIVAL])).unwrap().snapshot();
    let error_after = |change: &dyn Fn(&mut Snapshot)| {
        let mut snapshot = valid.clone();
        change(&mut snapshot);
        Curriculum::restore(1, snapshot).unwrap_err()
    };
    let is_state = |error| matches!(error, RestoreError::State { .. });
    assert!(is_state(error_after(&|snapshot| snapshot.state = serde_json::Value::Null)));
    assert!(is_state(error_after(&|snapshot| snapshot.state["tasks"] = serde_json::json!({}))));
    assert!(is_state(error_after(&|snapshot| snapshot.strategy = StrategyKind::Fixed)));
    assert!(is_state(error_after(&|snapshot| snapshot.settings.tasks[0].rows.truncate(3))));
    assert!(matches!(
        error_after(&|snapshot| snapshot.settings.tasks[0].task = "unknown/task".to_owned()),
        RestoreError::Settings(_)
    ));
}

#[test]
fn event_that_does_not_fit_is_rejected() {
    let mut curriculum = Curriculum::new(1, with_placement(&[SURVIVAL])).unwrap();
    let SequencedProposal { proposal, .. } = curriculum.clone().propose();
    let proposed = |proposal: &Proposal| CurriculumEvent::Proposed(proposal.clone());
    assert_eq!(
        curriculum.replay_event(1, &proposed(&proposal)),
        Err(RestoreError::OutOfOrder { found: 1, wanted: 0 })
    );
    let reworded = Proposal { why: "in other words".to_owned(), ..proposal.clone() };
    assert_eq!(curriculum.clone().replay_event(0, &proposed(&reworded)), Ok(()));
    let other = Proposal { level: Some(9), ..proposal };
    let error = curriculum.replay_event(0, &proposed(&other)).unwrap_err();
    assert!(matches!(error, RestoreError::OtherProposal { seq: 0, .. }), "{error}");
}

#[test]
fn changed_settings_restart_only_changed_tasks() {
    let mut run = TrainingRun::new(6, without_placement(&[SURVIVAL, ECO]));
    for _ in 0..1500 {
        run.step(&mut |_, _| 1.0);
    }
    let (survival, eco) = (run.status(SURVIVAL), run.status(ECO));
    assert!(survival.level > Some(1) && eco.level > Some(1));
    let SequencedProposal { seq, proposal: leased } = run.curriculum.propose();

    let mut settings = run.curriculum.settings().clone();
    settings.tasks[0].weight = 3.0;
    settings.tasks[1].default_params[0].1 = 40.0;
    run.curriculum.change_settings(settings.clone()).unwrap();
    assert_eq!((run.status(SURVIVAL), run.status(ECO).level), (survival, Some(0)));
    assert!(run.curriculum.mastery().iter().all(|found| found.task == SURVIVAL));
    assert_eq!(run.curriculum.is_current(seq, &leased), leased.task == SURVIVAL);
    // An outcome under the old default params says nothing about the new ones.
    let epoch = run.status(ECO).epoch;
    let late = GroupOutcome { proposal: seq, epoch, ..outcome(ECO, Some(0), 1, 1) };
    run.curriculum.open_slots(&[slot_of(&late)]);
    run.curriculum.observe(&late);
    assert_eq!(run.status(ECO).block.unwrap().n, 0);
    observe_new(&mut run.curriculum, &late);
    assert_eq!(run.status(ECO).block.unwrap().n, 1);

    let mastery = run.curriculum.mastery();
    settings = settings.with_strategy(StrategyKind::Uniform);
    run.curriculum.change_settings(settings.clone()).unwrap();
    assert_eq!(run.curriculum.mastery(), mastery);
    settings.tasks.clear();
    let next = run.curriculum.next_seq();
    assert!(run.curriculum.change_settings(settings).is_err());
    assert_eq!((run.curriculum.next_seq(), run.curriculum.settings().tasks.len()), (next, 2));
}
