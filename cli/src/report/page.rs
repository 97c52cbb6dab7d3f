//! HTML page of a report. The template escapes all text that users and models wrote.

use std::collections::BTreeMap;

use api_types::Estimate;
use clock::{Millis, rfc3339};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use orchestrator::queries::run_series::SeriesPoint;
use serde_json::Value;
use store::curriculum::LevelMoveKind;
use store::from_json;
use store::history::HistoryBucket;
use store::task_counters::TaskCounters;

use super::chart::{BLUE, Chart, Curve, GREEN, Interval, LevelMark, MAUVE, ORANGE};
use super::gather::{EvaluationResult, MAX_LAYOUTS, RunReport, TaskReport};
use super::rose::rose;
use super::sampler::sampler_table;

pub(super) const STYLE: &str = "\
:root{color-scheme:light;font:15px/1.45 system-ui,'Segoe UI',Roboto,sans-serif;color:#1b2430}\
body{max-width:76rem;margin:2rem auto;padding:0 1rem}h1{margin:0}h2{margin:2rem 0 .5rem;border-bottom:1px solid #d9dee6}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.5rem 0}th,td{padding:.2rem .7rem;text-align:left;\
border-bottom:1px solid #d9dee6;vertical-align:top}th{color:#566273;font-size:.85rem}.n{text-align:right}.soft{color:#566273}\
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(32rem,100%),1fr));gap:1rem}figure{margin:0}\
figcaption{font-size:.9rem;color:#566273}.say{min-width:14rem}svg{max-width:100%;height:auto}svg text{font-size:12px;fill:#566273}\
.foreign{unicode-bidi:isolate;overflow-wrap:anywhere}pre{overflow-x:auto;background:#eef1f5;padding:.6rem}\
.wide{overflow-x:auto}b.key{display:inline-block;width:.8em;height:.8em;margin-right:.3em}span.key{margin-left:.8em;white-space:nowrap}@media print{h2{break-after:avoid}figure{break-inside:avoid}}";

/// Renders the whole page.
///
/// # Errors
/// Returns an error if the run's settings are no JSON or a chart cannot be drawn.
pub(super) fn render(report: &RunReport) -> anyhow::Result<String> {
    let settings: Value = from_json("a run's settings", &report.row.settings)?;
    let tasks =
        report.tasks.iter().map(|task| task_section(report, task)).collect::<anyhow::Result<Vec<_>>>()?;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'";
                title { (report.row.name) " · Sparring" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                (head(report))
                @for task in tasks { (task) }
                (layouts(report))
                (evaluations(report))
                h2 { "Rules of the curriculum" }
                p { (report.explanation.summary) }
                ul { @for rule in &report.explanation.rules { li { (rule) } } }
                details { summary { "Settings (JSON)" } pre { (serde_json::to_string_pretty(&settings)?) } }
            }
        }
    };
    Ok(page.into_string())
}

fn head(report: &RunReport) -> Markup {
    let status = if report.row.archived_at.is_some() { "archived" } else { report.row.status.as_str() };
    html! {
        h1 .foreign { (report.row.name) }
        p .soft {
            "Run " (report.row.id) ", " (status) ", strategy " (report.explanation.strategy) ", created " (rfc3339(report.row.created_at))
            ", policy version " (report.row.policy_version) "; " (report.episodes) " episodes. As of " (rfc3339(report.now)) "; all times are UTC."
        }
        div .wide { table {
            thead { tr { th { "Task" } th .n { "Level" } th { "Mastery at current level (10 % to 90 % quantile)" } th .n { "Missing outcomes" } th .n { "Training episodes" } th .n { "Success rate" }
                th .n { "Mean score" } th .n { "Mean skill" } th { "Current state" } } }
            tbody {
                @for task in &report.tasks {
                    tr {
                        td { (task.spec.id()) }
                        td .n { @if let Some(level) = task.status.level { (level) } @else { "–" } }
                        td .say { (posterior(task)) }
                        td .n { (percent(task.mastery.as_ref().filter(|m| m.n > 0).map(|m| m.missing))) }
                        td .n { (task.sums.episodes) }
                        td .n { (percent(ratio(task.sums.successes as f64, ended_episodes(&task.sums)))) }
                        td .n { (number(ratio(task.sums.score_sum, task.sums.episodes))) }
                        td .n { (number(ratio(task.sums.skill_sum, task.sums.episodes_with_skill))) }
                        td .say { @for now in report.explanation.tasks.iter().filter(|of| of.task == task.spec.id()) { (now.current_state) }
                            @if let Some(held_back) = &task.status.held_back { ". Held back: " (held_back) } }
                    }
                }
            }
        } }
    }
}

