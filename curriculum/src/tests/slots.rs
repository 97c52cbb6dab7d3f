//! Tests of slots: which results count as evidence, and in which order.

use super::*;

#[test]
fn only_slots_of_the_frontier_fill_a_block() {
    let mut curriculum = ladder();
    let good = current_outcome(&curriculum, SURVIVAL, 1, 1);
    let others = [
        GroupOutcome { evidence: None, ..good.clone() },
        GroupOutcome { role: ProposalRole::Rehearsal, ..good.clone() },
        GroupOutcome { role: ProposalRole::Placement, ..good.clone() },
        GroupOutcome { epoch: 3, ..good.clone() },
        GroupOutcome { level: Some(1), ..good.clone() },
        GroupOutcome { task: ECO.to_owned(), ..good.clone() },
        GroupOutcome { task: "unknown/task".to_owned(), level: Some(99), ..good.clone() },
    ];
    for other in others {
        observe_new(&mut curriculum, &other);
        assert_eq!(survival_status(&curriculum).block.unwrap().n, 0, "{other:?}");
    }
    // A value without a slot changes nothing either.
    curriculum.observe(&good);
    assert_eq!(survival_status(&curriculum).block.unwrap().n, 0);
    observe_new(&mut curriculum, &good);
    assert_eq!(survival_status(&curriculum).block.unwrap().n, 1);
}

#[test]
fn slot_of_an_old_epoch_counts_for_mastery_only() {
    let mut curriculum = ladder();
    let old = current_outcome(&curriculum, SURVIVAL, 1, 1);
    // A move up and one down: the same level, but another epoch.
    for successes in [32, 32, 0, 0] {
        fill_block(&mut curriculum, successes);
    }
    assert_eq!((survival_status(&curriculum).level, survival_status(&curriculum).epoch), (Some(0), 2));
    let before = curriculum.mastery();
    observe_new(&mut curriculum, &old);
    assert_eq!(survival_status(&curriculum).block.unwrap().n, 0);
    let after = curriculum.mastery();
    assert_eq!(after[0].seen, before[0].seen + 1);
    assert_eq!(after[1], before[1]);
}

#[test]
fn mastery_is_the_posterior_of_64_slots() {
    let mut curriculum = ladder();
    assert_eq!(curriculum.mastery(), []);
    let rehearsal = GroupOutcome { role: ProposalRole::Rehearsal, ..outcome(SURVIVAL, Some(3), 8, 6) };
    observe_new(&mut curriculum, &rehearsal);
    let found = &curriculum.mastery()[0];
    assert_eq!((found.level, found.n, found.low, found.mean), (Some(3), 1, 0.75, 1.75 / 3.0));
    for _ in 0..64 {
        observe_new(&mut curriculum, &outcome(SURVIVAL, Some(3), 1, 0));
    }
    let found = &curriculum.mastery()[0];
    assert_eq!((found.n, found.low, found.seen, found.mean), (64, 0.0, 65, 1.0 / 66.0));
    assert!(found.q10 < found.mean && found.mean < found.q90);
    observe_new(&mut curriculum, &GroupOutcome { evidence: None, ..outcome(SURVIVAL, Some(5), 1, 1) });
    observe_new(&mut curriculum, &outcome(SURVIVAL, None, 1, 1));
    let levels: Vec<_> = curriculum.mastery().iter().map(|found| found.level).collect();
    assert_eq!(levels, [None, Some(3)]);
}

#[test]
fn missing_outcomes_lower_mastery_and_widen_its_interval() {
    let mut curriculum = ladder();
    for at in 0..64 {
        let value = if at % 2 == 0 { interval(1, 1, 1) } else { SuccessInterval::MISSING };
        let shown = GroupOutcome { evidence: Some(value), ..outcome(SURVIVAL, Some(2), 1, 1) };
        observe_new(&mut curriculum, &shown);
    }
    let found = &curriculum.mastery()[0];
    assert_eq!((found.n, found.low, found.high, found.missing), (64, 32.0, 64.0, 0.5));
    assert!((found.mean - 0.5).abs() < 1e-12 && found.q10 < 0.5 && found.q90 > 0.99, "{found:?}");
}

