//! Taking what is claimed in columns, and drawing what of it is audited.

use std::collections::BTreeSet;
use std::sync::Arc;

use env_core::Scenario;
use rand::seq::index;
use rand::{SeedableRng, TryRng};
use rand_chacha::ChaCha12Rng;

use super::lease::recipe_and_seed;
use super::settle;
use super::{Columns, MOST_SCORE_GAP, decode};
use crate::ids::{LeaseId, RunId};
use crate::store::columns::{self, ClaimRow, RangeRow};
use crate::store::leases::{self, GroupRow, LeaseRow};
use crate::store::scenarios::{self, Loader};
use crate::store::{from_json, runs};
use crate::training::lease::find;
use crate::training::settings::EvidenceFrom;
use crate::training::{Change, Desk, Happening, RunSettings, TrainingError, Work};

/// Share of a claim that may have failed for it to be evidence, as of a block's.
const MOST_FAILED: f64 = 0.1;
/// Groups looked at for one that can be audited: a scenario without a fair start is flown by nobody.
const TRIES: usize = 16;

/// Where a claim stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Claimed {
    /// The claim.
    pub claim: ClaimRow,
    /// The lease, with until when logs are due.
    pub lease: LeaseRow,
    /// Groups whose logs are due or came, by number.
    pub audited: Vec<i64>,
}

/// A group that is audited.
#[derive(Debug)]
struct Pick {
    range: RangeRow,
    group: i64,
    scenario: Scenario,
    scores: Vec<f32>,
}

/// Takes the columns of a lease: they are on disk when this answers, and what is audited is drawn. The same columns again are
/// answered as before.
///
/// # Errors
/// Columns that do not fit the lease, contradict those that came before, or come too late.
pub async fn claim(
    desk: &Desk,
    (run, lease): (RunId, LeaseId),
    policy_version: Option<u32>,
    columns: Columns,
) -> Result<Claimed, TrainingError> {
    let mut conn = desk.readers.acquire().await?;
    let stored = runs::get(&mut conn, run.as_str()).await?;
    let stored = stored.ok_or_else(|| TrainingError::UnknownRun(run.to_string()))?;
    let settings: RunSettings = from_json("a run's settings", &stored.settings)?;
    let row = find(&mut conn, &run, &lease).await?;
    if !row.is_columns() {
        let why = "its episodes are reported one by one; take a lease with form: columns to send columns";
        return Err(TrainingError::invalid("lease", why));
    }
    columns.check(usize::try_from(row.episodes()).unwrap_or_default())?;
    let mut loader = Loader::default();
    let mut ranges = Vec::new();
    for range in columns::ranges(&mut conn, row.id).await? {
        let recipe = loader.recipe(&mut conn, &range.recipe).await?;
        ranges.push((range, recipe));
    }
    drop(conn);
    let groups = settings.audit_groups;
    let group_size = usize::try_from(row.group_size).unwrap_or(1);
    // Compressing and drawing take milliseconds: not on the threads that answer.
    let enter = tokio::task::spawn_blocking(move || {
        for (range, recipe) in &ranges {
            in_range(&columns, range, group_size, recipe.task().score_range())?;
        }
        let picks = draw(&columns, &ranges, group_size, groups as usize)?;
        let sums = settle::sums(&columns, ranges.iter().map(|(range, _)| range), group_size);
        let (digest, body) = (columns.digest(), columns.encode()?);
        let failed = columns.failed.iter().filter(|failed| **failed).count();
        Ok::<_, TrainingError>(Enter { run, lease, policy_version, digest, body, failed, picks, sums })
    });
    let enter = enter.await.map_err(|error| TrainingError::invalid("score", error.to_string()))??;
    desk.writer.change(enter).await
}

/// That the scores of a range are ones its task can give.
fn in_range(
    columns: &Columns,
    range: &RangeRow,
    group_size: usize,
    scores: env_core::space::ScoreRange,
) -> Result<(), TrainingError> {
    let room = MOST_SCORE_GAP * (scores.max - scores.min);
    for at in episodes(range, group_size) {
        let score = f64::from(columns.scores[at]);
        let fine = (scores.min - room..=scores.max + room).contains(&score);
        if !fine && !columns.has_failed(at) {
            let why =
                format!("it is {score}, but scores of {} are {} to {}", range.task, scores.min, scores.max);
            return Err(TrainingError::invalid(format!("score.{at}"), why));
        }
    }
    Ok(())
}

/// Indices of a range's episodes in the lease.
pub(super) fn episodes(range: &RangeRow, group_size: usize) -> std::ops::Range<usize> {
    let at = |group: i64| usize::try_from(group).unwrap_or_default() * group_size;
    at(range.first)..at(range.first + range.groups)
}

/// Draws what is audited: as many groups of each range as of any other, by randomness that nobody outside can foresee.
fn draw(
    columns: &Columns,
    ranges: &[(RangeRow, Arc<env_core::Recipe>)],
    group_size: usize,
    wanted: usize,
) -> Result<Vec<Pick>, TrainingError> {
    let mut seed = [0; 32];
    rand::rngs::SysRng.try_fill_bytes(&mut seed).map_err(|error| {
        TrainingError::NotCommitted(format!("no randomness to draw audits with: {error}"))
    })?;
    let mut rng = ChaCha12Rng::from_seed(seed);
    // Where fewer are wanted than there are ranges, chance says which have one.
    let mut share = vec![wanted / ranges.len().max(1); ranges.len()];
    for at in index::sample(&mut rng, ranges.len(), wanted % ranges.len().max(1)) {
        share[at] += 1;
    }
    let mut picks = Vec::with_capacity(wanted);
    for ((range, recipe), share) in ranges.iter().zip(share) {
        let groups = usize::try_from(range.groups).unwrap_or_default();
        let looked_at = index::sample(&mut rng, groups, groups.min(share.saturating_mul(TRIES)));
        let mut taken = BTreeSet::new();
        for at in looked_at {
            if taken.len() >= share {
                break;
            }
            let group = range.first + at as i64;
            let first = usize::try_from(group).unwrap_or_default() * group_size;
            if (first..first + group_size).any(|at| columns.has_failed(at)) {
                continue;
            }
            let scenario = recipe_and_seed(range, Arc::clone(recipe), group)?;
            if scenario.task().start(&scenario).is_err() {
                continue;
            }
            taken.insert(group);
            let scores = columns.scores[first..first + group_size].to_vec();
            picks.push(Pick { range: range.clone(), group, scenario, scores });
        }
    }
    Ok(picks)
}

