//! Leasing groups, renewing and releasing leases, and letting them expire.

use sqlx::SqliteConnection;

use super::close::close_groups;
use super::design::serve;
use super::ended::Ended;
use super::queue::{self, AHEAD};
use super::sets::Sets;
use super::settings::{EvidenceFrom, MAX_GROUP_SIZE, within};
use super::{Change, Happening, Mind, TrainingError, Work, columns};
use crate::ids::{LeaseId, RunId, random_token};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::{self, LeaseRow};
use crate::store::proposals::{self, Queued};
use crate::store::{design_counts, folds, from_json, refills, serving, tokens};
use curriculum::Proposal;

/// Most groups of a lease.
pub const MAX_GROUPS: u32 = 1024;
/// Most episodes of a lease.
pub const MAX_EPISODES: u32 = 16_384;
/// Shortest and longest time a lease holds, seconds.
pub const TTL_S: (u32, u32) = (1, 24 * 3600);
/// Active leases a run may have.
const MAX_ACTIVE: i64 = 1024;

/// What a lease is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Purpose {
    /// To learn from.
    Train,
    /// To be judged by: flown without exploring, not learnt from.
    Probe,
    /// To measure: moves nothing. Its scenarios are drawn from evaluation seeds at the current levels.
    Eval,
}

impl Purpose {
    /// The word on the wire and in the store.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Probe => "probe",
            Self::Eval => "eval",
        }
    }
}

/// Takes a lease.
#[derive(Debug, Clone)]
pub struct TakeLease {
    /// Of which run.
    pub run: RunId,
    /// How many groups.
    pub groups: u32,
    /// Episodes in each; the run's own if none.
    pub group_size: Option<u32>,
    /// The policy that will fly it.
    pub policy_version: u32,
    /// How long it holds, seconds.
    pub ttl_s: u32,
    /// What for.
    pub purpose: Purpose,
    /// Whose it will be, where a token is needed.
    pub owner: Option<Owner>,
    /// Whether groups whose episodes all came to the same are replaced, up to as many as there are.
    pub refill: bool,
    /// The evaluation whose scenarios are wanted.
    pub evaluation: Option<i64>,
}

/// Who owns what is made, and how much of it they may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Owner {
    /// The token.
    pub token: i64,
    /// How many at most.
    pub most: u32,
}

/// A lease that is granted, as it is stored.
#[derive(Debug)]
pub struct Granted {
    /// The lease.
    pub row: LeaseRow,
    /// Its groups; none of one of columns.
    pub groups: Vec<GroupRow>,
    /// What they are flown and judged by, where it was read on the way: of a small lease.
    pub sets: Option<Sets>,
}

/// Groups whose sets are read while the lease is granted: whoever takes so few waits with an agent at a standstill, and every
/// turn of another thread is time. Of more they are read beside, for the sake of others.
const FEW: usize = 8;

impl TakeLease {
    pub(super) fn check(&self, mind: &Mind) -> Result<u32, TrainingError> {
        if mind.paused {
            return Err(TrainingError::Paused(mind.run.clone()));
        }
        let group_size = self.group_size.unwrap_or(mind.settings.group_size);
        within("groups", self.groups, 1, MAX_GROUPS)?;
        within("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        within("ttl_s", self.ttl_s, TTL_S.0, TTL_S.1)?;
        within("groups × group_size", self.groups * group_size, 1, MAX_EPISODES)?;
        if self.evaluation.is_some() && self.purpose != Purpose::Eval {
            let why = "its scenarios are flown with purpose: eval";
            return Err(TrainingError::invalid("evaluation", why));
        }
        if self.refill && (group_size < 2 || self.purpose != Purpose::Train) {
            let why = "only groups of two or more episodes for training can come to the same; leave it out";
            return Err(TrainingError::invalid("refill", why));
        }
        Ok(group_size)
    }

    /// The row of a lease that may be granted; it is not written yet.
    pub(super) async fn begin(
        &self,
        conn: &mut SqliteConnection,
        group_size: u32,
        now: i64,
    ) -> Result<LeaseRow, TrainingError> {
        let leases::Outlook { next, active } = leases::outlook(conn, self.run.as_str()).await?;
        if active >= MAX_ACTIVE {
            return Err(TrainingError::TooManyLeases(active));
        }
        if let Some(Owner { token, most }) = self.owner {
            let held = tokens::leases(conn, token).await?;
            if held >= i64::from(most) {
                return Err(TrainingError::TooManyLeasesOfToken(most));
            }
        }
        let ttl_ms = i64::from(self.ttl_s) * 1000;
        Ok(LeaseRow {
            folded: 0,
            owner: self.owner.map(|owner| owner.token),
            id: next,
            token: random_token(6),
            run: self.run.to_string(),
            purpose: self.purpose.word().to_owned(),
            form: leases::GROUPS.to_owned(),
            status: "active".to_owned(),
            groups: i64::from(self.groups),
            group_size: i64::from(group_size),
            policy_version: i64::from(self.policy_version),
            ttl_ms,
            created_at: now,
            expires_at: now + ttl_ms,
        })
    }
}

impl Change for TakeLease {
    /// None while scenarios are still being prepared.
    type Answer = Option<Granted>;

