//! Chooses the layouts of a lease's groups. The choice is a function of durable state alone, so that a restarted server serves the
//! same layouts.

use std::collections::BTreeMap;

use env_core::KeyedRng;
use env_core::keyed_rng::{RngPurpose, index_at};
use sqlx::SqliteConnection;
use store::groups::{GroupRole, GroupRow};
use store::layouts::LayoutKind;
use store::servable_layouts::{self, RetiredCount, ServableLayout};
use store::{StoreError, design_counters, from_json, learning_signals, to_u64};

use crate::designs::layout_status::{RecentResult, success_posterior};
use crate::designs::place::Place;
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

/// Task and place of the scenario that a designed group replaces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Opening {
    pub(crate) task: String,
    pub(crate) place: Place,
    /// True if the scenario must be contested, so that only a threat may replace it.
    pub(crate) contested: bool,
}

impl Opening {
    fn fits(&self, task: &str, place: Place, kind: LayoutKind) -> bool {
        let may_be_decoy = !self.contested || kind == LayoutKind::Threat;
        self.task == task && self.place.is_near(place) && may_be_decoy
    }
}

/// Groups of a lease that may be designed.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Openings<'a> {
    /// This number of groups, each of any task at its current level. They take no proposals.
    Current(u32),
    /// One entry for each group: a layout replaces the scenario of its proposal, unless it is `None`.
    Proposed(&'a [Option<Opening>]),
}

impl Openings<'_> {
    fn len(self) -> usize {
        match self {
            Self::Current(groups) => groups as usize,
            Self::Proposed(openings) => openings.len(),
        }
    }
}

/// Returns the index of one of `count` by a draw in [0, 1); `None` if there are none.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count of layouts")]
pub fn pick_index(pick: f64, count: usize) -> Option<usize> {
    (count > 0).then(|| ((pick * count as f64) as usize).min(count - 1))
}

/// Active layout, with what the agent's results on it say.
struct ActiveLayout {
    layout: ServableLayout,
    place: Place,
    /// Mean of p(1 − p) over the success rate p.
    weight: f64,
}

impl ActiveLayout {
    fn new(layout: ServableLayout) -> Result<Self, StoreError> {
        let recent: Vec<RecentResult> = from_json("a layout's results", &layout.recent_results)?;
        let place = Place::from_stored(layout.level, layout.start_rung);
        Ok(Self { layout, place, weight: success_posterior(&recent).mean_variance() })
    }
}

/// Layouts that may be served, with the groups that they have had.
struct LayoutChooser {
    /// Largest share of the training groups for one layout.
    layout_share: f64,
    active: Vec<ActiveLayout>,
    /// Numbers of mastered and hopeless layouts.
    retired: Vec<RetiredCount>,
    /// Groups that probed layouts have had, those of this lease included, by layout.
    probed: BTreeMap<i64, i64>,
    train_groups: i64,
}

/// Returns the layout of each group of a lease; `None` for a group without one. Nothing is written.
pub(crate) async fn choose_layouts(
    conn: &mut SqliteConnection,
    state: &RunState,
    lease: i64,
    openings: Openings<'_>,
) -> Result<Vec<Option<ServableLayout>>, StoreError> {
    let settings = state.settings.design;
    let none = vec![None; openings.len()];
    if !settings.is_enabled() {
        return Ok(none);
    }
    let run = state.run.as_str();
    let share = settings.current_share(&learning_signals::get(conn, run).await?);
    let groups = u32::try_from(openings.len()).unwrap_or(u32::MAX);
    let drawn = draw_groups(share, state.seed, to_u64(lease), groups);
    if !drawn.iter().any(|drawn| drawn.is_designed) {
        return Ok(none);
    }
    let current = current_openings(state);
    let active = servable_layouts::active(conn, run).await?;
    let probes = drawn.iter().any(|drawn| drawn.is_designed && drawn.is_probe);
    let mut chooser = LayoutChooser {
        layout_share: settings.layout_share,
        active: active.into_iter().map(ActiveLayout::new).collect::<Result<_, _>>()?,
        retired: if probes { servable_layouts::retired(conn, run).await? } else { Vec::new() },
        probed: BTreeMap::new(),
        train_groups: design_counters::groups(conn, run).await?.all,
    };
    let mut chosen = Vec::with_capacity(drawn.len());
    for (number, drawn) in drawn.into_iter().enumerate() {
        let at = match openings {
            Openings::Current(_) => current.as_slice(),
            Openings::Proposed(openings) => openings.get(number).map_or(&[][..], Option::as_slice),
        };
        chosen.push(if drawn.is_designed { chooser.choose(conn, run, drawn, at).await? } else { None });
        chooser.train_groups += 1;
    }
    Ok(chosen)
}

