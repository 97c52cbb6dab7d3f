//! Description of an observation: `observation_spec` of BSK-RL.

use super::opportunity::OpportunityProperty;
use super::property::Property;
use crate::tasking::access::OpportunityKind;

/// A part of an observation.
#[derive(Debug, Clone, PartialEq)]
pub enum ObservationItem {
    /// Properties of the satellite (`SatProperties`).
    Properties(Vec<Normalised<Property>>),
    /// Time since the start, or until the time limit (`Time`).
    Time {
        /// Divisor, s; `None` is the time limit.
        norm_s: Option<f64>,
        /// True for the remaining time.
        is_remaining: bool,
    },
    /// Properties of the next opportunities (`OpportunityProperties`).
    Opportunities {
        /// Kind of the objects.
        kind: OpportunityKind,
        /// Number of observed opportunities.
        count: usize,
        /// Properties of each opportunity.
        properties: Vec<Normalised<OpportunityProperty>>,
    },
    /// Time until the next eclipse begins and ends (`Eclipse`).
    Eclipse {
        /// Divisor of the times, s.
        norm_s: f64,
    },
    /// Weights of the rewards for resources (`ResourceRewardWeight`).
    ResourceWeights {
        /// Divisor of the weights.
        norm: f64,
    },
}

/// A property with its divisor and its name in the observation.
#[derive(Debug, Clone, PartialEq)]
pub struct Normalised<P> {
    /// The property that is observed.
    pub property: P,
    /// Divisor of the values.
    pub norm: f64,
    /// Name in the observation.
    pub name: String,
}

impl<P> Normalised<P> {
    /// Creates a property under BSK-RL's default name: that of the property, with `_normd` if it is divided.
    pub fn new(property: P, name: &str, norm: f64) -> Self {
        let suffix = if norm == 1.0 { "" } else { "_normd" };
        Self { property, norm, name: format!("{name}{suffix}") }
    }
}

/// An observation: named items in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObservationSpec {
    items: Vec<(String, ObservationItem)>,
}

impl ObservationSpec {
    /// Creates an observation from items and their names. A name that appears again gets its count as a suffix, as in BSK-RL.
    #[must_use]
    pub fn new(items: Vec<(String, ObservationItem)>) -> Self {
        let mut named: Vec<(String, ObservationItem)> = Vec::with_capacity(items.len());
        let mut given: Vec<String> = Vec::new();
        for (name, item) in items {
            let count = given.iter().filter(|other| **other == name).count();
            given.push(name.clone());
            named.push((if count == 0 { name } else { format!("{name}_{}", count + 1) }, item));
        }
        Self { items: named }
    }

    /// Items with their names, in order.
    #[must_use]
    pub fn items(&self) -> &[(String, ObservationItem)] {
        &self.items
    }

    /// Names of all values, in order. `weights` is the number of rewards for resources.
    #[must_use]
    pub fn columns(&self, weights: usize) -> Vec<String> {
        let mut columns = Vec::new();
        for (name, item) in &self.items {
            match item {
                ObservationItem::Properties(properties) => {
                    for entry in properties {
                        push_columns(&mut columns, &format!("{name}.{}", entry.name), entry.property.len());
                    }
                }
                ObservationItem::Time { .. } => columns.push(name.clone()),
                ObservationItem::Opportunities { count, properties, .. } => {
                    for i in 0..*count {
                        for entry in properties {
                            let prefix = format!("{name}.{name}_{i}.{}", entry.name);
                            push_columns(&mut columns, &prefix, entry.property.len());
                        }
                    }
                }
                ObservationItem::Eclipse { .. } => {
                    columns.extend([format!("{name}[0]"), format!("{name}[1]")]);
                }
                ObservationItem::ResourceWeights { .. } => {
                    columns.extend((0..weights).map(|i| format!("{name}[{i}]")));
                }
            }
        }
        columns
    }
}

/// Appends the names of a property's values: vectors have an index.
fn push_columns(columns: &mut Vec<String>, prefix: &str, count: usize) {
    if count == 1 {
        columns.push(prefix.to_owned());
    } else {
        columns.extend((0..count).map(|i| format!("{prefix}[{i}]")));
    }
}
