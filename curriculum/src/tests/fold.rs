//! The curriculum as a fold: the same events lead to the same curriculum, from the beginning or from any snapshot.

use proptest::prelude::{Just, ProptestConfig, Strategy, any, prop, prop_assert_eq, prop_oneof, proptest};

use super::*;

/// What happens next to a run.
#[derive(Debug, Clone, Copy)]
enum Happening {
    Propose,
    /// Some group in flight comes back: which, episodes, successes, lost ones, and how it was found.
    Report {
        which: usize,
        finished: u32,
        successes: u32,
        lost: u32,
        contested: bool,
        evidence: bool,
    },
    Change(usize),
}

fn happenings() -> impl Strategy<Value = Vec<Happening>> {
    let report = (any::<usize>(), 0..9u32, 0..9u32, 0..2u32, any::<bool>(), prop::bool::weighted(0.9))
        .prop_map(|(which, finished, successes, lost, contested, evidence)| Happening::Report {
            which,
            finished,
            successes: if successes > 6 { 0 } else { finished },
            lost: if successes == 0 { lost } else { 0 },
            contested,
            evidence,
        });
    let one = prop_oneof![
        40 => Just(Happening::Propose),
        40 => report,
        1 => (0..WAYS).prop_map(Happening::Change),
    ];
    prop::collection::vec(one, 0..1200)
}

/// Settings there are.
const WAYS: usize = 13;

