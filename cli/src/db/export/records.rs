//! Records of an export: the lines of NDJSON, from which the rows of tables follow.

use env_core::{ActionLog, Scenario};
use serde::Serialize;
use serde_json::{Value, json};
use store::layouts::{LayoutKind, LayoutState, RetirementReason};

use clock::rfc3339;
use env_core::frames::wire_step;
use store::columns::ClaimState;
use store::compacted_leases::{CompactedClaim, CompactedEpisode, CompactedGroup, CompactedLease};
use store::curriculum::{LevelMoveKind, LevelMoveRow};
use store::episodes::{EpisodeRow, EpisodeState};
use store::groups::{GroupRole, GroupRow, GroupState};
use store::ids::{EpisodeId, LayoutId};
use store::layouts::LayoutRow;
use store::leases::{LeaseRow, Purpose};
use store::runs::{RunRow, RunStatus};
use store::views::{MasteryRow, TrainerMetricRow};
use store::{StoreError, from_json};

/// Record of an export, tagged by its kind.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum ExportLine<'a> {
    /// Run with its settings.
    Run {
        run: String,
        name: String,
        seed: i64,
        status: RunStatus,
        policy_version: i64,
        at: String,
        settings: Value,
    },
    /// Level move with its evidence.
    Move {
        run: &'a str,
        seq: i64,
        task: String,
        #[serde(rename = "move")]
        way: LevelMoveKind,
        from: Option<i64>,
        to: i64,
        evidence: Value,
        at: String,
    },
    /// Layout in the design language.
    Layout {
        run: &'a str,
        layout: String,
        task: String,
        level: Option<i64>,
        designer: String,
        name: String,
        state: LayoutState,
        retirement_reason: Option<RetirementReason>,
        gate_check: Option<String>,
        refusal_reason: Option<String>,
        layout_kind: Option<LayoutKind>,
        aim: Option<String>,
        design: Option<Value>,
        groups: i64,
        episodes: i64,
        successes: i64,
        at: String,
    },
    /// Claim of a lease's episodes in columns.
    Claim { run: &'a str, lease: String, state: ClaimState, episodes: i64, failed: i64 },
    /// Group of episodes of one scenario.
    Group(Box<ExportedGroup<'a>>),
    /// Episode with a reported result.
    Episode(Box<ExportedEpisode<'a>>),
    /// Results and mastery of a task in a minute or an hour.
    Mastery {
        run: &'a str,
        #[serde(flatten)]
        row: MasteryRow,
    },
    /// Number that the trainer logged.
    TrainerMetric {
        run: &'a str,
        #[serde(flatten)]
        row: TrainerMetricRow,
    },
}

/// State and counts of a claim.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExportedClaim {
    pub(super) state: ClaimState,
    pub(super) episodes: i64,
    pub(super) failed: i64,
}

/// Group of episodes of one scenario.
#[derive(Debug, Serialize)]
pub(super) struct ExportedGroup<'a> {
    run: &'a str,
    lease: String,
    group_number: i64,
    purpose: Purpose,
    task: String,
    level: Option<i64>,
    role: GroupRole,
    layout: Option<String>,
    contested: bool,
    /// Null if retention has compacted the group.
    slot: Option<bool>,
    /// Null if retention has compacted the group.
    state: Option<GroupState>,
    episodes: i64,
    finished: i64,
    failed: i64,
    successes: i64,
    policy_version: i64,
    leased_at: String,
    replay: &'static str,
}

impl<'a> ExportedGroup<'a> {
    pub(super) fn new(run: &'a str, lease: &LeaseRow, group: &GroupRow) -> Self {
        Self {
            run,
            lease: lease.name(),
            group_number: group.number,
            purpose: lease.purpose,
            task: group.task.clone(),
            level: group.level,
            role: group.role,
            layout: group.layout.map(|id| LayoutId::of_run(run, id).to_string()),
            contested: group.is_contested,
            slot: Some(group.is_slot),
            state: Some(group.state),
            episodes: lease.group_size,
            finished: group.finished,
            failed: group.failed,
            successes: group.successes,
            policy_version: lease.policy_version,
            leased_at: rfc3339(lease.created_at),
            replay: "available",
        }
    }

    fn compacted(run: &'a str, lease: &LeaseRow, group: &CompactedGroup) -> Self {
        let count = |wanted: fn(&CompactedEpisode) -> bool| {
            group.episodes.iter().filter(|episode| wanted(episode)).count() as i64
        };
        let row = GroupRow {
            layout: group.layout,
            level: group.level,
            is_contested: group.contested,
            finished: count(|episode| episode.state == EpisodeState::Finished),
            failed: count(|episode| episode.state == EpisodeState::Failed),
            successes: count(|episode| {
                episode.state == EpisodeState::Finished && episode.success == Some(true)
            }),
            ..GroupRow::open(group.number, group.role, group.task.clone(), Vec::new())
        };
        Self { slot: None, state: None, replay: "expired", ..Self::new(run, lease, &row) }
    }
}

