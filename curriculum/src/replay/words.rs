//! PLR and its kin for people.

use super::super::explain::{Explanation, TaskStatus};
use super::super::kind::StrategyKind;
use super::super::settings::Settings;
use super::{FILLED, Replay, SCORE, Task, VERSION, capacity};

/// Outcomes from which a score that never comes is worth a warning.
const UNSCORED: u64 = 16;

pub(super) fn status(replay: &Replay, settings: &Settings) -> Vec<TaskStatus> {
    let of = |task: &str| replay.tasks.get(task);
    let status = |task: &str| TaskStatus {
        warnings: of(task).and_then(|known| warning(known, settings)).into_iter().collect(),
        ..TaskStatus::unmoved(task, Vec::new())
    };
    settings.tasks.iter().map(|plan| status(&plan.task)).collect()
}

/// A run that can never keep anything, because nothing says what its scenarios have to teach.
fn warning(task: &Task, settings: &Settings) -> Option<String> {
    let scored: u64 = task.seen.iter().sum();
    let score = settings.tuning.word(&SCORE);
    let why = match score {
        "learnability" => "it takes groups of at least two episodes",
        "regret" => "on the scenarios of this task acting well and acting blindly come to the same",
        _ => "the trainer must report it with its results",
    };
    (scored == 0 && task.unscored >= UNSCORED)
        .then(|| format!("none of {} outcomes has a {score}, so that nothing is kept: {why}", task.unscored))
}

pub(super) fn explain(replay: &Replay, settings: &Settings) -> Explanation {
    let summary = match settings.strategy {
        StrategyKind::Plr => {
            "Scenarios that the agent falls short on are faced again, by how far short and how long ago."
        }
        StrategyKind::PlrRobust => {
            "Scenarios that the agent falls short on are faced again; it learns from those alone, new ones are only scored."
        }
        _ => {
            "Scenarios that the agent falls short on are faced again and edited; it learns from those faced again, new ones and \
             edits are only scored."
        }
    };
    let rules = vec![
        "Tasks by their weight, each at least 5 %; new scenarios at levels drawn uniformly.".to_owned(),
        "What is kept is drawn by (1/rank)^(1/beta), or by how long ago it was proposed; a scenario's worth is the mean over its \
         visits."
            .to_owned(),
        "From the third visit on each that brings no gain takes 30 % of its priority: a reference with hindsight leaves gaps that \
         no agent can close."
            .to_owned(),
    ];
    let blank = Task::default();
    Explanation::of(settings, VERSION, (summary, rules), |plan| {
        now(replay.tasks.get(&plan.task).unwrap_or(&blank), settings)
    })
}

fn now(task: &Task, settings: &Settings) -> String {
    let [fresh, again, edits] = task.seen;
    let (kept, most) = (task.shelf.len(), capacity(settings));
    let filled = (settings.tuning.whole(&FILLED) as usize).min(most);
    let mut words = format!("{kept} of {most} scenarios are kept, of {fresh} new ones");
    if settings.strategy == StrategyKind::Accel {
        words.push_str(&format!(" and {edits} edits"));
    }
    words.push_str(&format!("; {again} were faced again"));
    if kept < filled {
        words.push_str(&format!(", which begins with {filled}"));
    }
    if let Some((seq, first)) = task.shelf.entries().next() {
        words.push_str(&format!(
            "; first stands that of proposal {seq}: worth {:.2} over {} visits, priority {:.2}",
            first.worth,
            first.visits,
            first.priority()
        ));
    }
    let edited = task.shelf.entries().filter(|(_, entry)| entry.generation > 0).count();
    if edited > 0 {
        let oldest = task.shelf.entries().map(|(_, entry)| entry.generation).max().unwrap_or(0);
        words.push_str(&format!("; {edited} of those kept are edits, the farthest of generation {oldest}"));
    }
    words
}
