//! Draws the groups of a lease of columns that are audited. They are drawn with the lease, and no client sees them before the claim:
//! a trainer that chooses the episodes to report cannot choose by the sample.

use std::collections::BTreeMap;
use std::sync::Arc;

use env_core::bracket::Bracket;
use env_core::{Recipe, Scenario, Seed, admission};
use rand::seq::index;
use rand::{SeedableRng, TryRng};
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;
use store::columns::SeedRangeRow;
use store::{StoreError, to_u64};

use crate::engine::error::ServiceError;

/// Groups tried for each group that is audited: a scenario without a fair start cannot be run.
const MAX_TRIES: usize = 16;

/// A range of seeds with its recipe.
#[derive(Debug, Clone)]
pub(crate) struct RecipeRange {
    pub(crate) range: SeedRangeRow,
    pub(crate) recipe: Arc<Recipe>,
}

/// A group that will be audited.
#[derive(Debug)]
pub(crate) struct SampledGroup {
    /// Number of the group in the lease.
    pub(crate) number: i64,
    pub(crate) scenario: Scenario,
    pub(crate) bracket: Bracket,
    pub(crate) is_contested: bool,
}

/// Draws the groups to audit with their brackets, as [`draw_scenarios`] does.
///
/// # Errors
/// Returns the errors of [`draw_scenarios`].
pub(crate) fn draw_sample(ranges: &[RecipeRange], wanted: usize) -> Result<Vec<SampledGroup>, ServiceError> {
    let groups: Vec<(i64, Scenario)> = draw_scenarios(ranges, wanted, &|_| true)?.into_iter().collect();
    let sampled = groups.into_par_iter().filter_map(|(number, scenario)| {
        let admission = admission::admit(&scenario);
        let (bracket, is_contested) = (admission.bracket?, admission.contested);
        Some(SampledGroup { number, scenario, bracket, is_contested })
    });
    Ok(sampled.collect())
}

/// Groups of a range that may be drawn.
struct PoolRange<'a> {
    range: &'a RecipeRange,
    groups: Vec<i64>,
}

/// Draws groups among those that `accepts` allows, with their scenarios: the same number from each range, as far as it has so many.
/// The system's randomness decides, so that no client can foresee it. Fewer groups are drawn if the scenarios of the others have no
/// fair start.
///
/// # Errors
/// Returns [`ServiceError::NotCommitted`] if the system has no randomness, and an error of the store if a seed is out of range.
pub(crate) fn draw_scenarios(
    ranges: &[RecipeRange],
    wanted: usize,
    accepts: &dyn Fn(i64) -> bool,
) -> Result<BTreeMap<i64, Scenario>, ServiceError> {
    let mut seed = [0; 32];
    rand::rngs::SysRng.try_fill_bytes(&mut seed).map_err(|error| ServiceError::NotCommitted {
        reason: format!("the operating system provides no randomness for the audit: {error}"),
        outage: None,
    })?;
    let mut rng = ChaCha12Rng::from_seed(seed);
    let pool = ranges.iter().map(|range| {
        let groups = range.range.first_group..range.range.first_group + range.range.groups;
        PoolRange { range, groups: groups.filter(|group| accepts(*group)).collect() }
    });
    let pool: Vec<PoolRange<'_>> = pool.filter(|range| !range.groups.is_empty()).collect();
    let (count, mut drawn) = (pool.len(), BTreeMap::new());
    if count == 0 {
        return Ok(drawn);
    }
    // If there are more ranges than wanted groups, chance decides which ranges are audited.
    let mut share = vec![wanted / count; count];
    for at in index::sample(&mut rng, count, wanted % count) {
        share[at] += 1;
    }
    for (range, share) in pool.iter().zip(share) {
        range.draw(&mut rng, share, &mut drawn)?;
    }
    // Ranges with too few groups are made up for by the others.
    for at in index::sample(&mut rng, count, count) {
        let missing = wanted.saturating_sub(drawn.len());
        pool[at].draw(&mut rng, missing, &mut drawn)?;
    }
    Ok(drawn)
}

impl PoolRange<'_> {
    /// Draws `wanted` groups, or fewer if the scenarios of the others have no fair start.
    fn draw(
        &self,
        rng: &mut ChaCha12Rng,
        wanted: usize,
        drawn: &mut BTreeMap<i64, Scenario>,
    ) -> Result<(), ServiceError> {
        let Self { range: RecipeRange { range, recipe }, groups } = self;
        let mut left = wanted;
        for at in index::sample(rng, groups.len(), groups.len().min(wanted.saturating_mul(MAX_TRIES))) {
            let group = groups[at];
            if left == 0 {
                break;
            }
            let scenario = scenario_of(range, Arc::clone(recipe), group)?;
            if drawn.contains_key(&group) || scenario.task().start(&scenario).is_err() {
                continue;
            }
            drawn.insert(group, scenario);
            left -= 1;
        }
        Ok(())
    }
}

/// Builds the scenario of a group of a range.
///
/// # Errors
/// Returns an error if the stored seed is out of range.
pub fn scenario_of(range: &SeedRangeRow, recipe: Arc<Recipe>, group: i64) -> Result<Scenario, StoreError> {
    let seed = Seed::new(to_u64(range.first_seed + (group - range.first_group)))?;
    Ok(Scenario::new(recipe, seed))
}
