//! Starts evaluations of policies on suites.

use api_types::EvaluationRequest;
use env_core::policy::PolicyError;
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use policy_files::{PolicyFolder, PolicyReference};
use store::evaluations::{self, EvaluationRow, EvaluationState};
use store::ids::RunId;
use store::principals::PrincipalId;
use store::{runs, to_i64, to_json};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::runs::settings::MAX_GROUP_SIZE;
use crate::runs::validate::check_range;
use evaluation::suite::file::{self, LoadedSuite};
use evaluation::suite::{Suite, SuiteEntry};

/// Maximum length of a name, in characters.
const MAX_NAME_CHARS: usize = 200;
/// Maximum number of unfinished evaluations.
const MAX_UNFINISHED: i64 = 100;

/// Starts an evaluation of a policy on a suite.
#[derive(Debug)]
pub struct BeginEvaluation {
    row: EvaluationRow,
    run: Option<RunId>,
    /// Positions of the scenarios in the suite.
    entries: Vec<i64>,
}

impl BeginEvaluation {
    /// Run whose policy is evaluated, if any.
    #[must_use]
    pub const fn run(&self) -> Option<&RunId> {
        self.run.as_ref()
    }

    /// Returns the change with an owner for the evaluation.
    #[must_use]
    pub fn owned_by(mut self, owner: Option<PrincipalId>) -> Self {
        self.row.owner = owner;
        self
    }

    /// Checks a request.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub fn from_request(request: EvaluationRequest, folder: &PolicyFolder) -> Result<Self, ServiceError> {
        let name = request.suite.as_deref().unwrap_or(file::DEFAULT_SUITE);
        let LoadedSuite { suite, hash } = file::built_in(name).ok_or_else(|| {
            let name = shorten(name, MAX_QUOTED_CHARS);
            ServiceError::invalid("suite", format!("must be one of {}, got {name:?}", file::built_in_names()))
        })?;
        check_names(&request)?;
        let run = request.run.as_deref().map(str::parse::<RunId>).transpose();
        let run = run.map_err(|error| ServiceError::invalid("run", error.to_string()))?;
        let (policy, stochastic) = match run {
            None => server_policy(suite, &request.policy, folder)?,
            Some(_) => (request.policy.clone(), request.stochastic.unwrap_or(true)),
        };
        let rollouts = request.rollouts.unwrap_or(if stochastic { 8 } else { 1 });
        check_range("rollouts", rollouts, 1, MAX_GROUP_SIZE)?;
        if run.is_none() {
            check_no_run_fields(&request)?;
        }
        let entries = entries(suite, request.tasks.as_deref())?;
        let row = EvaluationRow {
            id: 0,
            name: request.name.unwrap_or_else(|| request.policy.clone()),
            suite: suite.name.clone(),
            suite_hash: hash.clone(),
            tasks: request.tasks.as_ref().map(to_json).transpose()?,
            policy,
            run: run.as_ref().map(RunId::to_string),
            policy_version: request.policy_version.map(i64::from),
            training: request.training,
            training_seed: request.training_seed.map(i64::from),
            rollouts: i64::from(rollouts),
            is_stochastic: stochastic,
            seed: to_i64(u64::from(request.seed.unwrap_or(0))),
            state: if run.is_some() { EvaluationState::Open } else { EvaluationState::Running },
            error: None,
            scenarios: entries.len() as i64,
            scenarios_done: 0,
            retries: 0,
            created_at: 0,
            completed_at: None,
            owner: None,
        };
        Ok(Self { row, run, entries })
    }
}

/// Checks the lengths of names: 1 to 200 characters.
fn check_names(request: &EvaluationRequest) -> Result<(), ServiceError> {
    for (field, text) in [
        ("policy", Some(&request.policy)),
        ("training", request.training.as_ref()),
        ("name", request.name.as_ref()),
    ] {
        if text.is_some_and(|text| text.is_empty() || text.chars().count() > MAX_NAME_CHARS) {
            return Err(ServiceError::invalid(field, format!("must have 1 to {MAX_NAME_CHARS} characters")));
        }
    }
    Ok(())
}

