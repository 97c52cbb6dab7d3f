//! Leases of a suite's scenarios, for a trainer that flies an evaluation.

use std::sync::Arc;

use env_core::bracket;
use rayon::ThreadPool;
use rayon::prelude::*;

use crate::evaluation::suite::Entry;
use crate::evaluation::suite::file;
use crate::store::evaluations::{self, EvaluationRow};
use crate::store::groups::GroupRow;
use crate::store::leases::{self, LeaseRow};
use crate::training::lease::{Granted, TakeLease};
use crate::training::prepare::{Prepared, store_all};
use crate::training::{Change, Happening, TrainingError, Work, Writer};

/// Takes a lease of scenarios of an evaluation that nobody flies: as many as are wanted, or as there are.
///
/// # Errors
/// A lease that may not be granted, an evaluation that there is not, or one of which nothing is left.
pub async fn take_suite(
    writer: &Writer,
    threads: &Arc<ThreadPool>,
    wish: TakeLease,
    evaluation: i64,
) -> Result<Granted, TrainingError> {
    let (row, entries) = writer.change(Reserve { wish, evaluation }).await?;
    let threads = Arc::clone(threads);
    // The suite has no witnesses, and a scenario that is flown can be shown beside one.
    let prepare = move || {
        let one = |(_, entry): &(i64, &'static Entry)| {
            let admission = bracket::admit(&entry.scenario);
            admission.fair?;
            let contested = admission.contested;
            let bracket = admission.bracket.unwrap_or_else(|| entry.bracket.clone());
            Ok(Prepared { scenario: entry.scenario.clone(), bracket, contested, planted: false })
        };
        threads.install(|| {
            entries
                .par_iter()
                .map(|entry| Ok((*entry, one(entry)?)))
                .collect::<Result<Vec<_>, env_core::ScenarioError>>()
        })
    };
    let prepared = tokio::task::spawn_blocking(prepare).await;
    let prepared = prepared.map_err(|error| TrainingError::invalid("evaluation", error.to_string()))?;
    let prepared = prepared.map_err(|error| TrainingError::invalid("evaluation", error.to_string()))?;
    writer.change(Fill { row, evaluation, prepared }).await
}

fn unknown(evaluation: i64) -> TrainingError {
    TrainingError::invalid("evaluation", format!("there is no evaluation eval-{evaluation}"))
}

/// Looks what is to be flown; nothing is written yet.
struct Reserve {
    wish: TakeLease,
    evaluation: i64,
}

impl Change for Reserve {
    type Answer = (LeaseRow, Vec<(i64, &'static Entry)>);

    async fn apply(self, work: &mut Work) -> Result<Self::Answer, TrainingError> {
        let Self { mut wish, evaluation } = self;
        let now = work.now;
        let (mind, conn) = work.mind(wish.run.as_str()).await?;
        let row = evaluations::get(conn, evaluation).await?.ok_or_else(|| unknown(evaluation))?;
        let EvaluationRow { rollouts, version, run, suite, state, trouble, .. } = row;
        if run.as_deref() != Some(wish.run.as_str()) {
            let why = run.map_or_else(
                || "the server flies it by itself".to_owned(),
                |run| format!("it is one of the run {run}"),
            );
            return Err(TrainingError::invalid("evaluation", why));
        }
        if state == "failed" {
            let why = format!("it is over: {}", trouble.unwrap_or(state));
            return Err(TrainingError::invalid("evaluation", why));
        }
        let size = crate::store::small(rollouts);
        if wish.group_size.is_some_and(|given| given != size) {
            let why = format!("the evaluation flies each scenario {size} times; leave it out");
            return Err(TrainingError::invalid("group_size", why));
        }
        wish.group_size = Some(size);
        if let Some(version) = version.map(crate::store::small) {
            if wish.policy_version != 0 && wish.policy_version != version {
                let why = format!("the evaluation is of version {version}; leave it out");
                return Err(TrainingError::invalid("policy_version", why));
            }
            wish.policy_version = version;
        }
        wish.check(mind)?;
        let entries = evaluations::waiting(conn, evaluation, i64::from(wish.groups)).await?;
        if entries.is_empty() {
            return Err(TrainingError::invalid(
                "evaluation",
                "all of its scenarios are flown, or leased to somebody",
            ));
        }
        wish.groups = crate::store::small(entries.len() as i64);
        let lease = wish.begin(conn, size, now).await?;
        leases::insert(conn, &lease, &[]).await?;
        evaluations::leased(conn, (evaluation, lease.id), &entries).await?;
        let suite = file::built_in(&suite).ok_or_else(|| unknown(evaluation))?;
        let all: Vec<&'static Entry> = suite.suite.entries().collect();
        let picked = entries.into_iter().filter_map(|at| Some((at, *all.get(usize::try_from(at).ok()?)?)));
        work.tell(&lease.run, &Happening::lease(&lease, "taken"))?;
        Ok((lease, picked.collect()))
    }
}

/// Writes the groups of a reserved lease.
struct Fill {
    row: LeaseRow,
    evaluation: i64,
    prepared: Vec<((i64, &'static Entry), Prepared)>,
}

impl Change for Fill {
    type Answer = Granted;

    async fn apply(self, work: &mut Work) -> Result<Granted, TrainingError> {
        let Self { row, evaluation, prepared } = self;
        let row = leases::get(&mut work.conn, row.id).await?.ok_or_else(|| unknown(evaluation))?;
        if row.status != "active" {
            return Err(TrainingError::LeaseOver { lease: row.name(), status: row.status });
        }
        store_all(&mut work.conn, prepared.iter().map(|(_, prepared)| prepared)).await?;
        let group = |(number, ((_, entry), prepared)): (i64, ((i64, &'static Entry), Prepared))| GroupRow {
            number,
            proposal: None,
            layout: None,
            scenario: prepared.scenario.id().0.to_vec(),
            task: entry.scenario.task().id().to_owned(),
            level: None,
            role: "suite".to_owned(),
            contested: i64::from(prepared.contested),
            state: "open".to_owned(),
            finished: 0,
            failed: 0,
            successes: 0,
            evidence: 0,
            train: 0,
        };
        let groups: Vec<GroupRow> = (0i64..).zip(prepared).map(group).collect();
        crate::store::groups::insert(&mut work.conn, row.id, &groups).await?;
        Ok(Granted { row, groups, sets: None })
    }
}
