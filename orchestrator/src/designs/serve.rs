//! Chooses the layouts of a lease's groups. The choice is a function of durable state alone, so that a restarted server serves the
//! same layouts.

use std::collections::BTreeMap;

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;
use sqlx::SqliteConnection;
use store::design_counters::{self, LevelCount};
use store::groups::{GroupRole, GroupRow};
use store::layouts::LayoutKind;
use store::servable_layouts::{self, ServableLayout};
use store::{StoreError, to_u64};

use crate::designs::DesignSettings;
use crate::engine::run_state::RunState;

/// Share of designed groups that probe a retired layout, in case the agent has forgotten or learnt it.
pub const PROBE_SHARE: f64 = 0.05;
/// Number of groups that a layout may take regardless of its share.
const GUARANTEED_GROUPS: f64 = 4.0;

/// Random draws of one group. Every group draws three numbers, so that its result does not shift the next group's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroupDraws {
    /// True if the group is designed.
    pub is_designed: bool,
    /// True if it probes a retired layout, where one may be served.
    pub is_probe: bool,
    /// Selects the layout, in [0, 1).
    pub pick: f64,
}

/// Draws the numbers of each group of a lease.
#[must_use]
pub fn draw_groups(share: f64, run_seed: u64, lease: u64, groups: u32) -> Vec<GroupDraws> {
    let mut rng = KeyedRng::new(RngPurpose::LayoutSelection, run_seed, lease);
    let mut draw_group = || {
        let (designed, probes) = (rng.bernoulli(share), rng.bernoulli(PROBE_SHARE));
        GroupDraws { is_designed: designed, is_probe: probes, pick: rng.uniform() }
    };
    (0..groups).map(|_| draw_group()).collect()
}

/// Returns true if a layout that has had `groups` groups may have the next one, if `since` training groups were leased since it was
/// made.
#[must_use]
pub fn is_within_share(groups: i64, since: i64, layout_share: f64) -> bool {
    (groups + 1) as f64 <= (layout_share * (since + 1) as f64).max(GUARANTEED_GROUPS)
}

/// Returns true if a layout's level is at most one off the task's level. Without levels every layout is near.
#[must_use]
pub fn is_near(layout: Option<u32>, now: Option<u32>) -> bool {
    match (layout, now) {
        (Some(layout), Some(now)) => layout.abs_diff(now) <= 1,
        _ => true,
    }
}

/// Returns the index of one of `count` by a draw in [0, 1); `None` if there are none.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count of layouts")]
pub fn pick_index(pick: f64, count: usize) -> Option<usize> {
    (count > 0).then(|| ((pick * count as f64) as usize).min(count - 1))
}

/// Layouts that may be served, with the groups that they have had.
struct LayoutChooser {
    settings: DesignSettings,
    active: Vec<ServableLayout>,
    /// Numbers of mastered and hopeless layouts.
    retired: Vec<LevelCount>,
    /// Groups that probed layouts have had, those of this lease included, by layout.
    probed: BTreeMap<i64, i64>,
    train_groups: i64,
}

/// Returns the layout of each group of a lease; `None` for a group of the next proposal. Nothing is written.
pub(crate) async fn choose_layouts(
    conn: &mut SqliteConnection,
    state: &RunState,
    lease: i64,
    groups: u32,
) -> Result<Vec<Option<ServableLayout>>, StoreError> {
    let settings = state.settings.design;
    let none = vec![None; groups as usize];
    if !settings.is_enabled() {
        return Ok(none);
    }
    let drawn = draw_groups(settings.share, state.seed, to_u64(lease), groups);
    if !drawn.iter().any(|drawn| drawn.is_designed) {
        return Ok(none);
    }
    let run = state.run.as_str();
    let placed: Vec<_> =
        state.curriculum.status().into_iter().filter(|status| status.placement_done).collect();
    let fits = |task: &str, level: Option<i64>| {
        placed.iter().any(|s| s.task == task && is_near(level.and_then(|l| u32::try_from(l).ok()), s.level))
    };
    let mut active = servable_layouts::active(conn, run).await?;
    active.retain(|layout| fits(&layout.task, layout.level));
    let probes = drawn.iter().any(|drawn| drawn.is_designed && drawn.is_probe);
    let mut retired = if probes { servable_layouts::retired(conn, run).await? } else { Vec::new() };
    retired.retain(|of| fits(&of.task, of.level));
    let train_groups = design_counters::groups(conn, run).await?.all;
    let probed = BTreeMap::new();
    let mut chooser = LayoutChooser { settings, active, retired, probed, train_groups };
    let mut chosen = Vec::with_capacity(drawn.len());
    for drawn in drawn {
        chosen.push(if drawn.is_designed { chooser.choose(conn, run, drawn).await? } else { None });
        chooser.train_groups += 1;
    }
    Ok(chosen)
}

