//! The set-up of a recorded episode.

use serde_json::Value;

use super::read::{
    ReadResult, count_of, flag_of, list_of, member, number, number_of, numbers, text_of, texts_of, vector_of,
};
use crate::tasking::access::OpportunityKind;
use crate::tasking::clock::TickLength;
use crate::tasking::error::TaskingError;
use crate::tasking::observation::opportunity::OpportunityProperty;
use crate::tasking::observation::property::Property;
use crate::tasking::observation::spec::{Normalised, ObservationItem, ObservationSpec};
use crate::tasking::orbit::{GravityModel, OrbitalElements};
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::setup::actions::{ActionSpec, SoftwareAction, UNLIMITED_S};
use crate::tasking::setup::environment::{
    AgentSetup, ClockSetup, Communicator, EnvironmentMode, GenerationTimes, GroundStation, Links, Rewarder,
    SatelliteClass, Target,
};
use crate::tasking::setup::{ArgValue, Atmosphere, DynamicsModel, SatelliteArgs, Setup, SoftwareModel};
use crate::tasking::time::Epoch;

/// Largest number of opportunities that an action or an observation may look ahead. The lists are as long, whatever there is to see.
const MOST_AHEAD: usize = 10_000;

/// Reads the set-up of a recording under a gravity model.
///
/// # Errors
/// Returns the reason if the recording is not one of the format, or the set-up is not valid.
pub fn read_setup(recording: &Value, gravity: GravityModel) -> ReadResult<Setup> {
    let env = member(recording, "env")?;
    let world = member(recording, "world_args")?;
    let agents = list_of(recording, "satellites")?.iter().map(read_agent).collect::<ReadResult<Vec<_>>>()?;
    let atmosphere = read_atmosphere(world)?;
    for AgentSetup { satellite, .. } in &agents {
        atmosphere.check_negligible(&satellite.name, &satellite.args).map_err(text)?;
    }
    let mode = match text_of(env, "cls")? {
        "ConstellationTasking" => EnvironmentMode::Constellation,
        _ => EnvironmentMode::General,
    };
    Ok(Setup {
        agents,
        epoch: Epoch::parse(text_of(world, "utc_init")?).map_err(text)?,
        gravity,
        full_thrust: false,
        stations: read_stations(world)?,
        targets: read_targets(recording)?,
        rewarders: list_of(env, "rewarders")?
            .iter()
            .map(|rewarder| read_rewarder(rewarder, member(env, "scenario")?))
            .collect::<ReadResult<Vec<_>>>()?,
        communicator: read_communicator(member(env, "communicator")?)?,
        clock: ClockSetup {
            tick: TickLength::from_seconds(number_of(env, "sim_rate")?).map_err(text)?,
            max_step_s: number_of(env, "max_step_duration")?,
            time_limit_s: number_of(env, "time_limit")?,
            terminate_on_time_limit: flag_of(env, "terminate_on_time_limit")?,
        },
        failure_penalty: number_of(env, "failure_penalty")?,
        mode,
    })
}

#[expect(clippy::needless_pass_by_value, reason = "errors are mapped by it")]
fn text(error: TaskingError) -> String {
    error.to_string()
}

fn read_targets(recording: &Value) -> ReadResult<Vec<Target>> {
    list_of(recording, "targets")?
        .iter()
        .map(|target| {
            Ok(Target {
                name: text_of(target, "name")?.to_owned(),
                position: vector_of(target, "r_LP_P_m")?,
                priority: number_of(target, "priority")?,
            })
        })
        .collect()
}

/// The atmosphere of the world arguments; missing ones have their defaults.
fn read_atmosphere(world: &Value) -> ReadResult<Atmosphere> {
    let Atmosphere { planet_radius_m, base_density_kg_m3, scale_height_m } = Atmosphere::default();
    let own = |name: &str, default: f64| world.get(name).map_or(Ok(default), number);
    Ok(Atmosphere {
        planet_radius_m: own("planetRadius", planet_radius_m)?,
        base_density_kg_m3: own("baseDensity", base_density_kg_m3)?,
        scale_height_m: own("scaleHeight", scale_height_m)?,
    })
}

fn read_stations(world: &Value) -> ReadResult<Vec<GroundStation>> {
    if world.get("groundStationsData").is_none() {
        return Ok(Vec::new());
    }
    list_of(world, "groundStationsData")?
        .iter()
        .map(|station| {
            let degrees = [number_of(station, "lat")?, number_of(station, "long")?];
            let height = station.get("elev").map_or(Ok(0.0), number)?;
            let name = station.get("name").and_then(Value::as_str).unwrap_or_default();
            // A station may have values of its own; BSK-RL takes 0 for none.
            let own = |name: &str| match station.get(name).map(number).transpose()? {
                Some(value) if value != 0.0 => Ok(value),
                _ => number_of(world, name),
            };
            Ok(GroundStation {
                min_elevation_rad: own("gsMinimumElevation")?,
                max_range_m: own("gsMaximumRange")?,
                ..GroundStation::at(name, degrees, height, own("groundLocationPlanetRadius")?)
            })
        })
        .collect()
}

