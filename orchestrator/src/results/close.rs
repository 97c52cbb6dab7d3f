//! Closes groups: their counters and history are written, and their outcome goes to the curriculum, to their layout or to their
//! evaluation.

use crate::api_enums::ConvertEnum;
use std::collections::BTreeMap;

use api_types::GroupReceipt;
use curriculum::{GroupOutcome, LearningSignals, LevelMove, Proposal};
use env_core::admission;
use store::group_counters::{self, GroupCounters};
use store::group_results::{self, GroupResult};
use store::groups::{self, GroupRow, GroupState};
use store::history::{ParamValue, RungKey, RungResults};
use store::leases::LeaseRow;
use store::task_counters::{self, TaskCounters, TaskCountersKey};
use store::{from_json, proposals, to_u32, to_u64};

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::leases::refill;
use crate::leases::scenario_cache::ScenarioCache;
use crate::results::observe::observe;
use crate::results::report_summary::ReportSummary;
use crate::results::score_tolerance;
use crate::results::slot_value::slot_value;
use crate::{designs, evaluations};

/// Times a scenario is offered at most: a scenario that crashes every trainer must not return for ever.
const MAX_ATTEMPTS: i64 = 3;

/// Groups of a task whose blind panel is examined in one transaction at most, if only the history needs it: it means reading the
/// scenario.
const MAX_EXAMINED_PANELS: i64 = 2;

/// Closes groups of a lease. A group is complete if every episode finished, else partial if enough did, else lost; the scenario of a
/// lost group is offered again.
pub(crate) async fn close_groups(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    groups: Vec<GroupRow>,
) -> Result<ReportSummary, ServiceError> {
    update_and_close(run, lease, Vec::new(), groups).await
}

/// Writes the groups that stay open, and closes the others.
pub(crate) async fn update_and_close(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    open: Vec<GroupRow>,
    mut closing: Vec<GroupRow>,
) -> Result<ReportSummary, ServiceError> {
    let min_finished = i64::from(run.state.settings.min_group_for(to_u32(lease.group_size)));
    for group in &mut closing {
        group.state = match (group.finished >= min_finished, group.finished == lease.group_size) {
            (_, true) => GroupState::Complete,
            (true, false) => GroupState::Partial,
            (false, false) => GroupState::Lost,
        };
    }
    let mut rows = open;
    rows.extend(closing.iter().cloned());
    groups::update(run.conn, lease.id, &rows, run.now).await?;
    let (mut summary, mut group_sums) = (ReportSummary::default(), Vec::new());
    if closing.is_empty() {
        return Ok(summary);
    }
    let numbers: Vec<i64> = closing.iter().map(|group| group.number).collect();
    let statistics = group_results::read(run.conn, lease, &numbers).await?;
    let statistics: BTreeMap<i64, GroupResult> = statistics.into_iter().map(|of| (of.number, of)).collect();
    let panels = panel_success_rates(run, &closing, min_finished).await?;
    for group in &closing {
        let Some(statistics) = statistics.get(&group.number) else { continue }; // every group of the lease is in the store
        let closed = closed_group(lease, group, statistics);
        let is_enough = group.finished >= min_finished;
        let panel = panels.get(&group.number).copied();
        let one = ClosingGroup { lease, group, statistics, closed: &closed, panel, is_enough };
        summary.moves.extend(one.close(run).await?);
        if lease.group_size > 1 && group.is_training_or_probe() {
            group_sums.push(group_counters(group, &closed));
        }
        summary.groups.push(closed);
    }
    group_counters::add(run.conn, &lease.run, &group_sums).await?;
    designs::closed_groups::add_closed_groups(run, lease, &closing).await?;
    if lease.is_columns() {
        summary.groups.clear();
        return Ok(summary);
    }
    let zero_variance = summary.groups.iter().filter(|group| group.zero_variance == Some(true)).count();
    if zero_variance > 0 {
        summary.refills = refill::request_refill(run, lease, zero_variance as i64).await?;
    }
    Ok(summary)
}

