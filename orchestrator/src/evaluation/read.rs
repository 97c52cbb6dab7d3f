//! What evaluations found, and how they compare.

use sqlx::SqliteConnection;

use crate::evaluation::report::ReportSettings;
use crate::evaluation::seeds::{AcrossSeeds, estimate_across_seeds};
use crate::evaluation::suite::file::{self, LoadedSuite};
use crate::evaluation::{PolicyResults, EvaluationReport};
use crate::store::evaluations::{self, EntryEpisodes, EvaluationRow, EvaluationState};
use crate::store::{StoreError, from_json, to_u32, to_u64};
use crate::engine::error::ServiceError;

/// Evaluations on one side of a comparison at most.
pub const MOST: usize = 100;

/// A complete evaluation.
#[derive(Debug)]
pub struct Found {
    /// What it is.
    pub row: EvaluationRow,
    /// What was flown.
    pub flown: PolicyResults,
}

/// Why there is nothing to say of an evaluation.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// There is none.
    #[error("there is no evaluation eval-{0}")]
    Unknown(i64),
    /// It is not complete.
    #[error("eval-{id} is not complete: {flown} of its {scenarios} scenarios are flown")]
    Unfinished {
        /// Which.
        id: i64,
        /// Scenarios that are flown.
        flown: i64,
        /// Scenarios.
        scenarios: i64,
    },
    /// They are of different suites.
    #[error("eval-{0} and eval-{1} are of different suites: nothing of them compares")]
    OtherSuite(i64, i64),
    /// They flew other tasks of it.
    #[error("eval-{0} and eval-{1} flew no task of their suite in common: nothing of them compares")]
    NothingInCommon(i64, i64),
    /// One is named twice.
    #[error("eval-{0} is named twice: it is one training")]
    Twice(i64),
    /// Two are of the same training seed.
    #[error(
        "eval-{0} and eval-{1} are of the same training and seed: as two trainings they would count twice"
    )]
    SameSeed(i64, i64),
    /// A side mixes trainings of several kinds.
    #[error(
        "eval-{0} and eval-{1} are on one side, and of several trainings: a side is one kind, told apart by training_seed"
    )]
    Mixed(i64, i64),
    /// The database's.
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

/// Reads a complete evaluation.
///
/// # Errors
/// One that there is not, or that is not complete.
pub async fn read(conn: &mut SqliteConnection, id: i64) -> Result<Found, ReadError> {
    let row = evaluations::get(conn, id).await?.ok_or(ReadError::Unknown(id))?;
    if row.state != EvaluationState::Complete {
        return Err(ReadError::Unfinished { id, flown: row.flown, scenarios: row.scenarios });
    }
    // Of scenarios that were not to be flown there are no episodes.
    let mut episodes = vec![Vec::new(); suite_of(&row)?.suite.entries().count()];
    for EntryEpisodes { entry, episodes: text } in evaluations::all_scenarios(conn, id).await? {
        let known = usize::try_from(entry).ok().and_then(|place| episodes.get_mut(place));
        let known =
            known.ok_or_else(|| StoreError::corrupt("an evaluation", "a scenario beyond its suite"))?;
        if let Some(text) = text {
            *known = from_json("an evaluation", &text)?;
        }
    }
    let flown = PolicyResults { policy: row.name.clone(), is_stochastic: row.chance, episodes };
    Ok(Found { row, flown })
}

/// The suite of an evaluation, as it is now.
///
/// # Errors
/// Another suite by that name.
pub fn suite_of(row: &EvaluationRow) -> Result<&'static LoadedSuite, StoreError> {
    let known = file::built_in(&row.suite).filter(|known| known.hash == row.suite_hash);
    known.ok_or_else(|| StoreError::corrupt("an evaluation", "its suite is not the one it was flown on"))
}

