//! `--physics`: physics options on the command line, checked against the options of the worlds.

use std::collections::BTreeMap;

use anyhow::{Context, bail, ensure};
use env_core::space::OptionSpec;
use env_core::{Recipe, ScenarioError, TaskSpec};

use super::worlds;

/// Option chosen by one `--physics [TASK|WORLD:]NAME=CHOICE`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChosenOption {
    /// Task or world of the option; `None` for all tasks.
    scope: Option<String>,
    name: String,
    choice: String,
}

pub use evaluation::report::TaskOptions;

impl std::fmt::Display for ChosenOption {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(scope) = &self.scope {
            write!(f, "{scope}:")?;
        }
        write!(f, "{}={}", self.name, self.choice)
    }
}

/// Parses an option and checks it against the options of the tasks in its scope.
///
/// # Errors
/// Returns a message if the form, the scope, the name or the choice is unknown.
pub fn parse(text: &str) -> Result<ChosenOption, String> {
    let wanted =
        "an option must be NAME=CHOICE, such as contact=swept, or TASK:NAME=CHOICE or WORLD:NAME=CHOICE";
    let (left, choice) = text.split_once('=').ok_or(wanted)?;
    let (of, name) = match left.split_once(':') {
        Some((of, name)) => (Some(of), name),
        None => (None, left),
    };
    let meant: Vec<_> = env_core::tasks().filter(|task| is_in_scope(*task, of)).collect();
    if let (true, Some(of)) = (meant.is_empty(), of) {
        return Err(format!("{of:?} is neither a task nor a world ({})", worlds::names().join(", ")));
    }
    let specs: Vec<&OptionSpec> = meant.iter().flat_map(|task| task.options()).collect();
    let named: Vec<&&OptionSpec> = specs.iter().filter(|spec| spec.name == name).collect();
    if named.is_empty() {
        let known = each_once(specs.iter().map(|spec| spec.name));
        return Err(match of {
            Some(of) if known.is_empty() => format!("{of} has no options"),
            _ => format!("there is no option {name:?}; known are {known}"),
        });
    }
    if !named.iter().any(|spec| spec.choices.contains(&choice)) {
        let choices = each_once(named.iter().flat_map(|spec| spec.choices.iter().copied()));
        return Err(format!("{name} is {choice:?}; choose one of {choices}"));
    }
    Ok(ChosenOption { scope: of.map(str::to_owned), name: name.to_owned(), choice: choice.to_owned() })
}

fn is_in_scope(task: &dyn TaskSpec, scope: Option<&str>) -> bool {
    scope.is_none_or(|scope| {
        task.id() == scope || env_core::world(scope).is_some_and(|world| world.id() == task.world())
    })
}

fn each_once<'a>(words: impl Iterator<Item = &'a str>) -> String {
    let mut once = Vec::new();
    for word in words {
        if !once.contains(&word) {
            once.push(word);
        }
    }
    once.join(", ")
}

