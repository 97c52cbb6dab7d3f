//! Laws of the samplers, with learners whose success depends on the rung alone.

use env_core::keyed_rng::RngPurpose;
use env_core::space::START_SCALE;

use super::*;
use crate::core::settings::StrategyKind;
use crate::{Curriculum, SequencedProposal};

const DOCKING: &str = "docking/single";
const SURVIVAL: &str = "kessler/survival";

/// Group of a simulated run.
struct FlownGroup {
    rung: u32,
    role: ProposalRole,
    steps: u64,
    proposal: Proposal,
}

fn settings(strategy: StrategyKind, task: &str) -> Settings {
    Settings::ladder(vec![TaskPlan::standard(task).unwrap()]).with_strategy(strategy)
}

/// Runs groups of one episode, which succeed with a probability and last a number of steps that the rung determines. Each is
/// reported after `lag` later ones were proposed.
fn run(
    settings: &Settings,
    groups: usize,
    lag: usize,
    episode: impl Fn(u32) -> (f64, u64),
) -> (Curriculum, Vec<FlownGroup>) {
    let mut curriculum = Curriculum::new(5, settings.clone()).unwrap();
    let plan = &settings.tasks[0];
    let mut rng = KeyedRng::new(RngPurpose::Simulation, 5, 5);
    let mut flown = Vec::new();
    let mut waiting = std::collections::VecDeque::new();
    while flown.len() < groups {
        while waiting.len() <= lag {
            waiting.push_back(curriculum.propose());
        }
        let Some(SequencedProposal { seq, proposal }) = waiting.pop_front() else { break };
        let rung = RungScale::new(plan).rung(proposal.start_rung, proposal.level).unwrap();
        let (success, steps) = episode(rung);
        let successes = u32::from(rng.bernoulli(success));
        curriculum.observe(&GroupOutcome {
            successes,
            finished: 1,
            usable: true,
            evidence: None,
            steps,
            ..GroupOutcome::missing(seq, 0, &proposal)
        });
        flown.push(FlownGroup { rung, role: proposal.role, steps, proposal });
    }
    (curriculum, flown)
}

/// Success of one half at rung 6, and a rung more or less changes the odds by a factor of e.
fn half_at_six(rung: u32) -> (f64, u64) {
    (1.0 / (1.0 + libm::exp(f64::from(rung) - 6.0)), 10)
}

fn mean_rung(flown: &[FlownGroup]) -> f64 {
    let trained: Vec<f64> = flown
        .iter()
        .filter(|group| group.role == ProposalRole::Rung)
        .map(|group| f64::from(group.rung))
        .collect();
    trained.iter().sum::<f64>() / trained.len() as f64
}

/// With and without proposals that wait for their results.
#[test]
fn samplers_settle_where_half_of_the_episodes_succeed() {
    for strategy in [StrategyKind::Staircase, StrategyKind::Controller, StrategyKind::Auto] {
        for lag in [0, 200] {
            let (_, flown) = run(&settings(strategy, DOCKING), 6000, lag, half_at_six);
            let mean = mean_rung(&flown[4000..]);
            assert!((5.0..=7.0).contains(&mean), "{strategy} with {lag}: {mean}");
            // They begin at the easiest rung.
            assert!(flown[..20].iter().all(|group| group.rung <= 2), "{strategy}");
        }
    }
}

/// So `auto` cannot be worse there than uniform levels, but for noise.
#[test]
fn auto_proposes_as_uniform_where_its_table_names_it() {
    for task in ["kessler/rendezvous", "kessler/eco_station", "kessler/formation", "tasking/imaging"] {
        assert_eq!(scenarios(StrategyKind::Auto, task), scenarios(StrategyKind::Uniform, task), "{task}");
    }
    assert_ne!(scenarios(StrategyKind::Auto, SURVIVAL), scenarios(StrategyKind::Uniform, SURVIVAL));
}