/// Number of episodes that ended. Missing ones count as failures in the success rate.
fn ended_episodes(sums: &TaskCounters) -> i64 {
    sums.episodes + sums.failed + sums.expired
}

fn posterior(task: &TaskReport) -> String {
    match &task.mastery {
        Some(m) => format!("{:.2} ({:.2} to {:.2}), {} scenarios", m.mean, m.q10, m.q90, m.n),
        // A level without results has the prior.
        None if task.status.level.is_some() => "0.50 (0.10 to 0.90), no scenarios yet".to_owned(),
        None => "–".to_owned(),
    }
}

fn task_section(report: &RunReport, task: &TaskReport) -> anyhow::Result<Markup> {
    let times: Vec<Millis> = task.points.iter().map(|point| point.from.midpoint(point.to)).collect();
    let marks = level_marks(report, task);
    let of = |value: &dyn Fn(&HistoryBucket) -> Option<f64>| {
        task.points.iter().map(|point| value(&point.bucket)).collect::<Vec<_>>()
    };
    let plain = |name, colour, values| Curve { name, colour, values, intervals: None };
    let draw = |value_label: &str, limits, thresholds: &[f64], marks: &[_], curves: &[Curve]| {
        let range = report.range.clone();
        Chart { times: &times, range, value_label, limits, thresholds, marks, curves }.draw()
    };
    // Only the ladder moves by these thresholds.
    let thresholds: &[f64] = if report.explanation.strategy == "ladder" { &[0.3, 0.7] } else { &[] };
    let interval = |point: &SeriesPoint| point.bucket.mastery.map(|s| Interval { low: s.q10, high: s.q90 });
    let intervals = task.points.iter().map(interval).collect();
    let mastery = [
        Curve {
            name: "mastery",
            colour: BLUE,
            values: of(&|p| p.mastery.map(|s| s.mean)),
            intervals: Some(intervals),
        },
        plain("contested scenarios", GREEN, of(&|p| ratio(p.success_rate_sum, p.contested_groups))),
        plain("all episodes", ORANGE, of(&|p| ratio(p.successes as f64, p.episodes))),
        plain("blind panel", MAUVE, of(&|p| ratio(p.panel_success_rate_sum, p.panel_groups))),
    ];
    let skill = [
        plain("skill", BLUE, of(&|p| ratio(p.skill_sum, p.episodes_with_skill))),
        plain("score", ORANGE, of(&|p| ratio(p.score_sum, p.episodes))),
    ];
    let mut pictures = vec![
        (
            "Mastery and success".to_owned(),
            html! { (legend(&mastery)) (marks_legend(&marks, thresholds)) },
            draw("success rate", Some(Interval { low: 0.0, high: 1.0 }), thresholds, &marks, &mastery)?,
        ),
        level_picture(report, task, &times, &marks)?,
        ("Mean skill and score".to_owned(), legend(&skill), draw("skill, score", None, &[], &[], &skill)?),
    ];
    let params = param_curves(task);
    for (name, curve) in &params {
        let title = format!("Param {name}");
        let curve = std::slice::from_ref(curve);
        pictures.push((title, legend(curve), draw(&param_label(task, name), None, &[], &[], curve)?));
    }
    Ok(html! {
        h2 { (task.spec.id()) }
        @if task.points.is_empty() { p .soft { "No results yet." } }
        @else { (figures(&pictures)) }
        @if let Some(sampler) = &task.sampler { (sampler_table(sampler)) }
        (level_moves(task))
        (failure_modes(task))
    })
}

