//! Summary of a finished demo run: text for people and one JSON object for programs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use api_types::{MasteryEstimate, TaskMastery};
use env_core::reflex::ParameterMeaning;
use serde::Serialize;

use super::super::options::{self, TaskOptions};
use super::super::output::Report;
use super::super::worlds;
use super::designs::TaskDesignSummary;
use super::feed::mastery_evidence;
use super::show::{episodes_per_second, share, table};
use super::train::{LevelChange, Progress};
use super::trainee::{GenerationSuccess, LearnerMode, Trainee};

/// Width of the level chart of a task, in characters.
const CHART_WIDTH: usize = 40;
const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Summary of a run, printed as one JSON object.
#[derive(Debug, Serialize)]
pub(super) struct DemoSummary<'a> {
    learner: LearnerMode,
    seed: u64,
    episodes: usize,
    seconds: f64,
    /// True if training stopped before all planned episodes were run.
    stopped: bool,
    run: &'a str,
    db: Option<&'a Path>,
    physics: &'a TaskOptions,
    /// Share of training groups that came from designed layouts.
    designed: Option<f64>,
    tasks: BTreeMap<&'a str, TaskSummary<'a>>,
}

#[derive(Debug, Serialize)]
struct TaskSummary<'a> {
    level: Option<u32>,
    episodes: i64,
    /// Mean mastery of the current level: the share of successes on contested scenarios.
    success: f64,
    success_q10: f64,
    success_q90: f64,
    success_scenarios: u32,
    plain_success: Option<f64>,
    score: Option<f64>,
    skill: Option<f64>,
    last_generation: Option<GenerationSuccess>,
    generations: u32,
    params: &'a BTreeMap<String, f64>,
    learnt: BTreeMap<&'static str, f64>,
    /// Reflex parameters, each in [0, 1]; `None` for policies without a reflex.
    numbers: Option<&'a [f64]>,
    designs: TaskDesignSummary,
    moves: Vec<MoveSummary>,
    warnings: &'a [String],
}

#[derive(Debug, Serialize)]
struct MoveSummary {
    episodes: usize,
    from: Option<u32>,
    to: u32,
}

impl<'a> DemoSummary<'a> {
    /// Creates the summary of a run. `db` is the database path from the command line, if one was given.
    pub(super) fn new(progress: &'a Progress, run: &'a str, db: Option<&'a Path>) -> Self {
        let task = |task: &'a TaskMastery| (task.task.as_str(), TaskSummary::new(progress, task));
        Self {
            learner: progress.plan.kind,
            seed: progress.plan.seed,
            episodes: progress.flown,
            seconds: progress.elapsed.as_secs_f64(),
            stopped: progress.stopped,
            run,
            db,
            physics: &progress.plan.options,
            designed: progress.designs.share,
            tasks: progress.mastery.iter().map(task).collect(),
        }
    }
}

impl<'a> TaskSummary<'a> {
    fn new(progress: &'a Progress, task: &'a TaskMastery) -> Self {
        let trainee = progress.trainees.get(&task.task);
        let mastery = mastery_evidence(task).unwrap_or(MasteryEstimate::without_evidence(0));
        Self {
            level: task.level,
            episodes: task.results.episodes,
            success: mastery.mean,
            success_q10: mastery.q10,
            success_q90: mastery.q90,
            success_scenarios: mastery.n,
            plain_success: task.results.success,
            score: task.results.score,
            skill: task.results.skill,
            last_generation: trainee.and_then(Trainee::last_success),
            generations: trainee.map_or(0, Trainee::generation),
            params: &task.params,
            learnt: reflex_meaning(progress, task).iter().map(|m| (m.name, m.value)).collect(),
            numbers: trainee.and_then(Trainee::numbers),
            designs: progress.designs.summarize_task(&task.task),
            moves: moves(progress, &task.task)
                .map(|m| MoveSummary { episodes: m.at, from: m.from, to: m.to })
                .collect(),
            warnings: &task.warnings,
        }
    }
}

fn moves<'a>(progress: &'a Progress, task: &'a str) -> impl Iterator<Item = &'a LevelChange> {
    progress.moves.iter().filter(move |moved| moved.task == task)
}

