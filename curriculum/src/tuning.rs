//! Hyper-parameters of strategies: one table a strategy, by which settings are checked, documented and explained.

use std::collections::BTreeMap;

use serde_json::Value;

use super::kind::StrategyKind;
use super::settings::SettingsError;

/// A number, or one of some words, that a strategy goes by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hyper {
    /// Its name in `strategy_settings`.
    pub name: &'static str,
    /// What it takes.
    pub range: Range,
    /// What it does.
    pub about: &'static str,
    /// Where its default comes from.
    pub source: &'static str,
}

/// What a hyper-parameter takes, and what it is unless told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// A number.
    Number {
        /// Unless told.
        default: f64,
        /// At least.
        min: f64,
        /// At most.
        max: f64,
    },
    /// A whole number.
    Whole {
        /// Unless told.
        default: u32,
        /// At least.
        min: u32,
        /// At most.
        max: u32,
    },
    /// One of some words, the first unless told.
    Word(&'static [&'static str]),
}

/// The hyper-parameters of a strategy, all of them. Words are stored by their place among the choices.
#[derive(Debug, Clone, PartialEq)]
pub struct Tuning {
    table: &'static [Hyper],
    values: Vec<f64>,
}

/// Settings of which the first may not be above the second, where a strategy has both.
const ORDERED: [(&str, &str); 4] = [
    ("narrow", "widen"),
    ("least_components", "most_components"),
    ("kept", "candidates"),
    ("filled", "capacity"),
];

impl Tuning {
    /// A strategy's, as they are unless told.
    #[must_use]
    pub fn standard(strategy: StrategyKind) -> Self {
        let table = strategy.hypers();
        Self { table, values: table.iter().map(|hyper| hyper.range.default()).collect() }
    }

    /// The same, where these names say otherwise.
    ///
    /// # Errors
    /// The field at fault: a name that the strategy does not have, and a value that it does not take.
    pub fn read(strategy: StrategyKind, told: &BTreeMap<String, Value>) -> Result<Self, SettingsError> {
        let mut tuning = Self::standard(strategy);
        for (name, value) in told {
            let field = || format!("strategy_settings.{}", name.chars().take(60).collect::<String>());
            let Some(at) = tuning.table.iter().position(|hyper| hyper.name == name) else {
                let known: Vec<&str> = tuning.table.iter().map(|hyper| hyper.name).collect();
                let reason = match known.is_empty() {
                    true => format!("is told, but {strategy} has no settings of its own"),
                    false => format!("is no setting of {strategy}; it has {}", known.join(", ")),
                };
                return Err(SettingsError::new(field(), reason));
            };
            tuning.values[at] =
                tuning.table[at].range.read(value).map_err(|reason| SettingsError::new(field(), reason))?;
        }
        tuning.agrees()?;
        Ok(tuning)
    }

    /// Whether its settings fit each other.
    fn agrees(&self) -> Result<(), SettingsError> {
        let value = |name: &str| Some(self.values[self.table.iter().position(|hyper| hyper.name == name)?]);
        for (less, more) in ORDERED {
            if let (Some(low), Some(high)) = (value(less), value(more))
                && low > high
            {
                let reason = format!("is {low}, but may not be above {more}, which is {high}");
                return Err(SettingsError::new(format!("strategy_settings.{less}"), reason));
            }
        }
        Ok(())
    }

    /// All of them, by name, as they are sent and stored.
    #[must_use]
    pub fn told(&self) -> BTreeMap<String, Value> {
        let told = |(hyper, value): (&Hyper, &f64)| (hyper.name.to_owned(), hyper.range.told(*value));
        self.table.iter().zip(&self.values).map(told).collect()
    }

    /// One of them as a number; a whole one is one, a word is its place among the choices.
    #[must_use]
    pub fn number(&self, hyper: &Hyper) -> f64 {
        let at = self.table.iter().position(|known| known.name == hyper.name);
        at.and_then(|at| self.values.get(at)).copied().unwrap_or_else(|| hyper.range.default())
    }

    /// One that is whole.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it was read from a u32")]
    pub fn whole(&self, hyper: &Hyper) -> u32 {
        self.number(hyper) as u32
    }

    /// One that is a word.
    #[must_use]
    pub fn word(&self, hyper: &Hyper) -> &'static str {
        let Range::Word(choices) = hyper.range else { return "" };
        choices.get(self.whole(hyper) as usize).copied().unwrap_or_default()
    }

    /// In words, for people: each with its value.
    #[must_use]
    pub fn in_words(&self) -> Vec<String> {
        let line = |(hyper, value): (&Hyper, &f64)| {
            let told = match hyper.range.told(*value) {
                Value::String(word) => word,
                number => number.to_string(),
            };
            format!("{} = {told}: {} ({}).", hyper.name, hyper.about, hyper.source)
        };
        self.table.iter().zip(&self.values).map(line).collect()
    }
}

