//! `sparring config show`: prints settings with their sources.

use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Arg, ArgAction, Command};
use serde::Serialize;
use toml::{Table, Value};

use super::apply::{find_value, scalar};
use super::{ConfigFile, definition, environment};
use commands::names::suggest;
use commands::output::{self, Column, JsonFlag, Report, TextTable};

/// Show the settings of a subcommand, or those of all subcommands that are not at their defaults.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Subcommand whose settings to show, such as `serve` or `token create` [default: all, without defaults]
    #[arg(value_name = "SUBCOMMAND")]
    subcommand: Vec<String>,
    #[command(flatten)]
    output: JsonFlag,
}

/// Source of a setting's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Source {
    Environment,
    File,
    Default,
}

/// Setting of a subcommand.
#[derive(Debug, Serialize)]
struct Setting {
    subcommand: String,
    flag: String,
    /// Value as text; `None` if the flag has none.
    value: Option<String>,
    source: Source,
    variable: Option<String>,
}

#[derive(Debug, Serialize)]
struct Settings {
    file: Option<String>,
    settings: Vec<Setting>,
}

pub(super) fn run(args: &Args, file: &ConfigFile) -> anyhow::Result<ExitCode> {
    let mut settings = Vec::new();
    let definition = definition();
    let (command, tables) = find(&definition, &args.subcommand, &file.settings)?;
    let path = args.subcommand.join(" ");
    collect(command, &path, &tables, args.subcommand.is_empty(), &mut settings)?;
    if args.subcommand.is_empty() {
        settings.retain(|setting| setting.source != Source::Default);
    }
    let shown = Settings { file: file.path().map(|path| path.display().to_string()), settings };
    if args.output.json {
        output::print_json(&shown)?;
    } else {
        output::print_report(&report(&shown))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Finds a subcommand and the tables of the file that apply to it.
fn find<'a>(
    root: &'a Command,
    path: &[String],
    file: &'a Table,
) -> anyhow::Result<(&'a Command, Vec<&'a Table>)> {
    let (mut command, mut tables) = (root, vec![file]);
    // A table of the file joins the names by a dot.
    for name in path.iter().flat_map(|name| name.split('.')) {
        let known = command.get_subcommands().map(Command::get_name);
        command = match command.find_subcommand(name) {
            Some(sub) => sub,
            None => bail!("there is no subcommand {name}{}", suggest(name, known)),
        };
        tables.extend(tables.last().and_then(|table| table.get(name)).and_then(Value::as_table));
    }
    Ok((command, tables))
}

fn collect(
    command: &Command,
    path: &str,
    tables: &[&Table],
    with_subcommands: bool,
    settings: &mut Vec<Setting>,
) -> anyhow::Result<()> {
    for arg in command.get_arguments() {
        let Some(flag) = arg.get_long().filter(|flag| !matches!(*flag, "help" | "version")) else { continue };
        let (value, source) = value_of(arg, tables).with_context(|| format!("--{flag}"))?;
        settings.push(Setting {
            subcommand: path.to_owned(),
            flag: flag.to_owned(),
            value,
            source,
            variable: environment::variable(arg),
        });
    }
    if with_subcommands {
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            let own = tables.last().and_then(|table| table.get(sub.get_name())).and_then(Value::as_table);
            let inherited: Vec<&Table> = tables.iter().copied().chain(own).collect();
            let path = format!("{path} {}", sub.get_name());
            collect(sub, path.trim_start(), &inherited, true, settings)?;
        }
    }
    Ok(())
}

fn value_of(arg: &Arg, tables: &[&Table]) -> anyhow::Result<(Option<String>, Source)> {
    let variable = environment::variable(arg).and_then(std::env::var_os).filter(|value| !value.is_empty());
    if let Some(value) = variable {
        return Ok((Some(value.to_string_lossy().into_owned()), Source::Environment));
    }
    let key = arg.get_long().unwrap_or_default();
    match find_value(arg, tables) {
        Some(Value::Array(values)) => {
            let values = values.iter().map(|value| scalar(key, value)).collect::<anyhow::Result<Vec<_>>>()?;
            Ok((Some(values.join(", ")), Source::File))
        }
        Some(value) => Ok((Some(scalar(key, value)?), Source::File)),
        None => {
            let defaults = arg.get_default_values().iter().map(|value| value.to_string_lossy().into_owned());
            let value = defaults.collect::<Vec<_>>().join(", ");
            let is_switch = matches!(arg.get_action(), ArgAction::SetTrue);
            let value = if is_switch && value.is_empty() { "false".to_owned() } else { value };
            Ok(((!value.is_empty()).then_some(value), Source::Default))
        }
    }
}

fn report(shown: &Settings) -> Report {
    let mut report = Report::default();
    report.paragraph(match &shown.file {
        Some(file) => format!("Configuration file: {file}"),
        None => "There is no configuration file.".to_owned(),
    });
    if shown.settings.is_empty() {
        report.line("All settings are at their defaults.");
        return report;
    }
    let mut table = TextTable::new([
        Column::text("subcommand").optional(1),
        Column::text("flag"),
        Column::prose("value"),
        Column::text("source"),
        Column::text("variable").optional(2),
    ]);
    for setting in &shown.settings {
        table.add_row([
            if setting.subcommand.is_empty() { "(all)" } else { &setting.subcommand },
            &format!("--{}", setting.flag),
            setting.value.as_deref().unwrap_or("–"),
            match setting.source {
                Source::Environment => "environment",
                Source::File => "file",
                Source::Default => "default",
            },
            setting.variable.as_deref().unwrap_or("–"),
        ]);
    }
    report.table(table);
    report
}
