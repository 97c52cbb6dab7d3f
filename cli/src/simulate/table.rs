//! Formats simulations as text tables.

use super::CompletedSimulation;
use crate::output;
use curriculum::simulation::SimulatedGroup;
use curriculum::{LevelMove, MoveKind};

/// Number of rows of a single simulation's table.
const SECTIONS: usize = 10;

/// Formats one simulation in full, or several in one line each.
pub(super) fn tables(simulated: &[CompletedSimulation], episodes: u64) -> String {
    match simulated {
        [one] => in_full(one, episodes),
        several => lines(several),
    }
}

fn lines(simulated: &[CompletedSimulation]) -> String {
    let header = [
        "strategy",
        "learner",
        "skill",
        "faced",
        "success",
        "contested",
        "zero variance",
        "learnt from",
        "up",
        "down",
        "placed after",
    ];
    let mut table = output::table(&header, 2);
    let mut notes = Vec::new();
    for one in simulated {
        let summary = &one.summary;
        table.add_row([
            one.strategy.name().to_owned(),
            one.learner.name().to_owned(),
            format!("{:.1}", summary.skill),
            format!("{:.1}", summary.faced),
            format!("{:.2}", summary.success),
            format!("{:.2}", summary.contested_success),
            summary.flat.map_or_else(|| "none".to_owned(), |flat| format!("{flat:.2}")),
            format!("{:.2}", summary.trained),
            summary.ups.to_string(),
            summary.downs.to_string(),
            summary.placed_after.map_or_else(|| "never".to_owned(), |after| after.to_string()),
        ]);
        if let Some(warning) = summary.warnings.first() {
            notes.push(format!("{} × {}: {warning}", one.strategy.name(), one.learner.name()));
        }
    }
    if notes.is_empty() { format!("{table}\n") } else { format!("{table}\n\n{}\n", notes.join("\n")) }
}

fn in_full(one: &CompletedSimulation, episodes: u64) -> String {
    let explanation = one.track.curriculum.explain();
    let mut text =
        format!("{} with the learner {}. {}\n", one.strategy, one.learner.name(), explanation.summary);
    for (place, status) in one.track.status.iter().enumerate() {
        let of_task: Vec<&SimulatedGroup> =
            one.track.groups.iter().filter(|sample| sample.task_index == place).collect();
        let header = ["episodes", "groups", "skill", "faced", "success", "contested", "zero variance"];
        let mut table = output::table(&header, 0);
        for stretch in 0..SECTIONS as u64 {
            let (from, to) =
                (episodes * stretch / SECTIONS as u64, episodes * (stretch + 1) / SECTIONS as u64);
            let within =
                of_task.iter().copied().filter(|sample| (from..to).contains(&sample.episodes_before));
            table.add_row(row(to, &within.collect::<Vec<_>>()));
        }
        let now = explanation
            .tasks
            .iter()
            .find(|task| task.task == status.task)
            .map_or("", |task| &task.current_state);
        text.push_str(&format!("\n{}: {now}\n{table}\n", status.task));
        let moves = one.track.moves.iter().filter(|made| made.level_move.task == status.task);
        moves.for_each(|made| {
            text.push_str(&format!(
                "  after {}: {}\n",
                made.episodes_before,
                describe_move(&made.level_move)
            ));
        });
        status.warnings.iter().for_each(|warning| text.push_str(&format!("  {warning}\n")));
    }
    text
}

fn row(to: u64, samples: &[&SimulatedGroup]) -> [String; 7] {
    let share = |of: u64, all: u64| {
        if all == 0 { "none".to_owned() } else { format!("{:.2}", of as f64 / all as f64) }
    };
    let mean = |value: fn(&SimulatedGroup) -> f64| match samples.len() {
        0 => "none".to_owned(),
        n => format!("{:.1}", samples.iter().map(|sample| value(sample)).sum::<f64>() / n as f64),
    };
    let episodes = |of: fn(&SimulatedGroup) -> u32, contested: bool| {
        let these = samples.iter().filter(|sample| sample.contested || !contested);
        these.map(|sample| u64::from(of(sample))).sum::<u64>()
    };
    let success =
        |contested| share(episodes(|s| s.successes, contested), episodes(|s| s.finished, contested));
    let several = samples.iter().filter(|sample| sample.finished > 1).count() as u64;
    [
        to.to_string(),
        samples.len().to_string(),
        mean(|sample| sample.skill),
        mean(|sample| sample.difficulty),
        success(false),
        success(true),
        share(samples.iter().filter(|sample| sample.has_zero_variance()).count() as u64, several),
    ]
}

fn describe_move(made: &LevelMove) -> String {
    let (way, from) = (made.kind, made.from);
    match (way, from) {
        (MoveKind::Placement, _) | (_, None) => format!("placed at {}: {}", made.to, made.evidence.sentence),
        (MoveKind::Up, Some(from)) => format!("up from {from} to {}: {}", made.to, made.evidence.sentence),
        (MoveKind::Down, Some(from)) => {
            format!("down from {from} to {}: {}", made.to, made.evidence.sentence)
        }
    }
}