/// Enters a claim, and the groups that are audited.
struct Enter {
    run: RunId,
    lease: LeaseId,
    policy_version: Option<u32>,
    digest: Vec<u8>,
    body: Vec<u8>,
    failed: usize,
    picks: Vec<Pick>,
    sums: settle::ByRange,
}

impl Change for Enter {
    type Answer = Claimed;

    async fn apply(self, work: &mut Work) -> Result<Claimed, TrainingError> {
        let mut lease = find(&mut work.conn, &self.run, &self.lease).await?;
        if let Some(before) = columns::claim(&mut work.conn, lease.id).await? {
            if before.digest != self.digest {
                return Err(TrainingError::ClaimedOtherwise(self.lease.to_string()));
            }
            return standing_of(&mut work.conn, lease, before).await;
        }
        if lease.status != "active" || lease.expires_at <= work.now {
            let status = if lease.status == "active" { "expired".to_owned() } else { lease.status };
            return Err(TrainingError::LeaseOver { lease: self.lease.to_string(), status });
        }
        let row = ClaimRow {
            state: "claimed".to_owned(),
            digest: self.digest,
            policy_version: self.policy_version.map_or(lease.policy_version, i64::from),
            episodes: lease.episodes(),
            failed: self.failed as i64,
            why: None,
            at: work.now,
        };
        columns::insert_claim(&mut work.conn, lease.id, &row, &self.body).await?;
        self.sums.keep(work, &lease).await?;
        let (mind, conn) = work.mind(&lease.run).await?;
        let purpose = lease.purpose == "probe" || mind.settings.evidence_from == EvidenceFrom::Train;
        let lossy = self.failed as f64 > MOST_FAILED * lease.episodes() as f64;
        let mut audited = Vec::with_capacity(self.picks.len());
        for pick in &self.picks {
            audit(conn, &lease, pick, purpose && !lossy).await?;
            audited.push(pick.group);
        }
        lease.expires_at = work.now + lease.ttl_ms;
        leases::set_expiry(&mut work.conn, lease.id, lease.expires_at).await?;
        let told = Happening::Claim {
            lease: lease.name(),
            state: &row.state,
            episodes: row.episodes,
            failed: row.failed,
            audited: audited.len() as i64,
            why: None,
        };
        work.tell(&lease.run, &told)?;
        if self.picks.is_empty() {
            settle::settle(work, &lease).await?; // nothing of it can be flown again: all of it failed
        }
        audited.sort_unstable();
        Ok(Claimed { claim: row, lease, audited })
    }
}

/// Makes a group of what is audited.
async fn audit(
    conn: &mut sqlx::SqliteConnection,
    lease: &LeaseRow,
    pick: &Pick,
    evidence: bool,
) -> Result<(), TrainingError> {
    scenarios::insert(conn, &pick.scenario).await?;
    let group = GroupRow {
        number: pick.group,
        proposal: Some(pick.range.proposal),
        layout: None,
        scenario: pick.scenario.id().0.to_vec(),
        task: pick.range.task.clone(),
        level: pick.range.level,
        role: pick.range.role.clone(),
        contested: 0, // found when its logs come
        state: "open".to_owned(),
        finished: 0,
        failed: 0,
        successes: 0,
        evidence: i64::from(evidence),
    };
    leases::insert_group(conn, lease.id, &group).await?;
    for (index, score) in (pick.group * lease.group_size..).zip(&pick.scores) {
        columns::insert_score(conn, (lease.id, index), f64::from(*score)).await?;
    }
    Ok(())
}

/// Where the claim of a lease stands; none where nothing was claimed.
///
/// # Errors
/// The store's.
pub async fn standing(
    conn: &mut sqlx::SqliteConnection,
    lease: LeaseRow,
) -> Result<Option<Claimed>, TrainingError> {
    match columns::claim(conn, lease.id).await? {
        Some(claim) => standing_of(conn, lease, claim).await.map(Some),
        None => Ok(None),
    }
}

/// What was claimed of a lease, with what became of it; none where nothing was.
///
/// # Errors
/// The store's.
pub async fn entries(
    conn: &mut sqlx::SqliteConnection,
    lease: i64,
) -> Result<Option<(String, Columns)>, TrainingError> {
    let Some(claim) = columns::claim(conn, lease).await? else { return Ok(None) };
    let body = columns::body(conn, lease).await?.unwrap_or_default();
    Ok(Some((claim.state, decode(&body)?)))
}

async fn standing_of(
    conn: &mut sqlx::SqliteConnection,
    lease: LeaseRow,
    claim: ClaimRow,
) -> Result<Claimed, TrainingError> {
    let audited = leases::groups(conn, lease.id).await?.into_iter().map(|group| group.number).collect();
    Ok(Claimed { claim, lease, audited })
}
