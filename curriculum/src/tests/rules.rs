//! The rules, one by one.

use super::*;

/// A frontier outcome of the level and epoch in force.
fn now(curriculum: &Curriculum, task: &str, finished: u32, successes: u32) -> GroupOutcome {
    let status = curriculum.status().into_iter().find(|status| status.task == task).unwrap();
    GroupOutcome { epoch: status.epoch, ..outcome(task, status.level, finished, successes) }
}

/// Fills a block, so many of 32 a success.
fn block(curriculum: &mut Curriculum, successes: u32) -> Vec<Move> {
    let first = now(curriculum, SURVIVAL, 1, 0);
    (0..32)
        .flat_map(|at| {
            let successes = u32::from(at < successes);
            curriculum.observe(&GroupOutcome { successes, ..first.clone() }).1
        })
        .collect()
}

fn survival(curriculum: &Curriculum) -> TaskStatus {
    curriculum.status().into_iter().find(|status| status.task == SURVIVAL).unwrap()
}

fn ladder() -> Curriculum {
    Curriculum::new(1, from_zero(&[SURVIVAL])).unwrap()
}

#[test]
fn two_blocks_of_26_are_promoted_and_of_25_are_not() {
    let mut curriculum = ladder();
    for _ in 0..10 {
        assert_eq!(block(&mut curriculum, 25), []);
        assert_eq!(block(&mut curriculum, 26), []);
    }
    let moves = block(&mut curriculum, 26);
    assert_eq!((moves[0].kind, moves[0].from, moves[0].to), (MoveKind::Up, Some(0), 1));
    let blocks = &moves[0].evidence.blocks;
    assert_eq!((blocks.len(), blocks[0].n, blocks[0].sum, blocks[1].mean), (2, 32, 26.0, 26.0 / 32.0));
    assert!(blocks[0].q10 >= 0.70 && blocks[0].q90 < 1.0);
    assert!(moves[0].evidence.sentence.contains("26.00 and 26.00 of 32"), "{}", moves[0].evidence.sentence);
    let back: Vec<Move> = serde_json::from_str(&serde_json::to_string(&moves).unwrap()).unwrap();
    assert_eq!(back, moves);
}

#[test]
fn a_move_clears_the_blocks() {
    let mut curriculum = ladder();
    block(&mut curriculum, 32);
    assert_eq!(block(&mut curriculum, 32).len(), 1);
    let status = survival(&curriculum);
    assert_eq!((status.level, status.epoch, status.blocks, status.block.unwrap().n), (Some(1), 1, 0, 0));
    // One good block after the move is not two.
    assert_eq!(block(&mut curriculum, 32), []);
    assert_eq!(block(&mut curriculum, 32).len(), 1);
    // And down again.
    assert_eq!(block(&mut curriculum, 6), []);
    let moves = block(&mut curriculum, 6);
    assert_eq!((moves[0].kind, moves[0].from, moves[0].to), (MoveKind::Down, Some(2), 1));
}

#[test]
fn levels_stop_at_the_ends_of_the_table_and_blocks_go_on() {
    let mut curriculum = ladder();
    for _ in 0..4 {
        assert_eq!(block(&mut curriculum, 0), []);
    }
    assert_eq!(survival(&curriculum).blocks, 4);
    assert_eq!(survival(&curriculum).next.unwrap().down, None);
    for level in 1..=9 {
        let moves = [block(&mut curriculum, 32), block(&mut curriculum, 32)].concat();
        assert_eq!(moves.last().map(|made| made.to), Some(level));
    }
    for _ in 0..4 {
        assert_eq!(block(&mut curriculum, 32), []);
    }
    let status = survival(&curriculum);
    assert_eq!((status.level, status.epoch, status.blocks), (Some(9), 9, 4));
    assert_eq!(status.next.unwrap().up, None);
}

#[test]
fn target_half_moves_after_one_block() {
    let settings = Settings { target: Target::Half, ..from_zero(&[SURVIVAL]) };
    let mut curriculum = Curriculum::new(1, settings).unwrap();
    assert_eq!(block(&mut curriculum, 22), []);
    let up = block(&mut curriculum, 23);
    assert_eq!((up[0].kind, up[0].to, up[0].evidence.blocks.len()), (MoveKind::Up, 1, 1));
    assert!(up[0].evidence.sentence.contains("no claim of mastery"));
    assert_eq!(block(&mut curriculum, 10), []);
    assert_eq!(block(&mut curriculum, 9)[0].kind, MoveKind::Down);
}

