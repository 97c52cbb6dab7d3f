//! `--alerts` and `--alert-webhook`: what operators are told of.

use anyhow::Context;
use clap::ValueEnum;
use orchestrator::alerts::{AlertRules, AlertSettings, MessageFormat, Webhook};

/// Arguments of alerts.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Alerts (shown in the dashboard)")]
pub struct AlertArgs {
    /// Rules that are on, with commas between them, or `none`: no_results=MINUTES of an active run, missing_share=SHARE of a task's
    /// episodes, low_disk=MIB, level_down, evaluation_worse (than that of the policy version before)
    #[arg(
        long,
        value_name = "RULES",
        env = "SPARRING_ALERTS",
        hide_env_values = true,
        default_value = "no_results=15,missing_share=0.2,low_disk=1024,level_down,evaluation_worse"
    )]
    alerts: AlertRules,
    /// URL that is told when an alert begins and when it ends, by a POST request; a message that is not taken is sent again for a
    /// day
    #[arg(long, value_name = "URL", env = "SPARRING_ALERT_WEBHOOK", hide_env_values = true)]
    alert_webhook: Option<String>,
    /// Format of the messages: json has all fields, slack is a text for an incoming webhook of Slack
    #[arg(
        long,
        value_name = "FORMAT",
        env = "SPARRING_ALERT_FORMAT",
        hide_env_values = true,
        default_value = "json"
    )]
    alert_format: AlertFormat,
}

/// Value of `--alert-format`.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum AlertFormat {
    Json,
    Slack,
}

impl AlertArgs {
    /// Returns the settings of the alerts.
    ///
    /// # Errors
    /// Returns an error if the webhook is not a URL of http or https, or the system has no certificates.
    pub(super) fn settings(&self) -> anyhow::Result<AlertSettings> {
        let format = match self.alert_format {
            AlertFormat::Json => MessageFormat::Json,
            AlertFormat::Slack => MessageFormat::Slack,
        };
        let webhook = self.alert_webhook.as_deref().map(|url| Webhook::new(url, format));
        let webhook = webhook.transpose().context("--alert-webhook")?;
        Ok(AlertSettings { rules: self.alerts, webhook, ..AlertSettings::default() })
    }
}
