//! A run in memory: everything that the writer knows without a query.

use std::collections::BTreeMap;

use sqlx::SqliteConnection;

use crate::critiques::profile_cache::ProfileCache;
use crate::engine::error::ServiceError;
use crate::metrics;
use crate::runs::settings::RunSettings;
use ::curriculum::{
    Curriculum, CurriculumEvent, GroupOutcome, LevelMove, MoveKind, ObservedOutcome, ProposalRole,
    SequencedProposal, Settings, Slot, Snapshot,
};
use clock::Millis;
use store::curriculum::{self, CurriculumRecord, LevelMoveKind, LevelMoveRow, NewCurriculumEvent};
use store::groups::GroupRole;
use store::leases;
use store::proposals::{self, NewProposal};
use store::runs::{self, RunRow};
use store::{StoreError, from_json, to_i64, to_json, to_u64};

/// Number of lease deadlines that are kept in memory. At most one lease for each task and level keeps others waiting.
const MAX_KEPT_DEADLINES: usize = 256;

/// Curriculum events between two snapshots.
const SNAPSHOT_INTERVAL: u64 = 1000;
/// Curriculum events read by one query when a run is restored.
const EVENTS_PER_QUERY: i64 = 5000;

/// A run in memory. A failed change evicts it, and it is restored from the store when next needed: it never runs ahead of what is
/// committed.
#[derive(Debug)]
pub struct RunState {
    /// Id of the run.
    pub run: String,
    /// Seed of the run's random streams.
    pub seed: u64,
    /// Current settings of the run.
    pub settings: RunSettings,
    /// When the run was paused; `None` while it grants leases.
    pub paused_at: Option<Millis>,
    /// Ends of the first lifetimes of leases, as [`Self::first_deadline`] read them.
    first_deadlines: BTreeMap<i64, Millis>,
    /// Newest policy version that was reported.
    pub policy_version: i64,
    /// True if another run, possibly a deleted one, has the same seed: its scenarios may be known to a trainer.
    pub is_seed_reused: bool,
    /// The curriculum: a fold over the run's curriculum events.
    pub curriculum: Curriculum,
    /// Failure profiles by task, of the tasks that were written since the run was loaded.
    pub(crate) profiles: BTreeMap<String, ProfileCache>,
    /// Number of events at the last snapshot.
    snapshot_at: u64,
    /// Curriculum events that are not written yet.
    unwritten: Vec<NewCurriculumEvent>,
}

