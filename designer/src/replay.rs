//! The designer that reads layouts from a file: `{"layouts": [{"name": "…", "scenario": {…}}, …]}`, each scenario in the
//! wire form, complete with its seed.

use std::path::PathBuf;

use env_core::{Scenario, ScenarioError};
use serde::Deserialize;
use serde_json::Value;

use crate::{Brief, DesignError, Designed, Designer, Designing, Gate, Judged, Usage};

/// Largest file read, bytes.
const MAX_FILE: u64 = 64 * 1024 * 1024;

/// Reads layouts from a file, in its order, from where the brief before ended.
#[derive(Debug)]
pub struct Replay {
    path: PathBuf,
    read: Option<Vec<Draft>>,
    next: usize,
}

/// A layout of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Draft {
    /// Its name, for people.
    pub name: String,
    /// The scenario it makes.
    pub scenario: Scenario,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    layouts: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    scenario: Value,
}

impl Replay {
    /// The layouts of this file.
    #[must_use]
    pub const fn new(path: PathBuf) -> Self {
        Self { path, read: None, next: 0 }
    }

    /// The layouts of the file that are of a task, or all.
    ///
    /// # Errors
    /// A file that cannot be read, or holds something else.
    pub fn drafts(&mut self, task: Option<&str>, count: usize) -> Result<Vec<Draft>, DesignError> {
        let all = match &self.read {
            Some(all) => all,
            None => self.read.insert(read(&self.path)?),
        };
        let mut drafts = Vec::new();
        while drafts.len() < count && self.next < all.len() {
            let draft = &all[self.next];
            self.next += 1;
            if task.is_none_or(|task| task == draft.scenario.task().id()) {
                drafts.push(draft.clone());
            }
        }
        Ok(drafts)
    }

    /// How many layouts of the file have not been given, of whatever task.
    #[must_use]
    pub fn left(&self) -> usize {
        self.read.as_ref().map_or(0, |all| all.len() - self.next.min(all.len()))
    }

    fn layouts(&mut self, brief: &Brief, gate: &mut Gate) -> Result<Designed, DesignError> {
        let drafts = self.drafts(Some(brief.base.task().id()), brief.count)?;
        let judged = drafts.into_iter().map(|Draft { name, scenario }| {
            let design = scenario.recipe().layout().and_then(|layout| layout.provenance.clone());
            Judged { name, design, round: 1, verdict: gate.judge_scenario(&scenario) }
        });
        let usage = Usage { rounds: 1, ..Usage::default() };
        Ok(Designed { judged: judged.collect(), usage, ..Designed::default() })
    }
}

impl Designer for Replay {
    fn name(&self) -> &'static str {
        "replay"
    }

    fn design<'a>(&'a mut self, brief: &'a Brief, gate: &'a mut Gate) -> Designing<'a> {
        let layouts = self.layouts(brief, gate);
        Box::pin(std::future::ready(layouts))
    }
}

fn read(path: &std::path::Path) -> Result<Vec<Draft>, DesignError> {
    let fault = |reason: String| DesignError::Source { what: path.display().to_string(), reason };
    let size = std::fs::metadata(path).map_err(|error| fault(error.to_string()))?.len();
    if size > MAX_FILE {
        return Err(fault(format!("{size} bytes; at most {MAX_FILE} are read")));
    }
    let text = std::fs::read_to_string(path).map_err(|error| fault(error.to_string()))?;
    let file: File =
        serde_json::from_str(&text).map_err(|error| fault(format!("not a file of layouts: {error}")))?;
    let draft = |(at, entry): (usize, Entry)| {
        let scenario = Scenario::from_json(&entry.scenario).and_then(user_seed);
        match scenario {
            Ok(scenario) => Ok(Draft { name: entry.name, scenario }),
            Err(fault) => Err(DesignError::Layout { number: at + 1, name: entry.name, fault }),
        }
    };
    file.layouts.into_iter().enumerate().map(draft).collect()
}

/// Designs are made by people and programs: only seeds of the user's space.
fn user_seed(scenario: Scenario) -> Result<Scenario, ScenarioError> {
    env_core::Seed::user(scenario.seed().get())?;
    Ok(scenario)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use env_core::Recipe;

    use serde_json::json;

    use super::*;
    use crate::{Refusal, language};

    fn gate() -> Gate {
        Gate::new(language(env_core::task("kessler/survival").unwrap()).unwrap(), Vec::new())
    }

    fn file(text: &str) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        file
    }

    /// A head-on body for satellite 0 at step 8, found by the world's own planting; and an empty sky.
    fn layouts() -> serde_json::Value {
        use env_core::kessler::plant::{Threat, plant};
        let bare = Scenario::from_json(&json!({
            "task": "kessler/survival", "params": {"debris": 0, "fuel": 20}, "seed": 5
        }))
        .unwrap();
        let hit = (0..32).find_map(|i| {
            let threat = Threat { satellite: 0, step: 6, direction: f64::from(i) * 0.2, speed: 4.0 };
            plant(&bare, threat).ok().filter(|s| gate().judge_scenario(s).is_ok())
        });
        json!({"layouts": [
            {"name": "head-on", "scenario": hit.expect("one of 32 directions is contested").to_json()},
            {"name": "empty", "scenario": bare.to_json()},
        ]})
    }

    #[test]
    fn layouts_come_in_order_and_are_gated() {
        let file = file(&layouts().to_string());
        let mut replay = Replay::new(file.path().to_owned());
        let recipe = Recipe::new(env_core::task("kessler/survival").unwrap()).unwrap();
        let mut gate = gate();
        let mut brief = Brief::new(std::sync::Arc::new(recipe), 1, 0);
        let first = replay.layouts(&brief, &mut gate).unwrap();
        assert_eq!(first.judged[0].name, "head-on");
        let admitted = first.judged[0].verdict.as_ref().unwrap();
        let flown = env_core::rollout::replay(admitted.scenario(), &admitted.bracket().witness).unwrap();
        assert_eq!(flown, admitted.bracket().reference);
        brief.count = 9;
        let rest = replay.layouts(&brief, &mut gate).unwrap();
        assert_eq!((rest.judged.len(), rest.admitted()), (1, 0));
        let refusal = Refusal::Uncontested { blind: 16, most: 8, panel: 16, gap: 0.0 };
        assert_eq!(rest.judged[0].verdict, Err(refusal));
        assert!(replay.layouts(&brief, &mut gate).unwrap().judged.is_empty());
    }

    #[test]
    fn what_is_no_layout_is_a_clear_error() {
        for (text, part) in [
            ("not json", "not a file of layouts"),
            (
                r#"{"layouts": [{"name": "x", "scenario": {"task": "kessler/golf", "seed": 1}}]}"#,
                "kessler/golf",
            ),
            (
                r#"{"layouts": [{"name": "x", "scenario": {"task": "kessler/survival", "seed": 4503599627370497}}]}"#,
                "seed",
            ),
        ] {
            let file = file(text);
            let error = Replay::new(file.path().to_owned()).drafts(None, 1).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        assert!(Replay::new("/no/such/file".into()).drafts(None, 1).is_err());
    }
}
