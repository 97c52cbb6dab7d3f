//! Draws the groups of a lease of columns that are audited.

use std::collections::BTreeMap;
use std::sync::Arc;

use env_core::{Recipe, Scenario};
use rand::seq::index;
use rand::{SeedableRng, TryRng};
use rand_chacha::ChaCha12Rng;
use store::columns::SeedRangeRow;

use crate::engine::error::ServiceError;
use crate::leases::columns::scenario_of;
use crate::results::columns::table::Columns;

/// Groups tried for each group that can be audited: a scenario without a fair start cannot be run.
const MAX_TRIES: usize = 16;

/// A range of seeds with its recipe.
#[derive(Debug)]
pub(crate) struct RecipeRange {
    pub(crate) range: SeedRangeRow,
    pub(crate) recipe: Arc<Recipe>,
}

/// A group that is audited.
#[derive(Debug)]
pub(crate) struct DrawnGroup {
    pub(crate) range: SeedRangeRow,
    /// Number of the group in the lease.
    pub(crate) group: i64,
    pub(crate) scenario: Scenario,
    /// Claimed scores of the episodes that are claimed to have finished.
    pub(crate) scores: Vec<ClaimedScore>,
}

/// Score that a client claims for an episode.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClaimedScore {
    /// Index of the episode in the lease.
    pub(crate) episode: i64,
    pub(crate) score: f32,
}

/// Groups of a range that may be drawn.
struct PoolRange<'a> {
    range: &'a SeedRangeRow,
    recipe: &'a Arc<Recipe>,
    groups: Vec<i64>,
}

/// Groups that may be drawn: of each range, those with at least one episode that is claimed to have finished.
struct AuditPool<'a> {
    columns: &'a Columns,
    group_size: usize,
    ranges: Vec<PoolRange<'a>>,
}

impl<'a> AuditPool<'a> {
    fn of(columns: &'a Columns, ranges: &'a [RecipeRange], group_size: usize) -> Self {
        let ranges = ranges.iter().map(|RecipeRange { range, recipe }| {
            let groups = range.first_group..range.first_group + range.groups;
            let groups = groups.filter(|group| finished(columns, *group, group_size).next().is_some());
            PoolRange { range, recipe, groups: groups.collect() }
        });
        // The share of ranges in which every episode failed goes to the others.
        let ranges = ranges.filter(|range| !range.groups.is_empty()).collect();
        Self { columns, group_size, ranges }
    }

    /// Draws `wanted` groups of one range, or fewer if the scenarios of the others have no fair start.
    fn draw(
        &self,
        rng: &mut ChaCha12Rng,
        range: usize,
        wanted: usize,
        drawn: &mut BTreeMap<i64, DrawnGroup>,
    ) -> Result<(), ServiceError> {
        let PoolRange { range, recipe, groups } = &self.ranges[range];
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
            let scores = finished(self.columns, group, self.group_size).collect();
            drawn.insert(group, DrawnGroup { range: (*range).clone(), group, scenario, scores });
            left -= 1;
        }
        Ok(())
    }
}

/// Returns the claimed scores of the episodes of a group that are claimed to have finished.
fn finished(columns: &Columns, group: i64, group_size: usize) -> impl Iterator<Item = ClaimedScore> {
    let first = usize::try_from(group).unwrap_or_default() * group_size;
    let entries = (first..first + group_size).filter(|at| !columns.has_failed(*at));
    entries.map(|at| ClaimedScore { episode: at as i64, score: columns.scores[at] })
}

/// Draws the groups to audit: the same number from each range, as far as it has so many. The system's randomness decides, so that no
/// client can foresee it. A group with failed episodes is drawn like any other, and its finished episodes are audited.
///
/// # Errors
/// Returns [`ServiceError::Invalid`] if scores are claimed only for scenarios without a fair start.
pub(crate) fn draw_audit(
    columns: &Columns,
    ranges: &[RecipeRange],
    group_size: usize,
    wanted: usize,
) -> Result<Vec<DrawnGroup>, ServiceError> {
    let mut seed = [0; 32];
    rand::rngs::SysRng.try_fill_bytes(&mut seed).map_err(|error| ServiceError::NotCommitted {
        reason: format!("the operating system provides no randomness for the audit: {error}"),
        outage: None,
    })?;
    let mut rng = ChaCha12Rng::from_seed(seed);
    let pool = AuditPool::of(columns, ranges, group_size);
    let mut drawn = BTreeMap::new();
    if pool.ranges.is_empty() {
        return Ok(Vec::new()); // every episode failed
    }
    // If there are more ranges than wanted groups, chance decides which ranges are audited.
    let count = pool.ranges.len();
    let mut share = vec![wanted / count; count];
    for at in index::sample(&mut rng, count, wanted % count) {
        share[at] += 1;
    }
    for (range, share) in share.into_iter().enumerate() {
        pool.draw(&mut rng, range, share, &mut drawn)?;
    }
    // Ranges with too few groups are made up for by the others.
    for range in index::sample(&mut rng, count, count) {
        let missing = wanted.saturating_sub(drawn.len());
        pool.draw(&mut rng, range, missing, &mut drawn)?;
    }
    if drawn.is_empty() {
        let why = "all claimed scores are of scenarios without a fair start; claim these episodes as failed";
        return Err(ServiceError::invalid("score", why));
    }
    Ok(drawn.into_values().collect())
}
