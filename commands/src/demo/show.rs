//! Progress display on stderr: a progress bar above a live table on a terminal, else one line at intervals.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use api_types::TaskMastery;
use env_core::space::Harder;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::super::output::{Column, OutputTarget, TextTable};
use super::super::worlds;
use super::feed::mastery_evidence;
use super::train::{LevelChange, Progress, ProgressObserver};
use super::trainee::Trainee;

/// Interval between two updates of the live table.
const TABLE_INTERVAL: Duration = Duration::from_millis(500);
/// Interval between two lines if stderr is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Placeholder of a missing number.
const DASH: &str = "–";

/// Progress display of a training run.
pub(super) struct ProgressScreen {
    /// Progress bar; `None` if stderr is no terminal.
    bar: Option<ProgressBar>,
    started: Instant,
    last: Instant,
}

impl ProgressScreen {
    /// Creates the display for a run of `episodes` episodes.
    ///
    /// # Errors
    /// Returns an error if the template of the progress bar is invalid.
    pub(super) fn new(episodes: usize) -> anyhow::Result<Self> {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(Some(episodes as u64), ProgressDrawTarget::stderr());
            let style =
                ProgressStyle::with_template("{wide_bar} {pos}/{len} episodes{prefix}, {eta} left\n{msg}")?;
            Ok::<_, anyhow::Error>(bar.with_style(style))
        });
        let now = Instant::now();
        Ok(Self { bar: bar.transpose()?, started: now, last: now })
    }

    /// Removes the progress bar from the terminal.
    pub(super) fn close(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }

    fn print_line(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.println(line),
            // A closed stderr loses progress lines and nothing else.
            None => drop(writeln!(std::io::stderr().lock(), "{line}")),
        }
    }
}

impl ProgressObserver for ProgressScreen {
    fn is_due(&self) -> bool {
        self.last.elapsed() >= if self.bar.is_some() { TABLE_INTERVAL } else { LINE_INTERVAL }
    }

    fn show(&mut self, progress: &Progress) {
        self.last = Instant::now();
        match &self.bar {
            Some(bar) => {
                bar.set_position(progress.flown as u64);
                bar.set_prefix(format!(", {:.0}/s", episodes_per_second(progress)));
                bar.set_message(table(progress).render(OutputTarget::stderr()));
            }
            None => self.print_line(&line(progress)),
        }
    }

    fn level_changed(&mut self, change: &LevelChange) {
        let LevelChange { task, at, to, why, .. } = change;
        let seconds = self.started.elapsed().as_secs_f64();
        self.print_line(&format!("{seconds:5.0} s  {at} episodes  {task} is at level {to}: {why}"));
    }

    fn layouts_designed(&mut self, at: usize, news: &str) {
        let seconds = self.started.elapsed().as_secs_f64();
        self.print_line(&format!("{seconds:5.0} s  {at} episodes  {news}"));
    }
}

/// Returns the throughput in episodes per second.
pub(super) fn episodes_per_second(progress: &Progress) -> f64 {
    progress.flown as f64 / progress.elapsed.as_secs_f64().max(1e-3)
}

/// Formats the progress as one line.
fn line(progress: &Progress) -> String {
    let seconds = progress.elapsed.as_secs_f64();
    let tasks = progress.mastery.iter().map(|task| {
        let level = task.level.map_or_else(|| DASH.to_owned(), |level| level.to_string());
        format!(
            "  {} level {level} ({})",
            short_task_name(&task.task),
            share(mastery_evidence(task).map(|m| m.mean))
        )
    });
    format!(
        "{seconds:5.0} s  {}/{} episodes  {:.0}/s{}",
        progress.flown,
        progress.plan.episodes,
        episodes_per_second(progress),
        tasks.collect::<String>()
    )
}

/// Builds the table of all tasks: mastery of the level with its bounds, success and skill over all episodes, and the success of
/// the last generation.
pub(super) fn table(progress: &Progress) -> TextTable {
    let mut table = TextTable::new([
        Column::text("task"),
        Column::prose("params in force").optional(1),
        Column::number("level"),
        Column::number("mastery (10–90\u{a0}%)"),
        Column::number("success"),
        Column::number("skill"),
        Column::number("population success").optional(3),
        Column::number("elite success").optional(3),
        Column::number("episodes"),
        Column::number("episodes/s").optional(2),
    ]);
    for task in &progress.mastery {
        let generation = progress.trainees.get(&task.task).and_then(Trainee::last_success);
        let rate = task.results.episodes as f64 / progress.elapsed.as_secs_f64().max(1e-3);
        let contested = mastery_evidence(task).map(|m| format!("{:.2} ({:.2}–{:.2})", m.mean, m.q10, m.q90));
        table.add_row([
            task.task.clone(),
            harder_params(task),
            task.level.map_or_else(|| DASH.to_owned(), |level| level.to_string()),
            contested.unwrap_or_else(|| DASH.to_owned()),
            share(task.results.success),
            share(task.results.skill),
            share(generation.map(|success| success.population)),
            share(generation.map(|success| success.elite)),
            task.results.episodes.to_string(),
            format!("{rate:.0}"),
        ]);
    }
    table
}

/// Lists the params that make the task harder than the easiest values of its parameter space.
fn harder_params(task: &TaskMastery) -> String {
    let Some(spec) = env_core::task(&task.task) else { return String::new() };
    let columns = spec.levels().columns();
    let harder = spec.params().iter().filter(|param| columns.iter().any(|column| column == param.name));
    let described = harder.filter_map(|param| {
        let value = *task.params.get(param.name)?;
        let easiest = if param.harder == Harder::Down { param.max } else { param.min };
        (value != easiest).then(|| worlds::describe_param(param, &value.to_string()))
    });
    described.collect::<Vec<_>>().join(", ")
}

/// Returns the task's id without its world.
fn short_task_name(task: &str) -> &str {
    task.rsplit('/').next().unwrap_or(task)
}

/// Formats a share with two digits, or a dash if it is missing.
pub(super) fn share(value: Option<f64>) -> String {
    value.map_or_else(|| DASH.to_owned(), |value| format!("{value:.2}"))
}