/// Reports the summary of a run.
pub(super) fn text_report(progress: &Progress, run: &str, db: Option<&Path>) -> Report {
    let learner = match progress.plan.kind {
        LearnerMode::Learn => "The learner",
        LearnerMode::Hold => "Holding (a control that takes no action)",
        LearnerMode::Blind => "The blind plan (a control that ignores all observations)",
        LearnerMode::Frozen => "The frozen learner (a control with random parameters, never updated)",
    };
    let seconds = progress.elapsed.as_secs_f64();
    let mut report = Report::default();
    report.paragraph(format!(
        "{learner} ran {} episodes in {seconds:.0} s ({:.0}/s), seed {}{}.",
        progress.flown,
        episodes_per_second(progress),
        progress.plan.seed,
        if progress.stopped { ", and was stopped early" } else { "" },
    ));
    report.separate_table(table(progress));
    if !progress.plan.options.is_empty() {
        report.paragraph(format!("Physics: {}.", options::describe(&progress.plan.options)));
    }
    for task in &progress.mastery {
        add_task(&mut report, progress, task);
    }
    if let Some(share) = progress.designs.share.filter(|share| *share > 0.0) {
        report.paragraph(format!(
            "{:.0} % of all groups had designed layouts. Their results do not move levels.",
            100.0 * share
        ));
    }
    if progress.late > 0 {
        report.paragraph(format!(
            "{} results arrived after their lease had ended and did not count.",
            progress.late
        ));
    }
    if let Some(db) = db {
        report.paragraph(format!(
            "Run {run} is stored in {0}; `sparring serve --db {0}` shows it.",
            db.display()
        ));
    }
    report
}

fn add_task(report: &mut Report, progress: &Progress, task: &TaskMastery) {
    report.paragraph(&task.task);
    let level = task.level.unwrap_or(0);
    let top = env_core::task(&task.task).map_or(9, |spec| spec.levels().len().saturating_sub(1));
    let of_task: Vec<&LevelChange> = moves(progress, &task.task).collect();
    let chart = level_chart(&of_task, progress.flown, top as u32);
    report.item(format!("level over time  0 {chart} {level}   (of 0 to {top})"));
    report.item(match mastered_levels(&of_task) {
        Some(levels) => format!("Mastered: {levels}."),
        None => "Mastered: no level.".to_owned(),
    });
    if let Some(last) = of_task.last() {
        report.item(format!("Last move, after {} episodes: {}.", last.at, last.why.trim_end_matches('.')));
    }
    report.item(describe_frontier(task, level, top));
    if let Some(designs) = progress.designs.summarize_task(&task.task).describe() {
        report.item(designs);
    }
    if let Some(learnt) = describe_reflex(progress, task) {
        report.item(learnt);
    }
    for warning in &task.warnings {
        report.item(format!("Warning: {warning}"));
    }
}

/// Lists the levels that were left upwards, as "levels 0 to 4" or "levels 1 and 2".
fn mastered_levels(moves: &[&LevelChange]) -> Option<String> {
    let left: BTreeSet<u32> = moves.iter().filter_map(|m| m.from.filter(|&from| m.to > from)).collect();
    let (first, last) = (*left.first()?, *left.last()?);
    if first == last {
        return Some(format!("level {first}"));
    }
    if last == first + 1 {
        return Some(format!("levels {first} and {last}"));
    }
    if left.len() as u32 == last - first + 1 {
        return Some(format!("levels {first} to {last}"));
    }
    let all: Vec<String> = left.iter().map(u32::to_string).collect();
    Some(format!("levels {}", all.join(", ")))
}

/// Describes the level that is not mastered yet and the params that make it harder than the level below.
fn describe_frontier(task: &TaskMastery, level: u32, top: usize) -> String {
    let bounds = mastery_evidence(task).map_or_else(
        || "no contested scenario has counted yet".to_owned(),
        |m| format!("mastery {:.2} ({:.2} to {:.2}) after {} contested scenarios", m.mean, m.q10, m.q90, m.n),
    );
    let plain = share(task.results.success);
    let what = if level as usize == top { "Top level" } else { "Current level" };
    let harder = changed_params(&task.task, level);
    let harder = if harder.is_empty() { harder } else { format!(" (harder than {}: {harder})", level - 1) };
    format!("{what} {level}{harder}: {bounds}; success over all episodes {plain}.")
}

/// Lists the params that differ from the level below.
fn changed_params(task: &str, level: u32) -> String {
    let Some((spec, below)) = env_core::task(task).zip(level.checked_sub(1)) else { return String::new() };
    let levels = spec.levels();
    let rows = levels.params(below as usize).zip(levels.params(level as usize));
    let changed = rows.filter(|(before, now)| before.1 != now.1);
    let described = changed.filter_map(|((name, before), (_, now))| {
        let param = spec.params().iter().find(|param| param.name == name)?;
        Some(worlds::describe_param(param, &format!("{before} → {now}")))
    });
    described.collect::<Vec<_>>().join(", ")
}

/// Returns the meaning of the reflex parameters at the centre of the population.
fn reflex_meaning(progress: &Progress, task: &TaskMastery) -> Vec<ParameterMeaning> {
    let numbers = progress.trainees.get(&task.task).and_then(Trainee::numbers);
    let spec = env_core::task(&task.task);
    numbers.zip(spec).map(|(numbers, spec)| (spec.reflex().meaning)(numbers)).unwrap_or_default()
}