/// Episode with a reported result.
#[derive(Debug, Serialize)]
pub(super) struct ExportedEpisode<'a> {
    run: &'a str,
    episode: String,
    purpose: Purpose,
    task: String,
    level: Option<i64>,
    role: GroupRole,
    layout: Option<String>,
    contested: bool,
    state: EpisodeState,
    score: Option<f64>,
    skill: Option<f64>,
    success: Option<bool>,
    floor: Option<f64>,
    reference: Option<f64>,
    outcome: Option<Value>,
    reason: Option<String>,
    metrics: Option<Value>,
    policy_version: i64,
    at: String,
    replay: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    scenario: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    actions: Option<Value>,
}

impl<'a> ExportLine<'a> {
    pub(super) fn run(row: RunRow) -> Result<Self, StoreError> {
        Ok(Self::Run {
            run: row.id,
            name: row.name,
            seed: row.seed,
            status: row.status,
            policy_version: row.policy_version,
            at: rfc3339(row.created_at),
            settings: from_json("a run's settings", &row.settings)?,
        })
    }

    pub(super) fn moved(run: &'a str, row: LevelMoveRow) -> Result<Self, StoreError> {
        Ok(Self::Move {
            run,
            seq: row.seq,
            task: row.task,
            way: row.kind,
            from: row.from_level,
            to: row.to_level,
            evidence: from_json("a move's evidence", &row.evidence)?,
            at: rfc3339(row.at),
        })
    }

    pub(super) fn layout(run: &'a str, row: LayoutRow) -> Result<Self, StoreError> {
        Ok(Self::Layout {
            run,
            layout: LayoutId::of_run(run, row.id).to_string(),
            task: row.task,
            level: row.level,
            designer: row.designer,
            name: row.name,
            state: row.state,
            retirement_reason: row.retirement_reason,
            gate_check: row.gate_check,
            refusal_reason: row.refusal_reason,
            layout_kind: row.kind,
            aim: row.mode,
            design: row.design.map(|text| from_json("a design", &text)).transpose()?,
            groups: row.groups,
            episodes: row.episodes,
            successes: row.successes,
            at: rfc3339(row.created_at),
        })
    }

    pub(super) fn claim(run: &'a str, lease: &LeaseRow, claim: ExportedClaim) -> Self {
        let ExportedClaim { state, episodes, failed } = claim;
        Self::Claim { run, lease: lease.name(), state, episodes, failed }
    }
}

/// Returns the records of a compacted lease: its claim, its groups, then its episodes.
pub(super) fn compacted_lines<'a>(run: &'a str, lease: &CompactedLease) -> Vec<ExportLine<'a>> {
    let claim = lease.claim.iter().map(|CompactedClaim { state, episodes, failed }| {
        let claim = ExportedClaim { state: *state, episodes: *episodes, failed: *failed };
        ExportLine::claim(run, &lease.row, claim)
    });
    let episodes = lease.episodes().map(|(group, known)| {
        ExportLine::Episode(Box::new(ExportedEpisode::compacted(run, &lease.row, group, known)))
    });
    let groups = lease
        .groups
        .iter()
        .map(|group| ExportLine::Group(Box::new(ExportedGroup::compacted(run, &lease.row, group))));
    claim.chain(groups).chain(episodes).collect()
}

impl<'a> ExportedEpisode<'a> {
    pub(super) fn new(
        run: &'a str,
        lease: &LeaseRow,
        group: &GroupRow,
        row: &EpisodeRow,
    ) -> Result<Self, StoreError> {
        let json = |text: &Option<String>| text.as_ref().map(|text| from_json("a value", text)).transpose();
        Ok(Self {
            run,
            episode: EpisodeId { lease: lease.lease_id(), index: row.number }.to_string(),
            purpose: lease.purpose,
            task: group.task.clone(),
            level: group.level,
            role: group.role,
            layout: group.layout.map(|id| LayoutId::of_run(run, id).to_string()),
            contested: group.is_contested,
            state: row.state,
            score: row.score,
            skill: row.skill,
            success: row.success,
            floor: row.floor,
            reference: row.reference,
            outcome: json(&row.outcome)?,
            reason: row.reason.clone(),
            metrics: json(&row.metrics)?,
            policy_version: row.policy_version,
            at: rfc3339(row.at),
            replay: if row.outcome.is_some() { "available" } else { "none" },
            scenario: None,
            actions: None,
        })
    }

    fn compacted(run: &'a str, lease: &LeaseRow, group: &CompactedGroup, known: &CompactedEpisode) -> Self {
        Self {
            run,
            episode: EpisodeId { lease: lease.lease_id(), index: known.number }.to_string(),
            purpose: lease.purpose,
            task: group.task.clone(),
            level: group.level,
            role: group.role,
            layout: group.layout.map(|id| LayoutId::of_run(run, id).to_string()),
            contested: group.contested,
            state: known.state,
            score: known.score,
            skill: known.skill,
            success: known.success,
            floor: None,
            reference: None,
            outcome: None,
            reason: None,
            metrics: None,
            policy_version: known.policy_version,
            at: rfc3339(lease.created_at + known.after_ms),
            replay: if known.score.is_some() { "expired" } else { "none" },
            scenario: None,
            actions: None,
        }
    }

    /// Adds the scenario and the actions of the episode.
    pub(super) fn add_actions(&mut self, scenario: &Scenario, log: Option<&ActionLog>) {
        self.scenario = Some(scenario.to_json());
        self.actions = log.map(|log| json!(log.steps().map(|step| wire_step(log, step)).collect::<Vec<_>>()));
    }
}
