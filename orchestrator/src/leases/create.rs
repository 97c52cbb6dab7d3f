//! Creates a lease of prepared groups.

use std::ops::RangeInclusive;

use api_types::EvidenceFrom;
use sqlx::SqliteConnection;
use store::design_counters::{self, TrainingGroups};
use store::from_json;
use store::groups::GroupRow;
use store::ids::{RunId, random_token};
use store::leases::{self, Disclosure, LeaseForm, LeaseRow, LeaseStatus, Purpose};
use store::principals::{self, PrincipalId};
use store::proposals::{self, QueuedProposal};
use store::refills;
use store::servable_layouts::{self, ServableLayout};

use crate::designs::place::Place;
use crate::designs::serve::{self, Opening, Openings};
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::leases::group_row::{GroupTerms, ProposedGroup, proposed_group};
use crate::leases::proposal_queue;
use crate::leases::scenario_cache::ScenarioCache;
use crate::metrics::LeaseEvent;
use crate::runs::settings::{MAX_GROUP_SIZE, RunSettings};
use crate::runs::validate::{check_episodes, check_range};
use crate::runs::version_step::check_version_step;
use curriculum::{Proposal, ProposalRole, Slot};

/// Most groups of a lease.
pub const MAX_GROUPS: u32 = 1024;
/// Most episodes of a lease.
pub const MAX_EPISODES: u32 = 16_384;
/// Duration of a lease, in seconds.
pub const TTL_S: RangeInclusive<u32> = 1..=24 * 3600;
/// Most active leases of a run.
const MAX_ACTIVE: i64 = 1024;
/// Most groups of a lease whose scenarios are read while the lease is granted. A client that leases so few groups waits with an agent
/// at a standstill, and each switch of threads costs time. The scenarios of larger leases are read outside the transaction.
const SMALL_LEASE: usize = 8;

/// Creates a lease of groups.
#[derive(Debug, Clone)]
pub struct CreateLease {
    /// Id of the run.
    pub run: RunId,
    /// Number of requested groups.
    pub groups: u32,
    /// Number of episodes in each group; `None` for the run's own.
    pub group_size: Option<u32>,
    /// Version of the policy that will act.
    pub policy_version: u32,
    /// Duration of the lease, in seconds.
    pub ttl_s: u32,
    /// Purpose of the episodes.
    pub purpose: Purpose,
    /// Owner of the lease; `None` without authentication.
    pub owner: Option<OwnerQuota>,
    /// True if groups with zero variance are replaced, up to as many as the lease has.
    pub refill: bool,
    /// Number of the evaluation whose scenarios are requested.
    pub evaluation: Option<i64>,
    /// When the lease discloses its scenarios.
    pub disclosure: Disclosure,
}

/// Owner of a new lease or run, and how many of them the owner may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OwnerQuota {
    /// Principal that owns the lease or run.
    pub principal: PrincipalId,
    /// Most active leases, or most runs, of the principal; `None` for any number.
    pub max: Option<u32>,
}

impl OwnerQuota {
    /// The server as the owner of leases of its workers and sessions.
    pub const SERVER: Self = Self { principal: PrincipalId::SERVER, max: None };
}

/// A lease that was granted.
#[derive(Debug)]
pub struct GrantedLease {
    /// Row of the lease.
    pub row: LeaseRow,
    /// Rows of its groups; empty for a lease of columns.
    pub groups: Vec<GroupRow>,
    /// Scenarios and brackets of the groups, if they were read with a small lease.
    pub scenarios: Option<ScenarioCache>,
}

