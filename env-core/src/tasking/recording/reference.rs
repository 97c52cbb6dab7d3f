//! Older recordings, of the scanning environment and of three imaging satellites, as recordings of the current format.

use serde_json::{Map, Value, json};

use super::read::{ReadResult, list_of, member, number_of};
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::setup::environment::{DEFAULT_STATIONS, StationPlace};

/// Converts an older recording; one of the current format is returned as it is.
///
/// # Errors
/// Returns the reason if it is neither.
pub fn to_current_format(recording: &Value) -> ReadResult<Value> {
    if recording.get("format").is_some() {
        return Ok(recording.clone());
    }
    match recording.get("kind").and_then(Value::as_str).and_then(|kind| kind.chars().next()) {
        Some('a') => scanning(recording),
        Some('b') => imaging(recording),
        _ => Err("it is not a recording of BSK-RL".to_owned()),
    }
}

/// True if a value is an older recording.
#[must_use]
pub fn is_older_recording(recording: &Value) -> bool {
    recording.get("sat_args_realized").is_some() && recording.get("kind").is_some_and(Value::is_string)
}

/// Ground stations of the recorded world, which its traces leave out.
fn world_args(recording: &Value) -> ReadResult<Value> {
    if let Some(world) = recording.get("world_args_realized") {
        return Ok(world.clone());
    }
    let stations = DEFAULT_STATIONS.map(|StationPlace { name, degrees, height_m }| {
        json!({"name": name, "lat": degrees[0], "long": degrees[1], "elev": height_m})
    });
    Ok(json!({
        "utc_init": member(member(recording, "initial")?, "utc_init")?,
        "groundStationsData": stations,
        "groundLocationPlanetRadius": EARTH_RADIUS_M,
        "gsMinimumElevation": 10.0_f64.to_radians(),
        "gsMaximumRange": -1,
    }))
}

fn property(name: &str, norm: f64) -> Value {
    let suffix = if norm == 1.0 { "" } else { "_normd" };
    json!({"prop": name, "norm": norm, "name": format!("{name}{suffix}")})
}

/// Name of the only satellite of a scanning recording.
const SCANNER: &str = "scanner";

/// The scanning environment of Stephenson and Schaub's paper.
fn scanning(recording: &Value) -> ReadResult<Value> {
    const ORBIT_S: f64 = 5700.0;
    const LIMIT_S: f64 = 28_500.0;
    let action = |class: &str, duration: f64| json!({"type": class, "name": class, "duration": duration});
    let observations = json!([
        {"type": "SatProperties", "name": "sat_props", "properties": [
            property("storage_level_fraction", 1.0),
            property("battery_charge_fraction", 1.0),
            property("wheel_speeds_fraction", 1.0),
            property("instrument_pointing_error", std::f64::consts::PI),
            property("solar_pointing_error", std::f64::consts::PI),
        ]},
        {"type": "OpportunityProperties", "name": "ground_station", "opportunity_type": "ground_station",
         "n_ahead_observe": 1,
         "properties": [property("opportunity_open", ORBIT_S), property("opportunity_close", ORBIT_S)]},
        {"type": "Eclipse", "name": "eclipse", "norm": ORBIT_S},
        {"type": "Time", "name": "time", "norm": null, "observe_time_remaining": false},
    ]);
    let satellite = json!({
        "name": SCANNER, "type": "AccessSatellite", "variable_interval": true, "generation_duration": 600.0,
        "initial_generation_duration": null, "max_generation_duration_beyond_initial": null,
        "dyn": ["ContinuousImagingDynModel", "GroundStationDynModel"], "fsw": ["ContinuousImagingFSWModel"],
        "sat_args": member(recording, "sat_args_realized")?,
        "actions": [action("Scan", 180.0), action("Charge", 120.0), action("Downlink", 60.0), action("Desat", 60.0)],
        "observations": observations,
        "initial": state(&recording["initial"], "STORED DATA")?,
    });
    let steps = match recording.get("steps") {
        Some(_) => list_of(recording, "steps")?.iter().map(scanning_step).collect::<ReadResult<Vec<_>>>()?,
        None => Vec::new(),
    };
    Ok(json!({
        "format": "bsk-rl-recording", "version": 1, "seed": recording["seed"],
        "env": {
            "cls": "SatelliteTasking", "sim_rate": 1.0, "max_step_duration": 1e9, "time_limit": LIMIT_S,
            "failure_penalty": -1.0, "terminate_on_time_limit": true,
            "rewarders": [{"type": "ScanningTimeReward"}],
            "communicator": {"types": ["NoCommunication"], "min_period": 0.0},
            "scenario": {"type": "UniformNadirScanning", "value_per_second": 1.0 / LIMIT_S},
        },
        "world_args": world_args(recording)?,
        "satellites": [satellite],
        "targets": [],
        "initial": initial(recording, &json!({SCANNER: recording["initial"]["observation"]})),
        "steps": steps,
        "opportunities": scanning_opportunities(recording),
        "station_positions": recording["ground_station_positions_P_m"],
        "eclipse_sampled": recording["eclipse_sampled"],
        "final": recording["final"],
    }))
}