impl LayoutChooser {
    /// Chooses the layout of a group.
    async fn choose(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        drawn: GroupDraws,
    ) -> Result<Option<ServableLayout>, StoreError> {
        if drawn.is_probe
            && let Some(retired) = self.probe(conn, run, drawn.pick).await?
        {
            return Ok(Some(retired));
        }
        let (share, now) = (self.settings.layout_share, self.train_groups);
        let may = |layout: &ServableLayout| {
            is_within_share(layout.groups, now - layout.training_groups_at_creation, share)
        };
        let mut eligible: Vec<&mut ServableLayout> =
            self.active.iter_mut().filter(|layout| may(layout)).collect();
        let Some(at) = pick_index(drawn.pick, eligible.len()) else { return Ok(None) };
        let layout = &mut eligible[at];
        layout.groups += 1;
        Ok(Some(layout.clone()))
    }

    /// Returns the retired layout that is drawn, if it may be served.
    async fn probe(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        pick: f64,
    ) -> Result<Option<ServableLayout>, StoreError> {
        let all: i64 = self.retired.iter().map(|of| of.count).sum();
        let Some(mut nth) = pick_index(pick, usize::try_from(all).unwrap_or(0)).map(|nth| nth as i64) else {
            return Ok(None);
        };
        for LevelCount { task, level, count } in &self.retired {
            if nth < *count {
                let Some(found) = servable_layouts::nth_retired(conn, run, task, *level, nth).await? else {
                    return Ok(None);
                };
                let (share, since) =
                    (self.settings.layout_share, self.train_groups - found.training_groups_at_creation);
                let groups = self.probed.entry(found.id).or_insert(found.groups);
                let may = is_within_share(*groups, since, share);
                *groups += i64::from(may);
                return Ok(may.then_some(found));
            }
            nth -= count;
        }
        Ok(None)
    }
}

/// Returns the row of a group on a layout. Its outcome is no evidence of mastery: a layout is aimed at the agent's failures.
pub(crate) fn designed_group(state: &RunState, number: i64, layout: ServableLayout) -> GroupRow {
    GroupRow {
        layout: Some(layout.id),
        level: layout.level,
        is_contested: layout.kind == LayoutKind::Threat,
        is_for_training: !state.settings.curriculum.strategy.trains_on_replays_only(),
        ..GroupRow::open(number, GroupRole::Designed, layout.task, layout.scenario)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn draws_keep_the_share_and_depend_on_the_lease() {
        let drawn = draw_groups(0.3, 7, 3, 20_000);
        let designed = drawn.iter().filter(|drawn| drawn.is_designed).count();
        // Binomial with mean 6 000 and standard deviation 65: five of them.
        assert!(designed.abs_diff(6_000) < 325, "{designed}");
        let probes = drawn.iter().filter(|drawn| drawn.is_probe).count();
        // Mean 1 000, standard deviation 31.
        assert!(probes.abs_diff(1_000) < 155, "{probes}");
        assert_eq!(draw_groups(0.3, 7, 3, 20), drawn[..20]);
        assert_ne!(draw_groups(0.3, 7, 4, 20), drawn[..20]);
        assert!(draw_groups(0.0, 7, 3, 100).iter().all(|drawn| !drawn.is_designed));
        assert!(draw_groups(1.0, 7, 3, 100).iter().all(|drawn| drawn.is_designed));
    }

    #[test]
    fn adjacent_levels_are_near() {
        assert!(
            is_near(Some(3), Some(4))
                && is_near(Some(4), Some(3))
                && is_near(None, Some(9))
                && is_near(Some(1), None)
        );
        assert!(!is_near(Some(2), Some(4)));
    }

    proptest! {
        /// A layout that is served as often as allowed never has more than its share, beyond the first four groups.
        #[test]
        fn no_layout_exceeds_its_share(share in 0.001f64..1.0, asked in proptest::collection::vec(any::<bool>(), 0..400)) {
            let mut groups = 0;
            for (since, asked) in (0i64..).zip(asked) {
                if asked && is_within_share(groups, since, share) {
                    groups += 1;
                }
                prop_assert!(groups as f64 <= (share * (since + 1) as f64).max(GUARANTEED_GROUPS));
            }
        }

        #[test]
        fn picked_index_is_in_range(pick in 0.0f64..1.0, count in 0usize..1000) {
            prop_assert_eq!(pick_index(pick, count).is_some(), count > 0);
            prop_assert!(pick_index(pick, count).is_none_or(|at| at < count));
        }
    }
}
