//! Rules of alerts, as `--alerts` has them.

use std::str::FromStr;
use std::time::Duration;

use store::alerts::AlertRule;

/// Bytes in a MiB.
const MIB: u64 = 1 << 20;
/// Longest time without results, minutes: after a day a run counts as ended.
const MAX_MINUTES: u64 = 24 * 60 - 1;

/// Rules by which alerts begin. `None` and false switch a rule off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlertRules {
    /// Time without results after which an active run is reported.
    pub no_results: Option<Duration>,
    /// Share of missing episodes of a task, 0 to 1, above which it is reported.
    pub missing_share: Option<f64>,
    /// Free bytes on the disk of the database below which the server is reported.
    pub low_disk: Option<u64>,
    /// True if moves down a level are reported.
    pub level_down: bool,
    /// True if evaluations are reported that are worse than those of the version before.
    pub evaluation_worse: bool,
    /// True if lost workers on other machines are reported.
    pub worker_lost: bool,
}

/// A text that is no list of rules.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InvalidRules {
    /// The rule does not exist.
    #[error("{word:?} is no rule; the rules are {}, `all` or `none`", AlertRule::WORDS.join(", "))]
    Unknown {
        /// Word that was given.
        word: String,
    },
    /// The value of a rule is out of range, or the rule takes none.
    #[error("{rule} {expected}, got {value:?}")]
    Value {
        /// Word of the rule.
        rule: AlertRule,
        /// Range of its value.
        expected: String,
        /// Value that was given.
        value: String,
    },
}

impl Default for AlertRules {
    fn default() -> Self {
        Self {
            no_results: Some(Duration::from_mins(15)),
            missing_share: Some(0.2),
            low_disk: Some(1024 * MIB),
            level_down: true,
            evaluation_worse: true,
            worker_lost: true,
        }
    }
}

impl AlertRules {
    /// No rule at all.
    pub const NONE: Self = Self {
        no_results: None,
        missing_share: None,
        low_disk: None,
        level_down: false,
        evaluation_worse: false,
        worker_lost: false,
    };

    /// Returns the rules that are on, each with the condition under which an alert begins.
    pub fn active(&self) -> Vec<(AlertRule, String)> {
        let no_results = self.no_results.map(|time| {
            (AlertRule::NoResults, format!("a run that had results has none for {} min", time.as_secs() / 60))
        });
        let missing = self.missing_share.map(|share| {
            let condition = format!("over {} % of a task's episodes are missing", 100.0 * share);
            (AlertRule::MissingShare, condition)
        });
        let disk = self.low_disk.map(|bytes| {
            let condition = format!("less than {} MiB of the disk of the database are free", bytes / MIB);
            (AlertRule::LowDisk, condition)
        });
        let fixed = [
            (self.level_down, AlertRule::LevelDown, "a task goes down a level"),
            (
                self.evaluation_worse,
                AlertRule::EvaluationWorse,
                "a policy version is worse than the one before",
            ),
            (self.worker_lost, AlertRule::WorkerLost, "a worker on another machine stops without an order"),
        ];
        let fixed = fixed.into_iter().filter(|(is_on, ..)| *is_on);
        let fixed = fixed.map(|(_, rule, condition)| (rule, condition.to_owned()));
        [no_results, missing, disk].into_iter().flatten().chain(fixed).collect()
    }
}

impl FromStr for AlertRules {
    type Err = InvalidRules;

    /// Parses `all`, `none`, or words of rules with commas between them, each with `=VALUE` or with its default.
    fn from_str(text: &str) -> Result<Self, InvalidRules> {
        let (mut rules, defaults) = (Self::NONE, Self::default());
        match text.trim() {
            "none" => return Ok(rules),
            "all" => return Ok(defaults),
            _ => {}
        }
        for item in text.split(',').map(str::trim) {
            let (word, value) =
                item.split_once('=').map_or((item, None), |(word, value)| (word, Some(value)));
            let rule: AlertRule =
                word.parse().map_err(|_| InvalidRules::Unknown { word: word.to_owned() })?;
            match rule {
                AlertRule::NoResults => {
                    let minutes = number(rule, value, 1, MAX_MINUTES, "takes minutes")?;
                    rules.no_results = minutes.map(Duration::from_mins).or(defaults.no_results);
                }
                AlertRule::LowDisk => {
                    let mib = number(rule, value, 1, u64::MAX / MIB, "takes MiB")?;
                    rules.low_disk = mib.map(|mib| mib * MIB).or(defaults.low_disk);
                }
                AlertRule::MissingShare => {
                    rules.missing_share = share(rule, value)?.or(defaults.missing_share);
                }
                AlertRule::LevelDown => rules.level_down = without_value(rule, value)?,
                AlertRule::EvaluationWorse => rules.evaluation_worse = without_value(rule, value)?,
                AlertRule::WorkerLost => rules.worker_lost = without_value(rule, value)?,
            }
        }
        Ok(rules)
    }
}

