//! Results of a policy on a suite.

use env_core::SuccessRule;
use env_core::admission::is_success;
use serde::{Deserialize, Serialize};

use super::bootstrap::column_means;
use super::suite::{Suite, SuiteEntry};

/// Number of measures of an episode.
pub const MEASURES: usize = 5;

/// Measures of one episode, or their means over episodes. Stored as an array in the order of the fields.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "[Option<f64>; MEASURES]", into = "[Option<f64>; MEASURES]")]
pub struct EpisodeMeasures {
    /// Score of the world.
    pub score: Option<f64>,
    /// Success: 0 or 1, or the share of successes.
    pub success: Option<f64>,
    /// Skill between floor and reference; `None` if it is not defined on the scenario.
    pub skill: Option<f64>,
    /// Share of agents lost.
    pub lost: Option<f64>,
    /// Fuel used by all agents together.
    pub fuel_used: Option<f64>,
}

impl From<[Option<f64>; MEASURES]> for EpisodeMeasures {
    fn from([score, success, skill, lost, fuel_used]: [Option<f64>; MEASURES]) -> Self {
        Self { score, success, skill, lost, fuel_used }
    }
}

impl From<EpisodeMeasures> for [Option<f64>; MEASURES] {
    fn from(measures: EpisodeMeasures) -> Self {
        let EpisodeMeasures { score, success, skill, lost, fuel_used } = measures;
        [score, success, skill, lost, fuel_used]
    }
}

impl EpisodeMeasures {
    /// Returns the mean of each measure over the episodes that define it.
    pub fn mean_of(episodes: &[Self]) -> Self {
        let rows = episodes.iter().map(|&episode| <[Option<f64>; MEASURES]>::from(episode));
        column_means(rows).map(|column| column.mean).into()
    }
}

/// Episodes of a policy on a suite.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyResults {
    /// Name of the policy.
    pub policy: String,
    /// True if episodes of the policy on the same scenario differ by chance.
    pub is_stochastic: bool,
    /// Episodes of each scenario, in the order of the suite.
    pub episodes: Vec<Vec<EpisodeMeasures>>,
}

impl PolicyResults {
    /// Returns the results of the blind panel, whose plans are the episodes of the stored brackets.
    #[must_use]
    pub fn blind_panel(suite: &Suite) -> Self {
        let measure = |entry: &SuiteEntry| {
            entry.bracket.panel.iter().map(|outcome| measure_episode(entry, outcome)).collect()
        };
        let episodes = suite.entries().map(measure).collect();
        Self { policy: "blind_panel".to_owned(), is_stochastic: false, episodes }
    }

    /// Returns the mean over the episodes of each scenario.
    #[must_use]
    pub fn scenario_means(&self) -> Vec<EpisodeMeasures> {
        self.episodes.iter().map(|episodes| EpisodeMeasures::mean_of(episodes)).collect()
    }

    /// Returns the results on the scenarios whose value in `mask` is true.
    #[must_use]
    pub fn select(&self, mask: &[bool]) -> Self {
        let selected = self.episodes.iter().zip(mask).filter(|(_, is_selected)| **is_selected);
        let episodes = selected.map(|(episodes, _)| episodes.clone()).collect();
        Self { policy: self.policy.clone(), is_stochastic: self.is_stochastic, episodes }
    }
}

/// Measures one episode by the bracket of its suite entry.
#[must_use]
pub fn measure_episode(entry: &SuiteEntry, outcome: &env_core::EpisodeOutcome) -> EpisodeMeasures {
    let SuiteEntry { scenario, bracket, .. } = entry;
    let agents = scenario.task().agents(scenario.recipe()).max(1);
    let is_success = is_success(scenario, SuccessRule::Task, bracket, outcome);
    EpisodeMeasures {
        score: Some(outcome.score),
        success: Some(f64::from(u8::from(is_success))),
        skill: bracket.skill(outcome.score),
        lost: Some(f64::from(outcome.lost) / f64::from(agents)),
        fuel_used: Some(outcome.fuel_used),
    }
}
