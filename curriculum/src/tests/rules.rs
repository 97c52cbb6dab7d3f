//! Tests of single rules.

use super::*;

#[test]
fn two_blocks_of_26_move_up_and_of_25_do_not() {
    let mut curriculum = ladder();
    for _ in 0..10 {
        assert_eq!(fill_block(&mut curriculum, 25), []);
        assert_eq!(fill_block(&mut curriculum, 26), []);
    }
    let moves = fill_block(&mut curriculum, 26);
    assert_eq!((moves[0].kind, moves[0].from, moves[0].to), (MoveKind::Up, Some(0), 1));
    let blocks = &moves[0].evidence.blocks;
    assert_eq!((blocks.len(), blocks[0].n, blocks[0].low, blocks[1].mean), (2, 32, 26.0, 26.0 / 32.0));
    assert!(blocks[0].q10 >= 0.70 && blocks[0].q90 < 1.0);
    assert!(moves[0].evidence.sentence.contains("26.00 and 26.00 of 32"), "{}", moves[0].evidence.sentence);
    let back: Vec<LevelMove> = serde_json::from_str(&serde_json::to_string(&moves).unwrap()).unwrap();
    assert_eq!(back, moves);
}

#[test]
fn move_clears_the_blocks() {
    let mut curriculum = ladder();
    fill_block(&mut curriculum, 32);
    assert_eq!(fill_block(&mut curriculum, 32).len(), 1);
    let status = survival_status(&curriculum);
    assert_eq!((status.level, status.epoch, status.blocks, status.block.unwrap().n), (Some(1), 1, 0, 0));
    // The block before the move does not count for the next one.
    assert_eq!(fill_block(&mut curriculum, 32), []);
    assert_eq!(fill_block(&mut curriculum, 32).len(), 1);
    // And down again.
    assert_eq!(fill_block(&mut curriculum, 6), []);
    let moves = fill_block(&mut curriculum, 6);
    assert_eq!((moves[0].kind, moves[0].from, moves[0].to), (MoveKind::Down, Some(2), 1));
}

#[test]
fn levels_stop_at_the_ends_of_the_table() {
    let mut curriculum = ladder();
    for _ in 0..4 {
        assert_eq!(fill_block(&mut curriculum, 0), []);
    }
    assert_eq!(survival_status(&curriculum).blocks, 4);
    assert_eq!(survival_status(&curriculum).move_conditions.unwrap().down, None);
    for level in 1..=9 {
        let moves = [fill_block(&mut curriculum, 32), fill_block(&mut curriculum, 32)].concat();
        assert_eq!(moves.last().map(|made| made.to), Some(level));
    }
    for _ in 0..4 {
        assert_eq!(fill_block(&mut curriculum, 32), []);
    }
    let status = survival_status(&curriculum);
    assert_eq!((status.level, status.epoch, status.blocks), (Some(9), 9, 4));
    assert_eq!(status.move_conditions.unwrap().up, None);
}

#[test]
fn target_half_moves_after_one_block() {
    let settings = Settings { target: Target::Half, ..without_placement(&[SURVIVAL]) };
    let mut curriculum = Curriculum::new(1, settings).unwrap();
    assert_eq!(fill_block(&mut curriculum, 22), []);
    let up = fill_block(&mut curriculum, 23);
    assert_eq!((up[0].kind, up[0].to, up[0].evidence.blocks.len()), (MoveKind::Up, 1, 1));
    assert!(up[0].evidence.sentence.contains("no claim of mastery"));
    assert_eq!(fill_block(&mut curriculum, 10), []);
    assert_eq!(fill_block(&mut curriculum, 9)[0].kind, MoveKind::Down);
}

#[test]
fn placement_proposes_contested_scenarios_of_its_probe() {
    let mut run = TrainingRun::new(3, with_placement(&[SURVIVAL]));
    let mut epochs = Vec::new();
    while run.moves.is_empty() {
        let status = run.status(SURVIVAL);
        assert_eq!((status.level, status.placement_done), (Some(0), false));
        let outcome = run.step(&mut |_, _| 1.0).unwrap();
        assert_eq!(
            (outcome.role, outcome.contested, outcome.level),
            (ProposalRole::Placement, true, status.probe_level)
        );
        epochs.push((outcome.epoch, outcome.level.unwrap()));
    }
    epochs.dedup();
    assert_eq!(epochs, [(0, 4), (1, 7), (2, 8), (3, 9)]);
    let status = run.status(SURVIVAL);
    assert_eq!(
        (status.level, status.placement_done, status.probe_level, status.epoch),
        (Some(9), true, None, 4)
    );
    let evidence = &run.moves[0].evidence;
    assert_eq!((evidence.probes.len(), evidence.blocks.len()), (4, 0));
}

