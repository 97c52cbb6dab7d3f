//! Endpoint of the language model, from the command line and the environment.

use std::env::VarError;

use anyhow::{Context, bail};
use llm::{LlmClient, LlmConfig};

use super::Args;
use crate::llm_args;
use clock::Clock;

/// Creates the client of the selected endpoint.
///
/// # Errors
/// Returns an error if no model is named, or its key or address is invalid.
pub(super) fn endpoint(args: &Args) -> anyhow::Result<LlmClient> {
    let config = config(args, |name| std::env::var(name))?;
    LlmClient::new(config).context("the model")
}

fn config(args: &Args, read: impl Fn(&str) -> Result<String, VarError>) -> anyhow::Result<LlmConfig> {
    let missing = "no model is named: give --api-base-url and --model (or API_BASE_URL and MODEL_NAME), or run a built-in \
                   policy with --policy";
    let (Some(url), Some(model)) = (&args.api_base_url, &args.model) else { bail!(missing) };
    let mut config = LlmConfig::new(url, model, llm_args::wall_clock(&Clock::system()));
    let named = args.key_env.as_deref();
    config.key =
        llm_args::read_key(named.as_ref().map_or(&llm_args::UPSTREAM_KEYS[..], std::slice::from_ref), read)?;
    if let (Some(name), None) = (named, &config.key) {
        bail!("--key-env {name}: the variable is not set or is empty");
    }
    llm_args::set_pace(&mut config, args.timeout, args.concurrency);
    config.retries = args.retries;
    config.max_tokens = args.max_tokens;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct PlayCommand {
        #[command(flatten)]
        args: Args,
    }

    fn of(more: &str, held: &[(&str, &str)]) -> anyhow::Result<LlmConfig> {
        let line = format!("x --api-base-url http://h/v1 --model m {more}");
        let args = PlayCommand::try_parse_from(line.split_whitespace())?.args;
        config(&args, |name| {
            let found = held.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned());
            found.ok_or(VarError::NotPresent)
        })
    }

    #[test]
    fn key_is_read_from_the_original_or_the_named_variable() {
        use secrecy::ExposeSecret;
        let key = |more: &str, held: &[(&str, &str)]| {
            of(more, held).map(|config| config.key.map(|key| key.expose_secret().to_owned()))
        };
        let both = [("HF_TOKEN", "hf"), ("API_KEY", " sk "), ("MINE", "me")];
        assert_eq!(key("", &both).unwrap().as_deref(), Some("hf"));
        assert_eq!(key("", &both[1..]).unwrap().as_deref(), Some("sk"));
        assert_eq!(key("", &[]).unwrap(), None);
        assert_eq!(key("--key-env MINE", &both).unwrap().as_deref(), Some("me"));
        assert_eq!(
            key("--key-env YOURS", &both).unwrap_err().to_string(),
            "--key-env YOURS: the variable is not set or is empty"
        );
        let config = of("--retries 1 --timeout 7 --concurrency 3 --max-tokens 99", &both).unwrap();
        assert_eq!((config.retries, config.timeout.as_secs(), config.concurrency), (1, 7, 3));
        assert_eq!((config.connect_timeout.as_secs(), config.max_tokens), (7, 99));
    }
}
