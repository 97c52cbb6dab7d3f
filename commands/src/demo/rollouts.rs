//! Runs leased episodes on all cores. Each sibling of a group is controlled by its own member of the population.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use api_types::{Lease, LeasedGroup, ReceiptStatus, ResultReceipt};
use env_core::{Recipe, Scenario, Seed, rollout};
use rayon::prelude::*;

use super::feed::FinishedEpisode;
use super::trainee::{Member, MemberOutcome, Trainee};

/// Leased group with the population member that runs each of its episodes.
#[derive(Debug, Clone)]
pub(super) struct GroupAssignment {
    pub(super) task: String,
    pub(super) contested: bool,
    scenario: Scenario,
    episodes: Vec<AssignedEpisode>,
}

/// Episode with the population member that runs it.
#[derive(Debug, Clone)]
struct AssignedEpisode {
    id: String,
    member: Member,
}

/// Assigns the current population of each task to the groups of a lease.
///
/// # Errors
/// Returns an error if a recipe or seed is invalid, a task is not trained, or a group's size differs from its population's.
pub(super) fn assign_groups(
    lease: &Lease,
    trainees: &BTreeMap<String, Trainee>,
) -> anyhow::Result<Vec<GroupAssignment>> {
    let recipes = lease.recipes.iter().map(|recipe| Recipe::from_json(recipe).map(Arc::new));
    let recipes: Vec<Arc<Recipe>> = recipes.collect::<Result<_, _>>().context("a leased recipe")?;
    let assign = |group: &LeasedGroup| {
        let recipe = recipes
            .get(group.recipe)
            .context("a leased group names a recipe that the lease does not have")?;
        let trainee = trainees
            .get(&group.task)
            .with_context(|| format!("the demo has no learner for the task {}", group.task))?;
        let members = trainee.members();
        ensure!(
            group.episodes.len() == members.len(),
            "a group of {} episodes was leased for a population of {}",
            group.episodes.len(),
            members.len()
        );
        Ok(GroupAssignment {
            task: group.task.clone(),
            contested: group.contested,
            scenario: Scenario::new(Arc::clone(recipe), Seed::new(group.seed)?),
            episodes: group
                .episodes
                .iter()
                .zip(members)
                .map(|(id, member)| AssignedEpisode { id: id.clone(), member: member.clone() })
                .collect(),
        })
    };
    lease.groups.iter().map(assign).collect()
}

/// Runs all episodes of the groups in parallel.
///
/// # Errors
/// Returns an error if a policy or scenario cannot start.
pub(super) fn roll_out_groups(assignments: &[GroupAssignment]) -> anyhow::Result<Vec<FinishedEpisode>> {
    let episodes: Vec<(&Scenario, &AssignedEpisode)> = assignments
        .iter()
        .flat_map(|group| group.episodes.iter().map(|episode| (&group.scenario, episode)))
        .collect();
    episodes
        .into_par_iter()
        .map(|(scenario, AssignedEpisode { id, member })| {
            let mut policy = member.policy(scenario)?;
            let log = rollout::roll_out(scenario, &mut *policy)?.log;
            Ok(FinishedEpisode { id: id.clone(), log })
        })
        .collect()
}

/// Returns the outcomes of each group in sibling order. Episodes that did not count are left out.
///
/// # Errors
/// Returns an error if the service refused an episode.
pub(super) fn group_outcomes(
    assignments: &[GroupAssignment],
    receipts: Vec<ResultReceipt>,
) -> anyhow::Result<Vec<Vec<MemberOutcome>>> {
    let mut known = HashMap::with_capacity(receipts.len());
    for receipt in receipts {
        if receipt.status == ReceiptStatus::Refused {
            let why = receipt.detail.unwrap_or_default();
            bail!("the service refused episode {}: {why}", receipt.episode);
        }
        if let (ReceiptStatus::Counted | ReceiptStatus::Stored, Some(score), Some(success)) =
            (receipt.status, receipt.score, receipt.success)
        {
            known.insert(receipt.episode, MemberOutcome { score, skill: receipt.skill, success });
        }
    }
    let of_group = |group: &GroupAssignment| {
        group.episodes.iter().filter_map(|episode| known.get(&episode.id)).copied().collect()
    };
    Ok(assignments.iter().map(of_group).collect())
}
