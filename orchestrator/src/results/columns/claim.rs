//! Stores a claim: the results of all episodes of a lease as columns.

use std::collections::BTreeMap;

use env_core::{Scenario, format_shortest};
use sqlx::SqliteConnection;
use store::audit_samples::SampledGroupRow;
use store::columns::{self, ClaimState, ColumnClaimRow, RangeTotals, SeedRangeRow};
use store::compacted_leases::{self, CompactedClaim};
use store::groups::{self, GroupRow};
use store::ids::{LeaseId, RunId};
use store::leases::{self, LeaseRow, LeaseStatus};
use store::scenarios::{self, ScenarioLoader};
use store::{from_json, runs};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::leases::audit_sample::{RecipeRange, draw_scenarios};
use crate::leases::create::counts_as_evidence;
use crate::leases::find::{find_lease, find_own_lease};
use crate::leases::lease_service::LeaseService;
use crate::ownership::Actor;
use crate::results::columns::sample::{claimed_scores, sampled_row, take_sample};
use crate::results::columns::settle::settle;
use crate::results::columns::status::{ClaimStatus, claim_status_of};
use crate::results::columns::table::{Columns, range_episodes, range_totals};
use crate::runs::settings::RunSettings;
use crate::runs::version_step::check_version_step;

/// Stores the columns of a lease, and discloses the groups to audit. The answer is sent after the commit. The same columns again receive
/// the same answer.
///
/// # Errors
/// Returns [`ServiceError::Invalid`] if the columns do not fit the lease, [`ServiceError::ColumnsConflict`] if they differ from the
/// columns that were sent before, [`ServiceError::LeaseClosed`] if the lease has ended, and [`ServiceError::ForeignLease`] if it belongs
/// to another principal than `actor`.
pub async fn claim(
    lease_service: &LeaseService,
    run: RunId,
    lease: LeaseId,
    actor: Actor,
    policy_version: Option<u32>,
    columns: Columns,
) -> Result<ClaimStatus, ServiceError> {
    let mut conn = lease_service.readers.acquire().await?;
    let stored = runs::get(&mut conn, run.as_str()).await?;
    let stored = stored.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let row = find_own_lease(&mut conn, &run, &lease, actor).await?;
    if !row.is_columns() {
        let why =
            "is a lease of groups; report its episodes as results, or create a lease with `form: columns`";
        return Err(ServiceError::invalid("lease", why));
    }
    if let Some(version) = policy_version {
        check_version_step("policy_version", version, stored.policy_version)?;
    }
    let settings: RunSettings = from_json("a run's settings", &stored.settings)?;
    let audit_groups = settings.audit_groups as usize;
    columns.check(usize::try_from(row.episodes()).unwrap_or_default())?;
    let columns = columns.canonical();
    let mut loader = ScenarioLoader::default();
    let mut ranges = Vec::new();
    for range in columns::ranges(&mut conn, row.id).await? {
        let recipe = loader.recipe(&mut conn, &range.recipe).await?;
        ranges.push(RecipeRange { range, recipe });
    }
    drop(conn);
    let group_size = usize::try_from(row.group_size).unwrap_or(1);
    // Compressing takes milliseconds, which the threads that answer cannot spare.
    let change = tokio::task::spawn_blocking(move || {
        for RecipeRange { range, recipe } in &ranges {
            check_scores(&columns, range, group_size, recipe.task().score_range())?;
        }
        let has_finished = |group| claimed_scores(&columns, group, group_size).next().is_some();
        let drawn = draw_scenarios(&ranges, audit_groups, &has_finished)?;
        let totals = ranges.iter().map(|of| range_totals(&columns, &of.range, group_size)).collect();
        let (digest, body) = (columns.digest(), columns.encode()?);
        let failed = columns.failed.iter().filter(|failed| **failed).count();
        Ok::<_, ServiceError>(StoreClaim {
            run,
            lease,
            policy_version,
            digest,
            body,
            failed,
            columns,
            drawn,
            audit_groups,
            totals,
        })
    });
    let change = change.await.map_err(|error| ServiceError::invalid("score", error.to_string()))??;
    lease_service.writer.change(change).await
}