#[test]
fn only_contested_evidence_of_the_frontier_fills_a_block() {
    let mut curriculum = ladder();
    let good = now(&curriculum, SURVIVAL, 1, 1);
    let others = [
        GroupOutcome { evidence: false, ..good.clone() },
        GroupOutcome { contested: false, ..good.clone() },
        GroupOutcome { role: Role::Rehearsal, ..good.clone() },
        GroupOutcome { role: Role::Placement, ..good.clone() },
        GroupOutcome { epoch: 3, ..good.clone() },
        GroupOutcome { level: Some(1), ..good.clone() },
        GroupOutcome { finished: 0, successes: 0, failed: 1, ..good.clone() },
        GroupOutcome { task: ECO.to_owned(), ..good.clone() },
        GroupOutcome { task: "nobody/knows".to_owned(), level: Some(99), ..good.clone() },
    ];
    for other in others {
        curriculum.observe(&other);
        assert_eq!(survival(&curriculum).block.unwrap().n, 0, "{other:?}");
    }
    curriculum.observe(&good);
    assert_eq!(survival(&curriculum).block.unwrap().n, 1);
}

#[test]
fn an_outcome_of_an_old_epoch_fills_no_block_but_moves_its_own_mastery() {
    let mut curriculum = ladder();
    let old = now(&curriculum, SURVIVAL, 1, 1);
    // Up and down again: the same level, and yet another epoch.
    for successes in [32, 32, 0, 0] {
        block(&mut curriculum, successes);
    }
    assert_eq!((survival(&curriculum).level, survival(&curriculum).epoch), (Some(0), 2));
    let before = curriculum.mastery();
    curriculum.observe(&old);
    assert_eq!(survival(&curriculum).block.unwrap().n, 0);
    let after = curriculum.mastery();
    assert_eq!(after[0].seen, before[0].seen + 1);
    assert_eq!(after[1], before[1]);
}

#[test]
fn mastery_is_the_posterior_of_the_last_64_contested_scenarios() {
    let mut curriculum = ladder();
    assert_eq!(curriculum.mastery(), []);
    curriculum.observe(&GroupOutcome { role: Role::Rehearsal, ..outcome(SURVIVAL, Some(3), 8, 6) });
    let found = &curriculum.mastery()[0];
    assert_eq!((found.level, found.n, found.sum, found.mean), (Some(3), 1, 0.75, 1.75 / 3.0));
    for _ in 0..64 {
        curriculum.observe(&outcome(SURVIVAL, Some(3), 1, 0));
    }
    let found = &curriculum.mastery()[0];
    assert_eq!((found.n, found.sum, found.seen, found.mean), (64, 0.0, 65, 1.0 / 66.0));
    assert!(found.q10 < found.mean && found.mean < found.q90);
    curriculum.observe(&GroupOutcome { contested: false, ..outcome(SURVIVAL, Some(4), 1, 1) });
    curriculum.observe(&GroupOutcome { evidence: false, ..outcome(SURVIVAL, Some(5), 1, 1) });
    curriculum.observe(&outcome(SURVIVAL, None, 1, 1));
    let levels: Vec<_> = curriculum.mastery().iter().map(|found| found.level).collect();
    assert_eq!(levels, [None, Some(3)]);
}

#[test]
fn a_block_with_too_many_lost_episodes_does_not_count() {
    let mut curriculum = ladder();
    block(&mut curriculum, 32);
    for lost in [3, 4] {
        let gone =
            GroupOutcome { finished: 0, successes: 0, expired: lost, ..now(&curriculum, SURVIVAL, 1, 0) };
        curriculum.observe(&gone);
        let moves = block(&mut curriculum, 32);
        // 3 of 35 are 8.6 %: two good blocks running. 4 of 36 are 11 %.
        assert_eq!(moves.len(), usize::from(lost == 3), "{lost}");
        assert_eq!(survival(&curriculum).discarded, u32::from(lost == 4));
    }
    let status = survival(&curriculum);
    assert!(status.warnings[0].starts_with("1 block at this level was discarded"), "{:?}", status.warnings);
    assert!(status.warnings[0].contains("4 of 36"), "{:?}", status.warnings);
}