impl RunState {
    /// Restores a run from its newest snapshot and the events after it.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if the run does not exist, and [`ServiceError::Restore`] or [`ServiceError::Store`] if it
    /// cannot be restored.
    pub async fn load(conn: &mut SqliteConnection, run: &str) -> Result<Self, ServiceError> {
        let row = runs::get(conn, run).await?.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))?;
        let settings: RunSettings = from_json("a run's settings", &row.settings)?;
        let seed = to_u64(row.seed);
        let mut curriculum = match curriculum::newest_snapshot(conn, run).await? {
            Some(record) => Curriculum::restore(seed, from_json::<Snapshot>("a snapshot", &record.body)?)?,
            None => Curriculum::new(seed, first_settings(conn, &row).await?)?,
        };
        let snapshot_at = curriculum.next_seq();
        loop {
            let next = to_i64(curriculum.next_seq());
            let page = curriculum::events(conn, run, next, EVENTS_PER_QUERY).await?;
            if page.is_empty() {
                break;
            }
            for CurriculumRecord { seq, body } in page {
                let event: CurriculumEvent = from_json("a curriculum event", &body)?;
                curriculum.replay_event(to_u64(seq), &event)?;
            }
        }
        Ok(Self {
            run: row.id,
            seed,
            settings,
            paused_at: row.paused_at,
            first_deadlines: BTreeMap::new(),
            policy_version: row.policy_version,
            is_seed_reused: row.is_seed_reused,
            curriculum,
            profiles: BTreeMap::new(),
            snapshot_at,
            unwritten: Vec::new(),
        })
    }

    /// Time by which the deadlines of the run's leases are judged: they stand still while the run is paused.
    #[must_use]
    pub fn lease_clock(&self, now: Millis) -> Millis {
        self.paused_at.map_or(now, |paused_at| now.min(paused_at))
    }

    /// Returns when the first lifetime of a lease ends or ended, 0 for an unknown lease. Every report asks for the leases that keep
    /// others waiting, so that the newest answers are kept.
    ///
    /// # Errors
    /// Returns an error of the store if the deadline cannot be read.
    pub(crate) async fn first_deadline(
        &mut self,
        conn: &mut SqliteConnection,
        lease: i64,
    ) -> Result<Millis, StoreError> {
        if let Some(&deadline) = self.first_deadlines.get(&lease) {
            return Ok(deadline);
        }
        let deadline = leases::first_deadline(conn, lease).await?.unwrap_or(0);
        if self.first_deadlines.len() >= MAX_KEPT_DEADLINES {
            self.first_deadlines.clear();
        }
        self.first_deadlines.insert(lease, deadline);
        Ok(deadline)
    }

    /// Takes note that the deadlines of the run's leases were shifted in the store.
    pub(crate) fn forget_deadlines(&mut self) {
        self.first_deadlines.clear();
    }

    /// Takes note that all times of the run were shifted in the store by `by` milliseconds, after the system clock jumped.
    pub(crate) fn shift_times(&mut self, by: Millis) {
        self.paused_at = self.paused_at.map(|paused_at| paused_at + by);
        self.forget_deadlines();
    }

    /// Takes the curriculum events that are not written yet. The caller writes them.
    pub fn take_unwritten(&mut self) -> Vec<NewCurriculumEvent> {
        std::mem::take(&mut self.unwritten)
    }

    /// Makes `count` proposals and stores them.
    ///
    /// # Errors
    /// Returns an error of the store if a statement fails.
    pub async fn propose(
        &mut self,
        conn: &mut SqliteConnection,
        now: Millis,
        count: u64,
    ) -> Result<Vec<SequencedProposal>, StoreError> {
        let (mut proposed, mut rows) = (Vec::new(), Vec::new());
        for _ in 0..count {
            let sequenced = self.curriculum.propose();
            let seq = to_i64(sequenced.seq);
            rows.push(NewProposal { seq, body: to_json(&sequenced.proposal)? });
            let body = to_json(&CurriculumEvent::Proposed(sequenced.proposal.clone()))?;
            self.unwritten.push(NewCurriculumEvent { seq, body, at: now });
            proposed.push(sequenced);
        }
        proposals::insert(conn, &self.run, &rows).await?;
        metrics::record_proposals(self.settings.curriculum.strategy.to_string(), count);
        self.snapshot_if_due(conn).await?;
        Ok(proposed)
    }

    /// Tells the curriculum of groups that are slots. They are disclosed to their trainer after this.
    ///
    /// # Errors
    /// Returns an error of the store if a statement fails.
    pub async fn open_slots(
        &mut self,
        conn: &mut SqliteConnection,
        slots: Vec<Slot>,
        now: Millis,
    ) -> Result<(), StoreError> {
        if slots.is_empty() {
            return Ok(());
        }
        let seq = to_i64(self.curriculum.open_slots(&slots));
        let body = to_json(&CurriculumEvent::Opened(slots))?;
        self.unwritten.push(NewCurriculumEvent { seq, body, at: now });
        self.snapshot_if_due(conn).await
    }

    /// Drops slots whose groups the server lost before a trainer saw them, and stores the level moves that this caused.
    ///
    /// # Errors
    /// Returns an error of the store if a statement fails.
    pub async fn withdraw_slots(
        &mut self,
        conn: &mut SqliteConnection,
        slots: Vec<Slot>,
        now: Millis,
    ) -> Result<Vec<LevelMove>, StoreError> {
        let observed = self.curriculum.withdraw_slots(&slots);
        self.record_moves(conn, observed, &CurriculumEvent::Withdrawn(slots), now).await
    }

    /// Passes an outcome to the curriculum, and stores the event and the level moves it caused.
    ///
    /// # Errors
    /// Returns an error of the store if a statement fails.
    pub async fn observe(
        &mut self,
        conn: &mut SqliteConnection,
        outcome: GroupOutcome,
        now: Millis,
    ) -> Result<Vec<LevelMove>, StoreError> {
        let observed = self.curriculum.observe(&outcome);
        self.record_moves(conn, observed, &CurriculumEvent::Outcome(outcome), now).await
    }

    /// Stores an event that may move levels, and its moves.
    async fn record_moves(
        &mut self,
        conn: &mut SqliteConnection,
        observed: ObservedOutcome,
        event: &CurriculumEvent,
        now: Millis,
    ) -> Result<Vec<LevelMove>, StoreError> {
        let ObservedOutcome { seq, moves } = observed;
        let seq = to_i64(seq);
        self.unwritten.push(NewCurriculumEvent { seq, body: to_json(event)?, at: now });
        for level_move in &moves {
            let row = LevelMoveRow {
                seq,
                task: level_move.task.clone(),
                kind: move_kind(level_move.kind),
                from_level: level_move.from.map(i64::from),
                to_level: i64::from(level_move.to),
                evidence: to_json(&level_move.evidence)?,
                at: now,
            };
            curriculum::insert_move(conn, &self.run, &row).await?;
        }
        self.snapshot_if_due(conn).await?;
        Ok(moves)
    }

    /// Puts other settings of the curriculum in force.
    ///
    /// # Errors
    /// Returns [`ServiceError::Invalid`] if the settings are invalid.
    pub fn change_settings(&mut self, settings: Settings, now: Millis) -> Result<(), ServiceError> {
        let event = CurriculumEvent::Settings(settings.clone().into());
        let seq = to_i64(self.curriculum.change_settings(settings)?);
        self.unwritten.push(NewCurriculumEvent { seq, body: to_json(&event)?, at: now });
        Ok(())
    }

    /// Drops all evidence of the run: results have another meaning from now on.
    ///
    /// # Errors
    /// Returns [`ServiceError::Store`] if the event cannot be written as JSON.
    pub fn restart_evidence(&mut self, now: Millis) -> Result<(), ServiceError> {
        let seq = to_i64(self.curriculum.restart_evidence());
        let body = to_json(&CurriculumEvent::EvidenceRestarted)?;
        self.unwritten.push(NewCurriculumEvent { seq, body, at: now });
        Ok(())
    }

    async fn snapshot_if_due(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        if self.curriculum.next_seq() - self.snapshot_at >= SNAPSHOT_INTERVAL {
            self.snapshot(conn).await?;
        }
        Ok(())
    }

    /// Stores a snapshot of the curriculum, unless nothing happened since the last one.
    ///
    /// # Errors
    /// Returns an error of the store if a statement fails.
    pub async fn snapshot(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        let seq = self.curriculum.next_seq();
        if seq != self.snapshot_at {
            let body = to_json(&self.curriculum.snapshot())?;
            curriculum::save_snapshot(conn, &self.run, to_i64(seq), &body).await?;
            self.snapshot_at = seq;
        }
        Ok(())
    }
}

