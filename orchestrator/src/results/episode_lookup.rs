//! Looks reported episodes up: their lease, their group, and the scenario and bracket to replay them with.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use api_types::RefusalCode;
use env_core::{Bracket, Scenario};
use sqlx::SqliteConnection;
use store::compacted_leases::{self, CompactedLease};
use store::groups;
use store::ids::{EpisodeId, LeaseId, RunId};
use store::keys::{EpisodeKey, GroupKey};
use store::leases::{self, LeaseRow};

use crate::engine::error::ServiceError;
use crate::leases::scenario_cache::ScenarioCache;
use crate::ownership::Actor;
use crate::results::audit_outcome::AuditOutcome;
use crate::results::refusal::Refusal;

/// Scenario of a group, to replay its episodes with.
pub(crate) struct ReplayTarget {
    pub(crate) scenario: Scenario,
    /// `None` until the scenario of a lease of columns is bracketed.
    pub(crate) bracket: Option<Bracket>,
}

/// Place of a reported episode.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EpisodePlace {
    pub(crate) episode: EpisodeKey,
    pub(crate) group: GroupKey,
}

/// Place of a reported episode, or the outcome of its audit if it has none.
pub(crate) type EpisodeLookup = Result<EpisodePlace, AuditOutcome>;

/// Collects the groups that a report needs, and loads them together.
pub(crate) struct EpisodeFinder<'a> {
    run: &'a RunId,
    /// Client that reports, which the leases must belong to.
    actor: Actor,
    leases: HashMap<LeaseId, Result<LeaseRow, Refusal>>,
    /// Compacted leases by number.
    compacted: HashMap<i64, CompactedLease>,
    /// Needed groups by lease.
    needed: BTreeMap<i64, NeededGroups>,
    targets: HashMap<GroupKey, ReplayTarget>,
}

struct NeededGroups {
    is_columns: bool,
    numbers: BTreeSet<i64>,
}

/// A group whose scenario is to be loaded.
struct PendingGroup {
    key: GroupKey,
    is_columns: bool,
    scenario: Vec<u8>,
}

impl<'a> EpisodeFinder<'a> {
    /// A finder for episodes of one run that an actor reports.
    pub(crate) fn new(run: &'a RunId, actor: Actor) -> Self {
        Self {
            run,
            actor,
            leases: HashMap::new(),
            compacted: HashMap::new(),
            needed: BTreeMap::new(),
            targets: HashMap::new(),
        }
    }

    /// Finds the place of an episode as far as its lease shows it. [`Self::load`] and [`Self::confirm`] complete the search.
    pub(crate) async fn find(
        &mut self,
        conn: &mut SqliteConnection,
        name: &str,
    ) -> Result<EpisodeLookup, ServiceError> {
        let id: EpisodeId = match name.parse() {
            Ok(id) => id,
            Err(error) => return Ok(Err(AuditOutcome::refused(RefusalCode::BadId, error.to_string()))),
        };
        let lease = match self.lease(conn, &id.lease).await? {
            Ok(lease) => lease,
            Err(refusal) => return Ok(Err(AuditOutcome::Refused(refusal))),
        };
        if id.index >= lease.episodes() {
            let last = lease.episodes() - 1;
            let detail = format!("the index must be from 0 to {last} in this lease, got {}", id.index);
            return Ok(Err(AuditOutcome::refused(RefusalCode::UnknownEpisode, detail)));
        }
        let group = id.index / lease.group_size;
        if lease.is_compacted && groups::get(conn, lease.id, group).await?.is_none() {
            return Ok(Err(self.compacted_outcome(conn, &lease, id.index).await?));
        }
        let is_columns = lease.is_columns();
        let needed = self.needed.entry(lease.id);
        needed.or_insert_with(|| NeededGroups { is_columns, numbers: BTreeSet::new() }).numbers.insert(group);
        Ok(Ok(EpisodePlace {
            episode: EpisodeKey { lease: lease.id, number: id.index },
            group: GroupKey { lease: lease.id, number: group },
        }))
    }

    /// Loads scenarios and brackets of the needed groups.
    pub(crate) async fn load(&mut self, conn: &mut SqliteConnection) -> Result<(), ServiceError> {
        let mut pending = Vec::new();
        for (&lease, NeededGroups { is_columns, numbers }) in &self.needed {
            let numbers: Vec<i64> = numbers.iter().copied().collect();
            for row in groups::get_many(conn, lease, &numbers).await? {
                let key = GroupKey { lease, number: row.number };
                pending.push(PendingGroup { key, is_columns: *is_columns, scenario: row.scenario });
            }
        }
        let ids: BTreeSet<&[u8]> = pending.iter().map(|group| group.scenario.as_slice()).collect();
        let ids: Vec<_> = ids.into_iter().collect();
        let scenarios = ScenarioCache::of(conn, &ids).await?;
        for PendingGroup { key, is_columns, scenario } in &pending {
            let (scenario, bracket) = scenarios.get(scenario, *is_columns)?;
            self.targets.insert(*key, ReplayTarget { scenario: scenario.clone(), bracket: bracket.cloned() });
        }
        Ok(())
    }

    /// Refuses an episode whose group does not exist.
    pub(crate) fn confirm(&self, lookup: &mut EpisodeLookup) {
        let Ok(EpisodePlace { group, .. }) = lookup else { return };
        if !self.targets.contains_key(group) {
            let detail = if self.needed.get(&group.lease).is_some_and(|needed| needed.is_columns) {
                "the episode is not audited; its result is in the columns"
            } else {
                "the lease does not have this group"
            };
            *lookup = Err(AuditOutcome::refused(RefusalCode::UnknownEpisode, detail));
        }
    }

    /// Returns the loaded groups.
    pub(crate) fn into_targets(self) -> HashMap<GroupKey, ReplayTarget> {
        self.targets
    }

    async fn compacted_outcome(
        &mut self,
        conn: &mut SqliteConnection,
        lease: &LeaseRow,
        index: i64,
    ) -> Result<AuditOutcome, ServiceError> {
        if !self.compacted.contains_key(&lease.id)
            && let Some(compacted) = compacted_leases::get(conn, self.run.as_str(), lease.id).await?
        {
            self.compacted.insert(lease.id, compacted);
        }
        Ok(AuditOutcome::of_compacted(self.compacted.get(&lease.id), index))
    }

    async fn lease(
        &mut self,
        conn: &mut SqliteConnection,
        id: &LeaseId,
    ) -> Result<Result<LeaseRow, Refusal>, ServiceError> {
        if let Some(known) = self.leases.get(id) {
            return Ok(known.clone());
        }
        let row = match leases::get(conn, id.number).await? {
            None => compacted_leases::get(conn, self.run.as_str(), id.number)
                .await?
                .map(|compacted| compacted.row),
            row => row,
        };
        let found = match row.filter(|row| row.id_suffix == id.suffix) {
            None => Err(Refusal::new(RefusalCode::UnknownEpisode, format!("lease {id} does not exist"))),
            Some(row) if row.run != self.run.as_str() => {
                let detail = format!("lease {id} does not belong to run {}", self.run);
                Err(Refusal::new(RefusalCode::ForeignEpisode, detail))
            }
            Some(row) if !self.actor.may_use_lease(row.owner) => {
                let detail = ServiceError::ForeignLease(id.to_string()).to_string();
                Err(Refusal::new(RefusalCode::ForeignLease, detail))
            }
            Some(row) => Ok(row),
        };
        self.leases.insert(id.clone(), found.clone());
        Ok(found)
    }
}