/// Level, contest and params of a proposed scenario. A full start is no param.
type ProposedScenario = (Option<u32>, bool, Vec<(String, f64)>);

/// Scenarios of 500 groups, each of which fails before the next is proposed.
fn scenarios(strategy: StrategyKind, task: &str) -> Vec<ProposedScenario> {
    let mut curriculum = Curriculum::new(5, settings(strategy, task)).unwrap();
    let mut groups = Vec::new();
    for _ in 0..500 {
        let SequencedProposal { seq, proposal } = curriculum.propose();
        let outcome = GroupOutcome::missing(seq, 0, &proposal);
        curriculum.observe(&GroupOutcome { finished: 1, usable: true, evidence: None, steps: 10, ..outcome });
        let is_scaled = |(name, value): &(String, f64)| name != START_SCALE.name || *value < 1.0;
        let params = proposal.params.into_iter().filter(is_scaled).collect();
        groups.push((proposal.level, proposal.contested, params));
    }
    groups
}

#[test]
fn bandit_prefers_rungs_with_both_results() {
    let (_, flown) = run(&settings(StrategyKind::Bandit, DOCKING), 6000, 0, half_at_six);
    let share = |rungs: std::ops::RangeInclusive<u32>| {
        flown[3000..].iter().filter(|group| rungs.contains(&group.rung)).count() as f64 / 3000.0
    };
    assert!(share(5..=7) > 2.0 * share(0..=2), "{} {}", share(5..=7), share(0..=2));
    assert!((0..16).all(|rung| share(rung..=rung) > 0.005));
}

#[test]
fn learner_that_never_succeeds_stays_at_the_easiest_rung() {
    for strategy in [StrategyKind::Staircase, StrategyKind::Controller] {
        let (curriculum, flown) = run(&settings(strategy, DOCKING), 2000, 0, |_| (0.0, 10));
        assert!(mean_rung(&flown) < 1.0, "{strategy}");
        assert_eq!(curriculum.samplers()[0].rungs.len(), 16);
    }
}

#[test]
fn learner_that_always_succeeds_meets_all_rungs() {
    let (curriculum, flown) = run(&settings(StrategyKind::Staircase, DOCKING), 20_000, 0, |_| (1.0, 10));
    let late = &flown[10_000..];
    for rung in 0..16_u32 {
        let share = late.iter().filter(|group| group.rung == rung).count() as f64 / late.len() as f64;
        // A chain begins at a random rung and climbs past all above it.
        let expected = f64::from(rung + 1) / 136.0;
        assert!((0.6 * expected..1.4 * expected).contains(&share), "rung {rung}: {share}");
    }
    assert!(curriculum.samplers()[0].quartiles.is_some());
    let (_, flown) = run(&settings(StrategyKind::Controller, DOCKING), 4000, 0, |_| (1.0, 10));
    assert!(mean_rung(&flown[3000..]) > 14.0);
}

/// Episodes of hard rungs last thirty times as long, but have 3 % of the steps.
#[test]
fn coverage_has_its_share_of_the_steps() {
    let length = |rung: u32| (0.0, 40 + 80 * u64::from(rung));
    for strategy in [StrategyKind::Staircase, StrategyKind::Controller] {
        let (_, flown) = run(&settings(strategy, DOCKING), 20_000, 0, length);
        let steps = |groups: &mut dyn Iterator<Item = &FlownGroup>| {
            groups.map(|group| group.steps).sum::<u64>() as f64
        };
        let covered = steps(&mut flown.iter().filter(|group| group.role == ProposalRole::Coverage));
        let share = covered / steps(&mut flown.iter());
        assert!((0.02..0.04).contains(&share), "{strategy}: {share}");
    }
}

