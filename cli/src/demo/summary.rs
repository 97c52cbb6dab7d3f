//! What came of it: in words for people, as one object for machines.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use env_core::reflex::ParameterMeaning;
use serde::Serialize;

use super::super::options::{self, TaskOptions};
use super::super::worlds;
use super::designs::TaskDesigns;
use super::feed::{Posterior, TaskMastery};
use super::show::{rate, share, table};
use super::train::{Moved, Progress};
use super::trainee::{Fared, Kind, Trainee};

/// Columns of the picture of a task's levels.
const PICTURE: usize = 48;
/// Columns of its words.
const WIDTH: usize = 100;
const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// What is known of a level that was only just reached: the quantiles of Beta(1, 1).
const NO_EVIDENCE: Posterior = Posterior { n: 0, mean: 0.5, q10: 0.1, q90: 0.9 };

/// What came of it, as one JSON object.
#[derive(Debug, Serialize)]
pub(super) struct Summary<'a> {
    learner: Kind,
    seed: u64,
    episodes: usize,
    seconds: f64,
    /// Told to stop before all episodes were flown.
    stopped: bool,
    run: &'a str,
    db: Option<&'a Path>,
    physics: &'a TaskOptions,
    /// The share of training groups that were designed.
    designed: Option<f64>,
    tasks: BTreeMap<&'a str, TaskSummary<'a>>,
}

#[derive(Debug, Serialize)]
struct TaskSummary<'a> {
    level: Option<u32>,
    episodes: u64,
    /// Mastery's mean at the current level: success on contested scenarios.
    success: f64,
    success_q10: f64,
    success_q90: f64,
    success_scenarios: u32,
    plain_success: Option<f64>,
    score: Option<f64>,
    skill: Option<f64>,
    last_generation: Option<Fared>,
    generations: u32,
    params: &'a BTreeMap<String, f64>,
    learnt: BTreeMap<&'static str, f64>,
    /// The numbers of the reflex themselves, in [0, 1]; none where nobody flies a reflex.
    numbers: Option<&'a [f64]>,
    designs: TaskDesigns,
    moves: Vec<MoveSummary>,
    warnings: &'a [String],
}

#[derive(Debug, Serialize)]
struct MoveSummary {
    episodes: usize,
    from: Option<u32>,
    to: u32,
}

impl<'a> Summary<'a> {
    /// Of a run; `db` where it was told which database to keep it in.
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
        let mastery = task.evidence().unwrap_or(NO_EVIDENCE);
        Self {
            level: task.level,
            episodes: task.plain.episodes,
            success: mastery.mean,
            success_q10: mastery.q10,
            success_q90: mastery.q90,
            success_scenarios: mastery.n,
            plain_success: task.plain.success,
            score: task.plain.score,
            skill: task.plain.skill,
            last_generation: trainee.and_then(Trainee::fared),
            generations: trainee.map_or(0, Trainee::generation),
            params: &task.params,
            learnt: meaning(progress, task).iter().map(|m| (m.name, m.value)).collect(),
            numbers: trainee.and_then(Trainee::numbers),
            designs: progress.designs.of(&task.task),
            moves: moves(progress, &task.task)
                .map(|m| MoveSummary { episodes: m.at, from: m.from, to: m.to })
                .collect(),
            warnings: &task.warnings,
        }
    }
}

fn moves<'a>(progress: &'a Progress, task: &'a str) -> impl Iterator<Item = &'a Moved> {
    progress.moves.iter().filter(move |moved| moved.task == task)
}

