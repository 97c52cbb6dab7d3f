//! `--judge…`: arguments of the step judges of sessions.

use std::env::VarError;
use std::sync::Arc;

use anyhow::{Context, bail};
use api_types::Judge;
use clock::Clock;
use llm::{LlmClient, LlmConfig};
use llm_policy::judging::{Judges, ModelJudge, parse_judge};

use commands::llm_args::{self, LlmArgs};

/// Environment variable of the public kessler-env for the endpoint of its judge.
const UPSTREAM_URL: &str = "API_BASE_URL";
/// Environment variable of the public kessler-env for the model of its judge.
const UPSTREAM_MODEL: &str = "MODEL_NAME";

/// Arguments of the judges.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Judge")]
pub struct JudgeArgs {
    /// Judge of each session step: off, deterministic (rules) or llm. A judge changes the reward that the client receives to
    /// reward/1.2·(1 + 0.2·score), with a score from -1 to 1, and adds its comment to critical_alerts. Stored episodes keep
    /// the world's reward. A run can override this setting (`judge`). In ENABLE_JUDGE, true means llm and false off
    #[arg(long, value_name = "JUDGE", default_value = "off", env = "ENABLE_JUDGE", hide_env_values = true, value_parser = parse_judge)]
    judge: Judge,
    /// Base URL of the judge model's OpenAI-compatible API [default: --llm-url, or API_BASE_URL with --judge llm]
    #[arg(long, value_name = "URL")]
    judge_url: Option<String>,
    /// Name of the judge model [default: --llm-model, or MODEL_NAME with API_BASE_URL]
    #[arg(long, value_name = "NAME")]
    judge_model: Option<String>,
    /// Environment variable with the judge's API key [default: that of --llm-key-env with --llm-url, otherwise HF_TOKEN or
    /// API_KEY]
    #[arg(long, value_name = "VARIABLE")]
    judge_key_env: Option<String>,
    /// Timeout of a verdict in seconds; after a timeout the client receives the world's reward
    #[arg(long, value_name = "SECONDS", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=600))]
    judge_timeout: u64,
    /// Largest number of concurrent calls of the judge model
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1024))]
    judge_concurrency: u16,
}

impl JudgeArgs {
    /// Creates the judges of a service.
    ///
    /// # Errors
    /// Returns an error if `llm` judges and no model is named, or the settings of the endpoint are invalid.
    pub fn judges(&self, llm: &LlmArgs, clock: &Clock) -> anyhow::Result<Arc<Judges>> {
        let config = self.config(llm, clock, |name| std::env::var(name))?;
        if config.is_none() && self.judge == Judge::Llm {
            bail!(
                "--judge llm: no model is named; give --judge-url and --judge-model, or --llm-url and --llm-model, or {UPSTREAM_URL} and {UPSTREAM_MODEL}"
            );
        }
        let model = match config {
            Some(config) => {
                let llm = LlmClient::new(config).context("--judge-url")?;
                Some(ModelJudge::new(llm))
            }
            None => None,
        };
        Ok(Arc::new(Judges::new(self.judge, model)))
    }

