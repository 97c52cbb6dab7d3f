//! `--policy-…`: arguments of the policies that a server or a worker rolls out: the language model behind the policy `chat`, and the
//! folder of policy files. No request and no job can name another endpoint or another folder.

use std::env::VarError;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clock::Clock;
use llm::{LlmClient, LlmConfig};
use policy_files::PolicyFolder;
use rollout::{Endpoint, PolicySources};

use crate::llm_args::{self, LlmLimitArgs};

/// Largest response in bytes if token details are requested: each token comes with its text and log-probability.
const MAX_TOKEN_BODY_BYTES: usize = 16 << 20;

/// Arguments of the policies that a server or a worker rolls out.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Policy")]
pub struct PolicyArgs {
    /// Base URL of the OpenAI-compatible API behind the policy `chat`, such as http://127.0.0.1:8000/v1; without it this
    /// program does not roll out that policy
    #[arg(long, value_name = "URL", env = "SPARRING_POLICY_URL", hide_env_values = true)]
    policy_url: Option<String>,
    /// Name of the model at that API
    #[arg(long, value_name = "NAME", env = "SPARRING_POLICY_MODEL", hide_env_values = true)]
    policy_model: Option<String>,
    /// Environment variable with the API key; a key itself is never an argument
    #[arg(long, value_name = "VARIABLE")]
    policy_key_env: Option<String>,
    /// Sampling temperature of runs that set none, from 0 to 5 [default: that of the API]
    #[arg(long, value_name = "T", value_parser = llm_args::parse_temperature)]
    policy_temperature: Option<f64>,
    /// Largest number of tokens of one response, for runs that set none
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=131_072))]
    policy_max_tokens: u32,
    /// Largest number of concurrent calls
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1024))]
    policy_concurrency: u16,
    /// Timeout of one response in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=3600))]
    policy_timeout: u64,
    /// Request token ids and log-probabilities (vLLM's return_token_ids and logprobs) and add them to the trajectories;
    /// other endpoints may reject such requests
    #[arg(long)]
    policy_tokens: bool,
    /// Folder with policy files (ONNX models and reflexes) that clients can evaluate and roll out by name, such as
    /// onnx:model.onnx; files can be added and replaced at any time
    #[arg(long, value_name = "FOLDER", env = "SPARRING_POLICY_FOLDER", hide_env_values = true)]
    policy_folder: Option<PathBuf>,
}

impl PolicyArgs {
    /// Returns the policies that these arguments name.
    ///
    /// # Errors
    /// Returns an error if the settings of the endpoint are invalid, or the path is not that of a folder.
    pub fn sources(&self, limits: &LlmLimitArgs, clock: &Clock) -> anyhow::Result<PolicySources> {
        Ok(PolicySources { endpoint: self.endpoint(limits, clock)?, folder: self.policy_folder()? })
    }

    /// Returns the folder of policy files.
    ///
    /// # Errors
    /// Returns an error if the path is not that of a folder.
    pub fn policy_folder(&self) -> anyhow::Result<PolicyFolder> {
        let Some(path) = &self.policy_folder else { return Ok(PolicyFolder::default()) };
        if !path.is_dir() {
            bail!("--policy-folder {}: this is not a folder", path.display());
        }
        Ok(PolicyFolder::new(path.clone()))
    }

    /// Creates the client of the model, or returns `None` if none is named.
    ///
    /// # Errors
    /// Returns an error if the settings of the endpoint are invalid.
    pub fn endpoint(&self, limits: &LlmLimitArgs, clock: &Clock) -> anyhow::Result<Option<Endpoint>> {
        let Some(config) = self.config(limits, clock, |name| std::env::var(name))? else { return Ok(None) };
        let llm = LlmClient::new(config).context("--policy-url")?;
        Ok(Some(Endpoint { llm, temperature: self.policy_temperature }))
    }