/// Checks that fields that need `run` are left out.
fn check_no_run_fields(request: &EvaluationRequest) -> Result<(), ServiceError> {
    let run_only = [
        (
            "policy_version",
            request.policy_version.is_some(),
            "needs `run`: a built-in policy has no versions",
        ),
        (
            "stochastic",
            request.stochastic.is_some(),
            "must be left out without `run`: the built-in policy determines it",
        ),
        (
            "tasks",
            request.tasks.is_some(),
            "must be left out without `run`: the server evaluates whole suites",
        ),
    ];
    if let Some((field, _, reason)) = run_only.into_iter().find(|(_, is_set, _)| *is_set) {
        return Err(ServiceError::invalid(field, reason));
    }
    Ok(())
}

/// Returns the positions of a suite's scenarios of these tasks.
fn entries(suite: &Suite, tasks: Option<&[String]>) -> Result<Vec<i64>, ServiceError> {
    let known: Vec<&str> = suite.tasks().iter().map(|task| task.id()).collect();
    let unknown = tasks.into_iter().flatten().find(|task| !known.contains(&task.as_str()));
    if unknown.is_some() || tasks.is_some_and(<[String]>::is_empty) {
        let reason = format!("must list tasks of the suite {}: {}", suite.name, known.join(", "));
        return Err(ServiceError::invalid("tasks", reason));
    }
    let wanted = |entry: &SuiteEntry| {
        tasks.is_none_or(|tasks| tasks.iter().any(|task| task == entry.scenario.task().id()))
    };
    Ok((0..).zip(suite.entries()).filter(|(_, entry)| wanted(entry)).map(|(position, _)| position).collect())
}

/// Opens a policy that the server rolls out, and checks that it can act in all tasks of the suite. Returns its name, with the hash of
/// its file if it has one, and true if it is stochastic in some task.
fn server_policy(suite: &Suite, name: &str, folder: &PolicyFolder) -> Result<(String, bool), ServiceError> {
    let invalid = |reason: String| ServiceError::invalid("policy", reason);
    let reference = PolicyReference::parse(name);
    let pinned = folder.pin(&reference).map_err(|error| invalid(error.to_string()))?;
    let policy = folder.open(&pinned).map_err(|error| invalid(error.to_string()))?;
    for task in suite.tasks() {
        policy.check(task).map_err(|error| match error {
            PolicyError::Unknown { known, .. } => invalid(format!(
                "{} has no policy {:?}; choose one of {known}, a file in the server's policy folder such as onnx:model.onnx, or set `run` to \
                 evaluate the policy of its trainer",
                task.id(),
                shorten(name, MAX_QUOTED_CHARS)
            )),
            other => invalid(format!("the suite {} has scenarios of {}: {other}", suite.name, task.id())),
        })?;
    }
    let is_stochastic = suite.tasks().into_iter().any(|task| policy.is_stochastic(task));
    Ok((pinned.to_string(), is_stochastic))
}

impl Change for BeginEvaluation {
    type Output = EvaluationRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<EvaluationRow, ServiceError> {
        let Self { mut row, run, entries } = self;
        row.created_at = tx.now;
        let conn = &mut tx.conn;
        if evaluations::count_unfinished(conn).await? >= MAX_UNFINISHED {
            let reason = format!(
                "{MAX_UNFINISHED} evaluations are unfinished, the maximum; retry when one has ended, or cancel one"
            );
            return Err(ServiceError::invalid("suite", reason));
        }
        if let Some(run) = run {
            let known = runs::get(conn, run.as_str()).await?;
            let known = known.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
            row.policy_version = row.policy_version.or(Some(known.policy_version));
        }
        row.id = evaluations::insert(conn, &row, &entries).await?;
        Ok(row)
    }
}