    /// Returns the configuration of the judge's endpoint, or `None` if none is named. Budgets are those of `--llm-…`, counted
    /// for the judge alone.
    fn config(
        &self,
        llm: &LlmArgs,
        clock: &Clock,
        read: impl Fn(&str) -> Result<String, VarError> + Copy,
    ) -> anyhow::Result<Option<LlmConfig>> {
        let upstream = |name: &str| read(name).ok().filter(|value| !value.trim().is_empty());
        let wanted = self.judge == Judge::Llm;
        let own = match (&self.judge_url, llm.is_given()) {
            (Some(url), _) => {
                Some((url.clone(), self.judge_model.clone().or_else(|| upstream(UPSTREAM_MODEL))))
            }
            (None, false) if wanted => upstream(UPSTREAM_URL)
                .map(|url| (url, self.judge_model.clone().or_else(|| upstream(UPSTREAM_MODEL)))),
            _ => None,
        };
        let mut config = match own {
            Some((url, model)) => {
                let model = model.with_context(|| {
                    format!("the judge at {url} needs --judge-model (or {UPSTREAM_MODEL})")
                })?;
                let mut config = llm.with_limits(LlmConfig::new(url, model, llm_args::wall_clock(clock)));
                let named = self.judge_key_env.as_deref();
                config.key = llm_args::read_key(
                    named.as_ref().map_or(&llm_args::UPSTREAM_KEYS[..], std::slice::from_ref),
                    read,
                )?;
                config
            }
            None => {
                let Some(mut config) = llm.config_with(clock, read)? else { return Ok(None) };
                if let Some(model) = &self.judge_model {
                    config.model.clone_from(model);
                }
                if let Some(name) = &self.judge_key_env {
                    config.key = llm_args::read_key(&[name.as_str()], read)?;
                }
                config
            }
        };
        if let (Some(name), None) = (&self.judge_key_env, &config.key) {
            bail!("--judge-key-env {name}: the variable is not set or is empty");
        }
        llm_args::set_pace(&mut config, self.judge_timeout, self.judge_concurrency);
        Ok(Some(config))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use secrecy::ExposeSecret;

    use super::*;

    #[derive(Debug, Parser)]
    struct JudgeCommand {
        #[command(flatten)]
        llm: LlmArgs,
        #[command(flatten)]
        judge: JudgeArgs,
    }

    fn of(line: &str, held: &[(&str, &str)]) -> anyhow::Result<Option<(String, String, Option<String>)>> {
        let line = JudgeCommand::try_parse_from(format!("x {line}").split_whitespace())?;
        let found = line.judge.config(&line.llm, &Clock::manual(5).clock, |name| {
            let found = held.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned());
            found.ok_or(VarError::NotPresent)
        })?;
        Ok(found.map(|config| {
            assert_eq!((config.timeout.as_secs(), config.concurrency), (20, 8));
            (config.base_url, config.model, config.key.map(|key| key.expose_secret().to_owned()))
        }))
    }

    #[test]
    fn judge_endpoint_follows_arguments_and_environment() {
        let some = |url: &str, model: &str, key: Option<&str>| {
            Some((url.to_owned(), model.to_owned(), key.map(str::to_owned)))
        };
        let upstream = [
            ("API_BASE_URL", "http://u/v1"),
            ("MODEL_NAME", "um"),
            ("HF_TOKEN", "hf"),
            ("SPARRING_LLM_KEY", "lk"),
            ("MINE", "me"),
        ];
        assert_eq!(of("--judge off", &upstream).unwrap(), None);
        assert_eq!(of("--judge llm", &upstream).unwrap(), some("http://u/v1", "um", Some("hf")));
        assert_eq!(
            of("--judge llm --judge-key-env MINE", &upstream).unwrap(),
            some("http://u/v1", "um", Some("me"))
        );
        let llm = "--llm-url http://l/v1 --llm-model lm";
        assert_eq!(of(llm, &upstream).unwrap(), some("http://l/v1", "lm", Some("lk")));
        assert_eq!(
            of(&format!("{llm} --judge llm --judge-model jm"), &[]).unwrap(),
            some("http://l/v1", "jm", None)
        );
        let own = format!("{llm} --judge-url http://j/v1 --judge-model jm");
        assert_eq!(of(&own, &upstream[2..]).unwrap(), some("http://j/v1", "jm", Some("hf")));
        assert!(of("--judge-url http://j/v1", &[]).unwrap_err().to_string().contains("--judge-model"));
        for held in [&[][..], &[("MINE", "")], &[("MINE", "  ")]] {
            let refused = of(&format!("{llm} --judge-key-env MINE"), held).unwrap_err().to_string();
            assert!(refused.contains("MINE") && refused.contains("not set or is empty"), "{refused}");
        }
        assert!(of("--judge maybe", &[]).is_err() && of("--judge-timeout 0", &[]).is_err());
    }
}
