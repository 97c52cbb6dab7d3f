//! `--llm-…`: arguments of the language model that designs layouts, and helpers for all endpoints of the command line.
//!
//! Endpoints are named on the command line only: no request can make the service call an address.

use std::env::VarError;
use std::time::Duration;

use anyhow::{Context, bail};
use clock::Clock;
use llm::{LlmConfig, WallClock};
use secrecy::SecretString;

/// Environment variables in which the public kessler-env looks for a key, in this order.
pub const UPSTREAM_KEYS: [&str; 2] = ["HF_TOKEN", "API_KEY"];

/// Arguments of the language model that designs layouts.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Language model")]
pub struct LlmArgs {
    /// Base URL of an OpenAI-compatible API, such as http://127.0.0.1:8080/v1; without it no model is used
    #[arg(long, value_name = "URL", env = "SPARRING_LLM_URL", hide_env_values = true)]
    llm_url: Option<String>,
    /// Name of the model at that API
    #[arg(long, value_name = "NAME", env = "SPARRING_LLM_MODEL", hide_env_values = true)]
    llm_model: Option<String>,
    /// Environment variable with the API key; a key itself is never an argument
    #[arg(long, value_name = "VARIABLE", default_value = "SPARRING_LLM_KEY")]
    llm_key_env: String,
    /// Timeout of one call in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=3600))]
    llm_timeout: u64,
    /// Largest number of concurrent calls
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=256))]
    llm_concurrency: u16,
    /// Largest number of tokens of one response
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(64..=131_072))]
    llm_max_tokens: u32,
    /// Retries, budgets and prices.
    #[command(flatten)]
    pub limits: LlmLimitArgs,
}

/// Retries, budgets and prices of a language model, which all endpoints of a process share.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Language model")]
pub struct LlmLimitArgs {
    /// Number of retries after a transient failure
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=10))]
    llm_retries: u32,
    /// Token budget of one run [default: unlimited]
    #[arg(long, value_name = "N")]
    llm_tokens_per_run: Option<u64>,
    /// Token budget of all runs per day (UTC) [default: unlimited]
    #[arg(long, value_name = "N")]
    llm_tokens_per_day: Option<u64>,
    /// Cost budget per day (UTC), in the currency of the prices [default: unlimited]
    #[arg(long, value_name = "COST")]
    llm_cost_per_day: Option<f64>,
    /// Price of a million prompt tokens [default: 0]
    #[arg(long, value_name = "PRICE")]
    llm_price_in: Option<f64>,
    /// Price of a million completion tokens [default: 0]
    #[arg(long, value_name = "PRICE")]
    llm_price_out: Option<f64>,
}

impl LlmArgs {
    /// Returns the configuration of the endpoint, or `None` without `--llm-url`. The key is read from its environment variable.
    ///
    /// # Errors
    /// Returns an error if the model or a price is missing, or the variable of the key is no UTF-8.
    pub fn config(&self, clock: &Clock) -> anyhow::Result<Option<LlmConfig>> {
        self.config_with(clock, |name| std::env::var(name))
    }

    /// Like [`LlmArgs::config`], with a function that reads environment variables.
    pub fn config_with(
        &self,
        clock: &Clock,
        read: impl Fn(&str) -> Result<String, VarError>,
    ) -> anyhow::Result<Option<LlmConfig>> {
        self.limits.check()?;
        let Some(url) = &self.llm_url else { return Ok(None) };
        let model = self.llm_model.as_deref().context("--llm-url needs --llm-model")?;
        let mut config = self.with_limits(LlmConfig::new(url, model, wall_clock(clock)));
        config.key = read_key(&[self.llm_key_env.as_str()], read)?;
        set_pace(&mut config, self.llm_timeout, self.llm_concurrency);
        Ok(Some(config))
    }

    /// Returns true if an endpoint is named.
    pub const fn is_given(&self) -> bool {
        self.llm_url.is_some()
    }

    /// Sets retries, the limit of tokens, prices and budgets.
    pub fn with_limits(&self, config: LlmConfig) -> LlmConfig {
        let mut config = self.limits.apply(config);
        config.max_tokens = self.llm_max_tokens;
        config
    }
}

impl LlmLimitArgs {
    /// Checks that a cost budget has prices. The configuration file can have one of them, so that the parser of the command line
    /// cannot check it.
    ///
    /// # Errors
    /// Returns an error if a price is missing.
    pub fn check(&self) -> anyhow::Result<()> {
        let prices = [("--llm-price-in", self.llm_price_in), ("--llm-price-out", self.llm_price_out)];
        match prices.into_iter().find(|(_, price)| price.is_none()) {
            Some((option, _)) if self.llm_cost_per_day.is_some() => {
                bail!("--llm-cost-per-day needs {option} PRICE")
            }
            _ => Ok(()),
        }
    }

