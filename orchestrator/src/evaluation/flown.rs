//! What a policy did on a suite.

use env_core::SuccessRule;
use env_core::bracket::success;
use serde::{Deserialize, Serialize};

use super::bootstrap::column_means;
use super::suite::{Entry, Suite};

/// Score, success, skill (where defined), share of agents lost, fuel used.
pub type Measures = [Option<f64>; 5];

/// What a policy did on a suite: of every scenario, in the suite's order, each of its episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Flown {
    /// The policy.
    pub policy: String,
    /// Whether its episodes on one scenario differ by chance.
    pub chance: bool,
    /// Episodes, scenario by scenario.
    pub episodes: Vec<Vec<Measures>>,
}

impl Flown {
    /// What the blind panel earns: its plans are the episodes, as the brackets have them.
    #[must_use]
    pub fn blind_panel(suite: &Suite) -> Self {
        let of = |entry: &Entry| entry.bracket.panel.iter().map(|flown| measure(entry, flown)).collect();
        Self { policy: "blind_panel".to_owned(), chance: false, episodes: suite.entries().map(of).collect() }
    }

    /// The mean of each scenario's episodes.
    #[must_use]
    pub fn means(&self) -> Vec<Measures> {
        self.episodes.iter().map(|episodes| column_means(episodes.iter()).map(|(mean, _)| mean)).collect()
    }

    /// The same on some of the scenarios.
    #[must_use]
    pub fn on(&self, picked: &[bool]) -> Self {
        let episodes = self.episodes.iter().zip(picked).filter(|(_, picked)| **picked);
        let episodes = episodes.map(|(episodes, _)| episodes.clone()).collect();
        Self { policy: self.policy.clone(), chance: self.chance, episodes }
    }
}

/// One episode, judged by the suite's own bracket.
#[must_use]
pub fn measure(entry: &Entry, flown: &env_core::Flown) -> Measures {
    let Entry { scenario, bracket, .. } = entry;
    let agents = scenario.task().agents(scenario.recipe()).max(1);
    [
        Some(flown.score),
        Some(f64::from(u8::from(success(scenario, SuccessRule::Task, bracket, flown)))),
        bracket.skill(flown.score),
        Some(f64::from(flown.lost) / f64::from(agents)),
        Some(flown.fuel_used),
    ]
}
