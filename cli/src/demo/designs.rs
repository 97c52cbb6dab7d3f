//! What was designed for the learner's own failures, as the service tells it.

use std::collections::{BTreeMap, BTreeSet};

use env_core::critique::bearing_sector;
use serde::{Deserialize, Serialize};

/// What designers thought of for the run.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Designs {
    /// The share of training groups that were designed; none before the first.
    pub(super) share: Option<f64>,
    /// Layouts and what the gate refused, the newest first.
    pub(super) all: Vec<Design>,
}

/// One design.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct Design {
    pub(super) id: String,
    pub(super) task: String,
    /// `active`, `retired` or `refused`.
    pub(super) state: String,
    pub(super) aim: Option<Aim>,
    /// Why it is retired, or which check of the gate refused it.
    pub(super) why: Option<String>,
    pub(super) flown: Flown,
}

/// What a design goes for.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct Aim {
    pub(super) mode: String,
    pub(super) bearing_deg: Option<f64>,
    pub(super) frame: Option<String>,
}

/// How the learner fared on it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct Flown {
    pub(super) episodes: u64,
    pub(super) successes: u64,
}

/// What came of designs for a task.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(super) struct TaskDesigns {
    /// Let through by the gate.
    pub(super) admitted: usize,
    /// Refused, by check.
    pub(super) refused: BTreeMap<String, usize>,
    /// Retired, by why.
    pub(super) retired: BTreeMap<String, usize>,
    /// Episodes flown on them, and the share that succeeded.
    pub(super) episodes: u64,
    pub(super) success: Option<f64>,
    /// What they went for, how often.
    pub(super) aims: BTreeMap<String, usize>,
}

impl Designs {
    /// Of one task.
    pub(super) fn of(&self, task: &str) -> TaskDesigns {
        let mut sums = TaskDesigns::default();
        let mut flown = Flown::default();
        for design in self.all.iter().filter(|design| design.task == task) {
            let why = || design.why.clone().unwrap_or_default();
            match design.state.as_str() {
                "refused" => {
                    *sums.refused.entry(why()).or_default() += 1;
                    continue;
                }
                "retired" => *sums.retired.entry(why()).or_default() += 1,
                _ => {}
            }
            sums.admitted += 1;
            *sums.aims.entry(design.words()).or_default() += 1;
            flown.episodes += design.flown.episodes;
            flown.successes += design.flown.successes;
        }
        sums.episodes = flown.episodes;
        sums.success = (flown.episodes > 0).then(|| flown.successes as f64 / flown.episodes as f64);
        sums
    }

    /// What is new since: a sentence a task. `seen` are the layouts that were told of, and will be.
    pub(super) fn news(&self, seen: &mut BTreeSet<String>) -> Vec<String> {
        let mut fresh: BTreeMap<&str, BTreeMap<String, usize>> = BTreeMap::new();
        for design in self.all.iter().filter(|design| design.state != "refused") {
            if seen.insert(design.id.clone()) {
                *fresh.entry(&design.task).or_default().entry(design.words()).or_default() += 1;
            }
        }
        let told = |(task, aims): (&str, BTreeMap<String, usize>)| {
            let count: usize = aims.values().sum();
            let layouts = if count == 1 { "a layout is" } else { "layouts are" };
            let number = if count == 1 { String::new() } else { format!("{count} ") };
            format!("{task}: {number}{layouts} designed for its failures: {}", listed(&aims))
        };
        fresh.into_iter().map(told).collect()
    }
}

impl TaskDesigns {
    /// What came of them, in a sentence; none where nothing was designed.
    pub(super) fn words(&self) -> Option<String> {
        if self.admitted + self.refused.len() == 0 {
            return None;
        }
        let mut words =
            format!("Designed for its failures: {} layouts ({})", self.admitted, listed(&self.aims));
        if !self.refused.is_empty() {
            let count: usize = self.refused.values().sum();
            words += &format!("; the gate refused {count} more ({})", listed(&self.refused));
        }
        if let Some(success) = self.success {
            words += &format!("; it flew them {} times and succeeded in {success:.2}", self.episodes);
        }
        if !self.retired.is_empty() {
            words += &format!("; retired: {}", listed(&self.retired));
        }
        Some(words + ".")
    }
}

