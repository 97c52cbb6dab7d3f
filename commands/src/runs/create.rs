//! `sparring runs create`: creates a run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, anyhow, ensure};
use api_types::RunSummary;
use clap::builder::PossibleValuesParser;
use curriculum::StrategyKind;
use serde_json::{Map, Value, json};

use crate::api::ApiClient;
use crate::files;
use crate::names;
use crate::output::{self, JsonFlag};

/// Create a run and print its id.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
--set and --from take all fields of POST /v1/runs, which /docs of a server describes. Flags override --from.

Examples:
  sparring runs create --name baseline --task survival,eco_station
  sparring runs create --strategy plr --set strategy_settings.replay=0.5
  sparring runs create --from run.json --seed 3")]
pub(super) struct Args {
    /// Name of the run for people
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Id of the run: 1 to 64 characters of a-z, 0-9, - and _ [default: generated]
    #[arg(long, value_name = "ID")]
    id: Option<String>,
    /// Task of the run, such as survival or docking/single; repeat the flag for several [default: all kessler tasks]
    #[arg(long = "task", value_name = "TASK", value_delimiter = ',', value_parser = names::parse_task)]
    tasks: Vec<String>,
    /// Strategy that chooses the scenarios [default: auto]
    #[arg(long, value_name = "STRATEGY", value_parser = PossibleValuesParser::new(StrategyKind::ALL.map(StrategyKind::name)))]
    strategy: Option<String>,
    /// Number of episodes of a group [default: 1]
    #[arg(long, value_name = "N")]
    group_size: Option<u32>,
    /// Seed of the run's random streams [default: drawn by the server]
    #[arg(long, value_name = "SEED", value_parser = clap::value_parser!(u64).range(..1 << 51))]
    seed: Option<u64>,
    /// Tag of the run, such as baseline or lr:3e-4; repeat the flag for several
    #[arg(long = "tag", value_name = "TAG", value_delimiter = ',')]
    tags: Vec<String>,
    /// Set another field, such as max_staleness=2 or design.designer=off; repeat the flag for several
    #[arg(long = "set", value_name = "FIELD=VALUE", value_parser = parse_field)]
    fields: Vec<(String, Value)>,
    /// JSON file with the settings of the run
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    #[command(flatten)]
    output: JsonFlag,
}

pub(crate) fn parse_field(text: &str) -> Result<(String, Value), String> {
    let (name, value) = text.split_once('=').ok_or("use FIELD=VALUE, such as max_staleness=2")?;
    let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
    Ok((name.to_owned(), value))
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let created: RunSummary = api.post("/v1/runs", &args.request()?).await?;
    if args.output.json { output::print_json(&created) } else { output::print(&created.id) }
}

impl Args {
    /// Returns the body of the request: the file, then the fields of --set, then the other flags.
    fn request(&self) -> anyhow::Result<Value> {
        let mut request = self.file()?;
        for (name, value) in &self.fields {
            set_field(&mut request, name, value.clone())?;
        }
        let flags: BTreeMap<&str, Option<Value>> = BTreeMap::from([
            ("name", self.name.as_ref().map(|name| json!(name))),
            ("id", self.id.as_ref().map(|id| json!(id))),
            ("tasks", (!self.tasks.is_empty()).then(|| json!(self.tasks))),
            ("tags", (!self.tags.is_empty()).then(|| json!(self.tags))),
            ("strategy", self.strategy.as_ref().map(|strategy| json!(strategy))),
            ("group_size", self.group_size.map(|size| json!(size))),
            ("seed", self.seed.map(|seed| json!(seed))),
        ]);
        for (name, value) in flags {
            if let Some(value) = value {
                request.insert(name.to_owned(), value);
            }
        }
        Ok(Value::Object(request))
    }

    fn file(&self) -> anyhow::Result<Map<String, Value>> {
        let Some(path) = &self.from else { return Ok(Map::new()) };
        let text = files::read(path).context("--from")?;
        serde_json::from_slice(&text).map_err(|error| {
            anyhow!("--from: {} must be a JSON object with the fields of a run: {error}", path.display())
        })
    }
}

/// Sets a field of a JSON object; dots separate the names of nested fields.
fn set_field(object: &mut Map<String, Value>, name: &str, value: Value) -> anyhow::Result<()> {
    let Some((first, rest)) = name.split_once('.') else {
        object.insert(name.to_owned(), value);
        return Ok(());
    };
    let inner = object.entry(first).or_insert_with(|| json!({}));
    let inner = inner.as_object_mut().with_context(|| format!("--set {name}: {first} is no object"))?;
    ensure!(!rest.is_empty(), "--set {name}: a field has no name");
    set_field(inner, rest, value)
}

#[cfg(test)]
mod tests {
    use clap::{Args as _, FromArgMatches};

    use super::*;

    fn request(line: &str) -> anyhow::Result<Value> {
        let command = Args::augment_args(clap::Command::new("create"));
        Args::from_arg_matches(&command.try_get_matches_from(line.split(' '))?)?.request()
    }

    #[test]
    fn flags_and_fields_form_the_request() {
        let line = "create --name a --tag x --tag lr:1,y --task survival,docking/single --strategy plr --seed 3 --set max_staleness=2 \
                    --set strategy_settings.replay=0.5 --set strategy_settings.score=max_mc --set design.designer=off";
        let expected = json!({
            "name": "a", "tags": ["x", "lr:1", "y"], "tasks": ["kessler/survival", "docking/single"], "strategy": "plr", "seed": 3,
            "max_staleness": 2, "strategy_settings": {"replay": 0.5, "score": "max_mc"}, "design": {"designer": "off"}
        });
        assert_eq!(request(line).unwrap(), expected);
        assert_eq!(request("create").unwrap(), json!({}));
        assert!(request("create --set a=1 --set a.b=2").unwrap_err().to_string().contains("a is no object"));
        assert!(request("create --set a").is_err());
        assert!(request("create --from /nonexistent").is_err());
    }
}
