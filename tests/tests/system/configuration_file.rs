//! Options that need another option, which can be on the command line or in the configuration file.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use system_tests::sparring_binary;

/// Folder with a scenario and a configuration file.
struct Fixture(tempfile::TempDir);

impl Fixture {
    fn new(settings: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("sparring.toml"), settings).unwrap();
        let scenario = r#"{"task": "kessler/survival", "seed": 7}"#;
        std::fs::write(folder.path().join("scenario.json"), scenario).unwrap();
        Self(folder)
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn command(&self, line: &str) -> Command {
        let mut command = Command::new(sparring_binary());
        command.current_dir(self.path()).args(line.split(' ')).stdin(Stdio::null());
        for variable in
            ["SPARRING_POLICY_URL", "SPARRING_POLICY_MODEL", "SPARRING_LLM_URL", "SPARRING_LLM_MODEL"]
        {
            command.env_remove(variable);
        }
        command
    }

    /// Runs a command until it ends, and returns its exit code and what it printed to stderr.
    fn run(&self, line: &str) -> (Option<i32>, String) {
        let output = self.command(line).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// Returns true if a server starts.
    fn serves(&self, options: &str) -> bool {
        let mut command = self.command(&format!("serve --temporary --port 0 {options}"));
        let mut server = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
        server.kill().unwrap();
        server.wait().unwrap();
        line.contains("http://")
    }
}

#[test]
fn option_without_the_one_that_it_needs_is_an_error() {
    let fixture = Fixture::new("");
    for (line, reason) in [
        ("serve --temporary --policy-url http://127.0.0.1:1/v1", "--policy-url needs --policy-model"),
        ("serve --temporary --policy-tokens", "--policy-tokens needs --policy-url"),
        ("serve --temporary --llm-url http://127.0.0.1:1/v1", "--llm-url needs --llm-model"),
        ("serve --temporary --llm-cost-per-day 3", "--llm-cost-per-day needs --llm-price-in"),
        (
            "serve --temporary --llm-cost-per-day 3 --llm-price-in 1",
            "--llm-cost-per-day needs --llm-price-out",
        ),
        ("mcp --run r", "--run r needs --url URL"),
        ("critique scenario.json --seed 3", "--seed 3 needs --policy NAME"),
    ] {
        let (code, stderr) = fixture.run(line);
        assert!(code == Some(2) && stderr.contains(reason), "{line}: {code:?} {stderr}");
    }
}

#[test]
fn needed_option_can_be_in_the_configuration_file() {
    let fixture = Fixture::new(
        "policy-model = 'm'\nllm-url = 'http://127.0.0.1:1/v1'\nllm-price-in = 1\nllm-price-out = 2\n\
         [mcp]\nurl = 'http://127.0.0.1:1'\n[critique]\npolicy = 'hold'\n",
    );
    let options = "--policy-url http://127.0.0.1:1/v1 --policy-tokens --llm-model m --llm-cost-per-day 3";
    assert!(fixture.serves(options));
    let (code, stderr) = fixture.run("critique scenario.json --seed 3");
    assert_eq!(code, Some(0), "{stderr}");
    std::fs::write(fixture.path().join("actions.json"), "{}").unwrap();
    let (_, stderr) = fixture.run("critique scenario.json --actions actions.json");
    assert!(stderr.contains("actions.json"), "the file has a policy: {stderr}");
    let (code, stderr) = fixture.run("mcp --run r");
    assert!(stderr.contains("no server responds at http://127.0.0.1:1"), "{code:?} {stderr}");
}

#[test]
fn option_of_the_file_needs_the_other_one_too() {
    for (settings, line, reason) in [
        ("policy-url = 'http://127.0.0.1:1/v1'", "serve --temporary", "--policy-url needs --policy-model"),
        ("llm-cost-per-day = 3", "serve --temporary", "--llm-cost-per-day needs --llm-price-in"),
        // A seed of the file is for other subcommands too.
        ("seed = 3", "critique scenario.json", "scenario.json contains no actions"),
    ] {
        let (code, stderr) = Fixture::new(settings).run(line);
        assert!(code == Some(2) && stderr.contains(reason), "{settings}: {code:?} {stderr}");
    }
}