fn read_rewarder(rewarder: &Value, scenario: &Value) -> ReadResult<Rewarder> {
    match text_of(rewarder, "type")? {
        "NoReward" => Ok(Rewarder::None),
        "UniqueImageReward" => Ok(Rewarder::UniqueImages),
        "ScanningTimeReward" => {
            Ok(Rewarder::ScanningTime { value_per_second: number_of(scenario, "value_per_second")? })
        }
        "ResourceReward" => Ok(Rewarder::Resource {
            property: Property::from_name(text_of(rewarder, "resource")?).map_err(text)?,
            weight: number_of(rewarder, "reward_weight")?,
        }),
        other => Err(format!("the rewarder `{other}` is not supported")),
    }
}

fn read_communicator(communicator: &Value) -> ReadResult<Communicator> {
    let mut read =
        Communicator { min_period_s: number_of(communicator, "min_period")?, ..Communicator::default() };
    for class in texts_of(communicator, "types")? {
        match class {
            "NoCommunication" => {}
            "FreeCommunication" => read.links = Links::Free,
            "LOSCommunication" => read.links = Links::LineOfSight,
            "MultiDegreeCommunication" => read.multi_degree = true,
            "LOSMultiCommunication" => (read.links, read.multi_degree) = (Links::LineOfSight, true),
            "BroadcastCommunication" => read.broadcast = true,
            other => return Err(format!("the communication `{other}` is not supported")),
        }
    }
    Ok(read)
}

fn read_agent(satellite: &Value) -> ReadResult<AgentSetup> {
    let dynamics = DynamicsModel::compose(texts_of(satellite, "dyn")?).map_err(text)?;
    let software = SoftwareModel::compose(texts_of(satellite, "fsw")?).map_err(text)?;
    let mut values = Vec::new();
    let recorded = member(satellite, "sat_args")?.as_object().ok_or("`sat_args` is not an object")?;
    for (name, value) in recorded {
        values.push((name.as_str(), read_argument(name, value)?));
    }
    let args = SatelliteArgs::read(values, dynamics, software).map_err(text)?;
    let initial = member(satellite, "initial_generation_duration")?;
    let times = GenerationTimes {
        block_s: number_of(satellite, "generation_duration")?,
        initial_s: if initial.is_null() { None } else { Some(number(initial)?) },
        max_beyond_s: number_of(satellite, "max_generation_duration_beyond_initial")?,
    };
    let class = match text_of(satellite, "type")? {
        "Satellite" => SatelliteClass::Plain,
        "AccessSatellite" => SatelliteClass::Access(times),
        "ImagingSatellite" => SatelliteClass::Imaging(times),
        other => return Err(format!("the satellite class `{other}` is not supported")),
    };
    Ok(AgentSetup {
        satellite: SatelliteSpec { name: text_of(satellite, "name")?.to_owned(), dynamics, software, args },
        class,
        variable_interval: flag_of(satellite, "variable_interval")?,
        actions: list_of(satellite, "actions")?.iter().map(read_action).collect::<ReadResult<_>>()?,
        observation: read_observation(satellite)?,
    })
}

fn read_argument(name: &str, value: &Value) -> ReadResult<ArgValue> {
    Ok(match value {
        Value::Null => ArgValue::None,
        Value::Bool(flag) => ArgValue::Flag(*flag),
        Value::String(text) if text == "inf" => ArgValue::Number(f64::INFINITY),
        Value::String(text) => ArgValue::Text(text.clone()),
        Value::Number(_) => ArgValue::Number(number(value)?),
        Value::Array(items) if items.iter().all(Value::is_string) => {
            ArgValue::Texts(items.iter().filter_map(Value::as_str).map(str::to_owned).collect())
        }
        Value::Array(_) => ArgValue::Numbers(numbers(value).map_err(|error| format!("`{name}` {error}"))?),
        Value::Object(_) => ArgValue::Elements(OrbitalElements {
            semi_major_axis_m: number_of(value, "a")?,
            eccentricity: number_of(value, "e")?,
            inclination_rad: number_of(value, "i")?,
            ascending_node_rad: number_of(value, "Omega")?,
            periapsis_rad: number_of(value, "omega")?,
            true_anomaly_rad: number_of(value, "f")?,
        }),
    })
}

