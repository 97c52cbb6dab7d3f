//! Settings of several runs, side by side.

use std::collections::BTreeMap;

use serde_json::Value;

/// Setting with its value in each run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SettingRow {
    /// Path of the setting, with dots between the names.
    pub(super) path: String,
    /// Values in the order of the runs; none where a run does not have the setting.
    pub(super) values: Vec<Option<String>>,
}

impl SettingRow {
    /// True if the runs have different values.
    pub(super) fn differs(&self) -> bool {
        self.values.iter().any(|value| *value != self.values[0])
    }
}

/// Returns the leaves of settings by path. Lists of objects with a name have the name in the path.
pub(super) fn leaves(settings: &Value) -> BTreeMap<String, String> {
    let mut leaves = BTreeMap::new();
    collect(settings, "", &mut leaves);
    leaves
}

fn collect(value: &Value, path: &str, leaves: &mut BTreeMap<String, String>) {
    let inside = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        Value::Object(fields) => {
            for (key, field) in fields {
                collect(field, &inside(key), leaves);
            }
        }
        Value::Array(items) if !items.is_empty() && items.iter().all(|item| name(item).is_some()) => {
            for item in items {
                collect(item, &inside(name(item).unwrap_or_default()), leaves);
            }
        }
        Value::String(text) => drop(leaves.insert(path.to_owned(), text.clone())),
        other => drop(leaves.insert(path.to_owned(), other.to_string())),
    }
}

fn name(item: &Value) -> Option<&str> {
    ["task", "name", "id"].iter().find_map(|key| item.get(key)?.as_str())
}

/// Returns all settings of the runs, ordered by path.
pub(super) fn settings_table(runs: &[&Value]) -> Vec<SettingRow> {
    let all: Vec<_> = runs.iter().map(|settings| leaves(settings)).collect();
    let mut paths: Vec<&String> = all.iter().flat_map(BTreeMap::keys).collect();
    paths.sort();
    paths.dedup();
    let row = |path: &String| SettingRow {
        path: path.clone(),
        values: all.iter().map(|settings| settings.get(path).cloned()).collect(),
    };
    paths.into_iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn table_has_the_names_of_tasks_in_its_paths() {
        let run = |strategy: &str, weight: u32| json!({"curriculum": {"strategy": strategy, "tasks": [{"task": "a/b", "weight": weight}]}, "rows": [[1]]});
        let (one, other) = (run("ladder", 1), run("plr", 1));
        let table = settings_table(&[&one, &other]);
        let paths: Vec<&str> = table.iter().map(|row| row.path.as_str()).collect();
        assert_eq!(
            paths,
            ["curriculum.strategy", "curriculum.tasks.a/b.task", "curriculum.tasks.a/b.weight", "rows"]
        );
        let differing: Vec<&SettingRow> = table.iter().filter(|row| row.differs()).collect();
        assert_eq!(differing[0].values, [Some("ladder".to_owned()), Some("plr".to_owned())]);
        assert_eq!(differing.len(), 1);
    }
}
