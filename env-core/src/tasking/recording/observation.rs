//! Comparison of an observation with a recorded one, with a tolerance of each column.

use serde_json::Value;

use super::read::{ReadResult, numbers};
use super::tolerances;
use crate::difference_tally::DifferenceTally;
use crate::tasking::access::OpportunityKind;
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::observation::opportunity::OpportunityProperty;
use crate::tasking::observation::property::Property;
use crate::tasking::observation::spec::{ObservationItem, ObservationSpec};
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::simulation::TaskingSim;

/// Shortest distance of a target from a satellite, m.
const SHORTEST_RANGE_M: f64 = 200e3;

/// How a value of an observation is compared.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ColumnTolerance {
    quantity: &'static str,
    /// Factor from the observed value to the unit of the quantity: the divisor of the observation.
    unit: f64,
    /// Largest allowed difference in that unit.
    allowed: f64,
}

impl ColumnTolerance {
    /// Tolerance of a value in the unit before its division.
    fn new(quantity: &'static str, norm: f64, allowed: f64) -> Self {
        let is_invertible = norm.is_finite() && norm != 0.0;
        Self { quantity, unit: if is_invertible { norm } else { 1.0 }, allowed }
    }

    /// Tolerance of a value as it is observed, given that before its division.
    fn observed(norm: f64, allowed: f64) -> Self {
        Self { quantity: "observation", unit: 1.0, allowed: allowed / norm.abs() + tolerances::ROUNDING }
    }
}

/// Compares all values of an observation.
pub(super) fn compare_observation(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tick_s: f64,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let theirs = numbers(recorded)?;
    let mut ours = Vec::with_capacity(theirs.len());
    sim.observe(index, &mut ours).map_err(|error| error.to_string())?;
    tally.compare_outcomes(&ours.len(), &theirs.len(), format_args!("number of values that {name} observes"));
    if ours.len() != theirs.len() {
        return Ok(());
    }
    let columns = sim.observation_columns(index);
    let mut limits = Vec::with_capacity(columns.len());
    let satellite = ObservedSatellite { spec: sim.satellite(index).spec(), tick_s };
    satellite.add_limits(sim.observation_spec(index), columns.len(), &mut limits);
    tally.compare_outcomes(
        &limits.len(),
        &columns.len(),
        format_args!("number of columns of {name} with a tolerance"),
    );
    for (((ours, theirs), column), limit) in ours.iter().zip(&theirs).zip(&columns).zip(&limits) {
        let what = format_args!("{column} of {name}");
        let (ours, theirs) = (ours * limit.unit, theirs * limit.unit);
        let allowed = limit.allowed + tolerances::ROUNDING * theirs.abs();
        tally.compare_numbers(limit.quantity, ours, theirs, allowed, what);
    }
    Ok(())
}

/// Satellite on which the tolerances of its columns depend.
struct ObservedSatellite<'a> {
    spec: &'a SatelliteSpec,
    tick_s: f64,
}

impl ObservedSatellite<'_> {
    /// Appends the tolerances of all columns. `columns` is their number.
    fn add_limits(&self, spec: &ObservationSpec, columns: usize, limits: &mut Vec<ColumnTolerance>) {
        let is_weights =
            |item: &&(String, ObservationItem)| matches!(item.1, ObservationItem::ResourceWeights { .. });
        let weights =
            (columns - spec.columns(0).len()) / spec.items().iter().filter(is_weights).count().max(1);
        for (_, item) in spec.items() {
            match item {
                ObservationItem::Properties(properties) => {
                    for entry in properties {
                        let limit = ColumnTolerance::observed(entry.norm, self.property(entry.property));
                        limits.extend(std::iter::repeat_n(limit, entry.property.len()));
                    }
                }
                ObservationItem::Time { .. } => limits.push(ColumnTolerance::observed(1.0, 0.0)),
                ObservationItem::Opportunities { kind, count, properties } => {
                    for _ in 0..*count {
                        for entry in properties {
                            let limit = self.opportunity(*kind, entry.property, entry.norm);
                            limits.extend(std::iter::repeat_n(limit, entry.property.len()));
                        }
                    }
                }
                ObservationItem::Eclipse { norm_s } => {
                    let limit = ColumnTolerance::new("observed_eclipse", *norm_s, tolerances::TIME_S);
                    limits.extend([limit; 2]);
                }
                ObservationItem::ResourceWeights { norm } => {
                    limits.extend(std::iter::repeat_n(ColumnTolerance::observed(*norm, 0.0), weights));
                }
            }
        }
    }

    /// Largest allowed difference of a property of the satellite, before its division.
    fn property(&self, property: Property) -> f64 {
        let direction = tolerances::direction_rad(self.spec);
        let (position, velocity) =
            (tolerances::position_m(self.tick_s), tolerances::velocity_m_s(self.tick_s));
        match property {
            Property::SigmaBn => tolerances::sigma(self.spec),
            Property::Bn | Property::Bp | Property::CHatP | Property::CHatH => direction,
            Property::Hn | Property::BetaAngle => 2.0 * position / EARTH_RADIUS_M,
            Property::OmegaBnB | Property::OmegaBpP | Property::OmegaBhH => 2.0 * tolerances::OMEGA_RAD_S,
            Property::RBnN | Property::RBnP => position,
            Property::VBnN | Property::VBnP => velocity,
            Property::SemiMajorAxis => 0.01,
            Property::Eccentricity | Property::Inclination | Property::AscendingNode => 1e-9,
            // They are the differences of nearly equal vectors where the orbit is nearly circular.
            Property::ArgumentOfPeriapsis | Property::TrueAnomaly => 1e-6,
            Property::BatteryCharge => tolerances::BATTERY_WS,
            Property::BatteryChargeFraction => tolerances::battery_fraction(self.spec),
            Property::WheelSpeeds => tolerances::WHEELS_RAD_S,
            Property::WheelSpeedsFraction => tolerances::wheel_fraction(self.spec),
            Property::StorageLevel | Property::StorageLevelFraction => 0.0,
            Property::InstrumentPointingError | Property::SolarPointingError => direction,
        }
    }

    /// Tolerance of a property of an opportunity.
    fn opportunity(
        &self,
        kind: OpportunityKind,
        property: OpportunityProperty,
        norm: f64,
    ) -> ColumnTolerance {
        let position = tolerances::position_m(self.tick_s);
        let window = match kind {
            OpportunityKind::Target => tolerances::OBSERVED_TARGET_WINDOW_S,
            OpportunityKind::GroundStation => tolerances::STATION_WINDOW_S,
        };
        match property {
            OpportunityProperty::Priority => ColumnTolerance::new("observed_priority", norm, 0.0),
            OpportunityProperty::Open | OpportunityProperty::Middle | OpportunityProperty::Close => {
                ColumnTolerance::new("observed_window", norm, window)
            }
            OpportunityProperty::Position => ColumnTolerance::observed(norm, 1e-6),
            // The axes of the Hill frame turn with the position.
            OpportunityProperty::HillPosition => ColumnTolerance::observed(norm, 4.0 * position),
            OpportunityProperty::Angle => {
                let limit = tolerances::direction_rad(self.spec) + position / SHORTEST_RANGE_M;
                ColumnTolerance::observed(norm, limit)
            }
            OpportunityProperty::AngleRate => ColumnTolerance::observed(norm, 2.0 * tolerances::OMEGA_RAD_S),
        }
    }
}
