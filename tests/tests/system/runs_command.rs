//! `sparring runs`, `status` and `tail`: against a server, against the server of a database, and against the database alone.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{ServerProcess, sparring_binary};

fn sparring(args: &[&str]) -> Command {
    let mut command = Command::new(sparring_binary());
    for variable in ["SPARRING_URL", "SPARRING_DB", "SPARRING_TOKEN", "SPARRING_LOG"] {
        command.env_remove(variable);
    }
    command.args(args);
    command
}

fn output_text(out: &Output) -> String {
    String::from_utf8([out.stdout.clone(), out.stderr.clone()].concat()).unwrap()
}

/// Runs a command that must succeed, and returns its stdout.
fn stdout(db: &Path, args: &[&str]) -> String {
    let out = sparring(args).arg("--db").arg(db).output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{args:?}: {}", output_text(&out));
    String::from_utf8(out.stdout).unwrap()
}

/// Runs a command that must fail, and returns the sentence on stderr.
fn error(command: &mut Command) -> String {
    let out = command.output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", output_text(&out));
    String::from_utf8(out.stderr).unwrap()
}

fn json_output(db: &Path, args: &[&str]) -> Value {
    serde_json::from_str(&stdout(db, args)).unwrap()
}

/// Creates, lists, changes and shows runs. The commands find out themselves whether a server uses the database.
fn use_runs(db: &Path, is_served: bool) {
    let created = stdout(
        db,
        &["runs", "create", "--id", "first", "--name", "baseline", "--task", "survival", "--set", "seed=3"],
    );
    assert_eq!(created.trim(), "first");
    let _ = stdout(
        db,
        &[
            "runs",
            "create",
            "--id",
            "second",
            "--strategy",
            "plr",
            "--set",
            "design.designer=off",
            "--set",
            "seed=3",
        ],
    );
    let listed = stdout(db, &["runs", "list"]);
    let lines: Vec<Vec<&str>> = listed.lines().map(|line| line.split('\t').collect()).collect();
    let column = |name: &str| lines[0].iter().position(|title| *title == name).unwrap();
    assert_eq!((lines.len(), lines[1][column("run")], lines[2][column("run")]), (3, "second", "first"));
    assert_eq!(lines[2][column("tasks")], "kessler/survival");
    assert_eq!(stdout(db, &["runs", "pause", "fir"]).trim(), "first is paused", "the beginning of one id");
    assert_eq!(stdout(db, &["runs", "resume", "baseline"]).trim(), "first is active");
    let shown = json_output(db, &["runs", "show", "fir", "--json"]);
    assert_eq!((&shown["id"], &shown["seed"]), (&json!("first"), &json!(3)));
    assert_eq!(shown["mastery"]["tasks"][0]["task"], "kessler/survival");
    let is_marked =
        |run: &str| stdout(db, &["runs", "show", run]).contains("Another run has or had the same seed");
    assert_eq!([is_marked("first"), is_marked("second")], [true, true]);
    let status = json_output(db, &["status", "--json"]);
    assert_eq!((&status["run_count"], status["url"].is_string()), (&json!(2), is_served));
    assert!(stdout(db, &["status", "first"]).contains("kessler/survival"));
    let events = stdout(db, &["tail", "first", "--json", "--no-follow", "--kind", "run"]);
    let states: Vec<Value> = events
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["data"]["state"].clone())
        .collect();
    assert_eq!(states, ["created", "paused", "resumed"]);
    assert_eq!(stdout(db, &["runs", "archive", "second"]).trim(), "second is archived");
    assert_eq!(json_output(db, &["runs", "list", "--archived", "--json"])[0]["id"], "second");
    tag_runs(db);
    search_runs(db);
    delete_run(db, is_served);
    // One run is left, so it needs no name.
    assert!(stdout(db, &["runs", "show"]).contains("Run first (baseline)"));
    let wrong = error(sparring(&["runs", "show", "frist", "--db"]).arg(db));
    assert!(wrong.contains("did you mean first?"), "{wrong}");
    let refused = error(sparring(&["runs", "create", "--set", "group_size=0", "--db"]).arg(db));
    assert!(refused.contains("group_size"), "{refused}");
}

