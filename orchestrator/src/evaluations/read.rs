//! Reads complete evaluations, reports on them, and compares them.

use api_types::AcrossSeeds;
use sqlx::SqliteConnection;
use store::evaluations::{self, EntryEpisodes, EvaluationRow, EvaluationState};
use store::{StoreError, from_json, to_u32, to_u64};

use crate::engine::error::ServiceError;
use evaluation::report::ReportSettings;
use evaluation::seeds::estimate_across_seeds;
use evaluation::suite::file::{self, LoadedSuite};
use evaluation::{EvaluationReport, PolicyResults};

/// Maximum number of evaluations on one side of a comparison.
pub const MAX_SIDE_EVALUATIONS: usize = 100;

/// A complete evaluation with its results.
#[derive(Debug)]
pub struct LoadedEvaluation {
    /// Row of the `evaluations` table.
    pub row: EvaluationRow,
    /// Episodes of each scenario.
    pub results: PolicyResults,
}

/// Reason why an evaluation cannot be read or compared.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The evaluation does not exist.
    #[error("evaluation eval-{0} does not exist")]
    Unknown(i64),
    /// The evaluation is not complete.
    #[error("eval-{id} is not complete: {flown} of its {scenarios} scenarios are done")]
    Unfinished {
        /// Number of the evaluation.
        id: i64,
        /// Scenarios that have results.
        flown: i64,
        /// Number of its scenarios.
        scenarios: i64,
    },
    /// The evaluations are of different suites.
    #[error("eval-{0} and eval-{1} are of different suites and cannot be compared")]
    OtherSuite(i64, i64),
    /// The evaluations have no task of their suite in common.
    #[error("eval-{0} and eval-{1} have no task in common and cannot be compared")]
    NothingInCommon(i64, i64),
    /// One evaluation is named twice.
    #[error("eval-{0} is listed twice; list it once")]
    Twice(i64),
    /// Two evaluations have the same training and seed.
    #[error("eval-{0} and eval-{1} have the same `training` and `training_seed`; list one of them")]
    SameSeed(i64, i64),
    /// A side mixes trainings of several kinds.
    #[error(
        "eval-{0} and eval-{1} cannot be on one side: all evaluations of a side must have the same `training` and differ in `training_seed`"
    )]
    Mixed(i64, i64),
    /// The store cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl From<ReadError> for ServiceError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Store(error) => error.into(),
            ReadError::Unknown(id) => Self::UnknownEvaluation(id),
            other => Self::invalid("evaluation", other.to_string()),
        }
    }
}

/// Loads a complete evaluation.
///
/// # Errors
/// Returns [`ReadError::Unknown`] if it does not exist, [`ReadError::Unfinished`] if it is not complete, and
/// [`ReadError::Store`] if it cannot be read.
pub async fn load_evaluation(conn: &mut SqliteConnection, id: i64) -> Result<LoadedEvaluation, ReadError> {
    let row = evaluations::get(conn, id).await?.ok_or(ReadError::Unknown(id))?;
    if row.state != EvaluationState::Complete {
        return Err(ReadError::Unfinished { id, flown: row.scenarios_done, scenarios: row.scenarios });
    }
    // Scenarios of tasks that are not evaluated have no episodes.
    let mut episodes = vec![Vec::new(); suite_of(&row)?.suite.entries().count()];
    for EntryEpisodes { entry, episodes: text, .. } in evaluations::all_scenarios(conn, id).await? {
        let slot = usize::try_from(entry).ok().and_then(|position| episodes.get_mut(position));
        let slot = slot.ok_or_else(|| StoreError::corrupt("an evaluation", "a scenario beyond its suite"))?;
        if let Some(text) = text {
            *slot = from_json("an evaluation", &text)?;
        }
    }
    let results = PolicyResults { policy: row.name.clone(), is_stochastic: row.is_stochastic, episodes };
    Ok(LoadedEvaluation { row, results })
}

/// Returns the suite of an evaluation.
///
/// # Errors
/// Returns [`StoreError`] if the built-in suite of that name has changed, or does not exist.
pub fn suite_of(row: &EvaluationRow) -> Result<&'static LoadedSuite, StoreError> {
    let known = file::built_in(&row.suite).filter(|known| known.hash == row.suite_hash);
    known.ok_or_else(|| {
        StoreError::corrupt("an evaluation", "its suite differs from the suite that was evaluated")
    })
}

