//! A run in memory: what the writer knows without asking the database.

use std::collections::BTreeMap;

use sqlx::SqliteConnection;

use super::TrainingError;
use super::criticise::Ledger;
use super::settings::RunSettings;
use crate::clock::Millis;
use crate::counts;
use crate::store::curriculum::Event;
use crate::store::{self, StoreError, from_json, signed, to_json, unsigned};
use curriculum::{Curriculum, CurriculumEvent, GroupOutcome, Move, Proposal, Settings, Snapshot};

/// Events between snapshots.
const SNAPSHOT_EVERY: u64 = 1000;
/// Events read at a time when restoring.
const PAGE: i64 = 5000;

/// A run in memory. Dropped whenever a change fails, and restored from the store when next needed: what is in memory
/// never runs ahead of what is committed.
#[derive(Debug)]
pub struct Mind {
    /// The run's id.
    pub run: String,
    /// The seed of its random streams.
    pub seed: u64,
    /// Its settings.
    pub settings: RunSettings,
    /// Whether it is paused.
    pub paused: bool,
    /// The newest policy version reported.
    pub policy_version: i64,
    /// The curriculum: a fold over the run's events.
    pub curriculum: Curriculum,
    /// Failure profiles, by task: those that were written to since the run came to memory.
    pub(super) ledgers: BTreeMap<String, Ledger>,
    snapshot_at: u64,
    /// Events of the curriculum that are not written yet.
    unwritten: Vec<Event>,
}

impl Mind {
    /// Restores a run: the newest snapshot, and the events after it.
    ///
    /// # Errors
    /// No such run, or a stored curriculum that cannot be brought back.
    pub async fn load(conn: &mut SqliteConnection, run: &str) -> Result<Self, TrainingError> {
        let row =
            store::runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))?;
        let settings: RunSettings = from_json("a run's settings", &row.settings)?;
        let seed = unsigned(row.seed);
        let mut curriculum = match store::curriculum::newest_snapshot(conn, run).await? {
            Some((_, body)) => Curriculum::restore(seed, from_json::<Snapshot>("a snapshot", &body)?)?,
            None => {
                let first = match store::runs::first_curriculum(conn, run).await? {
                    Some(told) => from_json("a run's first settings", &told)?,
                    None => settings.curriculum.clone(),
                };
                Curriculum::new(seed, first)?
            }
        };
        let snapshot_at = curriculum.next_seq();
        loop {
            let page = store::curriculum::events(conn, run, signed(curriculum.next_seq()), PAGE).await?;
            if page.is_empty() {
                break;
            }
            for (seq, body) in page {
                let event: CurriculumEvent = from_json("a curriculum event", &body)?;
                curriculum.replay(unsigned(seq), &event)?;
            }
        }
        Ok(Self {
            run: row.id,
            seed,
            settings,
            paused: row.status == "paused",
            policy_version: row.policy_version,
            curriculum,
            ledgers: BTreeMap::new(),
            snapshot_at,
            unwritten: Vec::new(),
        })
    }

    /// Events that are not written yet; whoever takes them writes them.
    pub fn take_unwritten(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.unwritten)
    }

    /// Proposes so often, and stores the events; the proposals with their seqs.
    ///
    /// # Errors
    /// The database's.
    pub async fn propose(
        &mut self,
        conn: &mut SqliteConnection,
        now: Millis,
        times: u64,
    ) -> Result<Vec<(u64, Proposal)>, StoreError> {
        let (mut proposed, mut queued) = (Vec::new(), Vec::new());
        for _ in 0..times {
            let (seq, proposal) = self.curriculum.propose();
            queued.push((signed(seq), to_json(&proposal)?));
            self.unwritten.push((signed(seq), to_json(&CurriculumEvent::Proposed(proposal.clone()))?, now));
            proposed.push((seq, proposal));
        }
        store::proposals::insert(conn, &self.run, &queued).await?;
        counts::proposals(self.settings.curriculum.strategy.to_string(), times);
        self.snapshot_if_due(conn).await?;
        Ok(proposed)
    }

    /// Observes an outcome, and stores the event and the moves it caused.
    ///
    /// # Errors
    /// The database's.
    pub async fn observe(
        &mut self,
        conn: &mut SqliteConnection,
        outcome: GroupOutcome,
        now: Millis,
    ) -> Result<Vec<Move>, StoreError> {
        let (seq, moves) = self.curriculum.observe(&outcome);
        let event = to_json(&CurriculumEvent::Outcome(outcome))?;
        self.unwritten.push((signed(seq), event, now));
        for moved in &moves {
            let row = store::curriculum::MoveRow {
                seq: signed(seq),
                task: moved.task.clone(),
                kind: word(&moved.kind)?,
                from_level: moved.from.map(i64::from),
                to_level: i64::from(moved.to),
                evidence: to_json(&moved.evidence)?,
                at: now,
            };
            store::curriculum::insert_move(conn, &self.run, &row).await?;
        }
        self.snapshot_if_due(conn).await?;
        Ok(moves)
    }

    /// Puts other settings of the curriculum in force; the event is written with the others.
    ///
    /// # Errors
    /// Settings that cannot be.
    pub fn change(&mut self, settings: Settings, now: Millis) -> Result<(), TrainingError> {
        let event = CurriculumEvent::Settings(settings.clone().into());
        let seq = self.curriculum.change(settings)?;
        self.unwritten.push((signed(seq), to_json(&event)?, now));
        Ok(())
    }

    async fn snapshot_if_due(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        if self.curriculum.next_seq() - self.snapshot_at >= SNAPSHOT_EVERY {
            self.snapshot(conn).await?;
        }
        Ok(())
    }

    /// Stores the curriculum as it is.
    ///
    /// # Errors
    /// The database's.
    pub async fn snapshot(&mut self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        let seq = self.curriculum.next_seq();
        if seq != self.snapshot_at {
            let body = to_json(&self.curriculum.snapshot())?;
            store::curriculum::save_snapshot(conn, &self.run, signed(seq), &body).await?;
            self.snapshot_at = seq;
        }
        Ok(())
    }
}

/// The word an enum has on the wire.
pub(crate) fn word<T: serde::Serialize>(value: &T) -> Result<String, StoreError> {
    Ok(to_json(value)?.trim_matches('"').to_owned())
}