/// Adds, removes and lists tags.
fn tag_runs(db: &Path) {
    assert_eq!(
        stdout(db, &["runs", "tag", "baseline", "paper", "lr:3e-4"]).trim(),
        "tags of first: lr:3e-4, paper"
    );
    let tagged = json_output(db, &["runs", "tag", "first", "seed:1", "--remove", "paper", "--json"]);
    assert_eq!((&tagged["id"], &tagged["tags"]), (&json!("first"), &json!(["lr:3e-4", "seed:1"])));
    let listed = stdout(db, &["runs", "list", "--tag", "seed:1"]);
    assert!(listed.lines().count() == 2 && listed.contains("lr:3e-4, seed:1"), "{listed}");
    assert_eq!(json_output(db, &["runs", "list", "--tag", "paper", "--json"]), json!([]));
    assert!(stdout(db, &["runs", "show", "first"]).contains("Tags: lr:3e-4, seed:1."));
    let third =
        ["runs", "create", "--id", "third", "--tag", "draft,other", "--set", "design.designer=off", "--json"];
    assert_eq!(json_output(db, &third)["tags"], json!(["draft", "other"]));
    let missing = error(sparring(&["runs", "tag", "first", "--remove", "paper", "--db"]).arg(db));
    assert!(missing.contains("run first has no tag paper; its tags are: lr:3e-4, seed:1"), "{missing}");
    let twice = error(sparring(&["runs", "tag", "first", "x", "--remove", "x", "--db"]).arg(db));
    assert!(twice.contains("x is both a tag to add and a tag to remove"), "{twice}");
    let invalid = error(sparring(&["runs", "tag", "first", "Paper", "--db"]).arg(db));
    assert!(invalid.contains("tags.") && invalid.contains("begin with a letter or a digit"), "{invalid}");
    let none = error(sparring(&["runs", "tag", "first", "--db"]).arg(db));
    assert!(none.contains("<TAG>"), "{none}");
}

/// Sets a note, and lists runs by search, activity and order: `first` is active, `third` is newer.
fn search_runs(db: &Path) {
    let noted = stdout(db, &["runs", "note", "baseline", "new encoder"]);
    assert_eq!(noted.trim(), "note of first: new encoder");
    let listed = |flags: &[&str]| -> Vec<String> {
        let runs = json_output(db, &[&["runs", "list", "--json"], flags].concat());
        runs.as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(listed(&[]), ["third", "first"]);
    assert_eq!(listed(&["--order", "asc"]), ["first", "third"]);
    assert_eq!(listed(&["--sort", "name", "--order", "asc"]), ["first", "third"], "baseline, third");
    assert_eq!(listed(&["--search", "encoder LR:3e"]), ["first"]);
    assert_eq!(listed(&["--activity", "waiting", "--strategy", "uniform"]), [""; 0]);
    assert_eq!(listed(&["--activity", "archived"]), ["second"]);
    assert_eq!(stdout(db, &["runs", "note", "first", ""]).trim(), "note of first: none");
    assert!(error(sparring(&["runs", "list", "--sort", "size", "--db"]).arg(db)).contains("last_results"));
}

/// Deletes the archived run `second` and the active run `third`.
fn delete_run(db: &Path, is_served: bool) {
    let active = error(sparring(&["runs", "delete", "third", "--yes", "--db"]).arg(db));
    assert!(active.contains("run third is not archived: add --archive"), "{active}");
    let no_terminal = error(sparring(&["runs", "delete", "second", "--db"]).arg(db).stdin(Stdio::null()));
    assert!(no_terminal.contains("add --yes"), "{no_terminal}");
    assert_eq!(stdout(db, &["runs", "delete", "second", "--yes"]).trim(), "second is deleted");
    let deleted = json_output(db, &["runs", "delete", "third", "--archive", "--yes", "--json"]);
    assert_eq!((&deleted["id"], deleted["archived_at"].is_string()), (&json!("third"), true));
    assert_eq!(json_output(db, &["runs", "list", "--archived", "--json"]), json!([]));
    let gone = error(sparring(&["runs", "show", "second", "--db"]).arg(db));
    assert!(gone.contains("there is no run"), "{gone}");
    if !is_served {
        // Without a server the command has deleted the rows itself.
        assert_eq!(stored_runs(db), ["first"]);
    }
}

/// Returns the ids of all rows of `runs`.
fn stored_runs(db: &Path) -> Vec<String> {
    let options = SqliteConnectOptions::new().filename(db).read_only(true);
    tokio::runtime::Runtime::new().unwrap().block_on(async {
        let mut conn = options.connect().await.unwrap();
        sqlx::query_scalar("SELECT id FROM runs ORDER BY id").fetch_all(&mut conn).await.unwrap()
    })
}

/// Python program that runs a command on a terminal and enters a line. It prints the output and exits with the command's code.
#[cfg(unix)]
const ON_TERMINAL: &str = "
import os, pty, sys
pid, terminal = pty.fork()
if pid == 0:
    os.execv(sys.argv[2], sys.argv[2:])
output = b''
while True:
    try:
        chunk = os.read(terminal, 4096)
    except OSError:
        break
    if not chunk:
        break
    output += chunk
    if output.rstrip().endswith(b'to delete it:'):
        os.write(terminal, sys.argv[1].encode() + b'\\n')
print(output.decode())
sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
";

#[cfg(unix)]
#[test]
fn deletion_on_a_terminal_asks_for_the_name() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    assert_eq!(ServerProcess::start(&db).terminate(), Some(0));
    let _ = stdout(
        &db,
        &["runs", "create", "--id", "first", "--name", "my baseline", "--set", "design.designer=off"],
    );
    let enter = |line: &str| {
        let mut command = Command::new("python3");
        command.args(["-c", ON_TERMINAL, line]).arg(sparring_binary());
        command.args(["runs", "delete", "first", "--archive", "--db"]).arg(&db).output().unwrap()
    };
    let refused = enter("baseline");
    assert_eq!(refused.status.code(), Some(2), "{}", output_text(&refused));
    // A terminal wraps the lines of an error.
    let text = output_text(&refused).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(text.contains("This deletes run first (my baseline) with 0 episodes"), "{text}");
    assert!(text.contains("nothing was deleted"), "{text}");
    assert_eq!(stored_runs(&db), ["first"]);
    let confirmed = enter("my baseline");
    assert_eq!(confirmed.status.code(), Some(0), "{}", output_text(&confirmed));
    assert!(output_text(&confirmed).contains("first is deleted"));
    assert_eq!(stored_runs(&db), [""; 0]);
}

