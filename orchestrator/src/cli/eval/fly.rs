//! What policies earn, scenario by scenario.

use anyhow::Context;
use env_core::bracket::success;
use env_core::{Flown, SuccessRule, rollout};
use indicatif::ProgressBar;
use rayon::prelude::*;

use crate::cli::bootstrap::column_means;
use crate::cli::suite::{Entry, Suite};

/// Score, success, skill (where defined), share of agents lost, fuel used.
pub(super) type Measures = [Option<f64>; 5];

/// One policy.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    pub(super) policy: String,
    /// One per scenario, in the suite's order.
    pub(super) measures: Vec<Measures>,
}

/// Flies a policy on every scenario: `rollouts` times where its actions are drawn.
pub(super) fn fly(
    suite: &Suite,
    policy: &str,
    seed: u64,
    rollouts: u32,
    bar: &ProgressBar,
) -> anyhow::Result<Row> {
    let entries: Vec<&Entry> = suite.entries().collect();
    let measures = entries
        .into_par_iter()
        .map(|entry| {
            let mut specs = entry.scenario.task().policies().iter();
            let drawn = specs.any(|spec| spec.name == policy && spec.chance);
            let flown: anyhow::Result<Vec<Measures>> = (0..if drawn { rollouts } else { 1 })
                .map(|rollout| fly_once(entry, policy, seed, rollout))
                .collect();
            bar.inc(1);
            Ok(mean(&flown?))
        })
        .collect::<anyhow::Result<_>>()?;
    Ok(Row { policy: policy.to_owned(), measures })
}

fn fly_once(entry: &Entry, policy: &str, seed: u64, rollout: u32) -> anyhow::Result<Measures> {
    let scenario = &entry.scenario;
    let context = || format!("{policy} on scenario {}", scenario.id());
    let seed = policy_seed(seed, policy, entry, rollout);
    let mut pilot = scenario.task().policy(policy, scenario, seed).with_context(context)?;
    let (flown, _) = rollout::fly(scenario, &mut *pilot).with_context(context)?;
    Ok(measure(entry, &flown))
}

/// What the blind panel earns: the mean of its plans, as the brackets have it.
pub(super) fn blind_panel(suite: &Suite) -> Row {
    let of = |entry: &Entry| {
        let plans: Vec<Measures> = entry.bracket.panel.iter().map(|flown| measure(entry, flown)).collect();
        mean(&plans)
    };
    Row { policy: "blind_panel".to_owned(), measures: suite.entries().map(of).collect() }
}

/// One episode, judged by the suite's own bracket.
pub(super) fn measure(entry: &Entry, flown: &Flown) -> Measures {
    let Entry { scenario, bracket, .. } = entry;
    let agents = scenario.task().agents(scenario.recipe()).max(1);
    [
        Some(flown.score),
        Some(f64::from(u8::from(success(scenario, SuccessRule::Task, bracket, flown)))),
        bracket.skill(flown.score),
        Some(f64::from(flown.lost) / f64::from(agents)),
        Some(flown.fuel_used),
    ]
}

fn mean(rows: &[Measures]) -> Measures {
    column_means(rows.iter()).map(|(mean, _)| mean)
}

/// A seed of its own for every (seed, policy, scenario, rollout).
fn policy_seed(seed: u64, policy: &str, entry: &Entry, rollout: u32) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("sparring eval policy seed 1");
    hasher.update(&seed.to_le_bytes()).update(&rollout.to_le_bytes());
    hasher.update(&entry.scenario.id().0).update(policy.as_bytes());
    let mut word = [0; 8];
    word.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(word)
}
