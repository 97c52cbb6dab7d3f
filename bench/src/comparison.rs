//! Saved measurements, and their comparison: the ratio of each figure to an earlier one, with the spread of alternating turns.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};

use crate::Row;

/// File name of the program that most benchmarks measure.
const SPARRING: &str = if cfg!(windows) { "sparring.exe" } else { "sparring" };

/// Figure of a benchmark as it is saved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Figure {
    benchmark: String,
    label: String,
    measured: String,
    /// Ratio to the goal, above 1 is better; null for figures without a goal.
    ratio: Option<f64>,
}

/// Figures of one turn: one start of this program.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Turn {
    figures: Vec<Figure>,
}

impl Turn {
    /// Adds the rows of a benchmark.
    pub(crate) fn add(&mut self, benchmark: &str, rows: &[Row]) {
        self.figures.extend(rows.iter().map(|row| Figure {
            benchmark: benchmark.to_owned(),
            label: row.label.clone(),
            measured: row.measured.clone(),
            ratio: row.ratio,
        }));
    }
}

/// Reads the turns that a file has.
///
/// # Errors
/// Returns an error if the file cannot be read, or has other content.
pub(crate) fn read(file: &Path) -> anyhow::Result<Vec<Turn>> {
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    serde_json::from_slice(&text).with_context(|| {
        format!("{} has no saved measurements: `bench --save FILE` writes them", file.display())
    })
}

/// Appends a turn to a file, which is created if it does not exist.
///
/// # Errors
/// Returns an error if the file has other content, or cannot be written.
pub(crate) fn append(file: &Path, turn: &Turn) -> anyhow::Result<Vec<Turn>> {
    let mut turns = if file.exists() { read(file)? } else { Vec::new() };
    turns.push(turn.clone());
    let text = serde_json::to_vec_pretty(&turns)?;
    std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))?;
    Ok(turns)
}

/// Runs the same benchmarks in another build of this program, and returns its figures. It measures the `sparring` beside it, or
/// the one that it builds.
///
/// # Errors
/// Returns an error if the program cannot be started or fails.
pub(crate) fn measure_other(program: &Path, benchmarks: &[String]) -> anyhow::Result<Turn> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("turn.json");
    let mut command = Command::new(program);
    command.args(benchmarks).arg("--save").arg(&file);
    // The variable names the `sparring` that this program measures.
    command.env_remove("SPARRING_BINARY");
    let own = program.canonicalize().ok().map(|program| program.with_file_name(SPARRING));
    if let Some(own) = own.filter(|own| own.exists()) {
        command.env("SPARRING_BINARY", own);
    }
    let status = command.status().with_context(|| format!("cannot start {}", program.display()))?;
    ensure!(status.success(), "{} failed", program.display());
    read(&file)?.pop().context("the other program saved no measurements")
}

/// Returns a row for each figure that both sides have: the median of the ratios of the turns with the same number, after to before,
/// with the smallest and the largest one. Above 1 the figure became better.
pub(crate) fn compare(before: &[Turn], after: &[Turn]) -> Vec<Row> {
    let pairs: Vec<(&Turn, &Turn)> = before.iter().zip(after).collect();
    let Some((_, first)) = pairs.first() else { return Vec::new() };
    let rows = first.figures.iter().filter_map(|figure| {
        let ratios = pairs.iter().filter_map(|(before, after)| {
            let of = |turn: &Turn| {
                let mut found = turn.figures.iter();
                found.find(|other| other.benchmark == figure.benchmark && other.label == figure.label)?.ratio
            };
            Some(of(after)? / of(before)?).filter(|ratio| ratio.is_finite())
        });
        let mut ratios: Vec<f64> = ratios.collect();
        ratios.sort_by(f64::total_cmp);
        let (least, most) = (*ratios.first()?, *ratios.last()?);
        let middle = f64::midpoint(ratios[(ratios.len() - 1) / 2], ratios[ratios.len() / 2]);
        let spread = match ratios.len() {
            1 => "1 turn, no spread".to_owned(),
            turns => format!("{least:.3} to {most:.3}, {turns} turns"),
        };
        Some(Row {
            label: format!("{}: {}", figure.benchmark, figure.label),
            measured: spread,
            goal: "after / before".to_owned(),
            ratio: Some(middle),
        })
    });
    rows.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(ratio: f64) -> Turn {
        let mut turn = Turn::default();
        let row = |label: &str, ratio| Row {
            label: label.to_owned(),
            measured: String::new(),
            goal: String::new(),
            ratio,
        };
        turn.add("results", &[row("durable results", Some(ratio)), row("bytes", None)]);
        turn
    }

    #[test]
    fn figures_are_compared_turn_by_turn() {
        let rows = compare(&[turn(1.0), turn(2.0), turn(1.0)], &[turn(1.1), turn(2.0), turn(0.9)]);
        let [row] = &rows[..] else { panic!("one figure has a ratio: {rows:?}") };
        assert_eq!(
            (row.label.as_str(), row.measured.as_str()),
            ("results: durable results", "0.900 to 1.100, 3 turns")
        );
        assert_eq!(row.ratio, Some(1.0));
        assert!(compare(&[], &[turn(1.0)]).is_empty());
    }

    #[test]
    fn turns_are_appended_to_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("turns.json");
        append(&file, &turn(1.0)).unwrap();
        assert_eq!(append(&file, &turn(2.0)).unwrap(), [turn(1.0), turn(2.0)]);
        assert_eq!(read(&file).unwrap().len(), 2);
        std::fs::write(&file, "{}").unwrap();
        assert!(read(&file).unwrap_err().to_string().contains("--save FILE"));
    }
}