/// Sky, flags and observations of the reset.
fn initial(recording: &Value, observation: &Value) -> Value {
    let initial = &recording["initial"];
    json!({
        "observation": observation,
        "info": initial["info"],
        "sun_position_N_m": initial["sun_position_N_m"],
        "PN_dcm": initial["PN_dcm"],
    })
}

fn scanning_opportunities(recording: &Value) -> Value {
    let Some(windows) = recording.get("ground_station_windows").and_then(Value::as_array) else {
        return Value::Null;
    };
    let rows: Vec<Value> = windows
        .iter()
        .map(|window| json!(["ground_station", window["station"], window["open"], window["close"]]))
        .collect();
    json!({SCANNER: {"windows": rows, "window_calculation_time": recording["window_calculation_end"]}})
}

fn scanning_step(step: &Value) -> ReadResult<Value> {
    let alive = step["alive"].as_bool().unwrap_or(true);
    let returned = number_of(step, "reward")?;
    let paid = if alive { returned } else { returned + 1.0 };
    Ok(json!({
        "t_start": step["t_start"], "t_end": step["t_end"], "actions": {SCANNER: step["action"]},
        "reward": {SCANNER: paid}, "returned": returned,
        "terminated": step["terminated"], "truncated": step["truncated"],
        "info": step["info"], "alive": {SCANNER: alive},
        "states": {SCANNER: state(step, "STORED DATA")?},
        "observation": {SCANNER: step["observation"]},
    }))
}

/// Fields of a state that the current format leaves out, or has under the same name.
const STATE_FIELDS: [&str; 16] = [
    "sigma_BN",
    "omega_BN_B",
    "wheel_speeds_rad_s",
    "wheel_speeds_fraction",
    "r_BN_N",
    "v_BN_N",
    "battery_charge_fraction",
    "storage_level_fraction",
    "net_power_W",
    "illumination_factor",
    "instrument_pointing_error_rad",
    "solar_pointing_error_rad",
    "next_eclipse_start",
    "next_eclipse_end",
    "checks",
    "next_ground_station",
];

/// The state of a satellite. `partition` is the only one of its storage.
fn state(recorded: &Value, partition: &str) -> ReadResult<Value> {
    let mut state: Map<String, Value> = STATE_FIELDS
        .iter()
        .filter_map(|field| recorded.get(*field).map(|value| ((*field).to_owned(), value.clone())))
        .collect();
    state.insert("battery_Ws".to_owned(), member(recorded, "battery_charge_Ws")?.clone());
    state.insert("storage".to_owned(), json!({partition: member(recorded, "storage_level_bits")?}));
    Ok(Value::Object(state))
}

