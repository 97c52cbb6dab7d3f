//! [`ReplayDesigner`]: reads layouts from a file `{"layouts": [{"name": "…", "scenario": {…}}, …]}`. Each scenario is in its
//! JSON form, with its seed.

use std::path::{Path, PathBuf};

use env_core::{Scenario, ScenarioError};
use serde::Deserialize;
use serde_json::Value;

use crate::brief::DesignBrief;
use crate::designer::{DesignError, DesignFuture, DesignOutcome, DesignUsage, Designer, JudgedLayout};
use crate::gate::Gate;

/// Size limit of a file, in bytes.
const MAX_FILE_BYTES: u64 = 64 * 1024 * 1024;

/// Designer that reads layouts from a file, in order. Each brief continues after the last layout of the previous one.
#[derive(Debug)]
pub struct ReplayDesigner {
    path: PathBuf,
    /// Layouts of the file; `None` before it is read.
    layouts: Option<Vec<StoredLayout>>,
    /// Index of the next layout.
    next: usize,
}

/// Layout of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredLayout {
    /// Name of the layout, for display.
    pub name: String,
    /// Scenario of the layout.
    pub scenario: Scenario,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LayoutFile {
    layouts: Vec<LayoutEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LayoutEntry {
    name: String,
    scenario: Value,
}

impl ReplayDesigner {
    /// Creates a designer for a file. The file is read with the first layout.
    #[must_use]
    pub const fn new(path: PathBuf) -> Self {
        Self { path, layouts: None, next: 0 }
    }

    /// Returns up to `count` further layouts of a task, or of any task if it is `None`.
    ///
    /// # Errors
    /// Returns [`DesignError::File`] if the file cannot be read or parsed, and [`DesignError::Layout`] if a scenario is invalid.
    pub fn next_layouts(
        &mut self,
        task: Option<&str>,
        count: usize,
    ) -> Result<Vec<StoredLayout>, DesignError> {
        let all = match &self.layouts {
            Some(all) => all,
            None => self.layouts.insert(read_layouts(&self.path)?),
        };
        let mut layouts = Vec::new();
        while layouts.len() < count && self.next < all.len() {
            let layout = &all[self.next];
            self.next += 1;
            if task.is_none_or(|task| task == layout.scenario.task().id()) {
                layouts.push(layout.clone());
            }
        }
        Ok(layouts)
    }

    /// Returns the number of layouts after the last returned one, of any task.
    #[must_use]
    pub fn remaining(&self) -> usize {
        self.layouts.as_ref().map_or(0, |all| all.len() - self.next.min(all.len()))
    }

    fn judge_layouts(&mut self, brief: &DesignBrief, gate: &mut Gate) -> Result<DesignOutcome, DesignError> {
        let layouts = self.next_layouts(Some(brief.recipe.task().id()), brief.count)?;
        let judged = (0..).zip(layouts).map(|(attempt, StoredLayout { name, scenario })| {
            let design = scenario.recipe().layout().and_then(|layout| layout.provenance.clone());
            JudgedLayout { name, design, attempt, round: 1, verdict: gate.judge_scenario(&scenario) }
        });
        let usage = DesignUsage { rounds: 1, ..DesignUsage::default() };
        Ok(DesignOutcome { judged: judged.collect(), usage, ..DesignOutcome::default() })
    }
}

impl Designer for ReplayDesigner {
    fn name(&self) -> &'static str {
        "replay"
    }

    fn design<'a>(&'a mut self, brief: &'a DesignBrief, gate: &'a mut Gate) -> DesignFuture<'a> {
        let outcome = self.judge_layouts(brief, gate);
        Box::pin(std::future::ready(outcome))
    }
}

fn read_layouts(path: &Path) -> Result<Vec<StoredLayout>, DesignError> {
    let file_error = |reason: String| DesignError::File { file: path.display().to_string(), reason };
    let size = std::fs::metadata(path).map_err(|error| file_error(error.to_string()))?.len();
    if size > MAX_FILE_BYTES {
        return Err(file_error(format!("must have at most {MAX_FILE_BYTES} bytes, got {size}")));
    }
    let text = std::fs::read_to_string(path).map_err(|error| file_error(error.to_string()))?;
    parse_layouts(path, &text)
}