/// Returns the report of an evaluation, with the blind panel beside it.
///
/// # Errors
/// Returns [`StoreError`] if the built-in suite of that name has changed.
pub fn report_evaluation(evaluation: &LoadedEvaluation) -> Result<EvaluationReport, StoreError> {
    let LoadedSuite { suite, hash } = suite_of(&evaluation.row)?;
    let settings = ReportSettings {
        seed: to_u64(evaluation.row.seed),
        rollouts: to_u32(evaluation.row.rollouts),
        against: None,
    };
    let results = [evaluation.results.clone(), PolicyResults::blind_panel(suite)];
    Ok(EvaluationReport::new(suite, hash.clone(), &settings, &results))
}

/// Comparison of two sides.
#[derive(Debug)]
pub struct SideComparison {
    /// Report of both sides and of one against the other; the trainings of a side are pooled.
    pub report: EvaluationReport,
    /// The first side across its trainings.
    pub first: AcrossSeeds,
    /// The second side across its trainings.
    pub second: AcrossSeeds,
}

/// Compares two sides, scenario by scenario. Both have at least one evaluation.
///
/// # Errors
/// Returns [`ReadError`] if the suites differ, an evaluation or a seed occurs twice, or a side mixes several trainings.
pub fn compare_sides(
    first: &[LoadedEvaluation],
    second: &[LoadedEvaluation],
) -> Result<SideComparison, ReadError> {
    let (head, other_head) = (&first[0].row, &second[0].row);
    let all = || first.iter().chain(second);
    if let Some(other) = all().find(|evaluation| evaluation.row.suite_hash != head.suite_hash) {
        return Err(ReadError::OtherSuite(head.id, other.row.id));
    }
    check_one_kind(first)?;
    check_one_kind(second)?;
    let on_both = |id: i64| second.iter().any(|other| other.row.id == id);
    if let Some(twice) = first.iter().find(|evaluation| on_both(evaluation.row.id)) {
        return Err(ReadError::Twice(twice.row.id));
    }
    let LoadedSuite { suite, hash } = suite_of(head)?;
    let settings = ReportSettings { seed: 0, rollouts: to_u32(head.rollouts), against: Some("b".to_owned()) };
    // Evaluations of different tasks are compared on the scenarios that all of them have.
    let has_episodes = |evaluation: &LoadedEvaluation, position: usize| {
        evaluation.results.episodes.get(position).is_some_and(|episodes| !episodes.is_empty())
    };
    let positions = 0..first[0].results.episodes.len();
    let common: Vec<bool> =
        positions.map(|position| all().all(|evaluation| has_episodes(evaluation, position))).collect();
    if !common.contains(&true) {
        return Err(ReadError::NothingInCommon(head.id, other_head.id));
    }
    let pooled = [pool("a", first, &common), pool("b", second, &common)];
    let across_seeds = |side: &[LoadedEvaluation]| {
        let results: Vec<PolicyResults> =
            side.iter().map(|evaluation| evaluation.results.select(&common)).collect();
        estimate_across_seeds(&results.iter().collect::<Vec<_>>(), 0)
    };
    Ok(SideComparison {
        report: EvaluationReport::new(suite, hash.clone(), &settings, &pooled),
        first: across_seeds(first),
        second: across_seeds(second),
    })
}

/// Checks that a side has trainings of one kind, each once.
fn check_one_kind(side: &[LoadedEvaluation]) -> Result<(), ReadError> {
    let kind = |row: &EvaluationRow| row.training.clone().unwrap_or_else(|| row.policy.clone());
    for (at, LoadedEvaluation { row, .. }) in side.iter().enumerate() {
        for LoadedEvaluation { row: before, .. } in &side[..at] {
            if before.id == row.id {
                return Err(ReadError::Twice(row.id));
            }
            if kind(before) != kind(row) {
                return Err(ReadError::Mixed(before.id, row.id));
            }
            if before.training_seed.is_some() && before.training_seed == row.training_seed {
                return Err(ReadError::SameSeed(before.id, row.id));
            }
        }
    }
    Ok(())
}

/// Pools the episodes of a side's trainings on the common scenarios; the other scenarios get none.
fn pool(name: &str, side: &[LoadedEvaluation], common: &[bool]) -> PolicyResults {
    let episodes = |(position, is_common): (usize, &bool)| match is_common {
        true => side
            .iter()
            .filter_map(|evaluation| evaluation.results.episodes.get(position))
            .flatten()
            .copied()
            .collect(),
        false => Vec::new(),
    };
    PolicyResults {
        policy: name.to_owned(),
        is_stochastic: side.len() > 1 || side.iter().any(|evaluation| evaluation.results.is_stochastic),
        episodes: common.iter().enumerate().map(episodes).collect(),
    }
}
