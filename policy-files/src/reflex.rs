//! Trained reflexes: the parameters of each task's reflex, as the demo prints them.

use std::collections::BTreeMap;

use env_core::policy::{Policy, PolicyError};
use env_core::policy_factory::PolicyFactory;
use env_core::{Scenario, TaskSpec};
use serde::Deserialize;

/// Factory of trained reflexes.
///
/// The file is the output of `sparring demo --json`, or any JSON object with `tasks.<task>.numbers`: the parameters of the task's
/// reflex, each from 0 to 1.
#[derive(Debug, Clone)]
pub struct ReflexPolicy {
    name: String,
    tasks: BTreeMap<String, Vec<f64>>,
}

#[derive(Deserialize)]
struct ReflexFile {
    tasks: BTreeMap<String, TaskReflex>,
}

#[derive(Deserialize)]
struct TaskReflex {
    /// Null in the output of a demo without a learner.
    numbers: Option<Vec<f64>>,
}

impl ReflexPolicy {
    /// Parses a file.
    ///
    /// # Errors
    /// Returns a reason if the file has no parameters, parameters of an unknown task, or invalid ones.
    pub fn parse(name: String, bytes: &[u8]) -> Result<Self, String> {
        let file: ReflexFile = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        let mut tasks = BTreeMap::new();
        for (id, TaskReflex { numbers }) in file.tasks {
            let Some(numbers) = numbers else { continue };
            let task = env_core::task(&id).ok_or_else(|| format!("tasks.{id}: there is no such task"))?;
            let names = task.reflex().names;
            if numbers.len() != names.len() {
                let (wanted, found) = (names.len(), numbers.len());
                return Err(format!("tasks.{id}.numbers must have {wanted} numbers, got {found}"));
            }
            if let Some(at) = numbers.iter().position(|number| !(0.0..=1.0).contains(number)) {
                return Err(format!("tasks.{id}.numbers.{at} must be from 0 to 1, got {}", numbers[at]));
            }
            tasks.insert(id, numbers);
        }
        if tasks.is_empty() {
            return Err("tasks: none has `numbers`".to_owned());
        }
        Ok(Self { name, tasks })
    }

    fn numbers(&self, task: &'static dyn TaskSpec) -> Result<&[f64], PolicyError> {
        self.tasks.get(task.id()).map(Vec::as_slice).ok_or_else(|| PolicyError::Task {
            name: self.name.clone(),
            task: task.id(),
            reason: format!(
                "it has reflexes of {} only",
                self.tasks.keys().cloned().collect::<Vec<_>>().join(", ")
            ),
        })
    }
}

impl PolicyFactory for ReflexPolicy {
    fn name(&self) -> &str {
        &self.name
    }

    fn check(&self, task: &'static dyn TaskSpec) -> Result<(), PolicyError> {
        self.numbers(task).map(|_| ())
    }

    fn is_stochastic(&self, _: &dyn TaskSpec) -> bool {
        false
    }

    fn create(&self, scenario: &Scenario, _: u64) -> Result<Box<dyn Policy>, PolicyError> {
        let task = scenario.task();
        Ok((task.reflex().policy)(self.numbers(task)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faulty_files_are_refused_with_their_field() {
        for (file, reason) in [
            ("{", "EOF"),
            ("{}", "missing field `tasks`"),
            (r#"{"tasks": {}}"#, "none has `numbers`"),
            (r#"{"tasks": {"kessler/survival": {"numbers": null}}}"#, "none has `numbers`"),
            (
                r#"{"tasks": {"kessler/none": {"numbers": [0.5]}}}"#,
                "tasks.kessler/none: there is no such task",
            ),
            (
                r#"{"tasks": {"kessler/survival": {"numbers": [0.5]}}}"#,
                "tasks.kessler/survival.numbers must have",
            ),
        ] {
            let error = ReflexPolicy::parse("reflex:f".to_owned(), file.as_bytes()).unwrap_err();
            assert!(error.contains(reason), "{file}: {error}");
        }
    }

    #[test]
    fn reflex_acts_as_the_task_creates_it() {
        let task = env_core::task("kessler/survival").unwrap();
        let numbers: Vec<f64> = (0..task.reflex().names.len()).map(|n| 0.1 * (n % 10) as f64).collect();
        let file = serde_json::json!({"seed": 1, "tasks": {task.id(): {"numbers": numbers, "level": 3}}});
        let policy = ReflexPolicy::parse("reflex:f".to_owned(), file.to_string().as_bytes()).unwrap();
        let scenario = env_core::Recipe::at_level(task, 3)
            .map(|recipe| Scenario::new(recipe, env_core::Seed::user(5).unwrap()))
            .unwrap();
        let from_file = env_core::rollout::roll_out(&scenario, &mut *policy.create(&scenario, 0).unwrap());
        let direct = env_core::rollout::roll_out(&scenario, &mut *(task.reflex().policy)(&numbers));
        assert_eq!(from_file.unwrap(), direct.unwrap());
        let other = env_core::task("docking/single").or_else(|| env_core::tasks().last()).unwrap();
        assert!(policy.check(other).unwrap_err().to_string().contains("kessler/survival only"));
    }
}
