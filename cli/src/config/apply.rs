//! Turns the values of a configuration file into defaults of flags.

use anyhow::{Context, bail};
use clap::{Arg, ArgAction, Command};
use toml::{Table, Value};

use super::ConfigFile;
use commands::names::suggest;

/// Returns the definition with the file's values as defaults.
///
/// # Errors
/// Returns an error if a key is neither a flag nor a subcommand, or a value has the wrong type.
pub(super) fn apply(definition: Command, file: &ConfigFile) -> anyhow::Result<Command> {
    if !file.exists() {
        return Ok(definition);
    }
    check_keys(&definition, &file.settings, true).with_context(|| file.name())?;
    apply_tables(definition, &[&file.settings]).with_context(|| file.name())
}

/// Sets the defaults of a command's flags and of its subcommands. The tables belong to the command and to those above it; the
/// last one has precedence.
fn apply_tables(mut command: Command, tables: &[&Table]) -> anyhow::Result<Command> {
    let flags: Vec<(clap::Id, Vec<String>)> = command
        .get_arguments()
        .filter_map(|arg| Some((arg, find_value(arg, tables)?)))
        .map(|(arg, value)| Ok((arg.get_id().clone(), default_values(arg, value)?)))
        .collect::<anyhow::Result<_>>()?;
    for (id, values) in flags {
        if !values.is_empty() {
            command = command.mut_arg(id, |arg| arg.required(false).default_values(values));
        }
    }
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    for name in names {
        let own = tables.last().and_then(|table| table.get(&name)).and_then(Value::as_table);
        let inherited: Vec<&Table> = tables.iter().copied().chain(own).collect();
        let sub = command.find_subcommand(&name).cloned().context("a subcommand disappeared")?;
        let applied = apply_tables(sub, &inherited)?;
        command = command.mut_subcommand(name, |_| applied);
    }
    Ok(command)
}

/// Returns the value of a flag from the innermost table that has it.
pub(super) fn find_value<'a>(arg: &Arg, tables: &[&'a Table]) -> Option<&'a Value> {
    let key = arg.get_long()?;
    if is_reserved(key) {
        return None;
    }
    tables.iter().rev().find_map(|table| {
        let value = table.get(key).or_else(|| table.get(&key.replace('-', "_")))?;
        (!value.is_table()).then_some(value)
    })
}

/// Returns true for flags that a file cannot set.
fn is_reserved(flag: &str) -> bool {
    matches!(flag, "help" | "version" | "config")
}

/// Returns the values of a flag as the command line would have them; none for a switch that is off.
///
/// # Errors
/// Returns an error if the value has the wrong type.
fn default_values(arg: &Arg, value: &Value) -> anyhow::Result<Vec<String>> {
    let key = arg.get_long().unwrap_or_default();
    let is_switch = matches!(arg.get_action(), ArgAction::SetTrue);
    match (value, is_switch) {
        (Value::Boolean(on), true) => Ok(if *on { vec!["true".to_owned()] } else { Vec::new() }),
        (_, true) => bail!("{key} must be true or false"),
        (Value::Array(values), false) => {
            let is_list = matches!(arg.get_action(), ArgAction::Append);
            if !is_list {
                bail!("{key} takes one value, not a list");
            }
            values.iter().map(|value| scalar(key, value)).collect()
        }
        (value, false) => Ok(vec![scalar(key, value)?]),
    }
}

pub(super) fn scalar(key: &str, value: &Value) -> anyhow::Result<String> {
    match value {
        Value::String(text) => Ok(text.clone()),
        Value::Integer(number) => Ok(number.to_string()),
        Value::Float(number) => Ok(number.to_string()),
        Value::Boolean(on) => Ok(on.to_string()),
        _ => bail!("{key} must be a string, a number, true or false"),
    }
}

/// Checks that every key is a flag or a subcommand. At the top level a key may be a flag of any subcommand.
fn check_keys(command: &Command, table: &Table, is_top_level: bool) -> anyhow::Result<()> {
    let mut flags: Vec<String> = Vec::new();
    collect_flags(command, is_top_level, &mut flags);
    let names: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
    for (key, value) in table {
        match (value.as_table(), command.find_subcommand(key)) {
            (Some(inner), Some(sub)) => {
                check_keys(sub, inner, false).with_context(|| format!("[{key}]"))?;
            }
            (Some(_), None) => bail!("[{key}] is no subcommand{}", suggest(key, names.iter().copied())),
            (None, _) if flags.contains(&key.replace('_', "-")) => {}
            (None, _) => bail!("{key} is no flag{}", suggest(key, flags.iter().map(String::as_str))),
        }
    }
    Ok(())
}

fn collect_flags(command: &Command, with_subcommands: bool, flags: &mut Vec<String>) {
    let own = command.get_arguments().filter_map(Arg::get_long).filter(|flag| !is_reserved(flag));
    flags.extend(own.map(str::to_owned));
    if with_subcommands {
        command.get_subcommands().for_each(|sub| collect_flags(sub, true, flags));
    }
}