#[test]
fn runs_of_a_database_without_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let missing = error(sparring(&["runs", "list", "--db"]).arg(&db));
    assert!(missing.contains("there is no database") && !db.exists(), "{missing}");
    assert_eq!(ServerProcess::start(&db).terminate(), Some(0));
    use_runs(&db, false);
    // Tokens are for clients of a server. A user who can write the file needs none.
    let _ = stdout(&db, &["token", "create", "me", "--role", "viewer"]);
    assert!(stdout(&db, &["runs", "list"]).contains("baseline"));
}

#[test]
fn runs_of_the_server_of_a_database() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let server = ServerProcess::start(&db);
    use_runs(&db, true);
    let url = format!("http://{}", server.address());
    let elsewhere = sparring(&["runs", "list", "--url", &url]).output().unwrap();
    assert!(output_text(&elsewhere).contains("baseline"));
    assert_eq!(server.terminate(), Some(0));
    let gone = error(&mut sparring(&["status", "--url", &url]));
    assert!(gone.contains("no server responds at") && gone.contains("sparring serve"), "{gone}");
}

#[test]
fn server_with_tokens_needs_one() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let token = stdout(&db, &["token", "create", "me", "--role", "admin"]);
    let server = ServerProcess::start(&db);
    let denied = error(sparring(&["runs", "create", "--db"]).arg(&db));
    assert!(denied.contains("set SPARRING_TOKEN"), "{denied}");
    let wrong =
        error(sparring(&["runs", "list", "--db"]).arg(&db).env("SPARRING_TOKEN", "sparring_nonsense"));
    assert!(wrong.contains("rejects the token in SPARRING_TOKEN"), "{wrong}");
    let out = sparring(&["runs", "create", "--id", "mine", "--db"])
        .arg(&db)
        .env("SPARRING_TOKEN", token.trim())
        .output();
    assert_eq!(output_text(&out.unwrap()).trim(), "mine");
    assert_eq!(server.terminate(), Some(0));
}

/// A client of another version says so, instead of failing at a field that it does not know.
#[test]
fn server_of_another_version_is_named() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let server = std::thread::spawn(move || {
        let (mut connection, _) = listener.accept().unwrap();
        let _ = connection.read(&mut [0; 4096]).unwrap();
        let head = "HTTP/1.1 200 OK\r\nsparring-version: 99.1.0\r\ncontent-length: 2\r\n\r\n{}";
        connection.write_all(head.as_bytes()).unwrap();
    });
    let sentence = error(&mut sparring(&["runs", "list", "--url", &url]));
    server.join().unwrap();
    let expected = format!(
        "{url}: the server has version 99.1.0 and this client 0.1.0; install the same version of both"
    );
    assert!(sentence.replace("\n  ", " ").contains(&expected), "{sentence}");
}