    /// Sets retries, prices and budgets.
    pub fn apply(&self, mut config: LlmConfig) -> LlmConfig {
        config.retries = self.llm_retries;
        config.tokens_per_run = self.llm_tokens_per_run;
        config.tokens_per_day = self.llm_tokens_per_day;
        config.cost_per_day = self.llm_cost_per_day;
        config.price_in = self.llm_price_in.unwrap_or(0.0);
        config.price_out = self.llm_price_out.unwrap_or(0.0);
        config
    }
}

/// Converts the clock to the one that budgets use.
pub fn wall_clock(clock: &Clock) -> WallClock {
    let clock = clock.clone();
    WallClock::new(move || clock.now())
}

/// Sets the timeout of one call in seconds and the number of concurrent calls.
pub fn set_pace(config: &mut LlmConfig, timeout_s: u64, concurrency: u16) {
    config.timeout = Duration::from_secs(timeout_s);
    config.connect_timeout = config.connect_timeout.min(config.timeout);
    config.concurrency = concurrency.into();
}

/// Parses a sampling temperature.
///
/// # Errors
/// Returns a message unless the text is a number between 0 and 5.
pub fn parse_temperature(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if (0.0..=5.0).contains(&number) => Ok(number),
        _ => Err("must be a number from 0 to 5".to_owned()),
    }
}

/// Returns the key in the first of these environment variables that is not blank.
///
/// # Errors
/// Returns an error if a variable is no UTF-8.
pub fn read_key(
    names: &[&str],
    read: impl Fn(&str) -> Result<String, VarError>,
) -> anyhow::Result<Option<SecretString>> {
    for name in names {
        match read(name) {
            Ok(key) if key.trim().is_empty() => {}
            Ok(key) => return Ok(Some(key.trim().to_owned().into())),
            Err(VarError::NotPresent) => {}
            // The error itself would show the value of the variable.
            Err(VarError::NotUnicode(_)) => bail!("the environment variable {name} is not valid UTF-8"),
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct LlmCommand {
        #[command(flatten)]
        llm: LlmArgs,
    }

    fn read(line: &str, key: &Result<&str, VarError>) -> anyhow::Result<Option<LlmConfig>> {
        let args = LlmCommand::try_parse_from(line.split(' '))?.llm;
        args.config_with(&Clock::manual(5).clock, |name| {
            assert_eq!(name, "MY_KEY");
            key.clone().map(str::to_owned)
        })
    }

    #[test]
    fn endpoint_comes_from_arguments_and_key_from_environment() {
        let line = "x --llm-url http://h/v1 --llm-model m --llm-key-env MY_KEY";
        let config = read(line, &Ok(" sk-1 \n")).unwrap().unwrap();
        assert_eq!((config.base_url.as_str(), config.model.as_str()), ("http://h/v1", "m"));
        assert!(config.key.is_some() && !format!("{config:?}").contains("sk-1"));
        assert_eq!((config.clock.now_ms(), config.timeout.as_secs(), config.retries), (5, 120, 3));
        llm::LlmClient::new(config).unwrap();
        for none in [Ok(""), Err(VarError::NotPresent)] {
            assert!(read(line, &none).unwrap().unwrap().key.is_none());
        }
        let odd = read(line, &Err(VarError::NotUnicode("sk-2".into()))).unwrap_err();
        assert_eq!(format!("{odd:#}"), "the environment variable MY_KEY is not valid UTF-8");
        let more = format!(
            "{line} --llm-cost-per-day 2.5 --llm-price-in 0.1 --llm-price-out 0.4 --llm-tokens-per-run 9"
        );
        let config = read(&more, &Ok("k")).unwrap().unwrap();
        assert_eq!((config.cost_per_day, config.tokens_per_run), (Some(2.5), Some(9)));
        assert!((config.cost(1_000_000, 500_000) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn missing_url_disables_the_model() {
        if std::env::var_os("SPARRING_LLM_URL").is_some() || std::env::var_os("SPARRING_LLM_MODEL").is_some()
        {
            return; // these variables would change the arguments
        }
        assert!(read("x", &Ok("k")).unwrap().is_none());
        for (line, words) in [
            ("x --llm-url http://h/v1", "--llm-url needs --llm-model"),
            ("x --llm-cost-per-day 3", "--llm-cost-per-day needs --llm-price-in"),
            ("x --llm-cost-per-day 3 --llm-price-in 1", "needs --llm-price-out"),
            ("x --llm-timeout 0", "--llm-timeout"),
            ("x --llm-concurrency 0", "--llm-concurrency"),
        ] {
            let error = read(line, &Ok("k")).unwrap_err().to_string();
            assert!(error.contains(words), "{line}: {error}");
        }
    }
}