fn closed_group(lease: &LeaseRow, group: &GroupRow, statistics: &GroupResult) -> GroupReceipt {
    let spread = statistics.lowest.zip(statistics.highest).map(|(lowest, highest)| highest - lowest);
    let is_flat = spread.map(|spread| spread <= score_tolerance(&group.task));
    GroupReceipt {
        lease: lease.name(),
        group: group.number,
        state: group.state.convert(),
        finished: group.finished,
        failed: group.failed,
        expired: (lease.group_size - group.finished - group.failed).max(0),
        successes: group.successes,
        mean_score: statistics.score,
        zero_variance: is_flat.filter(|_| group.finished > 1),
    }
}

/// Group that is being closed, with its results.
#[derive(Clone, Copy)]
struct ClosingGroup<'a> {
    lease: &'a LeaseRow,
    group: &'a GroupRow,
    statistics: &'a GroupResult,
    closed: &'a GroupReceipt,
    /// Share of blind plans that succeed on its scenario, if it was examined.
    panel: Option<f64>,
    /// True if enough episodes finished for the group to say something about its scenario.
    is_enough: bool,
}

impl ClosingGroup<'_> {
    /// Closes the group and returns the level moves it caused.
    async fn close(self, run: &mut RunTx<'_>) -> Result<Vec<LevelMove>, ServiceError> {
        let Self { lease, group, closed, is_enough, .. } = self;
        run.emit(&RunEvent::group(lease, group, closed.expired))?;
        self.count_expired_episodes(run).await?;
        if group.is_training_or_probe() {
            add_to_history(run, self);
        }
        if group.layout.is_some() {
            designs::outcome::observe_designed_group(run, lease, group, is_enough).await?;
        }
        if let Some(seq) = group.proposal {
            return self.observe_proposed_group(run, seq).await;
        }
        if group.layout.is_none() {
            evaluations::store_results::store_reported_group(run, lease, group).await?;
        }
        Ok(Vec::new())
    }

    /// Adds the expired episodes to the counters of the task, if the group counts.
    async fn count_expired_episodes(self, run: &mut RunTx<'_>) -> Result<(), ServiceError> {
        let Self { lease, group, closed, .. } = self;
        if closed.expired == 0 || !group.is_training_or_probe() {
            return Ok(());
        }
        let expired = TaskCounters { expired: closed.expired, ..TaskCounters::default() };
        run.task_counts(&group.task).add(&expired, group.level);
        let counters = BTreeMap::from([(TaskCountersKey::of(group), expired)]);
        Ok(task_counters::add(run.conn, &lease.run, &counters).await?)
    }

    /// Passes the outcome of a proposed group to the curriculum. The scenario of a lost group is offered again.
    async fn observe_proposed_group(
        self,
        run: &mut RunTx<'_>,
        seq: i64,
    ) -> Result<Vec<LevelMove>, ServiceError> {
        let Self { lease, group, is_enough, .. } = self;
        let Some(body) = &self.statistics.proposal else { return Ok(Vec::new()) };
        let proposal: Proposal = from_json("a proposal", body)?;
        if is_enough && group.layout.is_none() {
            let params = proposal.params.iter().map(|(name, value)| ParamValue { name, value: *value });
            let counts = run.task_counts(&group.task);
            counts.add_params(params);
            let key = RungKey {
                start_rung: proposal.start_rung.map(i64::from),
                level: proposal.level.map(i64::from),
            };
            let (episodes, successes) = (group.counted, group.counted_successes);
            counts.add_rung(key, RungResults { groups: 1, episodes, successes });
        }
        if !is_enough && run.state.curriculum.is_current(to_u64(seq), &proposal) {
            match group.layout {
                // The trainer received the layout, and not the scenario of the proposal.
                Some(_) => proposals::return_unseen(run.conn, &lease.run, &[seq]).await?,
                None => {
                    proposals::offer_again(run.conn, &lease.run, seq, MAX_ATTEMPTS).await?;
                }
            }
        }
        let panel = self.panel.filter(|_| run.state.settings.curriculum.uses_panel());
        observe(run, self.outcome(seq, proposal, panel)).await
    }

    /// Returns the outcome that the curriculum observes. Missing episodes are part of its evidence. Too few finished episodes say too
    /// little about the scenario for strategies that choose the next one.
    fn outcome(self, seq: i64, proposal: Proposal, panel: Option<f64>) -> GroupOutcome {
        let Self { lease, group, statistics, is_enough, .. } = self;
        GroupOutcome {
            proposal: to_u64(seq),
            group: if lease.is_columns() { to_u32(group.number) } else { 0 },
            level: proposal.level,
            start_rung: proposal.start_rung,
            chain: proposal.chain,
            epoch: proposal.epoch,
            role: proposal.role,
            contested: group.is_contested,
            finished: to_u32(group.counted),
            successes: to_u32(group.counted_successes),
            steps: statistics.steps.map_or(0, to_u64),
            evidence: group.is_slot.then(|| slot_value(group, lease.group_size)),
            usable: group.is_evidence && is_enough && group.counted > 0,
            mean_score: statistics.score.unwrap_or(0.0),
            mean_skill: statistics.skill,
            source: proposal.source,
            is_designed: group.layout.is_some(),
            params: if proposal.level.is_none() { proposal.params } else { Vec::new() },
            signals: LearningSignals {
                regret: statistics.regret,
                panel,
                positive_value_loss: statistics.positive_value_loss,
                max_mc: statistics.max_mc,
            },
            task: proposal.task,
        }
    }
}