/// Checks that the claimed scores of a range are possible for its task.
fn check_scores(
    columns: &Columns,
    range: &SeedRangeRow,
    group_size: usize,
    scores: env_core::space::ScoreRange,
) -> Result<(), ServiceError> {
    let tolerance = scores.tolerance();
    for at in range_episodes(range, group_size) {
        let score = f64::from(columns.scores[at]);
        let is_possible = (scores.min - tolerance..=scores.max + tolerance).contains(&score);
        if !is_possible && !columns.has_failed(at) {
            let (min, max, score) = (scores.min, scores.max, format_shortest(score));
            let why = format!("must be from {min} to {max}, the scores of {}, got {score}", range.task);
            return Err(ServiceError::invalid(format!("score.{at}"), why));
        }
    }
    Ok(())
}

/// Stores a claim, and the groups that are audited.
struct StoreClaim {
    run: RunId,
    lease: LeaseId,
    policy_version: Option<u32>,
    digest: Vec<u8>,
    body: Vec<u8>,
    failed: usize,
    columns: Columns,
    /// Groups with finished episodes. They are audited where episodes of the sample are claimed as failed.
    drawn: BTreeMap<i64, Scenario>,
    /// Number of groups to audit.
    audit_groups: usize,
    totals: Vec<RangeTotals>,
}

impl Change for StoreClaim {
    type Output = ClaimStatus;

    async fn apply(self, tx: &mut WriteTx) -> Result<ClaimStatus, ServiceError> {
        let lease = find_lease(&mut tx.conn, &self.run, &self.lease).await?;
        if let Some(before) = columns::claim(&mut tx.conn, lease.id).await? {
            if before.digest != self.digest {
                return Err(ServiceError::ColumnsConflict(self.lease.to_string()));
            }
            return claim_status_of(&mut tx.conn, lease, before).await;
        }
        if lease.is_compacted
            && let Some(compacted) = compacted_leases::get(&mut tx.conn, self.run.as_str(), lease.id).await?
            && let Some(claim) = compacted.claim
        {
            return Ok(self.compacted_status(lease, &claim));
        }
        let clock = tx.run(&lease.run).await?.lease_clock();
        if !lease.is_active() || lease.expires_at <= clock {
            let status = if lease.is_active() { LeaseStatus::Expired } else { lease.status };
            return Err(ServiceError::LeaseClosed { lease: self.lease.to_string(), status });
        }
        self.store(tx, lease).await
    }
}

impl StoreClaim {
    /// Returns the status of a claim that was stored before and is compacted: nothing is left to compare these columns with.
    fn compacted_status(self, lease: LeaseRow, claim: &CompactedClaim) -> ClaimStatus {
        let claim = ColumnClaimRow {
            state: claim.state,
            digest: self.digest,
            policy_version: lease.policy_version,
            episodes: claim.episodes,
            failed: claim.failed,
            refusal_reason: None,
            at: lease.created_at,
        };
        ClaimStatus { claim, lease, audited: Vec::new() }
    }

