//! Tests of the configuration file.

use clap::ArgMatches;

use super::super::bind_args::BindArgs;
use super::*;

fn file(text: &str) -> ConfigFile {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sparring.toml");
    std::fs::write(&path, text).unwrap();
    ConfigFile::read(path).unwrap()
}

fn matches(text: &str, line: &str) -> ArgMatches {
    let command = apply::apply(definition(), &file(text)).unwrap();
    command.try_get_matches_from(line.split(' ')).unwrap()
}

fn fault(text: &str) -> String {
    let error = format!("{:#}", apply::apply(definition(), &file(text)).unwrap_err());
    error.split_once("sparring.toml: ").unwrap().1.to_owned()
}

#[test]
fn file_sets_flags_and_command_line_overrides_it() {
    let text = "
        db = 'top.sqlite3'
        [serve]
        bind = 'localhost:9000'
        session_idle = 5
        openenv-public = true
        [token]
        db = 'tokens.sqlite3'
        [token.create]
        role = 'viewer'
        [eval]
        policy = ['hold', 'blind']
    ";
    let serve = matches(text, "sparring serve");
    let (_, serve) = serve.subcommand().unwrap();
    assert_eq!(BindArgs::from_arg_matches(serve).unwrap().address().to_string(), "127.0.0.1:9000");
    assert_eq!(serve.get_one::<std::path::PathBuf>("db").unwrap().to_str(), Some("top.sqlite3"));
    assert_eq!(serve.get_one::<u32>("session_idle"), Some(&5));
    assert!(serve.get_flag("openenv_public"));
    let serve = matches(text, "sparring serve --session-idle 7 --db other");
    let (_, serve) = serve.subcommand().unwrap();
    assert_eq!(serve.get_one::<u32>("session_idle"), Some(&7));
    assert_eq!(serve.get_one::<std::path::PathBuf>("db").unwrap().to_str(), Some("other"));
    let eval = matches(text, "sparring eval");
    let policies = eval.subcommand().unwrap().1.get_many::<String>("policies").unwrap();
    assert_eq!(policies.collect::<Vec<_>>(), ["hold", "blind"]);
    let token = matches(text, "sparring token create me");
    let (_, token) = token.subcommand().unwrap();
    assert_eq!(token.get_one::<std::path::PathBuf>("db").unwrap().to_str(), Some("tokens.sqlite3"));
}

#[test]
fn port_of_a_flag_has_precedence_over_a_port_of_the_file() {
    let address = |line: &str| {
        let matches = matches("[serve]\nport = 9005", line);
        let (_, serve) = matches.subcommand().unwrap();
        let mut bind = BindArgs::from_arg_matches(serve).unwrap();
        bind.apply_precedence(serve);
        bind.address().to_string()
    };
    assert_eq!(address("sparring serve --bind localhost:9006"), "127.0.0.1:9006");
    assert_eq!(address("sparring serve --bind localhost"), "127.0.0.1:9005", "the flag has no port");
    assert_eq!(address("sparring serve --bind localhost:9006 --port 9007"), "127.0.0.1:9007");
    assert_eq!(address("sparring serve"), "127.0.0.1:9005");
}

#[test]
fn faults_of_numbers_are_in_plain_words() {
    let fault = |line: &str| {
        let error = definition().try_get_matches_from(line.split(' ')).unwrap_err();
        in_plain_words(error, definition()).to_string().lines().next().unwrap_or_default().to_owned()
    };
    insta::assert_snapshot!(
        [
            fault("sparring serve --port abc"),
            fault("sparring runs create --seed -1"),
            fault("sparring serve --port 70000"),
            fault("sparring runs create --group-size 99999999999999999999"),
        ]
        .join("\n")
    );
}

#[test]
fn faults_of_the_file_name_the_key() {
    insta::assert_snapshot!(
        [
            "bnd = '8700'",
            "[serv]\nbind = '8700'",
            "[serve]\nsession-idel = 5",
            "[serve]\nopenenv-public = 'yes'",
            "[serve]\nbind = ['a', 'b']",
            "[serve]\nbind = 2026-01-01",
        ]
        .map(fault)
        .join("\n")
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sparring.toml");
    std::fs::write(&path, "[serve]\nbind = \n").unwrap();
    let error = format!("{:#}", ConfigFile::read(path).unwrap_err());
    assert!(error.contains("sparring.toml, line 2: "), "{error}");
}

#[test]
fn every_flag_of_serve_has_a_variable() {
    let definition = definition();
    let serve = definition.find_subcommand("serve").unwrap();
    for arg in serve.get_arguments().filter(|arg| arg.get_long().is_some_and(|flag| flag != "help")) {
        assert!(arg.get_env().is_some(), "{arg}");
    }
}