/// The numbers of one.
///
/// # Errors
/// Another suite by that name.
pub fn report(found: &Found) -> Result<EvaluationReport, StoreError> {
    let LoadedSuite { suite, hash } = suite_of(&found.row)?;
    let terms = ReportSettings { seed: to_u64(found.row.seed), rollouts: to_u32(found.row.rollouts), against: None };
    let flown = [found.flown.clone(), PolicyResults::blind_panel(suite)];
    Ok(EvaluationReport::new(suite, hash.clone(), &terms, &flown))
}

/// Two sides compared.
#[derive(Debug)]
pub struct Sides {
    /// Each policy's part of the report: what both did, and the one against the other, trainings of a side taken together.
    pub report: EvaluationReport,
    /// The first across its trainings.
    pub one: AcrossSeeds,
    /// The other.
    pub other: AcrossSeeds,
}

/// Compares one side with the other, scenario by scenario.
///
/// # Errors
/// Evaluations of different suites.
pub fn compare(one: &[Found], other: &[Found]) -> Result<Sides, ReadError> {
    let first = &one[0].row;
    if let Some(stranger) = one.iter().chain(other).find(|found| found.row.suite_hash != first.suite_hash) {
        return Err(ReadError::OtherSuite(first.id, stranger.row.id));
    }
    of_one_kind(one)?;
    of_one_kind(other)?;
    if let Some(both) = one.iter().find(|found| other.iter().any(|other| other.row.id == found.row.id)) {
        return Err(ReadError::Twice(both.row.id));
    }
    let LoadedSuite { suite, hash } = suite_of(first)?;
    let terms = ReportSettings { seed: 0, rollouts: to_u32(first.rollouts), against: Some("b".to_owned()) };
    // Where one flew fewer tasks than another, what both flew is compared.
    let flown_by_all = |place: usize| {
        one.iter().chain(other).all(|found| found.flown.episodes.get(place).is_some_and(|e| !e.is_empty()))
    };
    let common: Vec<bool> = (0..one[0].flown.episodes.len()).map(flown_by_all).collect();
    if !common.contains(&true) {
        return Err(ReadError::NothingInCommon(first.id, other[0].row.id));
    }
    let flown = [together("a", one, &common), together("b", other, &common)];
    let of = |side: &[Found]| {
        let flown: Vec<PolicyResults> = side.iter().map(|found| found.flown.select(&common)).collect();
        estimate_across_seeds(&flown.iter().collect::<Vec<_>>(), 0)
    };
    Ok(Sides { report: EvaluationReport::new(suite, hash.clone(), &terms, &flown), one: of(one), other: of(other) })
}

/// Whether a side is trainings of one kind, each once.
fn of_one_kind(side: &[Found]) -> Result<(), ReadError> {
    let kind = |found: &Found| found.row.training.clone().unwrap_or_else(|| found.row.policy.clone());
    for (at, found) in side.iter().enumerate() {
        for before in &side[..at] {
            let ids = (before.row.id, found.row.id);
            if ids.0 == ids.1 {
                return Err(ReadError::Twice(ids.0));
            }
            if kind(before) != kind(found) {
                return Err(ReadError::Mixed(ids.0, ids.1));
            }
            if before.row.training_seed.is_some() && before.row.training_seed == found.row.training_seed {
                return Err(ReadError::SameSeed(ids.0, ids.1));
            }
        }
    }
    Ok(())
}

/// The episodes of several trainings on each of these scenarios, none on the others.
fn together(name: &str, side: &[Found], common: &[bool]) -> PolicyResults {
    let of = |(at, common): (usize, &bool)| match common {
        true => side.iter().filter_map(|found| found.flown.episodes.get(at)).flatten().copied().collect(),
        false => Vec::new(),
    };
    PolicyResults {
        policy: name.to_owned(),
        is_stochastic: side.len() > 1 || side.iter().any(|found| found.flown.is_stochastic),
        episodes: common.iter().enumerate().map(of).collect(),
    }
}
