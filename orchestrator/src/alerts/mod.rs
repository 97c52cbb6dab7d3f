//! Alerts: what an operator should know of a run or of the server, shown in the dashboard and sent to a webhook.
//!
//! [`rules`] are the settings of `--alerts`. [`conditions`] finds which of them hold, [`update`] stores the difference from the
//! alerts that last, and [`webhook`] sends messages. The worker is `workers::alert`.

pub mod conditions;
mod lost_workers;
pub mod rules;
pub mod update;
pub mod webhook;

use std::time::Duration;

pub use self::rules::{AlertRules, InvalidRules};
pub use self::webhook::{InvalidWebhook, MessageFormat, Webhook};

/// Interval between two checks of all rules.
const CHECK_INTERVAL: Duration = Duration::from_secs(5);

/// Settings of the alerts of a server.
#[derive(Debug, Clone)]
pub struct AlertSettings {
    /// Rules by which alerts begin.
    pub rules: AlertRules,
    /// Receiver of messages; without one, alerts are only shown.
    pub webhook: Option<Webhook>,
    /// Interval between two checks of all rules.
    pub check_interval: Duration,
}

impl Default for AlertSettings {
    fn default() -> Self {
        Self { rules: AlertRules::default(), webhook: None, check_interval: CHECK_INTERVAL }
    }
}