/// Returns the level of a task over time, which changes in steps at its moves. Without moves it is that of the samples of mastery.
fn level_picture(
    report: &RunReport,
    task: &TaskReport,
    sampled_at: &[Millis],
    marks: &[LevelMark],
) -> anyhow::Result<(String, Markup, String)> {
    let level = |level: i64| Some(level as f64);
    let range = report.range.clone();
    let (times, values) = match task.moves.first() {
        None => {
            let samples =
                task.points.iter().map(|point| point.bucket.mastery.and_then(|sample| sample.level));
            (sampled_at.to_vec(), samples.map(|sample| sample.and_then(level)).collect())
        }
        Some(first) => {
            let mut steps = vec![(range.start, first.from_level)];
            for row in &task.moves {
                let before = steps.last().and_then(|(_, before)| *before);
                steps.extend([(row.at, before), (row.at, Some(row.to_level))]);
            }
            steps.push((range.end, steps.last().and_then(|(_, last)| *last)));
            // Moves before the first results are at its begin.
            let steps = steps.into_iter().map(|(at, step)| (at.max(range.start), step.and_then(level)));
            steps.unzip()
        }
    };
    let curves = [Curve { name: "level", colour: BLUE, values, intervals: None }];
    let limits = Some(level_limits(&curves));
    let chart =
        Chart { times: &times, range, value_label: "level", limits, thresholds: &[], marks, curves: &curves };
    Ok(("Level".to_owned(), html! { (legend(&curves)) (marks_legend(marks, &[])) }, chart.draw()?))
}

/// Returns the level moves in the range of the report.
fn level_marks(report: &RunReport, task: &TaskReport) -> Vec<LevelMark> {
    let moves = task.moves.iter().filter(|row| row.at >= report.range.start);
    moves.map(|row| LevelMark { at: row.at, is_upward: row.kind != LevelMoveKind::Down }).collect()
}

/// Returns pictures with their titles and legends.
fn figures(pictures: &[(String, Markup, String)]) -> Markup {
    html! {
        div .pictures {
            @for (title, legend, picture) in pictures {
                figure { (PreEscaped(picture)) figcaption { strong { (title.replace('_', " ")) } " " (legend) } }
            }
        }
    }
}

/// Returns the range of the axis of a level: at least levels 0 to 4, so that its labels are whole numbers.
fn level_limits(curves: &[Curve]) -> Interval {
    let levels = curves.iter().flat_map(|curve| curve.values.iter().flatten().copied());
    Interval { low: 0.0, high: levels.fold(3.0, f64::max) + 1.0 }
}

/// Returns the names of the curves, each beside its colour.
fn legend(curves: &[Curve]) -> Markup {
    html! { @for curve in curves {
        span .key {
            b .key style={ "background:rgb(" (curve.colour.0) "," (curve.colour.1) "," (curve.colour.2) ")" } {} (curve.name)
            @if curve.intervals.is_some() { " (band: 10 % to 90 % quantile)" }
        } " "
    } }
}

/// Returns the legend of the triangles and of the dashed lines, if the chart has any.
fn marks_legend(marks: &[LevelMark], thresholds: &[f64]) -> Markup {
    html! {
        @if !marks.is_empty() { span .key { "▲ level up or placed" } " " span .key { "▼ level down" } " " }
        @if !thresholds.is_empty() { span .key { "╌ thresholds of the ladder" } }
    }
}

/// Returns the label of a param's axis: its name and unit.
fn param_label(task: &TaskReport, name: &str) -> String {
    let unit = task.spec.params().iter().find(|spec| spec.name == name).map_or("", |spec| spec.unit);
    let name = name.replace('_', " ");
    if unit.is_empty() { name } else { format!("{name} ({unit})") }
}

/// Returns the curves of the params that changed, as means over each point.
fn param_curves(task: &TaskReport) -> Vec<(&str, Curve)> {
    let mut known: BTreeMap<&str, Vec<Option<f64>>> = BTreeMap::new();
    for name in task.points.iter().flat_map(|point| point.bucket.params.keys()) {
        let mean =
            |part: &HistoryBucket| part.params.get(name).map(|spread| spread.total / spread.n.max(1) as f64);
        known.entry(name).or_insert_with(|| task.points.iter().map(|point| mean(&point.bucket)).collect());
    }
    known.retain(|_, values| {
        let mut values = values.iter().flatten();
        values.next().is_some_and(|first| values.any(|value| (value - first).abs() > 1e-9))
    });
    let curve = |values| Curve { name: "mean of the scenarios", colour: BLUE, values, intervals: None };
    known.into_iter().map(|(name, values)| (name, curve(values))).collect()
}

fn level_moves(task: &TaskReport) -> Markup {
    html! {
        @if !task.moves.is_empty() {
            details { summary { "Level moves with their evidence (" (task.moves.len()) ")" }
                ol { @for row in &task.moves { li { (rfc3339(row.at)) ": " (row.kind) " to level " (row.to_level) ". " (evidence_sentence(&row.evidence)) } } }
            }
        }
    }
}

