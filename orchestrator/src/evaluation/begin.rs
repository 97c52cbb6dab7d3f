//! Beginning an evaluation.

use serde::Deserialize;
use utoipa::ToSchema;

use crate::evaluation::suite::file::{self, LoadedSuite};
use crate::evaluation::suite::{SuiteEntry, Suite};
use crate::ids::RunId;
use crate::store::evaluations::{self, EvaluationRow, EvaluationState};
use crate::store::{runs, to_i64, to_json};
use crate::runs::settings::{within, MAX_GROUP_SIZE};
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// Longest words, in characters.
const MOST: usize = 200;
/// Evaluations that may be under way.
const MOST_UNFINISHED: i64 = 100;

/// An evaluation as it is asked for.
#[derive(Debug, Clone, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluationWish {
    /// A suite that comes with the program (kessler-heldout-v2).
    #[schema(example = "kessler-heldout-v2")]
    pub suite: Option<String>,
    /// Only its scenarios of these tasks (all), for a policy that flies no others. Needs `run`: the server flies whole suites.
    #[schema(example = json!(["docking/single"]))]
    pub tasks: Option<Vec<String>>,
    /// Without `run`, a built-in policy that every task of the suite has: the server flies it. With `run`, whatever you call yours.
    #[schema(example = "heuristic")]
    pub policy: String,
    /// The run whose trainer flies it, in leases with `purpose: eval` and this evaluation's id.
    pub run: Option<String>,
    /// The version of the run's policy (the newest).
    pub version: Option<u32>,
    /// What trainings of one kind that differ by their seed are called together.
    pub training: Option<String>,
    /// By what this one differs from them.
    pub training_seed: Option<u32>,
    /// Episodes of each scenario: 1 to 1 024 (1; 8 where the policy has chance in it).
    pub rollouts: Option<u32>,
    /// Whether these differ by chance: a trainer's do unless told (a built-in policy is known).
    pub chance: Option<bool>,
    /// What a built-in policy with chance in it draws from (0).
    pub seed: Option<u32>,
    /// A name for people (the policy's).
    pub name: Option<String>,
}

/// Begins an evaluation.
#[derive(Debug)]
pub struct BeginEvaluation {
    row: EvaluationRow,
    run: Option<RunId>,
    /// Places of the suite.
    entries: Vec<i64>,
}

impl BeginEvaluation {
    /// Reads a wish.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(wish: EvaluationWish) -> Result<Self, ServiceError> {
        let which = wish.suite.unwrap_or_else(|| file::DEFAULT_SUITE.to_owned());
        let LoadedSuite { suite, hash } = file::built_in(&which).ok_or_else(|| {
            let which: String = which.chars().take(60).collect();
            ServiceError::invalid(
                "suite",
                format!("there is no suite {which:?}; there are {}", file::built_in_names()),
            )
        })?;
        for (field, words) in [
            ("policy", Some(&wish.policy)),
            ("training", wish.training.as_ref()),
            ("name", wish.name.as_ref()),
        ] {
            if words.is_some_and(|words| words.is_empty() || words.chars().count() > MOST) {
                return Err(ServiceError::invalid(field, format!("it must have 1 to {MOST} characters")));
            }
        }
        let run = wish.run.as_deref().map(str::parse::<RunId>).transpose();
        let run = run.map_err(|error| ServiceError::invalid("run", error.to_string()))?;
        let chance = match run {
            None => by_chance(suite, &wish.policy)?,
            Some(_) => wish.chance.unwrap_or(true),
        };
        let rollouts = wish.rollouts.unwrap_or(if chance { 8 } else { 1 });
        within("rollouts", rollouts, 1, MAX_GROUP_SIZE)?;
        let of_a_run = [
            ("version", wish.version.is_some(), "only the policy of a run has versions; say which run"),
            ("chance", wish.chance.is_some(), "of a built-in policy it is known; leave it out"),
            ("tasks", wish.tasks.is_some(), "the server flies whole suites; leave it out"),
        ];
        if let Some((field, _, why)) = of_a_run.into_iter().find(|(_, told, _)| run.is_none() && *told) {
            return Err(ServiceError::invalid(field, why));
        }
        let entries = entries(suite, wish.tasks.as_deref())?;
        let row = EvaluationRow {
            id: 0,
            name: wish.name.unwrap_or_else(|| wish.policy.clone()),
            suite: suite.name.clone(),
            suite_hash: hash.clone(),
            tasks: wish.tasks.as_ref().map(to_json).transpose()?,
            policy: wish.policy,
            run: run.as_ref().map(RunId::to_string),
            version: wish.version.map(i64::from),
            training: wish.training,
            training_seed: wish.training_seed.map(i64::from),
            rollouts: i64::from(rollouts),
            chance,
            seed: to_i64(u64::from(wish.seed.unwrap_or(0))),
            state: if run.is_some() { EvaluationState::Open } else { EvaluationState::Flying },
            trouble: None,
            scenarios: entries.len() as i64,
            flown: 0,
            reflown: 0,
            created_at: 0,
            completed_at: None,
        };
        Ok(Self { row, run, entries })
    }
}

/// The places of a suite's scenarios of these tasks.
fn entries(suite: &Suite, tasks: Option<&[String]>) -> Result<Vec<i64>, ServiceError> {
    let known: Vec<&str> = suite.tasks().iter().map(|task| task.id()).collect();
    let stranger = tasks.into_iter().flatten().find(|task| !known.contains(&task.as_str()));
    if stranger.is_some() || tasks.is_some_and(<[String]>::is_empty) {
        let why = format!("name one or more of {}, which {} is of", known.join(", "), suite.name);
        return Err(ServiceError::invalid("tasks", why));
    }
    let wanted =
        |entry: &SuiteEntry| tasks.is_none_or(|tasks| tasks.iter().any(|task| task == entry.scenario.task().id()));
    Ok((0..).zip(suite.entries()).filter(|(_, entry)| wanted(entry)).map(|(place, _)| place).collect())
}

/// Whether a built-in policy has chance in it.
fn by_chance(suite: &Suite, policy: &str) -> Result<bool, ServiceError> {
    let mut chance = false;
    for task in suite.tasks() {
        let Some(spec) = task.policies().iter().find(|spec| spec.name == policy) else {
            let known: Vec<&str> = task.policies().iter().map(|spec| spec.name).collect();
            let policy: String = policy.chars().take(60).collect();
            let why = format!(
                "there is no policy {policy:?} for {}; choose one of {}, or say the run whose trainer flies it",
                task.id(),
                known.join(", ")
            );
            return Err(ServiceError::invalid("policy", why));
        };
        chance |= spec.chance;
    }
    Ok(chance)
}

impl Change for BeginEvaluation {
    type Output = EvaluationRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<EvaluationRow, ServiceError> {
        let Self { mut row, run, entries } = self;
        row.created_at = tx.now;
        let conn = &mut tx.conn;
        if evaluations::count_unfinished(conn).await? >= MOST_UNFINISHED {
            let why = format!("{MOST_UNFINISHED} evaluations are under way; let some of them end first");
            return Err(ServiceError::invalid("suite", why));
        }
        if let Some(run) = run {
            let known = runs::get(conn, run.as_str()).await?;
            let known = known.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
            row.version = row.version.or(Some(known.policy_version));
        }
        row.id = evaluations::insert(conn, &row, &entries).await?;
        Ok(row)
    }
}