impl CreateLease {
    /// Checks the request against the run, and returns the group size.
    pub(crate) fn check(&self, state: &RunState) -> Result<u32, ServiceError> {
        if state.paused_at.is_some() {
            return Err(ServiceError::Paused(state.run.clone()));
        }
        let group_size = self.group_size.unwrap_or(state.settings.group_size);
        check_range("groups", self.groups, 1, MAX_GROUPS)?;
        check_range("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        check_range("ttl_s", self.ttl_s, *TTL_S.start(), *TTL_S.end())?;
        if self.purpose != Purpose::Eval {
            check_version_step("policy_version", self.policy_version, state.policy_version)?;
        }
        check_episodes(self.groups, group_size, MAX_EPISODES)?;
        if self.evaluation.is_some() && self.purpose != Purpose::Eval {
            let why = "needs `purpose: eval`";
            return Err(ServiceError::invalid("evaluation", why));
        }
        if self.disclosure == Disclosure::Begin && self.purpose == Purpose::Eval {
            let why = "must be `lease` with `purpose: eval`: evaluations are no evidence of mastery";
            return Err(ServiceError::invalid("disclosure", why));
        }
        if self.refill && (group_size < 2 || self.purpose != Purpose::Train) {
            let why = "needs `purpose: train` and a `group_size` of at least 2";
            return Err(ServiceError::invalid("refill", why));
        }
        Ok(group_size)
    }

    /// Builds the row of the lease, if run and owner may have another one. The row is not written yet.
    pub(crate) async fn new_row(
        &self,
        conn: &mut SqliteConnection,
        group_size: u32,
        now: i64,
    ) -> Result<LeaseRow, ServiceError> {
        let leases::LeaseCounters { next, active } = leases::counters(conn, self.run.as_str()).await?;
        if active >= MAX_ACTIVE {
            return Err(ServiceError::TooManyLeases(active));
        }
        if let Some(OwnerQuota { principal, max: Some(max) }) = self.owner {
            let held = principals::count_leases(conn, principal).await?;
            if held >= i64::from(max) {
                return Err(ServiceError::TooManyLeasesOfPrincipal(max));
            }
        }
        let ttl_ms = i64::from(self.ttl_s) * 1000;
        Ok(LeaseRow {
            is_compacted: false,
            owner: self.owner.map(|owner| owner.principal),
            id: next,
            id_suffix: random_token(6),
            run: self.run.to_string(),
            purpose: self.purpose,
            form: LeaseForm::Groups,
            status: LeaseStatus::Active,
            groups: i64::from(self.groups),
            group_size: i64::from(group_size),
            policy_version: i64::from(self.policy_version),
            ttl_ms,
            created_at: now,
            expires_at: now + ttl_ms,
            first_expires_at: now + ttl_ms,
            disclosure: self.disclosure,
        })
    }
}

impl Change for CreateLease {
    /// `None` while scenarios are still being prepared.
    type Output = Option<GrantedLease>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Self::Output, ServiceError> {
        let mut run = tx.run(self.run.as_str()).await?;
        let group_size = self.check(&run.state)?;
        let row = self.new_row(run.conn, group_size, run.now).await?;
        let Some(scenarios) = self.choose_scenarios(&mut run, row.id).await? else { return Ok(None) };
        let designed = scenarios.iter().filter(|chosen| chosen.layout.is_some()).count();
        let (groups, slots) = self.group_rows(&mut run, &row, scenarios).await?;
        leases::insert(run.conn, &row, &groups).await?;
        run.state.open_slots(run.conn, slots, run.now).await?;
        if self.refill {
            refills::allow(run.conn, row.id, row.groups).await?;
        }
        if self.purpose == Purpose::Train {
            let all = i64::from(self.groups);
            let added = TrainingGroups { all, designed: designed as i64 };
            design_counters::add_groups(run.conn, self.run.as_str(), added).await?;
        }
        let scenarios = match groups.len() {
            ..=SMALL_LEASE if self.disclosure == Disclosure::Lease => {
                Some(ScenarioCache::of_groups(run.conn, &groups).await?)
            }
            _ => None,
        };
        proposal_queue::fill(&mut run).await?;
        run.emit(&RunEvent::lease(&row, LeaseEvent::Created))?;
        Ok(Some(GrantedLease { row, groups, scenarios }))
    }
}

/// Choice for a group of a lease: a layout, a proposal, or a layout in place of the scenario of a proposal.
struct GroupChoice {
    layout: Option<ServableLayout>,
    proposal: Option<QueuedProposal>,
}

impl CreateLease {
    /// Chooses what each group serves; `None` while proposals are not prepared. A strategy that samples rungs learns from designed
    /// groups, so that they keep their proposals.
    async fn choose_scenarios(
        &self,
        run: &mut RunTx<'_>,
        lease: i64,
    ) -> Result<Option<Vec<GroupChoice>>, ServiceError> {
        let keeps_proposals = run.state.settings.curriculum.strategy.samples_rungs();
        if self.purpose == Purpose::Train && !keeps_proposals {
            let openings = Openings::Current(self.groups);
            let layouts = serve::choose_layouts(run.conn, &run.state, lease, openings).await?;
            let proposed = layouts.iter().filter(|layout| layout.is_none()).count();
            let Some(head) = self.take_proposals(run, proposed).await? else { return Ok(None) };
            let mut head = head.into_iter();
            let choice = |layout: Option<ServableLayout>| {
                let proposal = if layout.is_none() { head.next() } else { None };
                GroupChoice { layout, proposal }
            };
            return Ok(Some(layouts.into_iter().map(choice).collect()));
        }
        let Some(head) = self.take_proposals(run, self.groups as usize).await? else { return Ok(None) };
        let layouts = if self.purpose == Purpose::Train {
            let openings: Vec<Option<Opening>> = head.iter().map(opening_of).collect::<Result<_, _>>()?;
            serve::choose_layouts(run.conn, &run.state, lease, Openings::Proposed(&openings)).await?
        } else {
            vec![None; head.len()]
        };
        let choices = layouts.into_iter().zip(head);
        Ok(Some(choices.map(|(layout, proposal)| GroupChoice { layout, proposal: Some(proposal) }).collect()))
    }

