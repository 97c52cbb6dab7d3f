//! Taking what is claimed in columns, and drawing what of it is audited.

use std::collections::BTreeMap;
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
use crate::store::folds::{self, FoldedClaim};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::{self, LeaseRow};
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
    /// The episodes whose logs are due or came, by index in the lease.
    pub audited: Vec<i64>,
}

/// A group that is audited.
#[derive(Debug)]
struct Pick {
    range: RangeRow,
    group: i64,
    scenario: Scenario,
    /// What is claimed of the episodes that finished, by index in the lease.
    scores: Vec<(i64, f32)>,
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
    let columns = columns.plain();
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

/// What may be drawn: the ranges with their recipes, and of each the groups of which something is claimed to have finished.
struct Urn<'a> {
    columns: &'a Columns,
    group_size: usize,
    ranges: Vec<(&'a RangeRow, &'a Arc<env_core::Recipe>, Vec<i64>)>,
}

impl<'a> Urn<'a> {
    fn of(columns: &'a Columns, ranges: &'a [(RangeRow, Arc<env_core::Recipe>)], group_size: usize) -> Self {
        let ranges = ranges.iter().map(|(range, recipe)| {
            let groups = range.first..range.first + range.groups;
            (
                range,
                recipe,
                groups.filter(|group| flown(columns, *group, group_size).next().is_some()).collect(),
            )
        });
        // Where nothing finished nothing is drawn: what is drawn is spread over the others.
        Self {
            columns,
            group_size,
            ranges: ranges.filter(|(.., groups): &(_, _, Vec<i64>)| !groups.is_empty()).collect(),
        }
    }

    /// Draws some groups of one range, if so many can be flown: a scenario without a fair start is flown by nobody.
    fn draw(
        &self,
        rng: &mut ChaCha12Rng,
        range: usize,
        wanted: usize,
        picks: &mut BTreeMap<i64, Pick>,
    ) -> Result<(), TrainingError> {
        let (range, recipe, groups) = &self.ranges[range];
        let mut left = wanted;
        for at in index::sample(rng, groups.len(), groups.len().min(wanted.saturating_mul(TRIES))) {
            let group = groups[at];
            if left == 0 {
                break;
            }
            let scenario = recipe_and_seed(range, Arc::clone(recipe), group)?;
            if picks.contains_key(&group) || scenario.task().start(&scenario).is_err() {
                continue;
            }
            let scores = flown(self.columns, group, self.group_size).collect();
            picks.insert(group, Pick { range: (*range).clone(), group, scenario, scores });
            left -= 1;
        }
        Ok(())
    }
}

/// The episodes of a group that are claimed to have finished, by their index in the lease, with their scores.
fn flown(columns: &Columns, group: i64, group_size: usize) -> impl Iterator<Item = (i64, f32)> {
    let first = usize::try_from(group).unwrap_or_default() * group_size;
    let entries = (first..first + group_size).filter(|at| !columns.has_failed(*at));
    entries.map(|at| (at as i64, columns.scores[at]))
}

/// Draws what is audited: as many groups of each range as of any other, as far as there are so many, by randomness that nobody
/// outside can foresee. A group of which some failed is drawn like any other, and what finished of it is audited.
///
/// # Errors
/// Scores of scenarios that nobody can fly.
fn draw(
    columns: &Columns,
    ranges: &[(RangeRow, Arc<env_core::Recipe>)],
    group_size: usize,
    wanted: usize,
) -> Result<Vec<Pick>, TrainingError> {
    let mut seed = [0; 32];
    rand::rngs::SysRng.try_fill_bytes(&mut seed).map_err(|error| TrainingError::NotCommitted {
        reason: format!("no randomness to draw audits with: {error}"),
        trouble: None,
    })?;
    let mut rng = ChaCha12Rng::from_seed(seed);
    let urn = Urn::of(columns, ranges, group_size);
    let mut picks = BTreeMap::new();
    if urn.ranges.is_empty() {
        return Ok(Vec::new()); // all of it failed
    }
    // Where fewer are wanted than there are ranges, chance says which have one.
    let count = urn.ranges.len();
    let mut share = vec![wanted / count; count];
    for at in index::sample(&mut rng, count, wanted % count) {
        share[at] += 1;
    }
    for (range, share) in share.into_iter().enumerate() {
        urn.draw(&mut rng, range, share, &mut picks)?;
    }
    // What some ranges did not have the others have to give.
    for range in index::sample(&mut rng, count, count) {
        let missing = wanted.saturating_sub(picks.len());
        urn.draw(&mut rng, range, missing, &mut picks)?;
    }
    if picks.is_empty() {
        let why = "scores are claimed of scenarios that have no fair start; report them as failed";
        return Err(TrainingError::invalid("score", why));
    }
    Ok(picks.into_values().collect())
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
        if lease.folded != 0
            && let Some(folded) = folds::get(&mut work.conn, self.run.as_str(), lease.id).await?
            && let Some(FoldedClaim { state, episodes, failed }) = folded.claim
        {
            // They came, and are kept no longer: there is nothing left to compare these with.
            let (policy_version, at) = (lease.policy_version, lease.created_at);
            let claim =
                ClaimRow { state, digest: self.digest, policy_version, episodes, failed, why: None, at };
            return Ok(Claimed { claim, lease, audited: Vec::new() });
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
        audit(conn, &lease, &self.picks, purpose && !lossy).await?;
        lease.expires_at = work.now + lease.ttl_ms;
        leases::set_expiry(&mut work.conn, lease.id, lease.expires_at).await?;
        let told = Happening::Claim {
            lease: lease.name(),
            state: &row.state,
            episodes: row.episodes,
            failed: row.failed,
            audited: self.picks.len() as i64,
            why: None,
        };
        work.tell(&lease.run, &told)?;
        if self.picks.is_empty() {
            settle::settle(work, &lease).await?; // nothing of it can be flown again: all of it failed
        }
        // It may have ended at once.
        let claim = columns::claim(&mut work.conn, lease.id).await?.unwrap_or(row);
        standing_of(&mut work.conn, lease, claim).await
    }
}

/// Makes groups of what is audited.
async fn audit(
    conn: &mut sqlx::SqliteConnection,
    lease: &LeaseRow,
    picks: &[Pick],
    evidence: bool,
) -> Result<(), TrainingError> {
    let drawn: Vec<_> = picks.iter().map(|pick| &pick.scenario).collect();
    scenarios::insert(conn, &drawn).await?;
    let group = |pick: &Pick| GroupRow {
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
        failed: lease.group_size - pick.scores.len() as i64,
        successes: 0,
        evidence: i64::from(evidence),
        train: 1,
    };
    groups::insert(conn, lease.id, &picks.iter().map(group).collect::<Vec<_>>()).await?;
    let scores = picks.iter().flat_map(|pick| &pick.scores).map(|(index, score)| (*index, f64::from(*score)));
    Ok(columns::insert_scores(conn, lease.id, &scores.collect::<Vec<_>>()).await?)
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

/// Whether columns came for a lease.
pub(in crate::training) async fn is_claimed(
    conn: &mut sqlx::SqliteConnection,
    lease: i64,
) -> Result<bool, TrainingError> {
    Ok(columns::claim(conn, lease).await?.is_some())
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
    let audited = columns::audited(conn, lease.id).await?;
    Ok(Claimed { claim, lease, audited })
}