/// Settings that the curriculum of a run began with.
///
/// # Errors
/// Returns an error of the store if they cannot be read.
pub async fn first_settings(conn: &mut SqliteConnection, row: &RunRow) -> Result<Settings, StoreError> {
    match runs::initial_curriculum(conn, &row.id).await? {
        Some(body) => from_json("a run's first settings", &body),
        None => Ok(from_json::<RunSettings>("a run's settings", &row.settings)?.curriculum),
    }
}

/// Role of the group that serves a proposal of this role.
pub(crate) const fn group_role(role: ProposalRole) -> GroupRole {
    match role {
        ProposalRole::Placement => GroupRole::Placement,
        ProposalRole::Frontier => GroupRole::Frontier,
        ProposalRole::Rehearsal => GroupRole::Rehearsal,
        ProposalRole::Sample => GroupRole::Sample,
        ProposalRole::Explore => GroupRole::Explore,
        ProposalRole::Replay => GroupRole::Replay,
        ProposalRole::Edit => GroupRole::Edit,
        ProposalRole::Boundary => GroupRole::Boundary,
        ProposalRole::Rung => GroupRole::Rung,
        ProposalRole::Coverage => GroupRole::Coverage,
    }
}

/// Direction of a level move as it is stored.
#[must_use]
pub const fn move_kind(kind: MoveKind) -> LevelMoveKind {
    match kind {
        MoveKind::Placement => LevelMoveKind::Placement,
        MoveKind::Up => LevelMoveKind::Up,
        MoveKind::Down => LevelMoveKind::Down,
    }
}