    /// Takes prepared proposals from the head of the queue; `None` if some of them are not prepared yet.
    async fn take_proposals(
        &self,
        run: &mut RunTx<'_>,
        count: usize,
    ) -> Result<Option<Vec<QueuedProposal>>, ServiceError> {
        let mut head = proposals::head(run.conn, self.run.as_str(), count as i64).await?;
        if head.len() < count {
            // The lease is larger than the queue usually is, or queued proposals were discarded as unsolvable.
            proposal_queue::fill_at_least(run, self.groups).await?;
            head = proposals::head(run.conn, self.run.as_str(), count as i64).await?;
        }
        if head.iter().any(|queued| queued.scenario.is_none()) {
            return Ok(None);
        }
        let seqs: Vec<i64> = head.iter().map(|queued| queued.seq).collect();
        proposals::set_leased(run.conn, self.run.as_str(), &seqs).await?;
        Ok(Some(head))
    }

    /// Builds the rows of the groups, and their slots.
    async fn group_rows(
        &self,
        run: &mut RunTx<'_>,
        lease: &LeaseRow,
        choices: Vec<GroupChoice>,
    ) -> Result<(Vec<GroupRow>, Vec<Slot>), ServiceError> {
        let terms = GroupTerms {
            lease: lease.id,
            is_evidence: counts_as_evidence(self.purpose, &run.state.settings),
            is_for_training: self.purpose == Purpose::Train,
            disclosure: self.disclosure,
            is_seed_reused: run.state.is_seed_reused,
        };
        let (mut groups, mut slots) = (Vec::new(), Vec::new());
        for (number, GroupChoice { layout, proposal }) in (0i64..).zip(choices) {
            if let Some(layout) = layout {
                servable_layouts::add_group(run.conn, layout.id, run.now).await?;
                let proposal = proposal.map(|queued| queued.seq);
                groups.push(GroupRow {
                    proposal,
                    is_evidence: proposal.is_some() && terms.is_evidence,
                    is_disclosed: self.disclosure == Disclosure::Lease,
                    ..serve::designed_group(&run.state, number, layout)
                });
            } else if let Some(queued) = proposal {
                let ProposedGroup { row, slot } = proposed_group(number, queued, terms)?;
                slots.extend(slot);
                groups.push(row);
            }
        }
        Ok((groups, slots))
    }
}

/// Returns what a layout may replace in the group of a proposal; `None` if the strategy would not learn from it.
fn opening_of(queued: &QueuedProposal) -> Result<Option<Opening>, ServiceError> {
    let proposal: Proposal = from_json("a proposal", &queued.body)?;
    let is_sampled = proposal.role == ProposalRole::Rung;
    Ok(is_sampled.then(|| Opening {
        place: Place::of_proposal(&proposal),
        contested: proposal.contested,
        task: proposal.task,
    }))
}

/// Returns true if results of leases of this purpose are evidence.
pub(crate) const fn counts_as_evidence(purpose: Purpose, settings: &RunSettings) -> bool {
    match purpose {
        Purpose::Train => matches!(settings.evidence_from, EvidenceFrom::Train),
        Purpose::Probe => true,
        Purpose::Eval => false,
    }
}
