//! Findings of a check, grouped by kind: one line for each kind, with the first findings.

use std::collections::BTreeMap;

/// Findings that a line shows at most.
const MAX_SHOWN: usize = 5;

/// Kind of damage, in the order of the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum FindingKind {
    Pages,
    References,
    Logs,
    Groups,
    Runs,
    CompactedLeases,
    EpisodeCounters,
    ClaimCounters,
    Events,
    Moves,
    Snapshots,
    Levels,
    Replays,
    Scores,
    Skills,
    Successes,
}

impl FindingKind {
    /// Label at the beginning of a line.
    const fn label(self) -> &'static str {
        match self {
            Self::Pages => "damaged pages",
            Self::References => "missing rows",
            Self::Logs => "missing actions",
            Self::Groups => "wrong counts of groups",
            Self::Runs => "unreadable runs",
            Self::CompactedLeases => "unreadable compacted leases",
            Self::EpisodeCounters => "wrong counters of episodes",
            Self::ClaimCounters => "wrong counters of claims",
            Self::Events => "missing curriculum events",
            Self::Moves => "wrong level moves",
            Self::Snapshots => "wrong snapshots",
            Self::Levels => "wrong levels",
            Self::Replays => "failed replays",
            Self::Scores => "wrong scores",
            Self::Skills => "wrong skills",
            Self::Successes => "wrong successes",
        }
    }
}

/// Findings of a check, by kind.
#[derive(Debug, Default)]
pub(super) struct Findings(BTreeMap<FindingKind, FindingList>);

#[derive(Debug, Default)]
struct FindingList {
    count: usize,
    /// The first findings as sentences.
    shown: Vec<String>,
}

impl Findings {
    /// Adds a finding, a sentence without a full stop.
    pub(super) fn add(&mut self, kind: FindingKind, finding: String) {
        let list = self.0.entry(kind).or_default();
        list.count += 1;
        if list.shown.len() < MAX_SHOWN {
            list.shown.push(finding);
        }
    }

    /// Adds several findings of one kind.
    pub(super) fn extend(&mut self, kind: FindingKind, findings: Vec<String>) {
        findings.into_iter().for_each(|finding| self.add(kind, finding));
    }

    /// True if nothing was found.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Formats one line for each kind.
    pub(super) fn lines(&self) -> Vec<String> {
        let line = |(kind, FindingList { count, shown }): (&FindingKind, &FindingList)| {
            let rest = match count - shown.len() {
                0 => String::new(),
                rest => format!("; and {rest} more"),
            };
            format!("{}: {}{rest}", kind.label(), shown.join("; "))
        };
        self.0.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_one_line_with_its_first_findings() {
        let mut findings = Findings::default();
        findings.extend(FindingKind::Scores, (1..=7).map(|number| format!("ep_{number} is wrong")).collect());
        findings.add(FindingKind::Pages, "page 3 is never used".to_owned());
        insta::assert_snapshot!(findings.lines().join("\n"), @"
        damaged pages: page 3 is never used
        wrong scores: ep_1 is wrong; ep_2 is wrong; ep_3 is wrong; ep_4 is wrong; ep_5 is wrong; and 2 more
        ");
    }
}