/// Current level of each task whose placement is over.
fn current_openings(state: &RunState) -> Vec<Opening> {
    let placed = state.curriculum.status().into_iter().filter(|status| status.placement_done);
    placed
        .map(|status| Opening {
            task: status.task,
            place: Place { level: status.level, start_rung: None },
            contested: false,
        })
        .collect()
}

impl LayoutChooser {
    /// Chooses the layout of a group for one of the openings.
    async fn choose(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        drawn: GroupDraws,
        openings: &[Opening],
    ) -> Result<Option<ServableLayout>, StoreError> {
        if drawn.is_probe
            && let Some(probed) = self.probe(conn, run, drawn.pick, openings).await?
        {
            return Ok(Some(probed));
        }
        let weight = |active: &ActiveLayout| {
            let ActiveLayout { layout, place, weight } = active;
            let since = self.train_groups - layout.training_groups_at_creation;
            let may = is_within_share(layout.groups, since, self.layout_share)
                && openings.iter().any(|opening| opening.fits(&layout.task, *place, layout.kind));
            if may { *weight } else { 0.0 }
        };
        let weights: Vec<f64> = self.active.iter().map(weight).collect();
        let Some(at) = index_at(&weights, drawn.pick) else { return Ok(None) };
        let layout = &mut self.active[at].layout;
        layout.groups += 1;
        Ok(Some(layout.clone()))
    }

    /// Returns the retired layout that is drawn, if it may be served.
    async fn probe(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        pick: f64,
        openings: &[Opening],
    ) -> Result<Option<ServableLayout>, StoreError> {
        let fits = |of: &&RetiredCount| {
            let place = Place::from_stored(of.level, of.start_rung);
            openings.iter().any(|opening| opening.fits(&of.task, place, of.kind))
        };
        let retired: Vec<&RetiredCount> = self.retired.iter().filter(fits).collect();
        let all: i64 = retired.iter().map(|of| of.count).sum();
        let Some(nth) = pick_index(pick, usize::try_from(all).unwrap_or(0)) else { return Ok(None) };
        let mut nth = nth as i64;
        for of in retired {
            if nth < of.count {
                let found = servable_layouts::nth_retired(conn, run, of, nth).await?;
                return Ok(found.filter(|found| {
                    count_probe(&mut self.probed, found, self.train_groups, self.layout_share)
                }));
            }
            nth -= of.count;
        }
        Ok(None)
    }
}

/// Counts a group of a retired layout. Returns false if the layout has had its share.
fn count_probe(
    probed: &mut BTreeMap<i64, i64>,
    layout: &ServableLayout,
    train_groups: i64,
    layout_share: f64,
) -> bool {
    let groups = probed.entry(layout.id).or_insert(layout.groups);
    let may = is_within_share(*groups, train_groups - layout.training_groups_at_creation, layout_share);
    *groups += i64::from(may);
    may
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
    fn decoys_replace_no_contested_scenario() {
        let place = Place { level: Some(3), start_rung: None };
        let opening = |contested| Opening { task: "a".to_owned(), place, contested };
        assert!(opening(true).fits("a", place, LayoutKind::Threat));
        assert!(opening(false).fits("a", place, LayoutKind::Decoy));
        assert!(!opening(true).fits("a", place, LayoutKind::Decoy));
        assert!(!opening(true).fits("b", place, LayoutKind::Threat));
        let far = Place { level: Some(5), start_rung: None };
        assert!(!opening(true).fits("a", far, LayoutKind::Threat));
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