/// Counts in words, the most first: three of them, and how many more.
fn listed(counts: &BTreeMap<String, usize>) -> String {
    const TOLD: usize = 3;
    let mut counts: Vec<_> = counts.iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
    let mut told: Vec<String> =
        counts.iter().take(TOLD).map(|(name, count)| format!("{count} {name}")).collect();
    let rest: usize = counts.iter().skip(TOLD).map(|(_, count)| **count).sum();
    if rest > 0 {
        told.push(format!("{rest} more"));
    }
    if told.is_empty() { "none".to_owned() } else { told.join(", ") }
}

impl Design {
    /// What it goes for, in words, as "collision from +Y" or "collision from behind".
    fn words(&self) -> String {
        const ORBIT: [&str; 4] = ["outside", "ahead", "inside", "behind"];
        const SKY: [&str; 4] = ["+X", "+Y", "-X", "-Y"];
        let Some(aim) = &self.aim else { return "unknown".to_owned() };
        let mode = aim.mode.replace('_', " ");
        let inertial = aim.frame.as_deref() == Some("inertial");
        let axes = if inertial { SKY } else { ORBIT };
        let Some(sector) = aim.bearing_deg.map(bearing_sector) else { return mode };
        let axis = |number: u32| axes[(number / 3 % 4) as usize];
        // Every third sector is centred on an axis; the two between lie between two.
        let from = match sector % 3 {
            0 => axis(sector).to_owned(),
            _ if inertial => format!("{}/{}", axis(sector), axis(sector + 3)),
            _ => format!("{} and {}", axis(sector), axis(sector + 3)),
        };
        format!("{mode} from {from}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn design(id: &str, state: &str, why: Option<&str>, bearing: Option<f64>, frame: &str) -> Design {
        Design {
            id: id.to_owned(),
            task: "kessler/survival".to_owned(),
            state: state.to_owned(),
            aim: Some(Aim {
                mode: "collision".to_owned(),
                bearing_deg: bearing,
                frame: Some(frame.to_owned()),
            }),
            why: why.map(str::to_owned),
            flown: Flown { episodes: 24, successes: 6 },
        }
    }

    #[test]
    fn bearings_have_words() {
        let words = |bearing, frame| design("", "active", None, bearing, frame).words();
        assert_eq!(words(Some(85.0), "inertial"), "collision from +Y");
        assert_eq!(words(Some(330.0), "inertial"), "collision from -Y/+X");
        assert_eq!(words(Some(270.0), "radial_in_track"), "collision from behind");
        assert_eq!(words(Some(350.0), "radial_in_track"), "collision from outside");
        assert_eq!(words(Some(130.0), "radial_in_track"), "collision from ahead and inside");
        assert_eq!(words(None, "radial_in_track"), "collision");
    }

    #[test]
    fn what_is_new_is_told_once_and_sums_add_up() {
        let all = vec![
            design("4", "active", None, Some(91.0), "inertial"),
            design("3", "refused", Some("solvable"), None, "inertial"),
            design("2", "retired", Some("mastered"), Some(88.0), "inertial"),
            design("1", "active", None, Some(180.0), "inertial"),
        ];
        let designs = Designs { share: Some(0.2), all };
        let mut seen = BTreeSet::new();
        let told = "kessler/survival: 3 layouts are designed for its failures: 2 collision from +Y, 1 collision from -X";
        assert_eq!(designs.news(&mut seen), [told]);
        assert!(designs.news(&mut seen).is_empty());
        let sums = designs.of("kessler/survival");
        assert_eq!((sums.admitted, sums.episodes, sums.success), (3, 72, Some(0.25)));
        assert_eq!(
            sums.words().unwrap(),
            "Designed for its failures: 3 layouts (2 collision from +Y, 1 collision from -X); the gate refused 1 more \
             (1 solvable); it flew them 72 times and succeeded in 0.25; retired: 1 mastered."
        );
        assert_eq!(designs.of("kessler/formation").words(), None);
    }
}
