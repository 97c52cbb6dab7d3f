//! Layouts that designers made for the learner's failures, as the service reports them.

use std::collections::{BTreeMap, BTreeSet};

use api_types::{DesignState, DesignSummary};
use designer::GateCheck;
use env_core::critique::profile_sector;
use serde::Serialize;

/// Layouts that designers made for the run.
#[derive(Debug, Clone, Default)]
pub(super) struct Designs {
    /// Share of training groups that came from designs; `None` before the first group.
    pub(super) share: Option<f64>,
    /// Admitted and refused designs, the newest first.
    pub(super) all: Vec<DesignSummary>,
}

/// Results of the designs for one task.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(super) struct TaskDesignSummary {
    /// Layouts that the gate admitted.
    pub(super) admitted: usize,
    /// Refused layouts, counted by the check that refused them.
    pub(super) refused: BTreeMap<String, usize>,
    /// Retired layouts, counted by reason.
    pub(super) retired: BTreeMap<String, usize>,
    /// Episodes run on the admitted layouts.
    pub(super) episodes: i64,
    /// Share of these episodes that succeeded; `None` if there are no episodes.
    pub(super) success: Option<f64>,
    /// Aims of the admitted layouts, with their counts.
    pub(super) aims: BTreeMap<String, usize>,
}

impl Designs {
    /// Summarises the designs of one task.
    pub(super) fn summarize_task(&self, task: &str) -> TaskDesignSummary {
        let mut sums = TaskDesignSummary::default();
        let mut successes = 0;
        for design in self.all.iter().filter(|design| design.task == task) {
            let why = || design.state_reason.clone().unwrap_or_default();
            match design.state {
                DesignState::Refused => {
                    *sums.refused.entry(why()).or_default() += 1;
                    continue;
                }
                DesignState::Retired => *sums.retired.entry(why()).or_default() += 1,
                DesignState::Active => {}
            }
            sums.admitted += 1;
            *sums.aims.entry(describe_aim(design)).or_default() += 1;
            sums.episodes += design.results.episodes;
            successes += design.results.successes;
        }
        sums.success = (sums.episodes > 0).then(|| successes as f64 / sums.episodes as f64);
        sums
    }

    /// Describes new layouts in one sentence per task. `seen` holds the ids of known layouts and receives the new ones.
    pub(super) fn describe_new(&self, seen: &mut BTreeSet<String>) -> Vec<String> {
        let mut fresh: BTreeMap<&str, BTreeMap<String, usize>> = BTreeMap::new();
        for design in self.all.iter().filter(|design| design.state != DesignState::Refused) {
            if seen.insert(design.id.clone()) {
                *fresh.entry(&design.task).or_default().entry(describe_aim(design)).or_default() += 1;
            }
        }
        let describe = |(task, aims): (&str, BTreeMap<String, usize>)| {
            let count: usize = aims.values().sum();
            let layouts = if count == 1 { "layout" } else { "layouts" };
            format!("{task}: {count} new {layouts} for its failures: {}", list_counts(&aims))
        };
        fresh.into_iter().map(describe).collect()
    }
}

impl TaskDesignSummary {
    /// Describes the results in one sentence; `None` if nothing was designed.
    pub(super) fn describe(&self) -> Option<String> {
        if self.admitted + self.refused.len() == 0 {
            return None;
        }
        let mut words = format!("Layouts for its failures: {}", self.admitted);
        if self.admitted > 0 {
            words += &format!(" ({})", list_counts(&self.aims));
        }
        if !self.refused.is_empty() {
            let count: usize = self.refused.values().sum();
            words += &format!("; the gate refused {count} more ({})", list_counts(&defects(&self.refused)));
        }
        if let Some(success) = self.success {
            words += &format!("; success rate {success:.2} over {} episodes", self.episodes);
        }
        if !self.retired.is_empty() {
            words += &format!("; retired: {}", list_counts(&self.retired));
        }
        Some(words + ".")
    }
}

/// Renames checks of the gate to the defects that they found.
fn defects(refused: &BTreeMap<String, usize>) -> BTreeMap<String, usize> {
    let defect = |name: &String| {
        let check = GateCheck::ALL.iter().find(|check| check.as_str() == name);
        check.map_or_else(|| name.clone(), |check| check.defect().to_owned())
    };
    refused.iter().map(|(name, count)| (defect(name), *count)).collect()
}