/// Chains at rungs with long episodes are drawn less often, so that all chains have equal shares of the steps.
#[test]
fn chains_have_equal_shares_of_the_steps() {
    let episode = |rung: u32| (if rung < 8 { 0.9 } else { 0.1 }, 10 + 90 * u64::from(rung));
    let (_, flown) = run(&settings(StrategyKind::Staircase, DOCKING), 40_000, 0, episode);
    let mut steps = vec![0.0; 32];
    for group in flown[20_000..].iter().filter(|group| group.role == ProposalRole::Rung) {
        steps[group.proposal.chain.unwrap() as usize] += group.steps as f64;
    }
    let mean = steps.iter().sum::<f64>() / 32.0;
    assert!(steps.iter().all(|share| (0.8 * mean..1.2 * mean).contains(share)), "{steps:?}");
}

#[test]
fn start_rungs_scale_starts_at_levels_drawn_uniformly() {
    let (_, flown) = run(&settings(StrategyKind::Staircase, DOCKING), 4000, 0, half_at_six);
    let (rungs, plan) =
        (env_core::task(DOCKING).unwrap().start_rungs(), TaskPlan::standard(DOCKING).unwrap());
    let mut levels = vec![0.0; 10];
    for FlownGroup { rung, proposal, .. } in &flown {
        let scale = proposal.params.iter().find(|(name, _)| name == "start_scale").unwrap().1;
        assert_eq!((proposal.start_rung, scale), (Some(*rung), rungs[*rung as usize]));
        assert_eq!(proposal.has_full_start(), *rung == 15);
        assert!(!proposal.contested);
        let rest = |params: &[(String, f64)]| {
            params.iter().filter(|(name, _)| name != "start_scale").cloned().collect::<Vec<_>>()
        };
        let level = (0..10).find(|level| rest(&plan.params(Some(*level))) == rest(&proposal.params)).unwrap();
        levels[level as usize] += 1.0 / 4000.0;
        // Easier starts belong to no level.
        assert_eq!(proposal.level, Some(level).filter(|_| *rung == 15));
    }
    assert!(levels.iter().all(|share| (0.07..0.13).contains(share)), "{levels:?}");
}

#[test]
fn levels_are_the_rungs_of_a_task_without_start_rungs() {
    let (_, flown) = run(&settings(StrategyKind::Staircase, SURVIVAL), 2000, 0, half_at_six);
    for FlownGroup { rung, role, proposal, .. } in &flown {
        assert_eq!((proposal.level, proposal.start_rung), (Some(*rung), None));
        assert!(proposal.has_full_start());
        // A blind plan can succeed in survival, so what is trained must be contested.
        assert_eq!(proposal.contested, *role == ProposalRole::Rung);
    }
}

/// A table of levels that scales starts by itself leaves nothing to the start rungs.
#[test]
fn own_start_scales_replace_the_start_rungs() {
    let mut plan = TaskPlan::standard(DOCKING).unwrap();
    let spec = env_core::task(DOCKING).unwrap();
    let rows = vec![vec![0.1], vec![0.5], vec![1.0]];
    plan.levels = env_core::space::Levels::new(spec.params(), vec!["start_scale".to_owned()], rows).unwrap();
    assert!(!RungScale::new(&plan).are_starts());
    let mut scaled = TaskPlan::standard(DOCKING).unwrap();
    scaled
        .default_params
        .iter_mut()
        .filter(|(name, _)| name == "start_scale")
        .for_each(|(_, value)| *value = 0.5);
    assert_eq!((RungScale::new(&scaled).are_starts(), RungScale::new(&scaled).top()), (false, 9));
}

#[test]
fn auto_names_the_reason_for_each_task() {
    for task in env_core::tasks() {
        let curriculum = Curriculum::new(1, settings(StrategyKind::Auto, task.id())).unwrap();
        let state = curriculum.explain().tasks[0].current_state.clone();
        assert!(state.contains("because"), "{}: {state}", task.id());
        let name = match task.id() {
            DOCKING | SURVIVAL => "staircase",
            "docking/multiagent" | "tasking/scanning" => "bandit",
            _ => "uniform",
        };
        assert!(state.starts_with(name), "{}: {state}", task.id());
    }
}