/// What came of it, in words.
pub(super) fn words(progress: &Progress, run: &str, db: Option<&Path>) -> String {
    let who = match progress.plan.kind {
        Kind::Learn => "The learner",
        Kind::Hold => "Holding (a control: it does nothing)",
        Kind::Blind => "The blind plan (a control: it looks at nothing)",
        Kind::Frozen => "The frozen learner (a control: random numbers, never updated)",
    };
    let seconds = progress.elapsed.as_secs_f64();
    let mut out = format!(
        "\n{who} flew {} episodes in {seconds:.0} s ({:.0}/s), seed {}{}.\n\n{}\n",
        progress.flown,
        rate(progress),
        progress.plan.seed,
        if progress.stopped { ", and was stopped early" } else { "" },
        table(progress),
    );
    if !progress.plan.options.is_empty() {
        // Writing into a string cannot fail.
        let _ = writeln!(out, "\nPhysics: {}.", options::in_words(&progress.plan.options));
    }
    for task in &progress.mastery {
        // Writing into a string cannot fail.
        let _ = write!(out, "\n{}", paragraph(progress, task));
    }
    if let Some(share) = progress.designs.share.filter(|share| *share > 0.0) {
        let _ = writeln!(
            out,
            "\n{:.0} % of all groups flew designed layouts; these move no level.",
            100.0 * share
        );
    }
    if progress.late > 0 {
        let _ =
            writeln!(out, "\n{} results came after their lease was over and did not count.", progress.late);
    }
    if let Some(db) = db {
        let _ = writeln!(
            out,
            "\nEverything is in {0}, as run {run}: `sparring serve --db {0}` shows it at /dashboard.",
            db.display()
        );
    }
    out
}

fn paragraph(progress: &Progress, task: &TaskMastery) -> String {
    let mut out = format!("{}\n", task.task);
    let level = task.level.unwrap_or(0);
    let top = env_core::task(&task.task).map_or(9, |spec| spec.levels().len().saturating_sub(1));
    let of_task: Vec<&Moved> = moves(progress, &task.task).collect();
    let picture = picture(&of_task, progress.flown, top as u32);
    let wrapping = textwrap::Options::new(WIDTH).initial_indent("  ").subsequent_indent("    ");
    let mut line = |text: String| {
        out.push_str(&textwrap::fill(&text, &wrapping));
        out.push('\n');
    };
    line(format!("level over time  0 {picture} {level}   (of 0 to {top})"));
    line(match mastered(&of_task) {
        Some(levels) => format!("Mastered: {levels}."),
        None => "Mastered: nothing.".to_owned(),
    });
    if let Some(last) = of_task.last() {
        line(format!("Moved last, after {} episodes: {}.", last.at, last.why.trim_end_matches('.')));
    }
    line(defeat(task, level, top));
    if let Some(designs) = progress.designs.of(&task.task).words() {
        line(designs);
    }
    if let Some(learnt) = learnt(progress, task) {
        line(learnt);
    }
    for warning in &task.warnings {
        line(format!("Warning: {warning}"));
    }
    out
}