#[test]
fn result_waits_for_the_slots_before_it() {
    let mut curriculum = ladder();
    let good = current_outcome(&curriculum, SURVIVAL, 1, 1);
    let numbered: Vec<GroupOutcome> =
        (0..64).map(|proposal| GroupOutcome { proposal, ..good.clone() }).collect();
    curriculum.open_slots(&numbered.iter().map(slot_of).collect::<Vec<_>>());
    // The trainer reports all groups but the first one.
    assert!(numbered[1..].iter().all(|outcome| curriculum.observe(outcome).moves.is_empty()));
    let status = survival_status(&curriculum);
    assert_eq!((status.blocks, status.block.unwrap().open, status.block.unwrap().waiting), (0, 1, 63));
    assert!(
        status.held_back.unwrap().starts_with("63 results wait for 1 leased scenario without"),
        "the run says why"
    );
    assert_eq!(curriculum.mastery()[0].n, 0);
    // The first group is missing in the end.
    let missing = GroupOutcome { evidence: Some(SuccessInterval::MISSING), ..numbered[0].clone() };
    assert_eq!(curriculum.observe(&missing).moves.len(), 1);
    // A later report of it changes nothing.
    let before = curriculum.snapshot();
    curriculum.observe(&numbered[0]);
    let after = curriculum.snapshot();
    assert_eq!((after.state, after.mastery), (before.state, before.mastery));
}

#[test]
fn status_says_how_missing_outcomes_hold_a_promotion_back() {
    let mut curriculum = ladder();
    for at in 0..32 {
        let value = if at < 25 { interval(1, 1, 1) } else { SuccessInterval::MISSING };
        let shown = GroupOutcome { evidence: Some(value), ..current_outcome(&curriculum, SURVIVAL, 1, 1) };
        observe_new(&mut curriculum, &shown);
    }
    let status = survival_status(&curriculum);
    let held_back = status.held_back.unwrap();
    assert!(held_back.starts_with("7 of 32 outcomes of the last block are missing"), "{held_back}");
    assert!(
        status.warnings[0].starts_with("7 of the last 32 outcomes at level 0 are"),
        "{:?}",
        status.warnings
    );
}

#[test]
fn restarted_evidence_keeps_the_level_and_drops_results() {
    for settings in [without_placement(&[SURVIVAL]), with_placement(&[SURVIVAL])] {
        let mut curriculum = Curriculum::new(1, settings).unwrap();
        let open = curriculum.propose();
        let slot = slot_of(&outcome_of(&open, 1, 1));
        curriculum.open_slots(std::slice::from_ref(&slot));
        let before = survival_status(&curriculum);
        curriculum.restart_evidence();
        let after = survival_status(&curriculum);
        assert_eq!((after.level, after.probe_level), (before.level, before.probe_level));
        assert_eq!(after.epoch, before.epoch + 1);
        assert!(!curriculum.is_current(open.seq, &open.proposal) && curriculum.mastery().is_empty());
        curriculum.observe(&outcome_of(&open, 1, 1));
        assert_eq!(survival_status(&curriculum).block.unwrap().n, 0);
        let next = curriculum.propose();
        assert!(curriculum.is_current(next.seq, &next.proposal));
    }
}

/// Outcomes of proposals that hold a param at its bound, one for each of `count` proposals; the values come from `value`.
fn observe_boundaries(curriculum: &mut Curriculum, count: usize, value: impl Fn(usize) -> SuccessInterval) {
    let mut observed = 0;
    while observed < count {
        let SequencedProposal { seq, proposal } = curriculum.propose();
        if proposal.role != ProposalRole::Boundary {
            continue;
        }
        let outcome = GroupOutcome {
            proposal: seq,
            level: None,
            role: ProposalRole::Boundary,
            evidence: Some(value(observed)),
            params: proposal.params,
            ..outcome(SURVIVAL, None, 1, 1)
        };
        curriculum.open_slots(&[slot_of(&outcome)]);
        curriculum.observe(&outcome);
        observed += 1;
    }
}

#[test]
fn adr_says_how_missing_outcomes_hold_a_bound_back() {
    let settings = Settings {
        strategy: StrategyKind::Adr,
        hyperparameters: Hyperparameters::defaults(StrategyKind::Adr),
        ..without_placement(&[SURVIVAL])
    };
    let mut curriculum = Curriculum::new(1, settings).unwrap();
    assert_eq!(survival_status(&curriculum).held_back, None);
    // Of ten episodes six succeed and three are missing.
    observe_boundaries(&mut curriculum, 400, |at| match at % 10 {
        0 => interval(1, 1, 0),
        5..=7 => SuccessInterval::MISSING,
        _ => interval(1, 1, 1),
    });
    let held_back = survival_status(&curriculum).held_back.unwrap();
    assert!(held_back.contains("outcomes of the last buffer at the bound of"), "{held_back}");
    assert!(held_back.contains("are missing: the worst case has a mean of 0."), "{held_back}");
}