/// Describes the reflex parameters in one sentence; `None` if no member is a reflex.
fn describe_reflex(progress: &Progress, task: &TaskMastery) -> Option<String> {
    let generations = progress.trainees.get(&task.task).map_or(0, Trainee::generation);
    let numbers: Vec<String> = reflex_meaning(progress, task).iter().map(format_parameter).collect();
    let origin = match generations {
        0 => "Its reflex".to_owned(),
        n => format!("Learnt in {n} generations"),
    };
    (!numbers.is_empty()).then(|| format!("{origin}: {}.", numbers.join(", ")))
}

/// Formats a reflex parameter with three significant digits, as "burn size 0.22 LU/TU".
fn format_parameter(meaning: &ParameterMeaning) -> String {
    let ParameterMeaning { name, value, unit } = meaning;
    let digits = match value.abs() {
        size if size >= 100.0 => 0,
        size if size >= 10.0 => 1,
        size if size >= 0.1 || size == 0.0 => 2,
        _ => 4,
    };
    let number = format!("{value:.digits$}");
    let number =
        if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { &number };
    format!("{} {number}{}{unit}", name.replace('_', " "), if unit.is_empty() { "" } else { " " })
}

/// Draws the level over the run from left to right, as block characters.
fn level_chart(moves: &[&LevelChange], flown: usize, top: u32) -> String {
    let level_at = |episodes: usize| moves.iter().rev().find(|m| m.at <= episodes).map_or(0, |m| m.to);
    let block = |level: u32| {
        let index = level as usize * (BLOCKS.len() - 1) / top.max(1) as usize;
        BLOCKS[index.min(BLOCKS.len() - 1)]
    };
    (1..=CHART_WIDTH).map(|column| block(level_at(flown * column / CHART_WIDTH))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level_change(at: usize, from: Option<u32>, to: u32) -> LevelChange {
        LevelChange { task: "kessler/survival".to_owned(), at, from, to, why: String::new() }
    }

    #[test]
    fn level_chart_rises_with_the_level() {
        let moves = [level_change(10, Some(0), 1), level_change(50, Some(1), 9)];
        let drawn = level_chart(&moves.iter().collect::<Vec<_>>(), 100, 9);
        assert_eq!(drawn.chars().count(), CHART_WIDTH);
        assert_eq!(drawn.chars().filter(|c| *c == '█').count(), CHART_WIDTH / 2 + 1);
        assert!(drawn.starts_with('▁') && drawn.ends_with('█'));
        assert!(level_chart(&[], 0, 9).chars().all(|c| c == '▁'));
    }

    #[test]
    fn reflex_parameters_have_units() {
        let say = |name, value, unit| format_parameter(&ParameterMeaning { name, value, unit });
        assert_eq!(say("look_ahead", 8.0, "steps"), "look ahead 8 steps");
        assert_eq!(say("burn_size", 0.2178, "LU/TU"), "burn size 0.22 LU/TU");
        assert_eq!(say("map", -0.5, ""), "map -0.5");
        assert_eq!(say("damping", 0.01234, "1/s"), "damping 0.0123 1/s");
        assert_eq!([say("far", 1234.5, "m"), say("off", 0.0, "")], ["far 1234 m", "off 0"]);
    }

    #[test]
    fn levels_left_upwards_are_mastered() {
        let levels = |moves: &[LevelChange]| mastered_levels(&moves.iter().collect::<Vec<_>>());
        assert_eq!(levels(&[]), None);
        assert_eq!(levels(&[level_change(1, None, 4)]), None);
        assert_eq!(levels(&[level_change(1, Some(0), 1)]).as_deref(), Some("level 0"));
        let up_down_up = [(1, 0, 1), (2, 1, 2), (3, 2, 1), (4, 1, 2)]
            .map(|(at, from, to)| level_change(at, Some(from), to));
        assert_eq!(levels(&up_down_up).as_deref(), Some("levels 0 and 1"));
        assert_eq!(
            levels(&[level_change(1, Some(0), 1), level_change(2, Some(2), 3)]).as_deref(),
            Some("levels 0, 2")
        );
    }

    #[test]
    fn harder_params_of_a_level_are_listed() {
        assert_eq!(changed_params("kessler/survival", 0), "");
        assert_eq!(changed_params("kessler/survival", 5), "fuel 10 → 5");
        assert_eq!(
            changed_params("kessler/survival", 6),
            "debris 100 → 125, fuel 5 → 4, radar range 300 → 20"
        );
        assert_eq!(changed_params("docking/single", 3), "time limit 1500 → 1000 s, thrust bound 1 → 0.5");
    }
}