/// Returns the sentence of a move's evidence, or an empty string.
fn evidence_sentence(evidence: &str) -> String {
    let read: Option<Value> = serde_json::from_str(evidence).ok();
    read.and_then(|value| value["sentence"].as_str().map(str::to_owned)).unwrap_or_default()
}

fn failure_modes(task: &TaskReport) -> Markup {
    let count = |mode: &str| {
        task.failures.iter().filter(|cell| cell.key.mode == mode).map(|cell| cell.counters.count).sum::<i64>()
    };
    let modes: Vec<_> = task
        .spec
        .failure_modes()
        .iter()
        .map(|mode| (mode, count(mode.name)))
        .filter(|(_, n)| *n > 0)
        .collect();
    // Shares refer to all failures, since a body that was never visible could not be avoided.
    let avoidable = |mode: &str| {
        let of = task.failures.iter().filter(|cell| cell.key.mode == mode);
        let known = of.clone().any(|cell| cell.counters.avoidable + cell.counters.unavoidable > 0);
        ratio(of.map(|cell| cell.counters.avoidable).sum::<i64>() as f64, count(mode)).filter(|_| known)
    };
    html! {
        @if !modes.is_empty() {
            h3 { "Failure modes" }
            div .wide { table {
                thead { tr { th { "Failure mode" } th .n { "Failures" } th .n { "Avoidable" } th { "Description" } } }
                tbody { @for (mode, n) in &modes {
                    tr { td { (mode.name.replace('_', " ")) } td .n { (n) } td .n { (percent(avoidable(mode.name))) } td .say { (mode.description) } }
                } }
            } }
            div .pictures { @for (mode, _) in &modes { (rose(mode.name, &task.failures, &task.spec.sector_quantity(), &task.spec.speed_bands())) } }
        }
    }
}

fn layouts(report: &RunReport) -> Markup {
    html! {
        @if !report.layouts.is_empty() {
            h2 { "Designed layouts" }
            p .soft { "The table lists up to " (MAX_LAYOUTS) " of the newest layouts with episodes. Layouts with the lowest success rates are first." }
            div .wide { table {
                thead { tr { th { "Layout" } th { "Task" } th { "Aim" } th { "Designer" } th { "State" } th .n { "Episodes" } th .n { "Success rate" } } }
                tbody { @for row in &report.layouts {
                    tr {
                        td .foreign { (row.name) } td { (row.task) }
                        td { (row.mode.as_deref().unwrap_or("–").replace('_', " ")) @if let Some(from) = row.bearing_deg { " from " (from) "°" } }
                        td { (row.designer) } td { (row.state) } td .n { (row.episodes) }
                        td .n { (percent(ratio(row.successes as f64, row.episodes))) }
                    }
                } }
            } }
        }
    }
}

fn evaluations(report: &RunReport) -> Markup {
    html! {
        @if !report.evaluations.is_empty() {
            h2 { "Evaluations" }
            p .soft { "Results on frozen suites of held-out scenarios: mean [95 % interval over scenarios]. The blind panel is the baseline." }
            @for EvaluationResult { evaluation, rows } in &report.evaluations {
                h3 .foreign { (evaluation.name) }
                p .soft { (evaluation.suite) @if let Some(version) = evaluation.policy_version { ", policy version " (version) } ", episodes per scenario: " (evaluation.rollouts) }
                div .wide { table {
                    thead { tr { th { "Task" } th { "Scenarios" } th { "Policy" } th { "Success rate" } th { "Score" } th { "Skill" } } }
                    tbody { @for of in rows {
                        tr { td { (of.task) } td { (of.scenarios) " " (of.part.label()) } td .foreign { @if of.policy == "blind_panel" { "blind panel" } @else { (of.policy) } }
                            td { (format_estimate(of.success)) } td { (format_estimate(of.score)) } td { (format_estimate(of.skill)) } }
                    } }
                } }
            }
        }
    }
}

fn format_estimate(of: Option<Estimate>) -> String {
    of.map_or_else(|| "–".to_owned(), |e| format!("{:.3} [{:.3}, {:.3}]", e.mean, e.low, e.high))
}

/// Returns `sum / n`, or `None` if `n` is 0.
fn ratio(sum: f64, n: i64) -> Option<f64> {
    (n > 0).then(|| sum / n as f64)
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |share| format!("{:.0} %", 100.0 * share))
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"))
}