#[test]
fn placement_serves_contested_scenarios_of_the_probed_level_only() {
    let mut run = Simulation::new(3, placed(&[SURVIVAL]));
    let mut epochs = Vec::new();
    while run.moves.is_empty() {
        let status = run.status(SURVIVAL);
        assert_eq!((status.level, status.placed), (Some(0), false));
        let outcome = run.step(&mut |_, _| 1.0).unwrap();
        assert_eq!((outcome.role, outcome.contested, outcome.level), (Role::Placement, true, status.probing));
        epochs.push((outcome.epoch, outcome.level.unwrap()));
    }
    epochs.dedup();
    assert_eq!(epochs, [(0, 4), (1, 7), (2, 8), (3, 9)]);
    let status = run.status(SURVIVAL);
    assert_eq!((status.level, status.placed, status.probing, status.epoch), (Some(9), true, None, 4));
    let evidence = &run.moves[0].evidence;
    assert_eq!((evidence.probes.len(), evidence.blocks.len()), (4, 0));
}

#[test]
fn proposals_leased_beyond_a_probe_update_mastery_only() {
    let mut curriculum = Curriculum::new(3, placed(&[SURVIVAL])).unwrap();
    let leased: Vec<_> = (0..40).map(|_| curriculum.propose()).collect();
    assert!(leased.iter().all(|(_, proposal)| proposal.level == Some(4) && proposal.epoch == 0));
    for (seq, proposal) in &leased {
        curriculum.observe(&answer(*seq, proposal, 1, 0));
    }
    let status = survival(&curriculum);
    assert_eq!((status.probing, status.epoch, status.blocks), (Some(1), 1, 1));
    assert_eq!((curriculum.mastery()[0].seen, curriculum.mastery().len()), (40, 1));
    assert!(!curriculum.is_current(leased[39].0, &leased[39].1));
    let (seq, next) = curriculum.propose();
    assert!(curriculum.is_current(seq, &next));
}

#[test]
fn after_placement_shares_are_those_of_the_settings() {
    let mut run = Simulation::new(11, placed(&[SURVIVAL]));
    while run.moves.is_empty() {
        run.step(&mut curve_to_6);
    }
    assert_eq!(run.level(SURVIVAL), 6);
    let (n, mut contested, mut frontier, mut below) = (20_000u32, 0u32, 0u32, [0u32; 10]);
    for _ in 0..n {
        let (_, proposal) = run.curriculum.propose();
        contested += u32::from(proposal.contested);
        match proposal.role {
            Role::Frontier => {
                assert_eq!(proposal.level, Some(6));
                frontier += 1;
            }
            Role::Rehearsal => below[proposal.level.unwrap() as usize] += 1,
            other => panic!("{other:?}"),
        }
        let params = run.curriculum.settings().tasks[0].params(proposal.level);
        assert_eq!(proposal.params, params);
    }
    // Standard deviations 71, 65 and 37: five of them.
    assert!(contested.abs_diff(n / 2) < 355, "{contested}");
    assert!(frontier.abs_diff(n * 7 / 10) < 325, "{frontier}");
    assert!(below[2..=5].iter().all(|count| count.abs_diff(1500) < 187), "{below:?}");
    assert_eq!(below[..2].iter().chain(&below[6..]).sum::<u32>(), 0);
}

fn curve_to_6(proposal: &Proposal, _: &mut Draws) -> f64 {
    f64::from(u8::from(proposal.level <= Some(6)))
}

#[test]
fn at_the_bottom_everything_is_frontier_and_rehearsal_stays_in_the_table() {
    let mut curriculum = ladder();
    assert!((0..500).all(|_| curriculum.propose().1.role == Role::Frontier));
    block(&mut curriculum, 32);
    block(&mut curriculum, 32);
    let levels: std::collections::BTreeSet<_> = (0..500).map(|_| curriculum.propose().1.level).collect();
    assert_eq!(levels, [Some(0), Some(1)].into());
}