/// Levels that were left upwards, as "levels 0 to 4" or "levels 1 and 3".
fn mastered(moves: &[&Moved]) -> Option<String> {
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

/// What it cannot do yet, and what makes that harder than what it can.
fn defeat(task: &TaskMastery, level: u32, top: usize) -> String {
    let bounds = task.evidence().map_or_else(
        || "no contested scenario of it has counted yet".to_owned(),
        |m| {
            format!(
                "it succeeds on {:.2} of contested scenarios ({:.2} to {:.2}, n {})",
                m.mean, m.q10, m.q90, m.n
            )
        },
    );
    let plain = share(task.plain.success);
    let what = if level as usize == top { "At the top" } else { "Not mastered yet" };
    let harder = harder(&task.task, level);
    let harder = if harder.is_empty() { harder } else { format!(" (harder than {}: {harder})", level - 1) };
    format!("{what}: level {level}{harder}: {bounds}. Over all its episodes, easy ones too: {plain}.")
}

/// What changes from the level below.
fn harder(task: &str, level: u32) -> String {
    let Some((spec, below)) = env_core::task(task).zip(level.checked_sub(1)) else { return String::new() };
    let levels = spec.levels();
    let rows = levels.params(below as usize).zip(levels.params(level as usize));
    let changed = rows.filter(|(before, now)| before.1 != now.1);
    let told = changed.filter_map(|((name, before), (_, now))| {
        let param = spec.params().iter().find(|param| param.name == name)?;
        Some(worlds::param_in_words(param, &format!("{before} → {now}")))
    });
    told.collect::<Vec<_>>().join(", ")
}

/// What the numbers of the reflex at the centre of the population stand for.
fn meaning(progress: &Progress, task: &TaskMastery) -> Vec<ParameterMeaning> {
    let numbers = progress.trainees.get(&task.task).and_then(Trainee::numbers);
    let spec = env_core::task(&task.task);
    numbers.zip(spec).map(|(numbers, spec)| (spec.reflex().meaning)(numbers)).unwrap_or_default()
}

/// The same in words.
fn learnt(progress: &Progress, task: &TaskMastery) -> Option<String> {
    let generations = progress.trainees.get(&task.task).map_or(0, Trainee::generation);
    let numbers: Vec<String> = meaning(progress, task).iter().map(told).collect();
    let who = match generations {
        0 => "Its reflex".to_owned(),
        n => format!("Learnt in {n} generations"),
    };
    (!numbers.is_empty()).then(|| format!("{who}: {}.", numbers.join(", ")))
}

/// A number of a reflex, as "burn size 0.22 LU/TU": three digits, as many as mean anything.
fn told(meaning: &ParameterMeaning) -> String {
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

/// The level over the run, from left to right, as blocks.
fn picture(moves: &[&Moved], flown: usize, top: u32) -> String {
    let level_at = |episodes: usize| moves.iter().rev().find(|m| m.at <= episodes).map_or(0, |m| m.to);
    let block = |level: u32| {
        let index = level as usize * (BLOCKS.len() - 1) / top.max(1) as usize;
        BLOCKS[index.min(BLOCKS.len() - 1)]
    };
    (1..=PICTURE).map(|column| block(level_at(flown * column / PICTURE))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(at: usize, from: Option<u32>, to: u32) -> Moved {
        Moved { task: "kessler/survival".to_owned(), at, from, to, why: String::new() }
    }

    #[test]
    fn a_picture_rises_where_the_level_does() {
        let moves = [moved(10, Some(0), 1), moved(50, Some(1), 9)];
        let drawn = picture(&moves.iter().collect::<Vec<_>>(), 100, 9);
        assert_eq!(drawn.chars().count(), PICTURE);
        assert_eq!(drawn.chars().filter(|c| *c == '█').count(), PICTURE / 2 + 1);
        assert!(drawn.starts_with('▁') && drawn.ends_with('█'));
        assert!(picture(&[], 0, 9).chars().all(|c| c == '▁'));
    }

    #[test]
    fn numbers_of_a_reflex_are_told_with_their_units() {
        let say = |name, value, unit| told(&ParameterMeaning { name, value, unit });
        assert_eq!(say("look_ahead", 8.0, "steps"), "look ahead 8 steps");
        assert_eq!(say("burn_size", 0.2178, "LU/TU"), "burn size 0.22 LU/TU");
        assert_eq!(say("map", -0.5, ""), "map -0.5");
        assert_eq!(say("damping", 0.01234, "1/s"), "damping 0.0123 1/s");
        assert_eq!([say("far", 1234.5, "m"), say("off", 0.0, "")], ["far 1234 m", "off 0"]);
    }

    #[test]
    fn levels_left_upwards_are_mastered() {
        let told = |moves: &[Moved]| mastered(&moves.iter().collect::<Vec<_>>());
        assert_eq!(told(&[]), None);
        assert_eq!(told(&[moved(1, None, 4)]), None);
        assert_eq!(told(&[moved(1, Some(0), 1)]).as_deref(), Some("level 0"));
        let up_down_up =
            [moved(1, Some(0), 1), moved(2, Some(1), 2), moved(3, Some(2), 1), moved(4, Some(1), 2)];
        assert_eq!(told(&up_down_up).as_deref(), Some("levels 0 and 1"));
        assert_eq!(told(&[moved(1, Some(0), 1), moved(2, Some(2), 3)]).as_deref(), Some("levels 0, 2"));
    }

    #[test]
    fn what_makes_a_level_harder_is_named() {
        assert_eq!(harder("kessler/survival", 0), "");
        assert_eq!(harder("kessler/survival", 5), "fuel 10 → 5");
        assert_eq!(harder("kessler/survival", 6), "debris 100 → 125, fuel 5 → 4, radar range 300 → 20");
        assert_eq!(harder("docking/single", 3), "time limit 1500 → 1000 s, thrust bound 1 → 0.5");
    }
}
