//! The command and the document that shows what it draws.

use std::path::{Path, PathBuf};

use super::*;
use crate::output::OutputTarget;

const DOCUMENT: &str = include_str!("../../../docs/reference/strategies.md");

fn args(strategy: &str, learners: &[&str]) -> Args {
    Args {
        strategies: vec![strategy.to_owned()],
        trainers: vec!["honest".to_owned()],
        success: None,
        learners: learners.iter().map(|&name| name.to_owned()).collect(),
        tasks: default_tasks(),
        episodes: 40_000,
        group_size: 8,
        target: None,
        no_placement: false,
        set: Vec::new(),
        ahead: 64,
        seed: 0,
        svg: None,
        output: JsonFlag::default(),
    }
}

fn pictures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/pictures/curricula")
}

/// The pictures of the document are what is drawn. `SPARRING_PICTURES=write` draws them anew.
#[test]
fn the_documents_pictures_are_what_is_drawn() {
    let write = std::env::var("SPARRING_PICTURES").is_ok_and(|what| what == "write");
    StrategyKind::ALL.into_par_iter().for_each(|strategy| {
        let args = args(strategy.name(), &["slow", "fast", "forgetful", "hold"]);
        let drawn = picture::draw(&simulate_all(&args, &|| ()).unwrap(), args.episodes).unwrap();
        let path = pictures().join(format!("{}.svg", strategy.name()));
        assert!(
            DOCUMENT.contains(&format!("(../pictures/curricula/{}.svg)", strategy.name())),
            "{strategy} is shown"
        );
        if write {
            std::fs::create_dir_all(pictures()).unwrap();
            std::fs::write(&path, drawn).unwrap();
            return;
        }
        let kept = std::fs::read_to_string(&path).unwrap();
        assert!(kept == drawn, "{}: draw it anew with SPARRING_PICTURES=write", path.display());
    });
}

/// The rows of a table in the document, without its separator.
fn table_rows(table: &str) -> Vec<&str> {
    table.lines().filter(|line| line.starts_with('|') && !line.starts_with("| --")).collect()
}

/// The tables of settings in the document are those of the program.
#[test]
fn document_lists_the_hyperparameters_of_every_strategy() {
    let mut outdated = String::new();
    for strategy in StrategyKind::ALL {
        let Some((_, rest)) = DOCUMENT.split_once(&format!("<!-- settings {} -->\n", strategy.name())) else {
            continue;
        };
        let (table, _) = rest.split_once("<!-- end -->").unwrap();
        let mut wanted = String::new();
        if !strategy.hyperparameters().is_empty() {
            wanted.push_str("| setting | default | takes | what it does | source |\n");
        }
        for hyper in strategy.hyperparameters() {
            let default = hyper.range.default_json().to_string().trim_matches('"').to_owned();
            wanted.push_str(&format!(
                "| `{}` | {default} | {} | {} | {} |\n",
                hyper.name,
                hyper.range.expectation(),
                hyper.description,
                hyper.source
            ));
        }
        if table_rows(table) != table_rows(&wanted) {
            outdated += &format!("<!-- settings {} -->\n{wanted}", strategy.name());
        }
    }
    assert!(outdated.is_empty(), "docs/reference/strategies.md: put these rows there:\n{outdated}");
}

#[test]
fn one_is_told_in_full_and_several_in_a_line_each() {
    let one = args("ladder", &["fast"]);
    let text = |args: &Args| {
        let report = table::text_report(&simulate_all(args, &|| ()).unwrap(), args.episodes);
        report.render(OutputTarget::Terminal(120))
    };
    insta::assert_snapshot!("in_full", text(&one));
    let several =
        Args { strategies: vec![ALL.to_owned()], episodes: 8000, ..args("all", &["fast", "drops"]) };
    insta::assert_snapshot!("lines", text(&several));
}

#[test]
fn settings_are_read_and_refused() {
    assert_eq!(setting("replay=0.5").unwrap().1, serde_json::json!(0.5));
    assert_eq!(setting("score=max_mc").unwrap().1, serde_json::json!("max_mc"));
    assert!(setting("replay").is_err());
    let wrong = Args { set: vec![setting("beta=0").unwrap()], ..args("plr", &["fast"]) };
    let error = simulate_all(&wrong, &|| ()).unwrap_err().to_string();
    assert!(error.contains("strategy_settings.beta must be a number from 0.01 to 10, got 0"), "{error}");
    let wrong = Args { tasks: vec!["golf/driving".to_owned()], ..args("plr", &["fast"]) };
    assert!(simulate_all(&wrong, &|| ()).unwrap_err().to_string().contains("golf/driving"));
}
