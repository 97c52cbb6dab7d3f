//! The designer that reads layouts from a file: `{"layouts": [{"name": "…", "scenario": {…}}, …]}`, each scenario in the
//! wire form, complete with its seed.

use std::path::PathBuf;

use env_core::{Scenario, ScenarioError};
use serde::Deserialize;
use serde_json::Value;

use crate::{Brief, DesignError, Designer, Designing, Draft};

/// Largest file read, bytes.
const MAX_FILE: u64 = 64 * 1024 * 1024;

/// Reads layouts from a file, in its order, from where the brief before ended.
#[derive(Debug)]
pub struct Replay {
    path: PathBuf,
    read: Option<Vec<Draft>>,
    next: usize,
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

    fn drafts(&mut self, brief: &Brief) -> Result<Vec<Draft>, DesignError> {
        let all = match &self.read {
            Some(all) => all,
            None => self.read.insert(read(&self.path)?),
        };
        let mut drafts = Vec::new();
        while drafts.len() < brief.count && self.next < all.len() {
            let draft = &all[self.next];
            self.next += 1;
            if brief.task.as_deref().is_none_or(|task| task == draft.scenario.task().id()) {
                drafts.push(draft.clone());
            }
        }
        Ok(drafts)
    }
}

impl Designer for Replay {
    fn name(&self) -> &'static str {
        "replay"
    }

    fn design<'a>(&'a mut self, brief: &'a Brief) -> Designing<'a> {
        let drafts = self.drafts(brief);
        Box::pin(std::future::ready(drafts))
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
            Err(source) => Err(DesignError::Layout { number: at + 1, name: entry.name, source }),
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
    use std::task::{Context, Poll, Waker};

    use serde_json::json;

    use super::*;
    use crate::gate;

    fn ask(designer: &mut Replay, count: usize) -> Result<Vec<Draft>, DesignError> {
        let brief = Brief { task: None, count };
        let mut designing = designer.design(&brief);
        match designing.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(drafts) => drafts,
            Poll::Pending => unreachable!("a file is read at once"),
        }
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
            plant(&bare, threat).ok().filter(|s| gate::threat(s).is_ok())
        });
        json!({"layouts": [
            {"name": "head-on", "scenario": hit.expect("one of 32 directions is contested").to_json()},
            {"name": "empty", "scenario": bare.to_json()},
        ]})
    }

    #[test]
    fn layouts_come_in_order_and_are_gated() {
        let file = file(&layouts().to_string());
        let mut designer = Replay::new(file.path().to_owned());
        let first = ask(&mut designer, 1).unwrap();
        assert_eq!(first[0].name, "head-on");
        let bracket = gate::threat(&first[0].scenario).unwrap();
        let flown = env_core::rollout::replay(&first[0].scenario, &bracket.witness).unwrap();
        assert_eq!(flown, bracket.reference);
        let rest = ask(&mut designer, 9).unwrap();
        assert_eq!(rest.len(), 1);
        assert_eq!(
            gate::threat(&rest[0].scenario).unwrap_err(),
            gate::Refusal::Uncontested { blind: 16, most: 8, panel: 16, gap: 0.0 }
        );
        assert!(ask(&mut designer, 9).unwrap().is_empty());
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
            let error = ask(&mut Replay::new(file.path().to_owned()), 1).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        assert!(ask(&mut Replay::new("/no/such/file".into()), 1).is_err());
    }
}