impl Range {
    fn default(self) -> f64 {
        match self {
            Self::Number { default, .. } => default,
            Self::Whole { default, .. } => f64::from(default),
            Self::Word(_) => 0.0,
        }
    }

    fn read(self, value: &Value) -> Result<f64, String> {
        let wanted = self.wanted();
        let shown: String = value.to_string().chars().take(60).collect();
        let wrong = || format!("is {shown}, but must be {wanted}");
        match self {
            Self::Number { min, max, .. } => {
                value.as_f64().filter(|number| (min..=max).contains(number)).ok_or_else(wrong)
            }
            Self::Whole { min, max, .. } => {
                let whole = value.as_u64().and_then(|number| u32::try_from(number).ok());
                whole.filter(|number| (min..=max).contains(number)).map(f64::from).ok_or_else(wrong)
            }
            Self::Word(choices) => {
                let place = choices.iter().position(|choice| value.as_str() == Some(choice));
                place.and_then(|place| u32::try_from(place).ok()).map(f64::from).ok_or_else(wrong)
            }
        }
    }

    /// What it takes, as the end of a sentence.
    #[must_use]
    pub fn wanted(self) -> String {
        match self {
            Self::Number { min, max, .. } => format!("a number from {min} to {max}"),
            Self::Whole { min, max, .. } => format!("a whole number from {min} to {max}"),
            Self::Word(choices) => format!("one of {}", choices.join(", ")),
        }
    }

    /// A value as it is sent.
    #[must_use]
    pub fn told(self, value: f64) -> Value {
        match self {
            Self::Number { .. } => Value::from(value),
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "it was read from a u32"
            )]
            Self::Whole { .. } => Value::from(value as u32),
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "it is a place in a list"
            )]
            Self::Word(choices) => Value::from(choices.get(value as usize).copied().unwrap_or_default()),
        }
    }

    /// What it is unless told.
    #[must_use]
    pub fn standard(self) -> Value {
        self.told(self.default())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn settings_that_contradict_each_other_are_refused() {
        for (strategy, value, field) in [
            (StrategyKind::Adr, json!({"narrow": 0.9, "widen": 0.1}), "narrow"),
            (StrategyKind::AlpGmm, json!({"least_components": 9, "most_components": 3}), "least_components"),
            (StrategyKind::Learnability, json!({"kept": 10_000, "candidates": 2}), "kept"),
            (StrategyKind::Plr, json!({"capacity": 1}), "filled"),
        ] {
            let refused = told(strategy, value).unwrap_err();
            assert!(refused.contains(field) && refused.contains("may not be above"), "{refused}");
        }
    }

    fn told(strategy: StrategyKind, value: Value) -> Result<Tuning, String> {
        let told = serde_json::from_value(value).unwrap();
        Tuning::read(strategy, &told).map_err(|error| error.to_string())
    }

    #[test]
    fn what_is_told_is_read_and_told_again() {
        for strategy in StrategyKind::ALL {
            let standard = Tuning::standard(strategy);
            assert_eq!(Tuning::read(strategy, &standard.told()).unwrap(), standard);
            for hyper in strategy.hypers() {
                assert!(hyper.range.read(&hyper.range.standard()).is_ok(), "{strategy} {}", hyper.name);
                assert!(!hyper.about.is_empty() && !hyper.source.is_empty());
            }
        }
    }

    #[test]
    fn what_cannot_be_is_said_with_its_field() {
        let error = |strategy, value| told(strategy, value).unwrap_err();
        let unknown = error(StrategyKind::Plr, json!({"betta": 0.3}));
        assert!(unknown.starts_with("strategy_settings.betta is no setting of plr; it has "), "{unknown}");
        let over = error(StrategyKind::Plr, json!({"replay": 1.5}));
        assert_eq!(over, "strategy_settings.replay is 1.5, but must be a number from 0 to 1");
        let none = error(StrategyKind::Uniform, json!({"replay": 0.5}));
        assert!(none.contains("uniform has no settings of its own"), "{none}");
        let word = error(StrategyKind::Plr, json!({"score": "luck"}));
        assert!(word.contains("must be one of regret,"), "{word}");
        let fraction = error(StrategyKind::Plr, json!({"capacity": 10.5}));
        assert!(fraction.contains("whole number"), "{fraction}");
    }
}