fn settings(which: usize) -> Settings {
    let mut changed = placed(&[SURVIVAL, RENDEZVOUS]);
    match which {
        0 => {}
        1 => changed.tasks.truncate(1),
        2..11 => return changed.by(StrategyKind::ALL[which - 2]),
        11 => {
            let told = serde_json::from_str(r#"{"filled": 2, "replay": 1.0, "capacity": 6}"#).unwrap();
            let tuning = Tuning::read(StrategyKind::Accel, &told).unwrap();
            return Settings { tuning, ..changed.by(StrategyKind::Accel) };
        }
        _ => {
            (changed.target, changed.placement) = (Target::Half, false);
            changed.tasks[0].default_params[0].1 = 30.0;
            changed.tasks[1].weight = 0.3;
        }
    }
    changed
}

/// Lives through what happens; the events as they are stored, and the curriculum after each.
fn live(seed: u64, first: usize, happenings: &[Happening]) -> (Curriculum, Vec<String>, Vec<Snapshot>) {
    let mut curriculum = Curriculum::new(seed, settings(first)).unwrap();
    let (mut in_flight, mut events, mut snapshots) = (Vec::new(), Vec::new(), vec![curriculum.snapshot()]);
    for happening in happenings {
        let event = match *happening {
            Happening::Propose => {
                let (seq, proposal) = curriculum.propose();
                in_flight.push((seq, proposal.clone()));
                CurriculumEvent::Proposed(proposal)
            }
            Happening::Report { which, finished, successes, lost, contested, evidence } => {
                if in_flight.is_empty() {
                    continue;
                }
                let (seq, proposal) = in_flight.swap_remove(which % in_flight.len());
                let contested = contested || proposal.contested;
                let outcome = GroupOutcome {
                    contested,
                    evidence,
                    failed: lost,
                    mean_score: 0.1 + 0.2 * f64::from(successes),
                    ..answer(seq, &proposal, finished, successes)
                };
                curriculum.observe(&outcome);
                CurriculumEvent::Outcome(outcome)
            }
            Happening::Change(which) => {
                curriculum.change(settings(which)).unwrap();
                CurriculumEvent::Settings(settings(which).into())
            }
        };
        events.push(serde_json::to_string(&event).unwrap());
        snapshots.push(curriculum.snapshot());
    }
    (curriculum, events, snapshots)
}

fn replay(curriculum: &mut Curriculum, events: &[String], from: usize) {
    for (seq, event) in events.iter().enumerate().skip(from) {
        curriculum.replay(seq as u64, &serde_json::from_str(event).unwrap()).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_snapshot_anywhere_and_the_events_after_it_are_the_run(
        seed in any::<u64>(),
        first in 0..WAYS,
        happenings in happenings(),
        cut in any::<prop::sample::Index>(),
    ) {
        let (lived, events, snapshots) = live(seed, first, &happenings);

        let mut again = Curriculum::new(seed, settings(first)).unwrap();
        replay(&mut again, &events, 0);
        prop_assert_eq!(again.snapshot(), lived.snapshot());

        let cut = cut.index(snapshots.len());
        let stored = serde_json::to_string(&snapshots[cut]).unwrap();
        let mut restored = Curriculum::restore(seed, serde_json::from_str(&stored).unwrap()).unwrap();
        replay(&mut restored, &events, cut);
        prop_assert_eq!(restored.snapshot(), lived.snapshot());
        prop_assert_eq!(restored.mastery(), lived.mastery());
        prop_assert_eq!(restored.status(), lived.status());

        // And it goes on as the run would have gone on, sentences included.
        let mut lived = lived.clone();
        for _ in 0..20 {
            prop_assert_eq!(restored.propose(), lived.propose());
        }
    }
}

/// A run long enough for placement, moves up and moves down, snapshotted in all its stages.
#[test]
fn a_long_run_is_restored_at_every_stage() {
    let happenings: Vec<Happening> = (0..3000)
        .flat_map(|step: u32| {
            let successes = u32::from(!(1500..2500).contains(&step));
            let report = Happening::Report {
                which: 0,
                finished: 1,
                successes,
                lost: 0,
                contested: true,
                evidence: true,
            };
            [Happening::Propose, report]
        })
        .collect();
    let (lived, events, snapshots) = live(4, 0, &happenings);
    let status = lived.status();
    assert!(status.iter().all(|task| task.placed && task.epoch > 8), "{status:?}");
    for cut in (0..snapshots.len()).step_by(997) {
        let mut restored = Curriculum::restore(4, snapshots[cut].clone()).unwrap();
        replay(&mut restored, &events, cut);
        assert_eq!(restored.snapshot(), lived.snapshot());
    }
}

#[test]
fn another_seed_proposes_something_else() {
    let first = |seed| {
        let mut curriculum = Curriculum::new(seed, placed(&[SURVIVAL, ECO, RENDEZVOUS])).unwrap();
        (0..50).map(|_| curriculum.propose().1.task).collect::<Vec<_>>()
    };
    assert_eq!(first(1), first(1));
    assert_ne!(first(1), first(2));
}

#[test]
fn a_snapshot_of_another_version_is_refused() {
    for strategy in StrategyKind::ALL {
        let curriculum = Curriculum::new(1, placed(&[SURVIVAL]).by(strategy)).unwrap();
        let mut snapshot = curriculum.snapshot();
        snapshot.version += 1;
        let error = Curriculum::restore(1, snapshot).unwrap_err();
        assert_eq!(error, RestoreError::OtherVersion { strategy, found: 2, wanted: 1 });
    }
}

#[test]
fn a_snapshot_that_cannot_be_is_refused() {
    let sound = Curriculum::new(1, placed(&[SURVIVAL])).unwrap().snapshot();
    let refused = |change: &dyn Fn(&mut Snapshot)| {
        let mut snapshot = sound.clone();
        change(&mut snapshot);
        Curriculum::restore(1, snapshot).unwrap_err()
    };
    let is_state = |error| matches!(error, RestoreError::State { .. });
    assert!(is_state(refused(&|snapshot| snapshot.state = serde_json::Value::Null)));
    assert!(is_state(refused(&|snapshot| snapshot.state["tasks"] = serde_json::json!({}))));
    assert!(is_state(refused(&|snapshot| snapshot.strategy = StrategyKind::Fixed)));
    assert!(is_state(refused(&|snapshot| snapshot.settings.tasks[0].rows.truncate(3))));
    assert!(matches!(
        refused(&|snapshot| snapshot.settings.tasks[0].task = "nobody/knows".to_owned()),
        RestoreError::Settings(_)
    ));
}

#[test]
fn a_replay_that_does_not_fit_is_refused() {
    let mut curriculum = Curriculum::new(1, placed(&[SURVIVAL])).unwrap();
    let (_, proposal) = curriculum.clone().propose();
    let proposed = |proposal: &Proposal| CurriculumEvent::Proposed(proposal.clone());
    assert_eq!(
        curriculum.replay(1, &proposed(&proposal)),
        Err(RestoreError::OutOfOrder { found: 1, wanted: 0 })
    );
    let reworded = Proposal { why: "in other words".to_owned(), ..proposal.clone() };
    assert_eq!(curriculum.clone().replay(0, &proposed(&reworded)), Ok(()));
    let other = Proposal { level: Some(9), ..proposal };
    let error = curriculum.replay(0, &proposed(&other)).unwrap_err();
    assert!(matches!(error, RestoreError::OtherProposal { seq: 0, .. }), "{error}");
}

#[test]
fn changed_settings_keep_what_they_do_not_touch() {
    let mut run = Simulation::new(6, from_zero(&[SURVIVAL, ECO]));
    for _ in 0..1500 {
        run.step(&mut |_, _| 1.0);
    }
    let (survival, eco) = (run.status(SURVIVAL), run.status(ECO));
    assert!(survival.level > Some(1) && eco.level > Some(1));
    let (seq, leased) = run.curriculum.propose();

    let mut settings = run.curriculum.settings().clone();
    settings.tasks[0].weight = 3.0;
    settings.tasks[1].default_params[0].1 = 40.0;
    run.curriculum.change(settings.clone()).unwrap();
    assert_eq!((run.status(SURVIVAL), run.status(ECO).level), (survival, Some(0)));
    assert!(run.curriculum.mastery().iter().all(|found| found.task == SURVIVAL));
    assert_eq!(run.curriculum.is_current(seq, &leased), leased.task == SURVIVAL);
    // What was leased of the old table says nothing about the new one.
    let late = GroupOutcome { proposal: seq, ..outcome(ECO, Some(0), 1, 1) };
    run.curriculum.observe(&late);
    assert_eq!(run.status(ECO).block.unwrap().n, 0);
    run.curriculum.observe(&GroupOutcome { proposal: seq + 2, ..late });
    assert_eq!(run.status(ECO).block.unwrap().n, 1);

    let mastery = run.curriculum.mastery();
    settings = settings.by(StrategyKind::Uniform);
    run.curriculum.change(settings.clone()).unwrap();
    assert_eq!(run.curriculum.mastery(), mastery);
    settings.tasks.clear();
    let next = run.curriculum.next_seq();
    assert!(run.curriculum.change(settings).is_err());
    assert_eq!((run.curriculum.next_seq(), run.curriculum.settings().tasks.len()), (next, 2));
}