fn read_action(action: &Value) -> ReadResult<ActionSpec> {
    let name = text_of(action, "name")?.to_owned();
    let duration = |field: &str| {
        let value = action.get(field).unwrap_or(&Value::Null);
        number(value).map(|seconds| seconds.min(UNLIMITED_S))
    };
    let class = text_of(action, "type")?;
    let software = match class {
        "Image" => {
            let targets = count_of(action, "n_ahead_image", MOST_AHEAD)?;
            return Ok(ActionSpec::Image { name, targets, max_duration_s: duration("max_duration")? });
        }
        "Broadcast" => return Ok(ActionSpec::Broadcast { name, duration_s: duration("duration")? }),
        "Scan" => SoftwareAction::Scan,
        "Charge" => SoftwareAction::Charge,
        "Downlink" => SoftwareAction::Downlink,
        "Desat" => SoftwareAction::Desaturate,
        "NadirPoint" => SoftwareAction::NadirPoint,
        "Drift" => SoftwareAction::Drift,
        "DiscreteFSWAction" => SoftwareAction::from_function(text_of(action, "fsw_action")?).map_err(text)?,
        other => return Err(format!("the action `{other}` is not supported")),
    };
    let reset_task = match action.get("reset_task") {
        Some(reset) => reset.as_bool().unwrap_or(false),
        None => class == "Desat",
    };
    Ok(ActionSpec::Software { name, action: software, duration_s: duration("duration")?, reset_task })
}

fn read_observation(satellite: &Value) -> ReadResult<ObservationSpec> {
    let mut items = Vec::new();
    for item in list_of(satellite, "observations")? {
        items.push((text_of(item, "name")?.to_owned(), read_observation_item(item)?));
    }
    Ok(ObservationSpec::new(items))
}

fn read_observation_item(item: &Value) -> ReadResult<ObservationItem> {
    Ok(match text_of(item, "type")? {
        "SatProperties" => ObservationItem::Properties(read_properties(item, |name| {
            Property::from_name(name).map_err(text)
        })?),
        "OpportunityProperties" => ObservationItem::Opportunities {
            kind: match text_of(item, "opportunity_type")? {
                "target" => OpportunityKind::Target,
                "ground_station" => OpportunityKind::GroundStation,
                other => return Err(format!("opportunities of type `{other}` are not supported")),
            },
            count: count_of(item, "n_ahead_observe", MOST_AHEAD)?,
            properties: read_properties(item, |name| OpportunityProperty::from_name(name).map_err(text))?,
        },
        "Time" => ObservationItem::Time {
            norm_s: Some(number_of(item, "norm")?).filter(|norm| norm.is_finite()),
            is_remaining: flag_of(item, "observe_time_remaining")?,
        },
        "Eclipse" => ObservationItem::Eclipse { norm_s: number_of(item, "norm")? },
        "ResourceRewardWeight" => ObservationItem::ResourceWeights { norm: number_of(item, "norm")? },
        other => return Err(format!("the observation `{other}` is not supported")),
    })
}

fn read_properties<P>(
    item: &Value,
    from_name: impl Fn(&str) -> ReadResult<P>,
) -> ReadResult<Vec<Normalised<P>>> {
    list_of(item, "properties")?
        .iter()
        .map(|entry| {
            Ok(Normalised {
                property: from_name(text_of(entry, "prop")?)?,
                norm: number_of(entry, "norm")?,
                name: text_of(entry, "name")?.to_owned(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Values that are no number of opportunities.
    fn no_counts() -> [Value; 7] {
        [json!(10_001), json!(1e17), json!(-1), json!(2.5), json!("inf"), json!("10"), Value::Null]
    }

    #[test]
    fn opportunities_ahead_are_bounded() {
        let observation = |count: &Value| {
            let properties = json!([{"prop": "priority", "norm": 1.0, "name": "priority"}]);
            json!({
                "type": "OpportunityProperties", "opportunity_type": "target", "n_ahead_observe": count,
                "properties": properties,
            })
        };
        let image = |count: &Value| json!({"type": "Image", "name": "image", "n_ahead_image": count, "max_duration": null});
        for count in [json!(1), json!(10.0), json!(10_000)] {
            assert!(read_observation_item(&observation(&count)).is_ok(), "{count}");
            assert!(read_action(&image(&count)).is_ok(), "{count}");
        }
        for count in no_counts() {
            let error = read_observation_item(&observation(&count)).unwrap_err();
            assert_eq!(error, "`n_ahead_observe` is not a whole number from 0 to 10000", "{count}");
            let error = read_action(&image(&count)).unwrap_err();
            assert_eq!(error, "`n_ahead_image` is not a whole number from 0 to 10000", "{count}");
        }
    }
}
