//! Status and explanation of PLR, robust PLR and ACCEL.

use super::{Replay, ScoredOutcomes, TaskBuffer, capacity, replay_threshold};
use crate::core::explanation::Explanation;
use crate::core::settings::hyperparameters::replay::{SCORE, ScenarioScore};
use crate::core::settings::{Settings, StrategyKind};
use crate::core::strategy::StrategyState;

/// Number of outcomes without a score from which a task causes a warning, if none had one.
const MIN_UNSCORED_FOR_WARNING: u64 = 16;

/// Warns about a task that can keep no scenario, because no outcome has the score.
pub(super) fn warning(task: &TaskBuffer, settings: &Settings) -> Option<String> {
    let name = settings.hyperparameters.choice(&SCORE);
    let why = match ScenarioScore::from_name(name) {
        ScenarioScore::Learnability => "it needs groups of at least two episodes",
        ScenarioScore::Regret => "on this task's scenarios, acting well and acting blindly score the same",
        ScenarioScore::PositiveValueLoss | ScenarioScore::MaxMc => {
            "the trainer must report it with its results"
        }
    };
    (task.scored == ScoredOutcomes::default() && task.unscored >= MIN_UNSCORED_FOR_WARNING)
        .then(|| format!("none of {} outcomes has a {name}, so no scenario is kept: {why}", task.unscored))
}

/// Explains the rules and the state of each task.
pub(super) fn explain(replay: &Replay, settings: &Settings) -> Explanation {
    let summary = match settings.strategy {
        StrategyKind::Plr => {
            "Scenarios on which the agent falls short are repeated, by how far it falls short and how \
             long ago they were proposed."
        }
        StrategyKind::PlrRobust => {
            "Scenarios on which the agent falls short are repeated; it trains on those alone, and fresh \
             ones are only scored."
        }
        _ => {
            "Scenarios on which the agent falls short are repeated and edited; it trains on repeated ones \
             alone, and fresh ones and edits are only scored."
        }
    };
    let rules = vec![
        "Tasks share the proposals by weight, each at least 5 %; fresh scenarios are at levels drawn \
         uniformly."
            .to_owned(),
        "Kept scenarios are sampled by (1/rank)^(1/beta), or by how long ago they were proposed. A \
         scenario's score is the mean over its visits."
            .to_owned(),
        "From the third visit on, each visit without a gain lowers the priority by 30 %: a reference with \
         hindsight leaves gaps that no agent can close."
            .to_owned(),
    ];
    let empty = TaskBuffer::default();
    Explanation::without_levels(settings, Replay::VERSION, summary, rules, |plan| {
        describe_buffer(replay.tasks.get(&plan.task).unwrap_or(&empty), settings)
    })
}

fn describe_buffer(task: &TaskBuffer, settings: &Settings) -> String {
    let (kept, capacity, threshold) = (task.buffer.len(), capacity(settings), replay_threshold(settings));
    let mut text = format!("{kept} of {capacity} scenarios are kept, of {} fresh ones", task.scored.fresh);
    if settings.strategy == StrategyKind::Accel {
        text.push_str(&format!(" and {} edits", task.scored.edited));
    }
    text.push_str(&format!("; {} were repeated", task.scored.replayed));
    if kept < threshold {
        text.push_str(&format!(", which begins at {threshold}"));
    }
    if let Some((seq, first)) = task.buffer.iter().next() {
        text.push_str(&format!(
            "; the first is that of proposal {seq}: score {:.2} over {} visits, priority {:.2}",
            first.score,
            first.visits,
            first.priority()
        ));
    }
    let edited = task.buffer.iter().filter(|(_, level)| level.generation > 0).count();
    if edited > 0 {
        let highest = task.buffer.iter().map(|(_, level)| level.generation).max().unwrap_or(0);
        text.push_str(&format!("; {edited} of those kept are edits, up to generation {highest}"));
    }
    text
}
