//! `--policy-…`: arguments of the language model that runs episodes under the policy `chat`. No request can name another
//! endpoint.

use std::env::VarError;

use anyhow::{Context, bail};
use llm::{LlmClient, LlmConfig};

use super::llm_args::{self, LlmArgs};
use orchestrator::clock::Clock;
use orchestrator::rollouts::Endpoint;

/// Largest response in bytes if token details are requested: each token comes with its text and log-probability.
const MAX_TOKEN_BODY_BYTES: usize = 16 << 20;

/// Arguments of the model behind the policy `chat`.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Policy")]
pub struct PolicyArgs {
    /// The OpenAI-compatible API of the model that flies for runs with the policy chat, as http://127.0.0.1:8000/v1. Without it
    /// such a policy is refused
    #[arg(
        long,
        value_name = "URL",
        env = "SPARRING_POLICY_URL",
        hide_env_values = true,
        requires = "policy_model"
    )]
    policy_url: Option<String>,
    /// The model's name there
    #[arg(long, value_name = "NAME", env = "SPARRING_POLICY_MODEL", hide_env_values = true)]
    policy_model: Option<String>,
    /// The environment variable that holds its key; a key itself is never an argument
    #[arg(long, value_name = "VARIABLE")]
    policy_key_env: Option<String>,
    /// Its sampling temperature, where a run does not say; left out the endpoint decides
    #[arg(long, value_name = "T", value_parser = llm_args::parse_temperature)]
    policy_temperature: Option<f64>,
    /// Tokens of one answer, at most, where a run does not say
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=131_072))]
    policy_max_tokens: u32,
    /// Calls at once, at most
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1024))]
    policy_concurrency: u16,
    /// Longest time one answer may take, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=3600))]
    policy_timeout: u64,
    /// Ask for token ids and log-probabilities (return_token_ids and logprobs, as vLLM knows them) and put them into
    /// trajectories. Other endpoints may refuse to be asked
    #[arg(long, requires = "policy_url")]
    policy_tokens: bool,
}

impl PolicyArgs {
    /// Creates the client of the model, or returns `None` if none is named.
    ///
    /// # Errors
    /// Returns an error if the settings of the endpoint are invalid.
    pub fn endpoint(&self, llm: &LlmArgs, clock: &Clock) -> anyhow::Result<Option<Endpoint>> {
        let Some(config) = self.config(llm, clock, |name| std::env::var(name))? else { return Ok(None) };
        let llm = LlmClient::new(config).context("--policy-url")?;
        Ok(Some(Endpoint { llm, temperature: self.policy_temperature }))
    }

    /// Returns the configuration of the endpoint. Retries, prices and budgets are those of `--llm-…`, counted for the policy
    /// alone.
    fn config(
        &self,
        llm: &LlmArgs,
        clock: &Clock,
        read: impl Fn(&str) -> Result<String, VarError> + Copy,
    ) -> anyhow::Result<Option<LlmConfig>> {
        let Some(url) = &self.policy_url else {
            if let Some(name) = &self.policy_key_env {
                bail!("--policy-key-env {name}: there is no --policy-url it could be the key of");
            }
            return Ok(None);
        };
        let model = self.policy_model.as_deref().context("--policy-url needs --policy-model")?;
        let mut config = llm.with_limits(LlmConfig::new(url, model, llm_args::wall_clock(clock)));
        if let Some(name) = &self.policy_key_env {
            config.key = llm_args::read_key(&[name.as_str()], read)?;
            if config.key.is_none() {
                bail!("--policy-key-env {name}: the variable holds nothing");
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
        llm: LlmArgs,
        #[command(flatten)]
        policy: PolicyArgs,
    }

    fn of(line: &str) -> anyhow::Result<Option<LlmConfig>> {
        let line = PolicyCommand::try_parse_from(format!("x {line}").split_whitespace())?;
        line.policy.config(&line.llm, &Clock::manual(5).clock, |name| match name {
            "MINE" => Ok(" me ".to_owned()),
            "EMPTY" => Ok(" ".to_owned()),
            _ => Err(VarError::NotPresent),
        })
    }

    #[test]
    fn policy_endpoint_follows_the_arguments() {
        if std::env::var_os("SPARRING_POLICY_URL").is_some() || std::env::var_os("SPARRING_LLM_URL").is_some()
        {
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
            (format!("{there} --policy-key-env EMPTY"), "holds nothing"),
            ("--policy-key-env MINE".to_owned(), "no --policy-url"),
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