    async fn apply(self, work: &mut Work) -> Result<Self::Answer, TrainingError> {
        let (run, now) = (self.run.as_str(), work.now);
        let (mind, conn) = work.mind(run).await?;
        let group_size = self.check(mind)?;
        let evidence = match self.purpose {
            Purpose::Train => mind.settings.evidence_from == EvidenceFrom::Train,
            Purpose::Probe => true,
            Purpose::Eval => false,
        };
        let row = self.begin(conn, group_size, now).await?;
        let designed = match self.purpose {
            Purpose::Train => serve::choose(conn, mind, row.id, self.groups).await?,
            Purpose::Probe | Purpose::Eval => vec![None; self.groups as usize],
        };
        let proposed = designed.iter().filter(|layout| layout.is_none()).count();
        let mut head = proposals::head(conn, run, proposed as i64).await?;
        if head.len() < proposed {
            // More than wait while nobody asks, or some of those that did were hopeless.
            queue::fill(work, run, AHEAD.max(self.groups)).await?;
            head = proposals::head(&mut work.conn, run, proposed as i64).await?;
        }
        let (mind, conn) = work.mind(run).await?;
        if head.iter().any(|queued| queued.scenario.is_none()) {
            return Ok(None);
        }
        let seqs: Vec<i64> = head.iter().map(|queued| queued.seq).collect();
        proposals::leased(conn, run, &seqs).await?;
        let (mut head, mut groups) = (head.into_iter(), Vec::new());
        for (number, layout) in (0i64..).zip(designed) {
            groups.push(match layout {
                Some(layout) => {
                    serving::served(conn, layout.id, now).await?;
                    serve::group(mind, number, layout)
                }
                None => {
                    let Some(queued) = head.next() else { continue }; // the queue was filled for as many
                    proposed_group(number, queued, (evidence, self.purpose == Purpose::Train))?
                }
            });
        }
        leases::insert(conn, &row, &groups).await?;
        if self.refill {
            refills::allow(conn, row.id, row.groups).await?;
        }
        if self.purpose == Purpose::Train {
            let designed = i64::from(self.groups) - proposed as i64;
            design_counts::add_groups(conn, run, i64::from(self.groups), designed).await?;
        }
        let sets = match groups.len() {
            ..=FEW => Some(Sets::of_groups(conn, &groups).await?),
            _ => None,
        };
        queue::fill(work, run, AHEAD).await?;
        work.tell(run, &Happening::lease(&row, "taken"))?;
        Ok(Some(Granted { row, groups, sets }))
    }
}

/// The group that serves a prepared proposal: whether it may be evidence, and whether it may be learnt from.
pub(super) fn proposed_group(
    number: i64,
    queued: Queued,
    (evidence, learn): (bool, bool),
) -> Result<GroupRow, TrainingError> {
    let proposal: Proposal = from_json("a proposal", &queued.body)?;
    Ok(GroupRow {
        number,
        proposal: Some(queued.seq),
        layout: None,
        scenario: queued.scenario.unwrap_or_default(),
        task: proposal.task,
        level: proposal.level.map(i64::from),
        role: super::mind::word(&proposal.role)?,
        contested: queued.contested.unwrap_or(0),
        state: "open".to_owned(),
        finished: 0,
        failed: 0,
        successes: 0,
        evidence: i64::from(evidence),
        train: i64::from(proposal.train && learn),
    })
}

/// A lease of this run, by its id.
///
/// # Errors
/// No such lease, or one of another run or database.
pub async fn find(
    conn: &mut SqliteConnection,
    run: &RunId,
    lease: &LeaseId,
) -> Result<LeaseRow, TrainingError> {
    let row = match leases::get(conn, lease.number).await? {
        None => folds::get(conn, run.as_str(), lease.number).await?.map(|folded| folded.row),
        row => row,
    };
    row.filter(|row| row.token == lease.token && row.run == run.as_str())
        .ok_or_else(|| TrainingError::UnknownLease(lease.to_string()))
}

/// Holds a lease for its time again, from now.
#[derive(Debug)]
pub struct Renew {
    /// Of which run.
    pub run: RunId,
    /// Which.
    pub lease: LeaseId,
}

impl Change for Renew {
    type Answer = LeaseRow;

