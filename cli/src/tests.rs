//! Tests of the help texts and of the accepted arguments.

use clap::{CommandFactory, Parser};

use super::Cli;

/// Renders the help of a subcommand at 100 columns.
fn help(path: &[&str]) -> String {
    help_at(100, path)
}

fn help_at(columns: usize, path: &[&str]) -> String {
    let mut command = super::config::definition().term_width(columns);
    command.build();
    let mut at = &mut command;
    for name in path {
        at = at.find_subcommand_mut(name).unwrap();
    }
    at.render_long_help().to_string()
}

#[test]
fn command_line_definition_is_valid() {
    Cli::command().debug_assert();
}

#[test]
fn help_teaches() {
    for path in [
        &[][..],
        &["serve"],
        &["demo"],
        &["design"],
        &["eval"],
        &["play"],
        &["suite"],
        &["suite", "build"],
        &["suite", "verify"],
        &["replay"],
        &["critique"],
        &["judge-agreement"],
        &["report"],
        &["db"],
        &["token"],
        &["token", "create"],
        &["config"],
        &["config", "show"],
        &["completions"],
        &["man"],
        &["bench"],
        &["simulate-curriculum"],
    ] {
        insta::assert_snapshot!(format!("help_{}", path.join("_")), help(path));
    }
}

/// A terminal of 80 columns shows examples as they are typed, and breaks no word of the help.
#[test]
fn examples_fit_80_columns() {
    fn check(command: &clap::Command, path: &mut Vec<String>) {
        let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let examples = text.split_once("Example").map(|(_, examples)| examples).unwrap_or_default();
        for line in examples.lines() {
            assert!(line.chars().count() <= 80, "{}: {line}", path.join(" "));
        }
        let names: Vec<&str> = path.iter().map(String::as_str).collect();
        for line in help_at(80, &names).lines() {
            let is_long_word = line.trim().split(' ').count() == 1;
            assert!(line.chars().count() <= 80 || is_long_word, "{}: {line}", path.join(" "));
        }
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            path.push(sub.get_name().to_owned());
            check(sub, path);
            path.pop();
        }
    }
    check(&super::config::definition(), &mut Vec::new());
}

#[test]
fn bad_arguments_are_usage_errors() {
    for line in [
        "sparring",
        "sparring fly",
        "sparring eval",
        "sparring eval --policy nobody",
        "sparring demo --task kessler/golf",
        "sparring demo --learner heuristic",
        "sparring eval --policy hold --rollouts 0",
        "sparring play --task golf",
        "sparring play --policy nobody",
        "sparring play --temperature 6",
        "sparring play --temperature NaN",
        "sparring play --episodes 0",
        "sparring play --concurrency 0",
        "sparring play --format lines",
        "sparring eval --policy hold --seed -1",
        "sparring design --run a --profile b.json",
        "sparring design --layouts a.json --level 3",
        "sparring design --layouts a.json --dry-run",
        "sparring design --param fuel",
        "sparring design --n 0",
        "sparring replay",
        "sparring replay x.json --tolerance NaN",
        "sparring critique",
        "sparring critique x.json --policy hold --actions y.json",
        "sparring bench --seconds 0",
        "sparring bench --env golf",
        "sparring suite",
        "sparring suite build --name Bad! --out x",
        "sparring suite build --name x --out x --physics risk",
        "sparring eval --policy hold --physics contact=hard",
        "sparring eval --policy hold --physics drag=on",
        "sparring demo --physics golf:contact=swept",
        "sparring bench --physics docking:contact=swept",
        "sparring bench --log a=b=c",
        "sparring bench --log-format xml",
    ] {
        let error = Cli::try_parse_from(line.split(' ')).expect_err(line);
        assert_eq!(error.exit_code(), 2, "{line}");
    }
}