/// Parses the text of a file of layouts; `path` is its name in errors.
///
/// # Errors
/// Returns [`DesignError::File`] if the text is no such file, and [`DesignError::Layout`] for the first invalid layout.
pub fn parse_layouts(path: &Path, text: &str) -> Result<Vec<StoredLayout>, DesignError> {
    let file: LayoutFile = serde_json::from_str(text).map_err(|error| DesignError::File {
        file: path.display().to_string(),
        reason: format!("not a file of layouts: {error}"),
    })?;
    let layout = |(index, entry): (usize, LayoutEntry)| match Scenario::from_json(&entry.scenario)
        .and_then(require_user_seed)
    {
        Ok(scenario) => Ok(StoredLayout { name: entry.name, scenario }),
        Err(error) => Err(DesignError::Layout { number: index + 1, name: entry.name, error }),
    };
    file.layouts.into_iter().enumerate().map(layout).collect()
}

/// Rejects seeds outside the user space, since layouts are made by users.
fn require_user_seed(scenario: Scenario) -> Result<Scenario, ScenarioError> {
    env_core::Seed::user(scenario.seed().get())?;
    Ok(scenario)
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::sync::Arc;

    use env_core::Recipe;
    use env_core::kessler::threat_placement::{Threat, place_threat};
    use serde_json::json;

    use super::*;
    use crate::{Refusal, design_language};

    fn gate() -> Gate {
        Gate::new(design_language(env_core::task("kessler/survival").unwrap()).unwrap(), Vec::new())
    }

    fn file(text: &str) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        file
    }

    /// A file with a threat that the gate admits, and a scenario without debris.
    fn layouts() -> Value {
        let empty = Scenario::from_json(&json!({
            "task": "kessler/survival", "params": {"debris": 0, "fuel": 20}, "seed": 5
        }))
        .unwrap();
        let hit = (0..32).find_map(|i| {
            let threat = Threat { satellite: 0, step: 6, direction: f64::from(i) * 0.2, speed: 4.0 };
            place_threat(&empty, threat).ok().filter(|s| gate().judge_scenario(s).is_ok())
        });
        json!({"layouts": [
            {"name": "head-on", "scenario": hit.expect("one of 32 directions is contested").to_json()},
            {"name": "empty", "scenario": empty.to_json()},
        ]})
    }

    #[test]
    fn layouts_are_judged_in_file_order() {
        let file = file(&layouts().to_string());
        let mut replay = ReplayDesigner::new(file.path().to_owned());
        let recipe = Recipe::new(env_core::task("kessler/survival").unwrap()).unwrap();
        let mut gate = gate();
        let mut brief = DesignBrief::new(Arc::new(recipe), 1, 0);
        let first = replay.judge_layouts(&brief, &mut gate).unwrap();
        assert_eq!(first.judged[0].name, "head-on");
        let admitted = first.judged[0].verdict.as_ref().unwrap();
        let bracket = admitted.bracket();
        let replayed = env_core::rollout::replay(admitted.scenario(), &bracket.reference_plan).unwrap();
        assert_eq!(replayed, bracket.reference);
        brief.count = 9;
        let rest = replay.judge_layouts(&brief, &mut gate).unwrap();
        assert_eq!((rest.judged.len(), rest.admitted()), (1, 0));
        let refusal = Refusal::Uncontested {
            blind: 16,
            most: 8,
            panel: 16,
            gap: 0.0,
            words: gate.language().refusal_words(),
        };
        assert_eq!(rest.judged[0].verdict, Err(refusal));
        assert!(replay.judge_layouts(&brief, &mut gate).unwrap().judged.is_empty());
    }

    #[test]
    fn invalid_file_is_a_clear_error() {
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
            let error = ReplayDesigner::new(file.path().to_owned()).next_layouts(None, 1).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        }
        assert!(ReplayDesigner::new("/no/such/file".into()).next_layouts(None, 1).is_err());
    }
}