/// Three imaging satellites with 1 000 targets.
fn imaging(recording: &Value) -> ReadResult<Value> {
    let args =
        member(recording, "sat_args_realized")?.as_object().ok_or("`sat_args_realized` is not an object")?;
    let names: Vec<&String> = args.keys().collect();
    let first = names.first().ok_or("`sat_args_realized` has no satellite")?;
    let observations = json!([{
        "type": "OpportunityProperties", "name": "target", "opportunity_type": "target", "n_ahead_observe": 10,
        "properties": [property("priority", 1.0), property("opportunity_open", 5700.0)],
    }]);
    let satellites: Vec<Value> = args
        .iter()
        .map(|(name, args)| {
            Ok(json!({
                "name": name, "type": "ImagingSatellite", "variable_interval": true, "generation_duration": 600.0,
                "initial_generation_duration": null, "max_generation_duration_beyond_initial": null,
                "dyn": ["FullFeaturedDynModel"], "fsw": ["SteeringImagerFSWModel"], "sat_args": args,
                "actions": [{"type": "Image", "name": "action_image", "n_ahead_image": 10, "max_duration": null}],
                "observations": observations,
                "initial": state(&recording["initial"]["satellites"][name], "image_buffer")?,
            }))
        })
        .collect::<ReadResult<_>>()?;
    let steps = match recording.get("steps") {
        Some(_) => list_of(recording, "steps")?
            .iter()
            .map(|step| imaging_step(step, &names))
            .collect::<ReadResult<Vec<_>>>()?,
        None => Vec::new(),
    };
    let limit = recording.get("env").map_or(Value::Null, |env| env["time_limit"].clone());
    Ok(json!({
        "format": "bsk-rl-recording", "version": 1, "seed": recording["seed"],
        "env": {
            "cls": recording.get("api").cloned().unwrap_or_else(|| json!("GeneralSatelliteTasking")),
            "sim_rate": 1.0, "max_step_duration": 1e9, "time_limit": limit, "failure_penalty": -1.0,
            "terminate_on_time_limit": false, "rewarders": [{"type": "UniqueImageReward"}],
            "communicator": {"types": ["LOSCommunication"], "min_period": 0.0},
            "scenario": {"type": "UniformTargets"},
        },
        "world_args": world_args(recording)?,
        "satellites": satellites,
        "targets": recording.get("targets").cloned().map_or_else(|| trace_targets(recording), Ok)?,
        "initial": initial(recording, &by_name(&recording["initial"]["observation"], &names)),
        "steps": steps,
        "opportunities": imaging_opportunities(recording),
        "station_positions": recording["satellites"][first]["ground_station_positions_P_m"],
        "final": recording["final"],
    }))
}

/// Targets that a trace mentions, in the order of their first action.
fn trace_targets(recording: &Value) -> ReadResult<Value> {
    let mut targets: Vec<Value> = Vec::new();
    for action in list_of(recording, "actions")? {
        for target in list_of(action, "targets")?.iter().filter(|target| !target.is_null()) {
            if !targets.iter().any(|known| known["name"] == target["name"]) {
                targets.push(target.clone());
            }
        }
    }
    Ok(Value::Array(targets))
}

/// A list by satellite, or an object, as an object.
fn by_name(value: &Value, names: &[&String]) -> Value {
    match value {
        Value::Array(items) => {
            let members: Map<String, Value> =
                names.iter().map(|name| (*name).clone()).zip(items.iter().cloned()).collect();
            Value::Object(members)
        }
        other => other.clone(),
    }
}

fn imaging_opportunities(recording: &Value) -> Value {
    let mut rows = Map::new();
    for (name, satellite) in recording.get("satellites").and_then(Value::as_object).into_iter().flatten() {
        let Some(opportunities) = satellite.get("opportunities").and_then(Value::as_array) else {
            return Value::Null;
        };
        let windows: Vec<Value> = opportunities
            .iter()
            .map(|item| json!([item["type"], item["object"], item["open"], item["close"]]))
            .collect();
        let end = &satellite["window_calculation_time"];
        rows.insert(name.clone(), json!({"windows": windows, "window_calculation_time": end}));
    }
    Value::Object(rows)
}

fn imaging_step(step: &Value, names: &[&String]) -> ReadResult<Value> {
    let mut states = Map::new();
    for (name, recorded) in member(step, "states")?.as_object().into_iter().flatten() {
        states.insert(name.clone(), state(recorded, "image_buffer")?);
    }
    Ok(json!({
        "t_start": step["t_start"], "t_end": step["t_end"], "actions": step["actions"], "selected": step["selected"],
        "reward": step["reward_by_satellite"], "returned": step["reward"],
        "terminated": step["terminated"], "truncated": step["truncated"],
        "required_retasking_before": step["required_retasking_before"],
        "requires_retasking": step["requires_retasking"], "info": step["info"], "d_ts": step["d_ts"],
        "imaged": step["imaged_count"], "missed": step["missed_count"], "newly_imaged": step["newly_imaged"],
        "known_imaged": step["known_imaged_after_comm"], "pairs": step["communication_pairs"],
        "states": states,
        "observation": by_name(&step["observation"], names),
    }))
}