#[test]
fn proposals_leased_beyond_a_probe_count_for_mastery_only() {
    let mut curriculum = Curriculum::new(3, with_placement(&[SURVIVAL])).unwrap();
    let leased: Vec<_> = (0..40).map(|_| curriculum.propose()).collect();
    assert!(leased.iter().all(|next| next.proposal.level == Some(4) && next.proposal.epoch == 0));
    let slots: Vec<Slot> = leased.iter().map(|next| slot_of(&outcome_of(next, 1, 0))).collect();
    curriculum.open_slots(&slots);
    for proposed in &leased {
        curriculum.observe(&outcome_of(proposed, 1, 0));
    }
    let status = survival_status(&curriculum);
    assert_eq!((status.probe_level, status.epoch, status.blocks), (Some(1), 1, 1));
    assert_eq!((curriculum.mastery()[0].seen, curriculum.mastery().len()), (40, 1));
    assert!(!curriculum.is_current(leased[39].seq, &leased[39].proposal));
    let next = curriculum.propose();
    assert!(curriculum.is_current(next.seq, &next.proposal));
}

#[test]
fn ladder_shares_follow_the_settings() {
    let mut run = TrainingRun::new(11, with_placement(&[SURVIVAL]));
    while run.moves.is_empty() {
        run.step(&mut curve_to_6);
    }
    assert_eq!(run.level(SURVIVAL), 6);
    let (n, mut contested, mut frontier, mut below) = (20_000u32, 0u32, 0u32, [0u32; 10]);
    for _ in 0..n {
        let SequencedProposal { proposal, .. } = run.curriculum.propose();
        contested += u32::from(proposal.contested);
        match proposal.role {
            ProposalRole::Frontier => {
                assert_eq!(proposal.level, Some(6));
                frontier += 1;
            }
            ProposalRole::Rehearsal => below[proposal.level.unwrap() as usize] += 1,
            other => panic!("{other:?}"),
        }
        let params = run.curriculum.settings().tasks[0].params(proposal.level);
        assert_eq!(proposal.params, params);
    }
    // Five standard deviations of 71, 65 and 37.
    assert!(contested.abs_diff(n / 2) < 355, "{contested}");
    assert!(frontier.abs_diff(n * 7 / 10) < 325, "{frontier}");
    assert!(below[2..=5].iter().all(|count| count.abs_diff(1500) < 187), "{below:?}");
    assert_eq!(below[..2].iter().chain(&below[6..]).sum::<u32>(), 0);
}

fn curve_to_6(proposal: &Proposal, _: &mut KeyedRng) -> f64 {
    f64::from(u8::from(proposal.level <= Some(6)))
}

#[test]
fn level_0_has_no_rehearsal_and_level_1_rehearses_it() {
    let mut curriculum = ladder();
    assert!((0..500).all(|_| curriculum.propose().proposal.role == ProposalRole::Frontier));
    fill_block(&mut curriculum, 32);
    fill_block(&mut curriculum, 32);
    let levels: std::collections::BTreeSet<_> =
        (0..500).map(|_| curriculum.propose().proposal.level).collect();
    assert_eq!(levels, [Some(0), Some(1)].into());
}

#[test]
fn uniform_draws_every_level_and_never_moves() {
    let settings = with_placement(&[SURVIVAL]).with_strategy(StrategyKind::Uniform);
    let mut run = TrainingRun::new(2, settings);
    let mut levels = [0u32; 10];
    for _ in 0..10_000 {
        let outcome = run.step(&mut |_, _| 1.0).unwrap();
        assert_eq!((outcome.role, outcome.contested, outcome.epoch), (ProposalRole::Sample, false, 0));
        levels[outcome.level.unwrap() as usize] += 1;
    }
    // Five standard deviations of 30.
    assert!(levels.iter().all(|count| count.abs_diff(1000) < 150), "{levels:?}");
    assert_eq!(run.moves, []);
    // A scenario that turns out to be contested counts for mastery.
    let contested = GroupOutcome { role: ProposalRole::Sample, ..outcome(SURVIVAL, Some(2), 1, 1) };
    observe_new(&mut run.curriculum, &contested);
    assert_eq!(run.curriculum.mastery()[0].n, 1);
    assert_eq!(run.status(SURVIVAL).level, None);
}