/// Lists the three largest counts and the sum of the others.
fn list_counts(counts: &BTreeMap<String, usize>) -> String {
    const MAX_LISTED: usize = 3;
    let mut counts: Vec<_> = counts.iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
    let mut listed: Vec<String> =
        counts.iter().take(MAX_LISTED).map(|(name, count)| format!("{count} {name}")).collect();
    let rest: usize = counts.iter().skip(MAX_LISTED).map(|(_, count)| **count).sum();
    if rest > 0 {
        listed.push(format!("{rest} more"));
    }
    if listed.is_empty() { "none".to_owned() } else { listed.join(", ") }
}

/// Describes the aim, as "collision from +Y" or "collision from behind".
fn describe_aim(design: &DesignSummary) -> String {
    const ORBIT: [&str; 4] = ["outside", "ahead", "inside", "behind"];
    const SKY: [&str; 4] = ["+X", "+Y", "-X", "-Y"];
    let Some(aim) = &design.aim else { return "unknown".to_owned() };
    let mode = aim.mode.replace('_', " ");
    let inertial = aim.frame.as_deref() == Some("inertial");
    let axes = if inertial { SKY } else { ORBIT };
    let Some(sector) = aim.bearing_deg.map(|bearing| profile_sector(bearing as f64)) else { return mode };
    let axis = |number: u32| axes[(number / 3 % 4) as usize];
    // Every third sector is centred on an axis. The two sectors between them lie between two axes.
    let from = match sector % 3 {
        0 => axis(sector).to_owned(),
        _ if inertial => format!("{}/{}", axis(sector), axis(sector + 3)),
        _ => format!("{} and {}", axis(sector), axis(sector + 3)),
    };
    format!("{mode} from {from}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn design(
        id: &str,
        state: DesignState,
        reason: Option<&str>,
        bearing_deg: Option<i64>,
        frame: &str,
    ) -> DesignSummary {
        let aim = serde_json::json!({"mode": "collision", "bearing_deg": bearing_deg, "frame": frame});
        let results = serde_json::json!({
            "groups": 2, "outcomes": 2, "episodes": 24, "successes": 6, "success": 0.25, "score": 0.5, "regret": 0.5,
            "as_aimed": null, "recent": [0.25, 0.25],
        });
        serde_json::from_value(serde_json::json!({
            "id": id, "run": "r", "task": "kessler/survival", "level": 1, "name": "n", "request": "request-1",
            "designer": "procedural", "round": 1, "aim": aim, "kind": "threat", "state": state, "state_reason": reason,
            "explanation": null, "novelty": null, "results": results, "created_at": "2026-01-01T00:00:00Z",
            "served_at": null, "retired_at": null,
        }))
        .unwrap()
    }

    #[test]
    fn bearings_are_described_by_axes() {
        let words = |bearing, frame| describe_aim(&design("", DesignState::Active, None, bearing, frame));
        assert_eq!(words(Some(85), "inertial"), "collision from +Y");
        assert_eq!(words(Some(330), "inertial"), "collision from -Y/+X");
        assert_eq!(words(Some(270), "radial_in_track"), "collision from behind");
        assert_eq!(words(Some(350), "radial_in_track"), "collision from outside");
        assert_eq!(words(Some(130), "radial_in_track"), "collision from ahead and inside");
        assert_eq!(words(None, "radial_in_track"), "collision");
    }

    #[test]
    fn new_layouts_are_reported_once_and_counts_add_up() {
        let all = vec![
            design("4", DesignState::Active, None, Some(91), "inertial"),
            design("3", DesignState::Refused, Some("solvable"), None, "inertial"),
            design("2", DesignState::Retired, Some("mastered"), Some(88), "inertial"),
            design("1", DesignState::Active, None, Some(180), "inertial"),
        ];
        let designs = Designs { share: Some(0.2), all };
        let mut seen = BTreeSet::new();
        let expected =
            "kessler/survival: 3 new layouts for its failures: 2 collision from +Y, 1 collision from -X";
        assert_eq!(designs.describe_new(&mut seen), [expected]);
        assert!(designs.describe_new(&mut seen).is_empty());
        let sums = designs.summarize_task("kessler/survival");
        assert_eq!((sums.admitted, sums.episodes, sums.success), (3, 72, Some(0.25)));
        assert_eq!(
            sums.describe().unwrap(),
            "Layouts for its failures: 3 (2 collision from +Y, 1 collision from -X); the gate refused 1 more \
             (1 unsolvable); success rate 0.25 over 72 episodes; retired: 1 mastered."
        );
        assert_eq!(designs.summarize_task("kessler/formation").describe(), None);
    }
}
