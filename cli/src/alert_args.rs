//! `--alerts` and `--alert-webhook`: rules of alerts, and the receiver of their messages.

use anyhow::Context;
use clap::ValueEnum;
use orchestrator::alerts::{AlertRules, AlertSettings, MessageFormat, Webhook};

/// Arguments that concern alerts.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Alerts (shown in the dashboard)")]
pub struct AlertArgs {
    /// Rules that are on, with commas between them, or `all` or `none`: no_results=15 (minutes of an active run),
    /// missing_share=0.2 (of a task's episodes), low_disk=1024 (MiB), level_down, evaluation_worse (than that of the policy
    /// version before), worker_lost (on another machine). A rule without a value has the default that is shown here
    #[arg(
        long,
        value_name = "RULES",
        env = "SPARRING_ALERTS",
        hide_env_values = true,
        default_value = "all"
    )]
    alerts: AlertRules,
    /// URL that receives a POST request when an alert begins and when it ends; a message that is not taken is sent again for a day
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

/// Value of the option `--alert-format`.
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
