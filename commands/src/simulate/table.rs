//! Formats simulations as text tables.

use super::CompletedSimulation;
use crate::output::{Column, Report, TextTable};
use curriculum::simulation::SimulatedGroup;
use curriculum::{LevelMove, MoveKind};

/// Number of rows of a single simulation's table.
const SECTIONS: usize = 10;

/// Reports one simulation in full, or several in one line each.
pub(super) fn text_report(simulated: &[CompletedSimulation], episodes: u64) -> Report {
    match simulated {
        [one] => in_full(one, episodes),
        several if several.iter().any(|one| one.trainer != several[0].trainer) => trainer_lines(several),
        several => lines(several),
    }
}

/// Compares trainers: the level that a run reaches and the mastery that it shows, beside true success.
fn trainer_lines(simulated: &[CompletedSimulation]) -> Report {
    let mut table = TextTable::new([
        Column::text("strategy"),
        Column::text("learner"),
        Column::text("trainer"),
        Column::number("level"),
        Column::number("shown"),
        Column::number("true"),
        Column::number("missing"),
        Column::number("up"),
        Column::number("down"),
    ]);
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "none".to_owned(), |value| format!("{value:.decimals$}"))
    };
    for one in simulated {
        let summary = &one.summary;
        table.add_row([
            one.strategy.name().to_owned(),
            one.learner.to_string(),
            one.trainer.name().to_owned(),
            number(summary.level, 1),
            number(summary.shown, 2),
            number(summary.true_success, 2),
            number(summary.missing, 2),
            summary.ups.to_string(),
            summary.downs.to_string(),
        ]);
    }
    let mut report = Report::default();
    report.table(table);
    report
}

fn lines(simulated: &[CompletedSimulation]) -> Report {
    let mut table = TextTable::new([
        Column::text("strategy"),
        Column::text("learner"),
        Column::number("ability"),
        Column::number("difficulty"),
        Column::number("success"),
        Column::number("contested"),
        Column::number("zero variance"),
        Column::number("learnt from").optional(2),
        Column::number("up").optional(1),
        Column::number("down").optional(1),
        Column::number("placed after").optional(3),
    ]);
    let mut notes = Vec::new();
    for one in simulated {
        let summary = &one.summary;
        table.add_row([
            one.strategy.name().to_owned(),
            one.learner.to_string(),
            format!("{:.1}", summary.ability),
            format!("{:.1}", summary.difficulty),
            format!("{:.2}", summary.success),
            format!("{:.2}", summary.contested_success),
            summary.flat.map_or_else(|| "none".to_owned(), |flat| format!("{flat:.2}")),
            format!("{:.2}", summary.trained),
            summary.ups.to_string(),
            summary.downs.to_string(),
            summary.placed_after.map_or_else(|| "never".to_owned(), |after| after.to_string()),
        ]);
        if let Some(warning) = summary.warnings.first() {
            notes.push(format!("{} × {}: {warning}", one.strategy.name(), one.learner));
        }
    }
    let mut report = Report::default();
    report.table(table);
    for note in notes {
        report.paragraph(note);
    }
    report
}

fn in_full(one: &CompletedSimulation, episodes: u64) -> Report {
    let explanation = one.track.curriculum.explain();
    let mut report = Report::default();
    report.paragraph(format!("{} with the learner {}. {}", one.strategy, one.learner, explanation.summary));
    for (place, status) in one.track.status.iter().enumerate() {
        let of_task: Vec<&SimulatedGroup> =
            one.track.groups.iter().filter(|sample| sample.task_index == place).collect();
        let now = explanation
            .tasks
            .iter()
            .find(|task| task.task == status.task)
            .map_or("", |task| &task.current_state);
        report.paragraph(format!("{}: {now}", status.task)).table(sections(&of_task, episodes));
        let moves = one.track.moves.iter().filter(|made| made.level_move.task == status.task);
        for made in moves {
            let text = describe_move(&made.level_move);
            report.item(format!("after {}: {text}", made.episodes_before));
        }
        for warning in status.warnings.iter().chain(&status.held_back) {
            report.item(warning);
        }
    }
    report
}

/// Builds the table of a task over time: one row for each tenth of the episodes.
fn sections(groups: &[&SimulatedGroup], episodes: u64) -> TextTable {
    let mut table = TextTable::new(
        ["episodes", "groups", "ability", "difficulty", "success", "contested", "zero variance"]
            .map(Column::number),
    );
    for section in 0..SECTIONS as u64 {
        let (from, to) = (episodes * section / SECTIONS as u64, episodes * (section + 1) / SECTIONS as u64);
        let within = groups.iter().copied().filter(|sample| (from..to).contains(&sample.episodes_before));
        table.add_row(row(to, &within.collect::<Vec<_>>()));
    }
    table
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
        mean(|sample| sample.ability),
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
