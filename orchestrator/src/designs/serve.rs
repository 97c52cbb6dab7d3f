//! Which groups of a lease are designed, and by which layout: a function of durable state alone, so that a restarted server
//! serves what it would have served.

use std::collections::BTreeMap;

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;
use sqlx::SqliteConnection;

use crate::designs::DesignSettings;
use crate::store::design_counters::{self, LevelCount};
use crate::store::groups::{GroupRole, GroupRow, GroupState};
use crate::store::layouts::LayoutClaim;
use crate::store::servable_layouts::{self, ServableLayout};
use crate::store::{StoreError, to_u64};
use crate::runs::settings::EvidenceFrom;
use crate::engine::run_state::RunState;
use crate::runs::settings::RunSettings;

/// The share of designed groups that try a retired layout: has the agent forgotten, or learnt?
pub const PROBED: f64 = 0.05;
/// Groups that a layout may take whatever its share.
const ALWAYS: f64 = 4.0;

/// The role of a designed group.
pub const ROLE: &str = "designed";

/// What was drawn for one group. Every group draws thrice, so that what one gets shifts nothing for the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroupDraws {
    /// It is to be designed.
    pub designed: bool,
    /// By a retired layout, where one may be served.
    pub probes: bool,
    /// Which, in [0, 1).
    pub pick: f64,
}

/// What is drawn for each group of a lease.
#[must_use]
pub fn draw(share: f64, run_seed: u64, lease: u64, groups: u32) -> Vec<GroupDraws> {
    let mut draws = KeyedRng::new(RngPurpose::LayoutSelection, run_seed, lease);
    let mut one = || {
        let (designed, probes) = (draws.bernoulli(share), draws.bernoulli(PROBED));
        GroupDraws { designed, probes, pick: draws.uniform() }
    };
    (0..groups).map(|_| one()).collect()
}

/// Whether a layout that has had so many groups may have the next, when `since` training groups were leased since it was
/// made.
#[must_use]
pub fn within_share(groups: i64, since: i64, layout_share: f64) -> bool {
    (groups + 1) as f64 <= (layout_share * (since + 1) as f64).max(ALWAYS)
}

/// Whether a layout of one level suits a task that stands at another. Without levels everything does.
#[must_use]
pub fn near(layout: Option<u32>, now: Option<u32>) -> bool {
    match (layout, now) {
        (Some(layout), Some(now)) => layout.abs_diff(now) <= 1,
        _ => true,
    }
}

/// One of `count`, by a draw in [0, 1).
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count of layouts")]
pub fn picked(pick: f64, count: usize) -> Option<usize> {
    (count > 0).then(|| ((pick * count as f64) as usize).min(count - 1))
}

/// What may be served, and what has been.
struct Shelf {
    settings: DesignSettings,
    active: Vec<ServableLayout>,
    /// Counts of layouts retired by themselves.
    retired: Vec<LevelCount>,
    /// Groups that retired layouts have had, those of this lease included.
    probed: BTreeMap<i64, i64>,
    train_groups: i64,
}

/// The layout of each group of a lease; none where the next proposal is served. Nothing is written.
pub(crate) async fn choose(
    conn: &mut SqliteConnection,
    mind: &RunState,
    lease: i64,
    groups: u32,
) -> Result<Vec<Option<ServableLayout>>, StoreError> {
    let settings = mind.settings.design;
    let none = vec![None; groups as usize];
    if !settings.on() {
        return Ok(none);
    }
    let drawn = draw(settings.share, mind.seed, to_u64(lease), groups);
    if !drawn.iter().any(|drawn| drawn.designed) {
        return Ok(none);
    }
    let run = mind.run.as_str();
    let placed: Vec<_> = mind.curriculum.status().into_iter().filter(|status| status.placed).collect();
    let fits = |task: &str, level: Option<i64>| {
        placed.iter().any(|s| s.task == task && near(level.and_then(|l| u32::try_from(l).ok()), s.level))
    };
    let mut active = servable_layouts::active(conn, run).await?;
    active.retain(|layout| fits(&layout.task, layout.level));
    let probes = drawn.iter().any(|drawn| drawn.designed && drawn.probes);
    let mut retired = if probes { servable_layouts::retired(conn, run).await? } else { Vec::new() };
    retired.retain(|of| fits(&of.task, of.level));
    let train_groups = design_counters::groups(conn, run).await?.all;
    let probed = BTreeMap::new();
    let mut shelf = Shelf { settings, active, retired, probed, train_groups };
    let mut chosen = Vec::with_capacity(drawn.len());
    for drawn in drawn {
        chosen.push(if drawn.designed { shelf.take(conn, run, drawn).await? } else { None });
        shelf.train_groups += 1;
    }
    Ok(chosen)
}

