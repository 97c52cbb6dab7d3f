//! `sparring judge-agreement`: measures the agreement of the judging language model with the deterministic judge.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use serde::Serialize;
use store::step_verdicts::{self, StepScores};

use super::output::{self, Column, JsonFlag, Report, TextTable};
use super::run_names::find_stored_run;
use llm_policy::judging::agreement::{Agreement, Band, ScorePair};

/// Measure how well a judging language model agrees with the deterministic judge.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A server with --judge llm (or a run with judge: llm) stores both verdicts of every judged step: the model's and that of the \
rules. Scores range from -1 to 1; the bands are blame (below -0.25), neutral and praise (above 0.25). kappa is Cohen's kappa \
over the bands with quadratic weights: 1 is perfect agreement, 0 agreement by chance. The table by case groups the model's \
scores by the verdict of the rules. Steps that only one judge scored are counted, but not compared. A server may use the \
database at the same time.

Examples:
  sparring judge-agreement
  sparring judge-agreement --db training.sqlite3 --run baseline
  sparring judge-agreement --json")]
pub struct Args {
    /// Path of the SQLite database of the server that judged
    #[arg(long, default_value = "sparring.sqlite3", value_name = "PATH", env = "SPARRING_DB")]
    db: PathBuf,
    /// Compare only the steps of this run, by id, prefix or name
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
    #[command(flatten)]
    output: JsonFlag,
}

/// Agreement between the models and the rules, printed as one JSON object.
#[derive(Debug, Serialize)]
struct AgreementReport {
    /// Number of stored verdicts.
    verdicts: usize,
    /// Verdicts without a score of the model.
    unanswered: usize,
    /// Reasons for missing scores with their counts, the most frequent first.
    reasons: Vec<(String, usize)>,
    /// Verdicts without a score of the rules.
    without_rules: usize,
    /// Agreement by model and task; `all` comes first.
    agreement: Vec<AgreementRow>,
    /// Agreement by the case of the rules.
    cases: Vec<CaseRow>,
}

#[derive(Debug, Serialize)]
struct AgreementRow {
    model: String,
    task: String,
    #[serde(flatten)]
    figures: Agreement,
}

#[derive(Debug, Serialize)]
struct CaseRow {
    case: String,
    #[serde(flatten)]
    figures: Agreement,
}