/// Groups the chosen options by task. Tasks without a chosen option are left out.
///
/// # Errors
/// Returns an error if an option's scope holds none of these tasks, a task in scope lacks the option, or it is chosen twice.
pub fn by_task(chosen: &[ChosenOption], tasks: &[&'static dyn TaskSpec]) -> anyhow::Result<TaskOptions> {
    let mut all = TaskOptions::new();
    for option in chosen {
        let mut meant = tasks.iter().filter(|task| is_in_scope(**task, option.scope.as_deref())).peekable();
        ensure!(
            meant.peek().is_some(),
            "option {option}: none of the tasks is {}",
            option.scope.as_deref().unwrap_or("")
        );
        for task in meant {
            if !task.options().iter().any(|spec| spec.name == option.name) {
                let name = &option.name;
                let known = env_core::tasks()
                    .filter(|task| task.options().iter().any(|spec| spec.name == *name))
                    .map(TaskSpec::id)
                    .collect::<Vec<_>>()
                    .join(", ");
                bail!(
                    "option {option}: {} has no such option; restrict it to a task that has it, as TASK:{name}=…: {known}",
                    task.id()
                );
            }
            let of_task = all.entry(task.id()).or_default();
            if of_task.insert(option.name.clone(), option.choice.clone()).is_some() {
                bail!("option {} is given twice for {}", option.name, task.id());
            }
        }
    }
    Ok(all)
}

/// Returns the recipe with these options.
///
/// # Errors
/// Returns an error if options contradict each other or are reserved for hand-written scenarios.
pub fn apply(recipe: Recipe, options: Option<&BTreeMap<String, String>>) -> anyhow::Result<Recipe> {
    let task = recipe.task().id();
    let chosen = options.into_iter().flatten().map(|(name, choice)| (name.as_str(), choice.as_str()));
    let under = |recipe: Recipe| -> Result<Recipe, ScenarioError> {
        let recipe = recipe.with_options(chosen)?;
        recipe.check_for_series()?;
        Ok(recipe)
    };
    under(recipe).with_context(|| format!("options of {task}"))
}

/// Formats options as "kessler/survival: contact swept, risk pc; …". Tasks with the same options share one entry.
pub fn describe(options: &TaskOptions) -> String {
    let mut groups: Vec<(Vec<&str>, &BTreeMap<String, String>)> = Vec::new();
    for (&task, of_task) in options {
        match groups.iter_mut().find(|(_, known)| *known == of_task) {
            Some((tasks, _)) => tasks.push(task),
            None => groups.push((vec![task], of_task)),
        }
    }
    let words = groups.iter().map(|(tasks, options)| {
        let options: Vec<String> = options.iter().map(|(name, choice)| format!("{name} {choice}")).collect();
        format!("{}: {}", tasks.join(", "), options.join(", "))
    });
    words.collect::<Vec<_>>().join("; ")
}

/// Returns the help text of all options, world by world.
pub fn help() -> String {
    let mut text =
        "Options of the worlds (--physics NAME=CHOICE; the first choice is the default):".to_owned();
    for world in env_core::worlds() {
        let tasks = world.tasks();
        let mut specs: Vec<&OptionSpec> = Vec::new();
        for spec in tasks.iter().flat_map(|task| task.options()) {
            if !specs.contains(&spec) {
                specs.push(spec);
            }
        }
        if specs.is_empty() {
            text.push_str(&format!("\n  {}: none", world.name()));
        }
        for spec in specs {
            let choices = spec.choices.join("|");
            text.push_str(&format!("\n  {} {}={choices}: {}", world.name(), spec.name, spec.description));
            for reserved in spec.manual_choices {
                text.push_str(&format!(
                    " ({} only for `sparring bench` and scenario files)",
                    reserved.choice
                ));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tasks(names: &[&str]) -> Vec<&'static dyn TaskSpec> {
        names.iter().map(|name| env_core::task(name).unwrap()).collect()
    }

    fn read(texts: &[&str]) -> Vec<ChosenOption> {
        texts.iter().map(|text| parse(text).unwrap()).collect()
    }

    #[test]
    fn options_are_checked_against_the_worlds() {
        for good in
            ["contact=swept", "kessler:risk=pc", "kessler@1:risk=pc", "kessler/survival:warnings=noisy"]
        {
            assert!(parse(good).is_ok(), "{good}");
        }
        let refused =
            ["contact", "=", "contact=", "contact=hard", "drag=on", "docking:contact=swept", "golf:a=b"];
        insta::assert_snapshot!(refused.map(|text| parse(text).unwrap_err()).join("\n"), @r#"
        an option must be NAME=CHOICE, such as contact=swept, or TASK:NAME=CHOICE or WORLD:NAME=CHOICE
        there is no option ""; known are start, compat, contact, gravity, risk, warnings, thrusters, retasking, targets, communication
        contact is ""; choose one of end_of_step, swept
        contact is "hard"; choose one of end_of_step, swept
        there is no option "drag"; known are start, compat, contact, gravity, risk, warnings, thrusters, retasking, targets, communication
        docking has no options
        "golf" is neither a task nor a world (kessler, docking, tasking)
        "#);
    }

    #[test]
    fn options_apply_to_the_tasks_in_scope() {
        let both = tasks(&["kessler/survival", "kessler/formation", "docking/single"]);
        let found =
            by_task(&read(&["kessler:contact=swept", "kessler/formation:gravity=j2"]), &both).unwrap();
        assert_eq!(
            describe(&found),
            "kessler/formation: contact swept, gravity j2; kessler/survival: contact swept"
        );
        let alike = by_task(&read(&["risk=pc"]), &both[..2]).unwrap();
        assert_eq!(describe(&alike), "kessler/formation, kessler/survival: risk pc");
        let refuse = |chosen: &[&str], tasks: &[&'static dyn TaskSpec]| {
            by_task(&read(chosen), tasks).unwrap_err().to_string()
        };
        insta::assert_snapshot!([
            refuse(&["contact=swept"], &both),
            refuse(&["kessler/rendezvous:contact=swept"], &both),
            refuse(&["kessler:risk=pc", "kessler/survival:risk=contact"], &both),
        ].join("\n"), @r#"
        option contact=swept: docking/single has no such option; restrict it to a task that has it, as TASK:contact=…: kessler/survival, kessler/eco_station, kessler/rendezvous, kessler/formation
        option kessler/rendezvous:contact=swept: none of the tasks is kessler/rendezvous
        option risk is given twice for kessler/survival
        "#);
    }

    #[test]
    fn contradictory_and_reserved_options_are_refused() {
        let of = |texts: &[&str]| {
            let task = tasks(&["kessler/survival"]);
            let options = by_task(&read(texts), &task).unwrap();
            apply(Recipe::new(task[0]).unwrap(), options.get("kessler/survival"))
        };
        assert_eq!(of(&["contact=swept"]).unwrap().option("contact"), Some("swept"));
        let refuse = |texts: &[&str]| format!("{:#}", of(texts).unwrap_err());
        insta::assert_snapshot!(
            [refuse(&["contact=swept", "risk=pc"]), refuse(&["compat=upstream"])].join("\n"), @r#"
        options of kessler/survival: physics.contact cannot be combined with risk: pc: its contacts are not destructive, so contact: swept has no effect
        options of kessler/survival: physics.compat must not be upstream, which only scenarios made by hand may have: it is for replays of recorded episodes, in which a satellite may burn more in a step than the plans of its bracket
        "#);
    }
}
