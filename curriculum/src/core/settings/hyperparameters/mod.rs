//! Hyperparameters of the strategies.
//!
//! One file a strategy declares them as constants; settings are checked, documented and explained by these
//! declarations. [`spec`] defines a declaration, [`Hyperparameters`] holds the values of one strategy.

pub(crate) mod adr;
pub(crate) mod alp_gmm;
pub(crate) mod bandit;
pub(crate) mod controller;
pub(crate) mod learnability;
pub(crate) mod replay;
pub(crate) mod spec;
pub(crate) mod staircase;

use std::collections::BTreeMap;

use env_core::text::{MAX_QUOTED_CHARS, shorten};
use serde_json::Value;

pub use self::spec::{Hyperparameter, ValueRange};
use super::error::SettingsError;
use super::strategy_kind::StrategyKind;

/// Values of all hyperparameters of one strategy. A choice is held as its index.
#[derive(Debug, Clone, PartialEq)]
pub struct Hyperparameters {
    specs: &'static [Hyperparameter],
    values: Vec<f64>,
}

/// Pairs of hyperparameters of one strategy: the first must not exceed the second.
const ORDERED: [(&str, &str); 4] = [
    ("narrow", "widen"),
    ("least_components", "most_components"),
    ("kept", "candidates"),
    ("filled", "capacity"),
];

impl Hyperparameters {
    /// Default hyperparameters of a strategy.
    #[must_use]
    pub fn defaults(strategy: StrategyKind) -> Self {
        let specs = strategy.hyperparameters();
        Self { specs, values: specs.iter().map(|spec| spec.range.default()).collect() }
    }

    /// Hyperparameters of a strategy from JSON values by name; missing names get their defaults.
    ///
    /// # Errors
    /// Returns an error at `strategy_settings.NAME` if the strategy has no such hyperparameter, if the value is
    /// outside its range, or if it exceeds a hyperparameter that bounds it.
    pub fn parse(strategy: StrategyKind, given: &BTreeMap<String, Value>) -> Result<Self, SettingsError> {
        let mut parsed = Self::defaults(strategy);
        for (name, value) in given {
            let field = || format!("strategy_settings.{}", shorten(name, MAX_QUOTED_CHARS));
            let Some(at) = parsed.specs.iter().position(|spec| spec.name == name) else {
                let known: Vec<&str> = parsed.specs.iter().map(|spec| spec.name).collect();
                let reason = match known.is_empty() {
                    true => format!("must be left out: the strategy {strategy} has no settings"),
                    false => format!(
                        "is not a setting of the strategy {strategy}; its settings are {}",
                        known.join(", ")
                    ),
                };
                return Err(SettingsError::new(field(), reason));
            };
            parsed.values[at] =
                parsed.specs[at].range.parse(value).map_err(|reason| SettingsError::new(field(), reason))?;
        }
        parsed.check_order()?;
        Ok(parsed)
    }

    fn check_order(&self) -> Result<(), SettingsError> {
        let value = |name: &str| Some(self.values[self.specs.iter().position(|spec| spec.name == name)?]);
        for (lower, upper) in ORDERED {
            if let (Some(low), Some(high)) = (value(lower), value(upper))
                && low > high
            {
                let reason = format!("must be at most {upper}, which is {high}, got {low}");
                return Err(SettingsError::new(format!("strategy_settings.{lower}"), reason));
            }
        }
        Ok(())
    }

    /// All values by name, as they are stored and sent.
    #[must_use]
    pub fn to_json(&self) -> BTreeMap<String, Value> {
        let entry =
            |(spec, value): (&Hyperparameter, &f64)| (spec.name.to_owned(), spec.range.to_json(*value));
        self.specs.iter().zip(&self.values).map(entry).collect()
    }

    /// Value of a hyperparameter as a number; a choice is its index. The default if the strategy does not have it.
    #[must_use]
    pub fn number(&self, spec: &Hyperparameter) -> f64 {
        let at = self.specs.iter().position(|known| known.name == spec.name);
        at.and_then(|at| self.values.get(at)).copied().unwrap_or_else(|| spec.range.default())
    }

    /// Value of a whole-number hyperparameter.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the value was parsed from a u32"
    )]
    pub fn integer(&self, spec: &Hyperparameter) -> u32 {
        self.number(spec) as u32
    }

    /// Name of the selected choice; empty if the hyperparameter is no choice.
    #[must_use]
    pub fn choice(&self, spec: &Hyperparameter) -> &'static str {
        let ValueRange::Choice(choices) = spec.range else { return "" };
        choices.get(self.integer(spec) as usize).copied().unwrap_or_default()
    }

    /// One sentence for each hyperparameter: its value, effect and source.
    #[must_use]
    pub fn describe(&self) -> Vec<String> {
        let line = |(spec, value): (&Hyperparameter, &f64)| {
            let value = match spec.range.to_json(*value) {
                Value::String(choice) => choice,
                number => number.to_string(),
            };
            format!("{} = {value}: {} ({}).", spec.name, spec.description, spec.source)
        };
        self.specs.iter().zip(&self.values).map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn parse(strategy: StrategyKind, given: Value) -> Result<Hyperparameters, String> {
        let given = serde_json::from_value(given).unwrap();
        Hyperparameters::parse(strategy, &given).map_err(|error| error.to_string())
    }

    #[test]
    fn contradicting_hyperparameters_are_rejected() {
        for (strategy, given, field) in [
            (StrategyKind::Adr, json!({"narrow": 0.9, "widen": 0.1}), "narrow"),
            (StrategyKind::AlpGmm, json!({"least_components": 9, "most_components": 3}), "least_components"),
            (StrategyKind::Learnability, json!({"kept": 10_000, "candidates": 2}), "kept"),
            (StrategyKind::Plr, json!({"capacity": 1}), "filled"),
        ] {
            let refused = parse(strategy, given).unwrap_err();
            assert!(refused.contains(field) && refused.contains("must be at most"), "{refused}");
        }
    }

    #[test]
    fn defaults_round_trip_through_json() {
        for strategy in StrategyKind::ALL {
            let defaults = Hyperparameters::defaults(strategy);
            assert_eq!(Hyperparameters::parse(strategy, &defaults.to_json()).unwrap(), defaults);
            for spec in strategy.hyperparameters() {
                assert!(spec.range.parse(&spec.range.default_json()).is_ok(), "{strategy} {}", spec.name);
                assert!(!spec.description.is_empty() && !spec.source.is_empty());
            }
        }
    }

    #[test]
    fn invalid_hyperparameter_error_names_its_field() {
        let error = |strategy, given| parse(strategy, given).unwrap_err();
        let unknown = error(StrategyKind::Plr, json!({"betta": 0.3}));
        assert!(
            unknown.starts_with("strategy_settings.betta is not a setting of the strategy plr; "),
            "{unknown}"
        );
        let over = error(StrategyKind::Plr, json!({"replay": 1.5}));
        assert_eq!(over, "strategy_settings.replay must be a number from 0 to 1, got 1.5");
        let none = error(StrategyKind::Uniform, json!({"replay": 0.5}));
        assert!(none.contains("the strategy uniform has no settings"), "{none}");
        let choice = error(StrategyKind::Plr, json!({"score": "luck"}));
        assert!(choice.contains("must be one of learnability,"), "{choice}");
        let fraction = error(StrategyKind::Plr, json!({"capacity": 10.5}));
        assert!(fraction.contains("must be an integer"), "{fraction}");
    }
}