#[test]
fn good_arguments_are_accepted() {
    for line in [
        "sparring eval --policy hold",
        "sparring eval --suite x.json --policy hold,blind --policy random --seed 3 --json --rollouts 4",
        "sparring play --policy heuristic",
        "sparring play --env-url https://h/x --api-base-url http://h/v1 --model m --key-env K --temperature 0.7 --history 0",
        "sparring play --task survival --task docking/single --telemetry raw --seed 3 --episodes 2 --json --out x",
        "sparring design",
        "sparring design --run a --url http://127.0.0.1:1 --task kessler/survival --n 3 --json",
        "sparring design --profile a.json --level 4 --param fuel=3 --physics contact=swept --svg x --out y.json",
        "sparring design --designer llm --dry-run",
        "sparring design --layouts a.json --out b.json --svg c",
        "sparring replay a.json b.json.gz --tolerance 1e-6 --json",
        "sparring critique x.json",
        "sparring critique x.json --policy random --seed 3 --json",
        "sparring critique x.json --actions y.json --telemetry z.jsonl",
        "sparring eval --policy hold --physics contact=swept --physics kessler/survival:risk=pc",
        "sparring demo --task docking/single --task kessler/survival --physics kessler:warnings=noisy",
        "sparring bench --physics gravity=j2",
        "sparring bench --env kessler --seconds 0.5 --json -v debug",
        "sparring --log info,sqlx=warn --log-format json suite verify",
        "sparring suite build --name x-v1 --out x.json --task survival --levels 1,2",
    ] {
        Cli::try_parse_from(line.split(' ')).expect(line);
    }
}

/// Compares the part of a page between two marks with the program's text. `SPARRING_DOCS=write` updates the page.
fn check_page(page: &str, mark: &str, wanted: &str) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/reference").join(page);
    let text = std::fs::read_to_string(&path).unwrap();
    let (start, end) = (format!("<!-- {mark} -->\n"), format!("<!-- end {mark} -->"));
    let (before, rest) = text.split_once(&start).unwrap();
    let (found, after) = rest.split_once(&end).unwrap();
    if std::env::var("SPARRING_DOCS").is_ok_and(|what| what == "write") {
        std::fs::write(&path, format!("{before}{start}{wanted}{end}{after}")).unwrap();
    } else {
        assert!(found == wanted, "{}: run the tests with SPARRING_DOCS=write", path.display());
    }
}

#[test]
fn reference_has_the_help_of_every_subcommand() {
    fn collect(command: &mut clap::Command, path: &mut Vec<String>, page: &mut String) {
        for sub in command.get_subcommands_mut().filter(|sub| sub.get_name() != "help") {
            path.push(sub.get_name().to_owned());
            let text = sub.render_help().to_string();
            let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
            page.push_str(&format!(
                "\n## sparring {}\n\n```text\n{}\n```\n",
                path.join(" "),
                lines.join("\n").trim_end()
            ));
            collect(sub, path, page);
            path.pop();
        }
    }
    // The page has the flags of all subcommands once.
    let mut command = super::config::definition().term_width(96);
    for global in ["log", "log_format", "config"] {
        command = command.mut_arg(global, |arg| arg.hide(true));
    }
    command.build();
    let mut page = String::new();
    collect(&mut command, &mut Vec::new(), &mut page);
    check_page("cli.md", "subcommands", &(page + "\n"));
}

#[test]
fn reference_has_the_settings_of_serve() {
    let definition = super::config::definition();
    let serve = definition.find_subcommand("serve").unwrap();
    let mut table = "\n| Key and flag | Variable | Default |\n| -- | -- | -- |\n".to_owned();
    for arg in serve.get_arguments().filter(|arg| !matches!(arg.get_long(), None | Some("help"))) {
        let default: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
        let is_switch = matches!(arg.get_action(), clap::ArgAction::SetTrue);
        let default = match default.join(", ") {
            text if text.is_empty() && is_switch => "`false`".to_owned(),
            text if text.is_empty() => "none".to_owned(),
            text => format!("`{text}`"),
        };
        let variable = arg.get_env().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        table.push_str(&format!("| `{}` | `{variable}` | {default} |\n", arg.get_long().unwrap_or_default()));
    }
    check_page("configuration.md", "serve", &(table + "\n"));
}