/// Prints the agreement.
///
/// # Errors
/// Returns an error if the database cannot be read or holds no verdicts.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    // Opening an empty file would turn it into a database.
    if std::fs::metadata(&args.db).is_ok_and(|file| file.len() == 0) {
        bail!("{} is empty", args.db.display());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let rows = runtime.block_on(async {
        let readers = store::open_current_readers(&args.db).await?;
        let mut connection = readers.acquire().await?;
        let run = match &args.run {
            None => None,
            Some(run) => Some(find_stored_run(&mut connection, Some(run)).await?),
        };
        anyhow::Ok(step_verdicts::scores(&mut connection, run.as_deref()).await?)
    })?;
    if rows.is_empty() {
        let of = args.run.as_ref().map_or_else(String::new, |run| format!(" of {run}"));
        bail!(
            "no language model judged any step{of}; serve with --judge llm, or create a run with judge: llm"
        );
    }
    let report = build_report(&rows);
    if args.output.json {
        output::print_json(&report)?;
    } else {
        output::print_report(&text_report(&report))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn build_report(rows: &[StepScores]) -> AgreementReport {
    let mut groups: BTreeMap<(&str, &str), Vec<ScorePair>> = BTreeMap::new();
    let mut cases: BTreeMap<&str, Vec<ScorePair>> = BTreeMap::new();
    for row in rows {
        let (Some(model), Some(rules)) = (row.score, row.rule_score) else { continue };
        let pair = ScorePair { model, rules };
        groups.entry((&row.model, &row.task)).or_default().push(pair);
        cases.entry(row.rule_case.as_deref().unwrap_or_default()).or_default().push(pair);
    }
    let mut lines: Vec<AgreementRow> = Vec::new();
    let mut models: BTreeMap<&str, Vec<ScorePair>> = BTreeMap::new();
    for ((model, _), pairs) in &groups {
        models.entry(model).or_default().extend(pairs);
    }
    for (model, all) in &models {
        let of = groups.iter().filter(|((of, _), _)| of == model);
        let tasks = of.map(|((_, task), pairs)| (*task, pairs.as_slice()));
        for (task, pairs) in std::iter::once(("all", all.as_slice())).chain(tasks) {
            lines.extend(Agreement::of(pairs).map(|figures| AgreementRow {
                model: (*model).to_owned(),
                task: task.to_owned(),
                figures,
            }));
        }
    }
    let case = |(case, pairs): (&&str, &Vec<ScorePair>)| {
        Agreement::of(pairs).map(|figures| CaseRow { case: (*case).to_owned(), figures })
    };
    AgreementReport {
        verdicts: rows.len(),
        unanswered: rows.iter().filter(|row| row.score.is_none()).count(),
        reasons: count_reasons(rows),
        without_rules: rows.iter().filter(|row| row.rule_score.is_none()).count(),
        agreement: lines,
        cases: cases.iter().filter_map(case).collect(),
    }
}

/// Largest number of listed reasons.
const MAX_REASONS: usize = 10;

fn count_reasons(rows: &[StepScores]) -> Vec<(String, usize)> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for error in rows.iter().filter_map(|row| row.error.as_deref()) {
        *counts.entry(error).or_default() += 1;
    }
    let mut all: Vec<(String, usize)> =
        counts.into_iter().map(|(why, count)| (why.to_owned(), count)).collect();
    all.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    all.truncate(MAX_REASONS);
    all
}

fn text_report(report: &AgreementReport) -> Report {
    let AgreementReport { verdicts, unanswered, without_rules, .. } = report;
    let also = if *without_rules > 0 {
        format!(", the rules gave no score for {without_rules}")
    } else {
        String::new()
    };
    let mut text = Report::default();
    text.paragraph(format!("{verdicts} verdicts; the model gave no score for {unanswered} of them{also}."));
    for (why, count) in &report.reasons {
        text.item(format!("{count}: {}", llm::sanitize_line(why)));
    }
    if !report.agreement.is_empty() {
        text.table(agreement_table(&report.agreement)).table(case_table(&report.cases));
    }
    text
}

fn agreement_table(rows: &[AgreementRow]) -> TextTable {
    let opt = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2}"));
    let mut table = TextTable::new([
        Column::text("model"),
        Column::text("task"),
        Column::number("steps"),
        Column::number("model mean").optional(2),
        Column::number("rules mean").optional(2),
        Column::number("mean difference"),
        Column::number("correlation").optional(1),
        Column::number("same band"),
        Column::number("kappa"),
    ]);
    for AgreementRow { model, task, figures: f } in rows {
        table.add_row([
            model.clone(),
            task.clone(),
            f.steps.to_string(),
            format!("{:.2}", f.model_mean),
            format!("{:.2}", f.rules_mean),
            format!("{:.2}", f.mean_difference),
            opt(f.correlation),
            format!("{:.0} %", 100.0 * f.same_band),
            opt(f.kappa),
        ]);
    }
    table
}

fn case_table(rows: &[CaseRow]) -> TextTable {
    let mut table = TextTable::new([
        Column::text("case of the rules"),
        Column::number("steps"),
        Column::number("rules mean"),
        Column::number("model mean"),
        Column::number("blame"),
        Column::number("neutral"),
        Column::number("praise"),
    ]);
    for CaseRow { case, figures: f } in rows {
        let band = |band: Band| f.bands[band as usize].iter().sum::<usize>().to_string();
        let numbers = [f.steps.to_string(), format!("{:.2}", f.rules_mean), format!("{:.2}", f.model_mean)];
        table.add_row(std::iter::once(case.replace('_', " ")).chain(numbers).chain(Band::ALL.map(band)));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::OutputTarget;

    fn row(task: &str, score: Option<f64>, rules: Option<(f64, &str)>) -> StepScores {
        StepScores {
            task: task.to_owned(),
            model: "m".to_owned(),
            score,
            rule_score: rules.map(|(score, _)| score),
            rule_case: rules.map(|(_, case)| case.to_owned()),
            error: score.is_none().then(|| "it was late".to_owned()),
        }
    }

    #[test]
    fn agreement_in_words_and_numbers() {
        let quiet = Some((1.0, "no_action_needed"));
        let rows = [
            row("kessler/survival", Some(0.9), quiet),
            row("kessler/survival", Some(0.8), quiet),
            row("kessler/survival", Some(0.5), Some((-1.0, "threat_missed"))),
            row("kessler/eco_station", Some(-0.6), Some((-0.55, "unnecessary_burn"))),
            row("kessler/eco_station", None, quiet),
            row("docking/single", Some(0.1), None),
        ];
        let report = build_report(&rows);
        insta::assert_snapshot!(text_report(&report).render(OutputTarget::Terminal(120)));
        insta::assert_json_snapshot!(report);
    }
}
