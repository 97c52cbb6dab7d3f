//! What is seen while it trains, on stderr: a progress bar over a live table on a terminal, else a line now and then.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use comfy_table::{Cell, ColumnConstraint, Table};
use env_core::space::Harder;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::super::{output, worlds};
use super::feed::TaskMastery;
use super::train::{Moved, Progress, Watch};
use super::trainee::Trainee;

/// Between two pictures on a terminal.
const PICTURE: Duration = Duration::from_millis(500);
/// Between two lines elsewhere.
const LINE: Duration = Duration::from_secs(5);

/// Where there is no number.
const DASH: &str = "–";

/// What is seen while it trains.
pub(super) struct Screen {
    /// None where stderr is no terminal.
    bar: Option<ProgressBar>,
    started: Instant,
    last: Instant,
}

impl Screen {
    /// A screen for so many episodes.
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

    /// Clears what moves.
    pub(super) fn close(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }

    fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.println(line),
            // A reader of stderr that has gone away misses progress, nothing else.
            None => drop(writeln!(std::io::stderr().lock(), "{line}")),
        }
    }
}

impl Watch for Screen {
    fn due(&self) -> bool {
        self.last.elapsed() >= if self.bar.is_some() { PICTURE } else { LINE }
    }

    fn show(&mut self, progress: &Progress) {
        self.last = Instant::now();
        match &self.bar {
            Some(bar) => {
                bar.set_position(progress.flown as u64);
                bar.set_prefix(format!(", {:.0}/s", rate(progress)));
                bar.set_message(table(progress).use_stderr().to_string());
            }
            None => self.say(&line(progress)),
        }
    }

    fn moved(&mut self, moved: &Moved) {
        let Moved { task, at, to, why, .. } = moved;
        let seconds = self.started.elapsed().as_secs_f64();
        self.say(&format!("{seconds:5.0} s  {at} episodes  {task} is at level {to}: {why}"));
    }

    fn designed(&mut self, at: usize, news: &str) {
        let seconds = self.started.elapsed().as_secs_f64();
        self.say(&format!("{seconds:5.0} s  {at} episodes  {news}"));
    }
}

/// Episodes a second.
pub(super) fn rate(progress: &Progress) -> f64 {
    progress.flown as f64 / progress.elapsed.as_secs_f64().max(1e-3)
}

/// One line of progress.
fn line(progress: &Progress) -> String {
    let seconds = progress.elapsed.as_secs_f64();
    let tasks = progress.mastery.iter().map(|task| {
        let level = task.level.map_or_else(|| DASH.to_owned(), |level| level.to_string());
        format!("  {} level {level} ({})", short(&task.task), share(task.evidence().map(|m| m.mean)))
    });
    format!(
        "{seconds:5.0} s  {}/{} episodes  {:.0}/s{}",
        progress.flown,
        progress.plan.episodes,
        rate(progress),
        tasks.collect::<String>()
    )
}

/// Columns of a terminal below which the table leaves out what else would not fit.
const WIDE: u16 = 118;
/// What is left out then: params, population, elite, episodes a second.
const NEEDS_WIDTH: [usize; 4] = [1, 6, 7, 9];

/// Where every task stands: success on contested scenarios of the level with its bounds, success and skill over all
/// episodes, and how the last generation fared.
pub(super) fn table(progress: &Progress) -> Table {
    let header = [
        "task",
        "params in force",
        "level",
        "contested (10–90 %)",
        "all",
        "skill",
        "population",
        "elite",
        "episodes",
        "per s",
    ];
    let mut table = output::table(&header, 2);
    let narrow = table.width().is_some_and(|columns| columns < WIDE);
    for (index, column) in table.column_iter_mut().enumerate() {
        match index {
            // The params wrap between words; everything else stays whole.
            1 if !narrow => {}
            _ if narrow && NEEDS_WIDTH.contains(&index) => {
                column.set_constraint(ColumnConstraint::Hidden);
            }
            _ => {
                column.set_constraint(ColumnConstraint::ContentWidth);
            }
        }
    }
    for task in &progress.mastery {
        let fared = progress.trainees.get(&task.task).and_then(Trainee::fared);
        let rate = task.plain.episodes as f64 / progress.elapsed.as_secs_f64().max(1e-3);
        let contested = task.evidence().map(|m| format!("{:.2} ({:.2}–{:.2})", m.mean, m.q10, m.q90));
        let cells = [
            task.task.clone(),
            params(task),
            task.level.map_or_else(|| DASH.to_owned(), |level| level.to_string()),
            contested.unwrap_or_else(|| DASH.to_owned()),
            share(task.plain.success),
            share(task.plain.skill),
            share(fared.map(|f| f.population)),
            share(fared.map(|f| f.elite)),
            task.plain.episodes.to_string(),
            format!("{rate:.0}"),
        ];
        table.add_row(cells.into_iter().map(Cell::new).collect::<Vec<_>>());
    }
    table
}

/// The params that make the task harder than its space's easiest.
fn params(task: &TaskMastery) -> String {
    let Some(spec) = env_core::task(&task.task) else { return String::new() };
    let columns = spec.levels().columns();
    let harder = spec.params().iter().filter(|param| columns.iter().any(|column| column == param.name));
    let told = harder.filter_map(|param| {
        let value = *task.params.get(param.name)?;
        let easiest = if param.harder == Harder::Down { param.max } else { param.min };
        (value != easiest).then(|| worlds::param_in_words(param, &value.to_string()))
    });
    told.collect::<Vec<_>>().join(", ")
}

/// The task without its world.
pub(super) fn short(task: &str) -> &str {
    task.rsplit('/').next().unwrap_or(task)
}

/// A share with two digits, or a dash.
pub(super) fn share(value: Option<f64>) -> String {
    value.map_or_else(|| DASH.to_owned(), |value| format!("{value:.2}"))
}