/// Returns the share of blind plans that succeed on the scenarios of groups, by group number: of all groups if the strategy uses it,
/// else of those that the history samples. All scenarios are read together.
async fn panel_success_rates(
    run: &mut RunTx<'_>,
    closing: &[GroupRow],
    min_finished: i64,
) -> Result<BTreeMap<i64, f64>, ServiceError> {
    let uses_panel = run.state.settings.curriculum.uses_panel();
    let mut sampled: BTreeMap<&str, i64> = BTreeMap::new();
    let mut examined: Vec<&GroupRow> = Vec::new();
    for group in closing {
        let is_used = uses_panel && group.proposal.is_some();
        let mut is_sampled = group.is_slot && group.finished >= min_finished;
        if is_sampled && !is_used {
            let sampled = sampled.entry(&group.task).or_default();
            *sampled += 1;
            is_sampled =
                run.outbox.examined_panels(&run.state.run, &group.task) + *sampled <= MAX_EXAMINED_PANELS;
        }
        if is_used || is_sampled {
            examined.push(group);
        }
    }
    if examined.is_empty() {
        return Ok(BTreeMap::new());
    }
    let ids: Vec<&[u8]> = examined.iter().map(|group| group.scenario.as_slice()).collect();
    let scenarios = ScenarioCache::of(run.conn, &ids).await?;
    let mut panels = BTreeMap::new();
    for group in examined {
        let (scenario, bracket) = scenarios.get(&group.scenario, true)?;
        if let Some(bracket) = bracket {
            panels.insert(group.number, admission::panel_success_rate(scenario, bracket));
        }
    }
    Ok(panels)
}

/// Adds a closed group to the history of its task. A missing episode of a slot counts as a failure.
fn add_to_history(run: &mut RunTx<'_>, closing: ClosingGroup<'_>) {
    let ClosingGroup { lease, group, closed, panel, is_enough, .. } = closing;
    let counts = run.task_counts(&group.task);
    if lease.group_size > 1 && is_enough {
        counts.groups += 1;
        counts.zero_variance_groups += i64::from(closed.zero_variance == Some(true));
    }
    if group.is_slot {
        counts.contested_groups += 1;
        counts.success_rate_sum += slot_value(group, lease.group_size).low;
        if let Some(share) = panel {
            counts.panel_groups += 1;
            counts.panel_success_rate_sum += share;
        }
    }
}

/// Counters of one group of several episodes.
fn group_counters(group: &GroupRow, closed: &GroupReceipt) -> GroupCounters {
    let is_in = |state: GroupState| i64::from(group.state == state);
    GroupCounters {
        task: group.task.clone(),
        level: group.level.unwrap_or(-1),
        complete: is_in(GroupState::Complete),
        partial: is_in(GroupState::Partial),
        lost: is_in(GroupState::Lost),
        zero_variance: i64::from(group.state != GroupState::Lost && closed.zero_variance == Some(true)),
    }
}