fn invalid(rule: AlertRule, expected: impl Into<String>, value: &str) -> InvalidRules {
    InvalidRules::Value { rule, expected: expected.into(), value: value.to_owned() }
}

/// Parses a whole number within a range; `None` without a value.
fn number(
    rule: AlertRule,
    value: Option<&str>,
    low: u64,
    high: u64,
    unit: &str,
) -> Result<Option<u64>, InvalidRules> {
    let Some(value) = value else { return Ok(None) };
    match value.parse() {
        Ok(number) if (low..=high).contains(&number) => Ok(Some(number)),
        _ => Err(invalid(rule, format!("{unit} from {low} to {high}"), value)),
    }
}

/// Parses a share between 0 and 1; `None` without a value.
fn share(rule: AlertRule, value: Option<&str>) -> Result<Option<f64>, InvalidRules> {
    let Some(value) = value else { return Ok(None) };
    match value.parse::<f64>() {
        Ok(share) if share > 0.0 && share < 1.0 => Ok(Some(share)),
        _ => Err(invalid(rule, "takes a share between 0 and 1", value)),
    }
}

/// Returns true if a rule without values has none.
fn without_value(rule: AlertRule, value: Option<&str>) -> Result<bool, InvalidRules> {
    value.map_or(Ok(true), |value| Err(invalid(rule, "takes no value", value)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listed_rules_are_on_and_others_are_off() {
        let rules: AlertRules = "no_results=5, low_disk, evaluation_worse".parse().unwrap();
        let expected = AlertRules {
            no_results: Some(Duration::from_mins(5)),
            low_disk: AlertRules::default().low_disk,
            evaluation_worse: true,
            ..AlertRules::NONE
        };
        assert_eq!(rules, expected);
        assert_eq!("none".parse(), Ok(AlertRules::NONE));
        assert_eq!("all".parse(), Ok(AlertRules::default()));
        assert_eq!(AlertRule::WORDS.join(",").parse(), Ok(AlertRules::default()));
    }

    #[test]
    fn active_rules_have_their_limits() {
        let rules: AlertRules = "no_results=5, missing_share=0.25, level_down".parse().unwrap();
        let active = rules.active();
        let texts: Vec<&str> = active.iter().map(|(_, condition)| condition.as_str()).collect();
        let expected = [
            "a run that had results has none for 5 min",
            "over 25 % of a task's episodes are missing",
            "a task goes down a level",
        ];
        assert_eq!(texts, expected);
        assert_eq!(AlertRules::default().active().len(), AlertRule::WORDS.len());
        assert!(AlertRules::NONE.active().is_empty());
    }

    #[test]
    fn invalid_rules_say_what_is_valid() {
        for (text, message) in [
            (
                "",
                "\"\" is no rule; the rules are no_results, missing_share, low_disk, level_down, evaluation_worse, worker_lost, `all` or `none`",
            ),
            ("no_results=0", "no_results takes minutes from 1 to 1439, got \"0\""),
            ("low_disk=-1", "low_disk takes MiB from 1 to 17592186044415, got \"-1\""),
            ("missing_share=20", "missing_share takes a share between 0 and 1, got \"20\""),
            ("missing_share=NaN", "missing_share takes a share between 0 and 1, got \"NaN\""),
            ("level_down=1", "level_down takes no value, got \"1\""),
        ] {
            assert_eq!(text.parse::<AlertRules>().unwrap_err().to_string(), message);
        }
    }
}