    /// Stores the first claim of an active lease, and renews the lease for the audit.
    async fn store(self, tx: &mut WriteTx, mut lease: LeaseRow) -> Result<ClaimStatus, ServiceError> {
        let row = ColumnClaimRow {
            state: ClaimState::Claimed,
            policy_version: self.policy_version.map_or(lease.policy_version, i64::from),
            episodes: lease.episodes(),
            failed: self.failed as i64,
            refusal_reason: None,
            at: tx.now,
            digest: self.digest.clone(),
        };
        columns::insert_claim(&mut tx.conn, lease.id, &row, &self.body).await?;
        for totals in &self.totals {
            columns::set_range_totals(&mut tx.conn, lease.id, totals).await?;
        }
        let run = tx.run(&lease.run).await?;
        let is_evidence = counts_as_evidence(lease.purpose, &run.state.settings);
        let (clock, conn) = (run.lease_clock(), run.conn);
        let mut rows = take_sample(conn, &lease, is_evidence).await?;
        self.add_verified_groups(conn, &lease, &mut rows).await?;
        let audited = self.insert_audited_groups(conn, &lease, rows).await?;
        if audited.episodes == 0 && self.failed as i64 != lease.episodes() {
            let why =
                "all claimed scores are of scenarios without a fair start; claim these episodes as failed";
            return Err(ServiceError::invalid("score", why));
        }
        lease.expires_at = clock + lease.ttl_ms;
        leases::set_expiry(&mut tx.conn, lease.id, lease.expires_at).await?;
        tx.emit(&lease.run, &claim_event(&lease, &row, audited.groups))?;
        if audited.episodes == 0 {
            settle(tx, &lease).await?; // every audited episode failed: there is nothing to audit
        }
        // The claim may have been settled at once.
        let claim = columns::claim(&mut tx.conn, lease.id).await?.unwrap_or(row);
        claim_status_of(&mut tx.conn, lease, claim).await
    }
}

/// Returns the event of a new claim with this number of audited groups.
fn claim_event(lease: &LeaseRow, claim: &ColumnClaimRow, audited: usize) -> RunEvent<'static> {
    RunEvent::Claim {
        lease: lease.name(),
        state: claim.state,
        episodes: claim.episodes,
        failed: claim.failed,
        audited: audited as i64,
        reason: None,
    }
}

/// Numbers of groups and episodes that are audited.
struct AuditSize {
    groups: usize,
    episodes: usize,
}

impl StoreClaim {
    /// Adds groups to the sample until as many groups with finished episodes are audited as the run wants. They verify the claim, and
    /// are no evidence: the trainer chose which episodes finished.
    async fn add_verified_groups(
        &self,
        conn: &mut SqliteConnection,
        lease: &LeaseRow,
        rows: &mut Vec<GroupRow>,
    ) -> Result<(), ServiceError> {
        let group_size = usize::try_from(lease.group_size).unwrap_or(1);
        let has_finished =
            |row: &&GroupRow| claimed_scores(&self.columns, row.number, group_size).next().is_some();
        let wanted = self.audit_groups.saturating_sub(rows.iter().filter(has_finished).count());
        let more: Vec<_> = (self.drawn.iter())
            .filter(|(number, _)| rows.iter().all(|row| row.number != **number))
            .take(wanted)
            .collect();
        let drawn: Vec<&Scenario> = more.iter().map(|(_, scenario)| *scenario).collect();
        scenarios::insert(conn, &drawn).await?;
        let ranges = columns::ranges(conn, lease.id).await?;
        for (number, scenario) in more {
            let Some(range) = ranges.iter().find(|range| range.holds(*number)) else { continue };
            let scenario = scenario.id().0.to_vec();
            let sampled = SampledGroupRow { number: *number, scenario, is_contested: false, is_slot: false };
            rows.push(sampled_row(range, sampled, false));
        }
        rows.sort_by_key(|row| row.number);
        Ok(())
    }

    /// Inserts the sampled groups as groups of the lease, with the claimed scores of their episodes.
    async fn insert_audited_groups(
        &self,
        conn: &mut SqliteConnection,
        lease: &LeaseRow,
        mut rows: Vec<GroupRow>,
    ) -> Result<AuditSize, ServiceError> {
        let group_size = usize::try_from(lease.group_size).unwrap_or(1);
        let mut scores = Vec::new();
        for row in &mut rows {
            let before = scores.len();
            let claimed = claimed_scores(&self.columns, row.number, group_size);
            scores.extend(claimed.map(|claimed| (claimed.episode, f64::from(claimed.score))));
            row.failed = lease.group_size - (scores.len() - before) as i64;
        }
        groups::insert(conn, lease.id, &rows).await?;
        columns::insert_scores(conn, lease.id, &scores).await?;
        Ok(AuditSize { groups: rows.len(), episodes: scores.len() })
    }
}