    async fn apply(self, work: &mut Work) -> Result<LeaseRow, TrainingError> {
        let mut row = find(&mut work.conn, &self.run, &self.lease).await?;
        if row.status != "active" || row.expires_at <= work.now {
            let status = if row.status == "active" { "expired".to_owned() } else { row.status };
            return Err(TrainingError::LeaseOver { lease: self.lease.to_string(), status });
        }
        if row.is_columns() && columns::is_claimed(&mut work.conn, row.id).await? {
            // Whoever knows what is audited must not have all the time to fly it until it fits.
            return Err(TrainingError::AuditDue(self.lease.to_string()));
        }
        row.expires_at = work.now + row.ttl_ms;
        leases::set_expiry(&mut work.conn, row.id, row.expires_at).await?;
        work.tell(&row.run, &Happening::lease(&row, "renewed"))?;
        Ok(row)
    }
}

/// Gives a lease back: what was not reported is offered again. Releasing twice is the same as once.
#[derive(Debug)]
pub struct Release {
    /// Of which run.
    pub run: RunId,
    /// Which.
    pub lease: LeaseId,
}

impl Change for Release {
    type Answer = LeaseRow;

    async fn apply(self, work: &mut Work) -> Result<LeaseRow, TrainingError> {
        let mut row = find(&mut work.conn, &self.run, &self.lease).await?;
        if row.status == "active" {
            end(work, &row, "released").await?;
            row.status = "released".to_owned();
        }
        Ok(row)
    }
}

/// Ends leases whose time is over.
#[derive(Debug)]
pub struct Expire;

/// Leases ended in one go.
const EXPIRE_AT_ONCE: i64 = 32;

impl Change for Expire {
    /// How many were ended.
    type Answer = usize;

    async fn apply(self, work: &mut Work) -> Result<usize, TrainingError> {
        let overdue = leases::overdue(&mut work.conn, work.now, EXPIRE_AT_ONCE).await?;
        for &id in &overdue {
            if let Some(row) = leases::get(&mut work.conn, id).await? {
                end(work, &row, "expired").await?;
            }
        }
        Ok(overdue.len())
    }
}

/// Ends a lease: what was not reported is offered again.
pub(super) async fn end(work: &mut Work, lease: &LeaseRow, status: &str) -> Result<Ended, TrainingError> {
    leases::set_status(&mut work.conn, lease.id, status).await?;
    work.tell(&lease.run, &Happening::lease(lease, status))?;
    if lease.is_columns() {
        columns::abandon(work, lease).await?;
        return Ok(Ended::default());
    }
    let mut groups = groups::of_lease(&mut work.conn, lease.id).await?;
    groups.retain(|group| group.state == "open");
    close_groups(work, lease, groups).await
}