    /// Returns the configuration of the endpoint. Retries, prices and budgets are those of `--llm-…`, counted for the policy
    /// alone.
    fn config(
        &self,
        limits: &LlmLimitArgs,
        clock: &Clock,
        read: impl Fn(&str) -> Result<String, VarError> + Copy,
    ) -> anyhow::Result<Option<LlmConfig>> {
        limits.check()?;
        let Some(url) = &self.policy_url else {
            // The configuration file can have one of two options, so that the parser of the command line cannot check them.
            if let Some(name) = &self.policy_key_env {
                bail!("--policy-key-env {name} needs --policy-url");
            }
            if self.policy_tokens {
                bail!("--policy-tokens needs --policy-url");
            }
            return Ok(None);
        };
        let model = self.policy_model.as_deref().context("--policy-url needs --policy-model")?;
        let mut config = limits.apply(LlmConfig::new(url, model, llm_args::wall_clock(clock)));
        if let Some(name) = &self.policy_key_env {
            config.key = llm_args::read_key(&[name.as_str()], read)?;
            if config.key.is_none() {
                bail!("--policy-key-env {name}: the variable is not set or is empty");
            }
        }
        config.max_tokens = self.policy_max_tokens;
        llm_args::set_pace(&mut config, self.policy_timeout, self.policy_concurrency);
        config.token_details = self.policy_tokens;
        if config.token_details {
            config.max_body_bytes = MAX_TOKEN_BODY_BYTES;
        }
        Ok(Some(config))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use secrecy::ExposeSecret;

    use super::*;

    #[derive(Debug, Parser)]
    struct PolicyCommand {
        #[command(flatten)]
        limits: LlmLimitArgs,
        #[command(flatten)]
        policy: PolicyArgs,
    }

    fn of(line: &str) -> anyhow::Result<Option<LlmConfig>> {
        let line = PolicyCommand::try_parse_from(format!("x {line}").split_whitespace())?;
        line.policy.config(&line.limits, &Clock::manual(5).clock, |name| match name {
            "MINE" => Ok(" me ".to_owned()),
            "EMPTY" => Ok(" ".to_owned()),
            _ => Err(VarError::NotPresent),
        })
    }

    #[test]
    fn policy_endpoint_follows_the_arguments() {
        if std::env::var_os("SPARRING_POLICY_URL").is_some() {
            return; // these variables would change the arguments
        }
        assert!(of("").unwrap().is_none());
        let there = "--policy-url http://p/v1 --policy-model m";
        let config = of(&format!(
            "{there} --policy-key-env MINE --policy-concurrency 3 --policy-timeout 7 --policy-max-tokens 99 --policy-tokens \
             --llm-retries 1 --llm-tokens-per-run 9"
        ));
        let config = config.unwrap().unwrap();
        assert_eq!((config.base_url.as_str(), config.model.as_str()), ("http://p/v1", "m"));
        assert_eq!(config.key.as_ref().map(ExposeSecret::expose_secret), Some("me"));
        assert_eq!((config.concurrency, config.timeout.as_secs(), config.max_tokens), (3, 7, 99));
        assert_eq!((config.retries, config.tokens_per_run, config.token_details), (1, Some(9), true));
        assert!(!of(there).unwrap().unwrap().token_details, "others refuse what they do not know");
        for (line, words) in [
            (format!("{there} --policy-key-env EMPTY"), "not set or is empty"),
            ("--policy-key-env MINE".to_owned(), "needs --policy-url"),
            ("--policy-url http://p/v1".to_owned(), "--policy-model"),
            (format!("{there} --policy-temperature 6"), "from 0 to 5"),
            (format!("{there} --policy-temperature NaN"), "from 0 to 5"),
            ("--policy-tokens".to_owned(), "--policy-url"),
        ] {
            let refused = of(&line).unwrap_err().to_string();
            assert!(refused.contains(words), "{line}: {refused}");
        }
    }
}