impl Shelf {
    async fn take(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        drawn: GroupDraws,
    ) -> Result<Option<ServableLayout>, StoreError> {
        if drawn.probes
            && let Some(retired) = self.probe(conn, run, drawn.pick).await?
        {
            return Ok(Some(retired));
        }
        let (share, now) = (self.settings.layout_share, self.train_groups);
        let may = |layout: &ServableLayout| within_share(layout.groups, now - layout.train_groups_at, share);
        let mut eligible: Vec<&mut ServableLayout> = self.active.iter_mut().filter(|layout| may(layout)).collect();
        let Some(at) = picked(drawn.pick, eligible.len()) else { return Ok(None) };
        let layout = &mut eligible[at];
        layout.groups += 1;
        Ok(Some(layout.clone()))
    }

    /// A retired layout, if the one that is drawn may be served.
    async fn probe(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        pick: f64,
    ) -> Result<Option<ServableLayout>, StoreError> {
        let all: i64 = self.retired.iter().map(|of| of.count).sum();
        let Some(mut nth) = picked(pick, usize::try_from(all).unwrap_or(0)).map(|nth| nth as i64) else {
            return Ok(None);
        };
        for LevelCount { task, level, count } in &self.retired {
            if nth < *count {
                let Some(found) = servable_layouts::nth_retired(conn, run, task, *level, nth).await? else {
                    return Ok(None);
                };
                let (share, since) = (self.settings.layout_share, self.train_groups - found.train_groups_at);
                let held = self.probed.entry(found.id).or_insert(found.groups);
                let may = within_share(*held, since, share);
                *held += i64::from(may);
                return Ok(may.then_some(found));
            }
            nth -= count;
        }
        Ok(None)
    }
}

/// The group that a layout makes.
pub(crate) fn group(mind: &RunState, number: i64, layout: ServableLayout) -> GroupRow {
    let contested = layout.claim == LayoutClaim::Threat;
    let evidence = contested && is_evidence(&mind.settings) && at_frontier(mind, &layout.task, layout.level);
    GroupRow {
        number,
        proposal: None,
        layout: Some(layout.id),
        scenario: layout.scenario,
        task: layout.task,
        level: layout.level,
        role: GroupRole::Designed,
        is_contested: contested,
        state: GroupState::Open,
        finished: 0,
        failed: 0,
        successes: 0,
        is_evidence: evidence,
        is_for_training: !mind.settings.curriculum.strategy.trains_on_replays_only(),
    }
}

/// Whether outcomes of designed groups may move the curriculum.
const fn is_evidence(settings: &RunSettings) -> bool {
    settings.design.evidence && matches!(settings.evidence_from, EvidenceFrom::Train)
}

/// Whether a level is the one that its task stands at.
pub(crate) fn at_frontier(mind: &RunState, task: &str, level: Option<i64>) -> bool {
    let status = mind.curriculum.status();
    let status = status.iter().find(|status| status.task == task);
    status.is_some_and(|s| s.placed && s.level.is_some() && s.level.map(i64::from) == level)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_share_is_kept_and_draws_are_those_of_the_lease() {
        let drawn = draw(0.3, 7, 3, 20_000);
        let designed = drawn.iter().filter(|drawn| drawn.designed).count();
        // Binomial with mean 6 000 and standard deviation 65: five of them.
        assert!(designed.abs_diff(6_000) < 325, "{designed}");
        let probes = drawn.iter().filter(|drawn| drawn.probes).count();
        // Mean 1 000, standard deviation 31.
        assert!(probes.abs_diff(1_000) < 155, "{probes}");
        assert_eq!(draw(0.3, 7, 3, 20), drawn[..20]);
        assert_ne!(draw(0.3, 7, 4, 20), drawn[..20]);
        assert!(draw(0.0, 7, 3, 100).iter().all(|drawn| !drawn.designed));
        assert!(draw(1.0, 7, 3, 100).iter().all(|drawn| drawn.designed));
    }

    #[test]
    fn levels_one_off_are_near() {
        assert!(
            near(Some(3), Some(4)) && near(Some(4), Some(3)) && near(None, Some(9)) && near(Some(1), None)
        );
        assert!(!near(Some(2), Some(4)));
    }

    proptest! {
        /// A layout that is served whenever it may be never has more than its share, beyond the first four.
        #[test]
        fn no_layout_takes_more_than_its_share(share in 0.001f64..1.0, asked in proptest::collection::vec(any::<bool>(), 0..400)) {
            let mut groups = 0;
            for (since, asked) in (0i64..).zip(asked) {
                if asked && within_share(groups, since, share) {
                    groups += 1;
                }
                prop_assert!(groups as f64 <= (share * (since + 1) as f64).max(ALWAYS));
            }
        }

        #[test]
        fn a_pick_is_one_of_them(pick in 0.0f64..1.0, count in 0usize..1000) {
            prop_assert_eq!(picked(pick, count).is_some(), count > 0);
            prop_assert!(picked(pick, count).is_none_or(|at| at < count));
        }
    }
}