#[test]
fn uniform_draws_every_level_as_it_comes_and_nothing_moves() {
    let settings = placed(&[SURVIVAL]).by(StrategyKind::Uniform);
    let mut run = Simulation::new(2, settings);
    let mut levels = [0u32; 10];
    for _ in 0..10_000 {
        let outcome = run.step(&mut |_, _| 1.0).unwrap();
        assert_eq!((outcome.role, outcome.contested, outcome.epoch), (Role::Sample, false, 0));
        levels[outcome.level.unwrap() as usize] += 1;
    }
    // Standard deviation 30: five of them.
    assert!(levels.iter().all(|count| count.abs_diff(1000) < 150), "{levels:?}");
    assert_eq!(run.moves, []);
    // Found contested, it tells of mastery all the same.
    run.curriculum.observe(&GroupOutcome { role: Role::Sample, ..outcome(SURVIVAL, Some(2), 1, 1) });
    assert_eq!(run.curriculum.mastery()[0].n, 1);
    assert_eq!(run.status(SURVIVAL).level, None);
}

#[test]
fn fixed_takes_the_tasks_in_turn_at_their_defaults() {
    let settings = placed(&[SURVIVAL, ECO, RENDEZVOUS]).by(StrategyKind::Fixed);
    let mut curriculum = Curriculum::new(2, settings.clone()).unwrap();
    for turn in 0..30 {
        let (_, proposal) = curriculum.propose();
        let plan = &settings.tasks[turn % 3];
        assert_eq!(
            (&proposal.task, proposal.level, &proposal.params),
            (&plan.task, None, &plan.default_params)
        );
        assert_eq!((proposal.role, proposal.contested), (Role::Sample, false));
    }
}

#[test]
fn a_level_is_its_row_over_the_defaults() {
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
fn settings_that_cannot_be_name_the_field() {
    let check = |wanted: &str, change: &dyn Fn(&mut Settings)| {
        let mut settings = placed(&[SURVIVAL, ECO]);
        change(&mut settings);
        let error = Curriculum::new(1, settings).unwrap_err();
        assert!(error.field.starts_with(wanted), "{error}");
    };
    check("tasks", &|settings| settings.tasks.clear());
    check("tasks.1.task", &|settings| settings.tasks[1].task = SURVIVAL.to_owned());
    check("tasks.0.task", &|settings| settings.tasks[0].task = "nobody/knows".to_owned());
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
fn settings_come_back_from_json_to_the_bit_and_bad_ones_do_not() {
    let mut settings = placed(&[SURVIVAL, RENDEZVOUS]);
    settings.contested_share = 0.1 + 0.2;
    let json = serde_json::to_string(&settings).unwrap();
    assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings);
    let mut stored = StoredSettings::from(settings);
    stored.tasks[1].task = "nobody/knows".to_owned();
    let error = Settings::try_from(stored.clone()).unwrap_err();
    assert_eq!(error.field, "tasks.1.task");
    assert!(error.reason.contains("known are kessler/survival"), "{error}");
    stored.tasks[1].task = SURVIVAL.to_owned();
    stored.tasks[1].columns[0] = "nothing".to_owned();
    assert_eq!(Settings::try_from(stored).unwrap_err().field, "tasks.1.levels");
}

#[test]
fn a_curriculum_explains_itself() {
    let mut curriculum = ladder();
    block(&mut curriculum, 32);
    block(&mut curriculum, 32);
    let explanation = curriculum.explain();
    assert_eq!((explanation.strategy.as_str(), explanation.tasks[0].share), ("ladder", 1.0));
    assert!(explanation.tasks[0].last_move.as_ref().unwrap().contains("32.00 and 32.00 of 32"));
    assert!(explanation.rules.iter().any(|rule| rule.contains("70 %")), "{:?}", explanation.rules);
    for strategy in StrategyKind::ALL {
        let other = Curriculum::new(1, placed(&[SURVIVAL, ECO]).by(strategy)).unwrap().explain();
        assert_eq!((other.strategy, other.tasks.len()), (strategy.to_string(), 2));
        assert!(!other.rules.is_empty() && other.tasks.iter().all(|task| !task.now.is_empty()), "{strategy}");
        let shares: f64 = other.tasks.iter().map(|task| task.share).sum();
        assert!((shares - 1.0).abs() < 1e-9, "{strategy}");
    }
}
