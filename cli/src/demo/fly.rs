//! Flying what was leased, on all cores: every sibling of a group by its own member of the population.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use env_core::{Recipe, Scenario, Seed, rollout};
use rayon::prelude::*;

use super::feed::{Finished, Lease, Receipt};
use super::trainee::{Member, Outcome, Trainee};

/// A group and who flies it.
#[derive(Debug, Clone)]
pub(super) struct Sortie {
    pub(super) task: String,
    pub(super) contested: bool,
    scenario: Scenario,
    crew: Vec<(String, Member)>,
}

/// The groups of a lease, each with the population that stands now.
pub(super) fn sorties(lease: &Lease, trainees: &BTreeMap<String, Trainee>) -> anyhow::Result<Vec<Sortie>> {
    let recipes = lease.recipes.iter().map(|recipe| Recipe::from_json(recipe).map(Arc::new));
    let recipes: Vec<Arc<Recipe>> = recipes.collect::<Result<_, _>>().context("a leased recipe")?;
    let sortie = |group: &super::feed::LeasedGroup| {
        let recipe = recipes.get(group.recipe).context("a leased group names a recipe that is not there")?;
        let trainee = trainees.get(&group.task).with_context(|| format!("nobody trains {}", group.task))?;
        let members = trainee.members();
        ensure!(
            group.episodes.len() == members.len(),
            "a group of {} episodes was leased for a population of {}",
            group.episodes.len(),
            members.len()
        );
        Ok(Sortie {
            task: group.task.clone(),
            contested: group.contested,
            scenario: Scenario::new(Arc::clone(recipe), Seed::new(group.seed)?),
            crew: group.episodes.iter().cloned().zip(members.iter().cloned()).collect(),
        })
    };
    lease.groups.iter().map(sortie).collect()
}

/// Flies them all.
pub(super) fn fly(sorties: &[Sortie]) -> anyhow::Result<Vec<Finished>> {
    let episodes: Vec<(&Scenario, &String, &Member)> = sorties
        .iter()
        .flat_map(|sortie| sortie.crew.iter().map(|(episode, member)| (&sortie.scenario, episode, member)))
        .collect();
    episodes
        .into_par_iter()
        .map(|(scenario, episode, member)| {
            let mut pilot = member.pilot(scenario)?;
            let log = rollout::roll_out(scenario, &mut *pilot)?.log;
            Ok(Finished::new(episode.clone(), log))
        })
        .collect()
}

/// What the receipts say of each sortie, sibling by sibling; siblings that did not count are left out.
pub(super) fn outcomes(sorties: &[Sortie], receipts: Vec<Receipt>) -> anyhow::Result<Vec<Vec<Outcome>>> {
    let mut known = HashMap::with_capacity(receipts.len());
    for receipt in receipts {
        if receipt.status == "refused" {
            let why = receipt.detail.unwrap_or_default();
            bail!("the service refused episode {}: {why}", receipt.episode);
        }
        if let ("counted" | "stored", Some(score), Some(success)) =
            (receipt.status.as_str(), receipt.score, receipt.success)
        {
            known.insert(receipt.episode, Outcome { score, skill: receipt.skill, success });
        }
    }
    let of_crew =
        |sortie: &Sortie| sortie.crew.iter().filter_map(|(episode, _)| known.get(episode)).copied().collect();
    Ok(sorties.iter().map(of_crew).collect())
}
