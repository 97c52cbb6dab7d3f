//! Groups of runs whose curves are averaged.

use std::collections::BTreeMap;

use super::compared_run::ComparedRun;
use super::settings::{leaves, settings_table};

/// Rule by which runs form groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(in crate::report) enum Grouping {
    /// Runs with equal settings, which differ by their seeds.
    Settings,
    /// Runs with the same tags.
    Tags,
    /// No groups: each run has curves of its own.
    Run,
}

/// Runs that are averaged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RunGroup {
    /// Name of the group, unique in the comparison.
    pub(super) label: String,
    /// Positions of its runs.
    pub(super) runs: Vec<usize>,
}

/// Number of settings in the label of a group, and length of the longest value there.
const MAX_LABEL: (usize, usize) = (3, 24);

/// Groups the runs in the order of their first members.
pub(super) fn group_runs(runs: &[ComparedRun], grouping: Grouping) -> Vec<RunGroup> {
    let mut groups: Vec<(String, RunGroup)> = Vec::new();
    for (at, run) in runs.iter().enumerate() {
        let key = match grouping {
            Grouping::Settings => format!("{:?}", leaves(&run.settings)),
            Grouping::Tags => tag_label(run, runs),
            Grouping::Run => at.to_string(),
        };
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, group)) => group.runs.push(at),
            None => groups.push((key, RunGroup { label: String::new(), runs: vec![at] })),
        }
    }
    let mut used = BTreeMap::<String, usize>::new();
    let named = groups.into_iter().map(|(_, mut group)| {
        let at = group.runs[0];
        let label = match grouping {
            Grouping::Settings => settings_label(at, runs).unwrap_or_else(|| run_label(at, runs)),
            Grouping::Tags => tag_label(&runs[at], runs),
            Grouping::Run => run_label(at, runs),
        };
        let count = used.entry(label.clone()).and_modify(|n| *n += 1).or_insert(1);
        group.label = if *count > 1 { format!("{label} ({count})") } else { label };
        group
    });
    named.collect()
}

/// Returns the tags of a run that not all runs have.
fn tag_label(run: &ComparedRun, runs: &[ComparedRun]) -> String {
    let is_common = |tag: &String| runs.iter().all(|other| other.row.tags.0.contains(tag));
    let own: Vec<&str> = run.row.tags.0.iter().filter(|tag| !is_common(tag)).map(String::as_str).collect();
    if own.is_empty() { "without a tag".to_owned() } else { own.join(", ") }
}

/// Returns the settings of a run that differ between the runs; none if all are equal.
fn settings_label(at: usize, runs: &[ComparedRun]) -> Option<String> {
    let (count, length) = MAX_LABEL;
    let table = settings_table(&runs.iter().map(|run| &run.settings).collect::<Vec<_>>());
    let parts = table.iter().filter(|row| row.differs()).filter_map(|row| {
        let value = row.values[at].as_deref().unwrap_or("–");
        let name = row.path.rsplit('.').next().unwrap_or(&row.path);
        (value.chars().count() <= length).then(|| format!("{name} {value}"))
    });
    let parts: Vec<String> = parts.take(count).collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

/// Returns the name of a run; runs with the same name have their seed, and their id if that is not enough.
pub(super) fn run_label(at: usize, runs: &[ComparedRun]) -> String {
    let row = &runs[at].row;
    let same: Vec<&ComparedRun> = runs.iter().filter(|run| run.row.name == row.name).collect();
    match same.iter().filter(|run| run.row.seed == row.seed).count() {
        _ if same.len() < 2 => row.name.clone(),
        1 => format!("{}, seed {}", row.name, row.seed),
        _ => format!("{}, {}", row.name, row.id),
    }
}