#[test]
fn fixed_takes_the_tasks_in_turn_at_default_params() {
    let settings = with_placement(&[SURVIVAL, ECO, RENDEZVOUS]).with_strategy(StrategyKind::Fixed);
    let mut curriculum = Curriculum::new(2, settings.clone()).unwrap();
    for turn in 0..30 {
        let SequencedProposal { proposal, .. } = curriculum.propose();
        let plan = &settings.tasks[turn % 3];
        assert_eq!(
            (&proposal.task, proposal.level, &proposal.params),
            (&plan.task, None, &plan.default_params)
        );
        assert_eq!((proposal.role, proposal.contested), (ProposalRole::Sample, false));
    }
}

#[test]
fn params_of_a_level_override_the_defaults() {
    let mut plan = TaskPlan::standard(SURVIVAL).unwrap();
    plan.default_params = vec![("rogue_speed".to_owned(), 0.7), ("fuel".to_owned(), 3.0)];
    let params = plan.params(Some(0));
    assert!(
        params.contains(&("rogue_speed".to_owned(), 0.7)) && params.contains(&("fuel".to_owned(), 100.0))
    );
    assert_eq!(params.len(), 5);
    assert_eq!(plan.params(None), plan.default_params);
}

#[test]
fn invalid_settings_error_names_the_field() {
    let check = |wanted: &str, change: &dyn Fn(&mut Settings)| {
        let mut settings = with_placement(&[SURVIVAL, ECO]);
        change(&mut settings);
        let error = Curriculum::new(1, settings).unwrap_err();
        assert!(error.field.starts_with(wanted), "{error}");
    };
    check("tasks", &|settings| settings.tasks.clear());
    check("tasks.1.task", &|settings| settings.tasks[1].task = SURVIVAL.to_owned());
    check("tasks.0.task", &|settings| settings.tasks[0].task = "unknown/task".to_owned());
    check("contested_share", &|settings| settings.contested_share = f64::NAN);
    check("frontier_share", &|settings| settings.frontier_share = 1.1);
    for weight in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        check("tasks.1.weight", &|settings| settings.tasks[1].weight = weight);
    }
    let defaults = |pairs: &[(&str, f64)]| pairs.iter().map(|&(n, v)| (n.to_owned(), v)).collect::<Vec<_>>();
    let bad: [&[(&str, f64)]; 3] = [&[("fule", 1.0)], &[("fuel", 1e9)], &[("fuel", 1.0), ("fuel", 1.0)]];
    for pairs in bad {
        check("tasks.0.default_params.fu", &|settings| settings.tasks[0].default_params = defaults(pairs));
    }
}

#[test]
fn settings_round_trip_through_json_exactly() {
    let mut settings = with_placement(&[SURVIVAL, RENDEZVOUS]);
    settings.contested_share = 0.1 + 0.2;
    let json = serde_json::to_string(&settings).unwrap();
    assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings);
    let mut stored = StoredSettings::from(settings);
    stored.tasks[1].task = "unknown/task".to_owned();
    let error = Settings::try_from(stored.clone()).unwrap_err();
    assert_eq!(error.field, "tasks.1.task");
    assert!(error.reason.contains("must be one of kessler/survival"), "{error}");
    stored.tasks[1].task = SURVIVAL.to_owned();
    stored.tasks[1].columns[0] = "nothing".to_owned();
    assert_eq!(Settings::try_from(stored).unwrap_err().field, "tasks.1.levels.columns.nothing");
}

#[test]
fn explanation_covers_every_strategy() {
    let mut curriculum = ladder();
    fill_block(&mut curriculum, 32);
    fill_block(&mut curriculum, 32);
    let explanation = curriculum.explain();
    assert_eq!((explanation.strategy.as_str(), explanation.tasks[0].share), ("ladder", 1.0));
    assert!(explanation.tasks[0].last_move.as_ref().unwrap().contains("32.00 and 32.00 of 32"));
    assert!(explanation.rules.iter().any(|rule| rule.contains("70 %")), "{:?}", explanation.rules);
    for strategy in StrategyKind::ALL {
        let other =
            Curriculum::new(1, with_placement(&[SURVIVAL, ECO]).with_strategy(strategy)).unwrap().explain();
        assert_eq!((other.strategy, other.tasks.len()), (strategy.to_string(), 2));
        assert!(
            !other.rules.is_empty() && other.tasks.iter().all(|task| !task.current_state.is_empty()),
            "{strategy}"
        );
        let shares: f64 = other.tasks.iter().map(|task| task.share).sum();
        assert!((shares - 1.0).abs() < 1e-9, "{strategy}");
    }
}
