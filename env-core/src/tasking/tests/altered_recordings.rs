//! A change of any recorded value beyond its tolerance is found.

use serde_json::{Value, json};

use super::recordings::{load, recordings, reference};
use crate::tasking::recording::compare_recording;

/// A change of a number of a recording, and how the message about the first difference begins.
struct Alteration {
    /// Place of the number in the recording.
    pointer: &'static str,
    /// Number that is added; the value is negated if it is a truth value.
    change: f64,
    message: &'static str,
}

const fn alter(pointer: &'static str, change: f64, message: &'static str) -> Alteration {
    Alteration { pointer, change, message }
}

/// Asserts that each change of a recording is found in its step, and that the recording replays without.
fn assert_found(recording: &Value, step: usize, alterations: &[Alteration]) {
    assert_eq!(compare_recording(recording, 0.0).unwrap().first, None);
    for Alteration { pointer, change, message } in alterations {
        let mut altered = recording.clone();
        let value = altered.pointer_mut(pointer).unwrap_or_else(|| panic!("there is no {pointer}"));
        *value = match *value {
            Value::Bool(flag) => json!(!flag),
            ref number if number.is_u64() => json!(number.as_u64().unwrap() + *change as u64),
            ref number => json!(number.as_f64().unwrap_or_else(|| panic!("{pointer} is no number")) + change),
        };
        let first = compare_recording(&altered, 0.0).unwrap().first;
        let first = first.unwrap_or_else(|| panic!("the change of {pointer} is not found"));
        assert!(first.what.starts_with(message), "{pointer}: {}", first.what);
        assert!(first.step == step || pointer.starts_with("/final"), "{pointer}: step {}", first.step);
    }
}

/// Keeps the first steps of a recording, so that its replay is short.
fn shorten(mut recording: Value, steps: usize) -> Value {
    recording["steps"].as_array_mut().unwrap().truncate(steps);
    recording["final"] = Value::Null;
    recording["opportunities"] = Value::Null;
    recording
}

#[test]
fn altered_steps_of_scanning_are_found() {
    let recording = shorten(reference("a_random_seed0"), 4);
    assert_found(
        &recording,
        4,
        &[
            alter("/steps/3/t_start", 1e-3, "start of the step"),
            alter("/steps/3/info/d_ts", 1e-3, "duration of the step"),
            alter("/steps/3/info/requires_retasking", 0.0, "requires_retasking in info"),
            alter("/steps/3/v_BN_N/1", 0.01, "velocity of"),
            alter("/steps/3/net_power_W", 0.1, "net power of"),
            alter("/steps/3/illumination_factor", -0.01, "illumination of"),
            alter("/steps/3/battery_charge_fraction", 1e-4, "battery_charge_fraction of"),
            alter("/steps/3/storage_level_fraction", 1e-9, "storage_level_fraction of"),
            alter("/steps/3/wheel_speeds_fraction/0", 1e-3, "share of a wheel's limit of"),
            alter("/steps/3/instrument_pointing_error_rad", 1e-3, "instrument_pointing_error_rad of"),
            alter("/steps/3/solar_pointing_error_rad", 1e-3, "solar_pointing_error_rad of"),
            alter("/steps/3/checks/battery_valid", 0.0, "battery_valid of"),
            alter("/steps/3/next_eclipse_start", 30.0, "next eclipse of"),
            alter("/steps/3/next_ground_station/open", 0.2, "opening of the next window"),
            // Values that are divided by 5 700 s.
            alter(
                "/steps/3/observation/7",
                0.15 / 5700.0,
                "ground_station.ground_station_0.opportunity_open",
            ),
            alter(
                "/steps/3/observation/8",
                0.15 / 5700.0,
                "ground_station.ground_station_0.opportunity_close",
            ),
            alter("/steps/3/observation/9", 0.5 / 5700.0, "eclipse[0]"),
            alter("/steps/3/observation/10", 0.5 / 5700.0, "eclipse[1]"),
            alter("/steps/3/observation/1", 1e-5, "sat_props.battery_charge_fraction"),
            alter("/steps/3/observation/5", 1e-3, "sat_props.instrument_pointing_error"),
        ],
    );
}

#[test]
fn altered_resets_and_totals_of_scanning_are_found() {
    let recording = reference("a_random_seed1");
    assert_found(
        &recording,
        0,
        &[
            alter("/initial/observation/0", 1e-6, "sat_props.storage_level_fraction"),
            alter("/initial/observation/9", 0.5 / 5700.0, "eclipse[0]"),
            alter("/initial/info/requires_retasking", 0.0, "requires_retasking of"),
            alter("/initial/sun_position_N_m/0", 1e6, "direction of the Sun"),
            alter("/initial/PN_dcm/0/1", 1e-9, "rotation of the Earth"),
            alter("/initial/battery_charge_Ws", 2.0, "battery of"),
            alter(
                "/ground_station_positions_P_m/GroundStationHawaii/0",
                1.0,
                "position of GroundStationHawaii",
            ),
            alter("/final/cum_reward_data", 1e-4, "`cum_reward_data`"),
            alter("/final/total_return", 1e-4, "`total_return`"),
            alter("/final/sim_time", 1.0, "end of the episode"),
        ],
    );
    let steps = recording["steps"].as_array().unwrap().len();
    assert_found(
        &recording,
        steps,
        &[
            alter("/eclipse_sampled/illumination_factor/100", 0.5, "illumination of sample 100"),
            alter("/ground_station_windows/2/open", 0.2, "opening of the window of GroundStation"),
        ],
    );
}

#[test]
fn altered_steps_of_imaging_are_found() {
    let mut recording = reference("b_pz_seed0");
    recording["steps"].as_array_mut().unwrap().truncate(3);
    recording["satellites"]["EO_1"]["opportunities"] = Value::Null;
    recording["final"] = Value::Null;
    assert_found(
        &recording,
        3,
        &[
            alter("/steps/2/d_ts", 1e-3, "duration of the step"),
            alter("/steps/2/info/EO_3/d_ts", 1e-3, "duration of the step"),
            alter("/steps/2/info/__common__/d_ts", 1e-3, "duration of the step"),
            alter("/steps/2/info/EO_3/requires_retasking", 0.0, "requires_retasking in info of EO_3"),
            alter("/steps/2/required_retasking_before/EO_2", 0.0, "need of an action before of EO_2"),
            alter("/steps/2/states/EO_2/v_BN_N/0", 0.01, "velocity of EO_2"),
            alter("/steps/2/states/EO_2/battery_charge_fraction", 1e-6, "battery_charge_fraction of EO_2"),
            // Openings are divided by 5 700 s.
            alter("/steps/2/observation/EO_1/1", 0.1 / 5700.0, "target.target_0.opportunity_open"),
            alter("/steps/2/observation/EO_1/4", 5e-5, "target.target_2.priority"),
            alter("/steps/2/reward_by_satellite/EO_2", 1e-6, "reward of EO_2"),
        ],
    );
    let first = recording["steps"][0]["selected"]["EO_1"].is_object();
    assert!(first, "the first step chooses a target");
    recording["steps"].as_array_mut().unwrap().truncate(1);
    assert_found(
        &recording,
        1,
        &[
            alter("/steps/0/selected/EO_1/open", 100.0, "opening of the window that EO_1 chose"),
            alter("/steps/0/selected/EO_1/close", 0.1, "close of the window that EO_1 chose"),
        ],
    );
    // A satellite that chose a target without a recorded one.
    recording["steps"][0]["selected"]["EO_1"] = Value::Null;
    let first = compare_recording(&recording, 0.0).unwrap().first.unwrap();
    assert!(first.what.starts_with("target of EO_1"), "{}", first.what);
}

#[test]
fn altered_totals_of_imaging_are_found() {
    let recording = reference("b_los_pz_seed10");
    assert_found(
        &recording,
        75,
        &[
            alter("/final/cum_reward/EO_2", 1e-4, "sum of the rewards of EO_2"),
            alter("/final/unique_imaged", 1.0, "number of imaged targets"),
            alter("/satellites/EO_3/opportunities/5/close", 0.05, "close of the window of"),
        ],
    );
}

#[test]
fn altered_ticks_of_traces_are_found() {
    let scanning = reference("a_trace1hz_seed42");
    assert_found(
        &scanning,
        101,
        &[
            alter("/panel_power_W/100", 0.1, "panel_power of"),
            alter("/illumination/100", -0.01, "illumination of"),
            alter("/cmd_torque_Nm/100/0", 1e-3, "motor_torque of"),
            alter("/guid_sigma_BR/100/1", 1e-4, "guidance of"),
            alter("/v_BN_N/100/2", 0.01, "velocity of"),
        ],
    );
    let imaging = reference("b_trace1hz_seed7");
    assert_found(
        &imaging,
        201,
        &[
            alter("/satellites/EO_2/target_elevation/200", 1e-3, "elevation of EO_2"),
            alter("/satellites/EO_2/target_range/200", 10.0, "range of EO_2"),
            alter("/satellites/EO_2/target_access/200", 1.0, "target access of EO_2"),
            alter("/satellites/EO_2/guid_sigma_BR/200/0", 1e-4, "guidance of EO_2"),
        ],
    );
    let mut image = imaging.clone();
    image["actions"][0]["imaged"]["EO_2"] = json!([]);
    let first = compare_recording(&image, 0.0).unwrap().first.unwrap();
    assert_eq!((first.step, first.what.starts_with("images of EO_2")), (1, true), "{}", first.what);
}

#[test]
fn altered_recordings_of_the_current_format_are_found() {
    let path = recordings("recorded").into_iter().find(|path| path.ends_with("all_observations.json.gz"));
    let recording = shorten(load(&path.unwrap()), 3);
    assert_found(
        &recording,
        0,
        &[
            alter("/satellites/0/initial/v_BN_N/0", 0.01, "velocity of EO"),
            alter("/satellites/0/initial/battery_Ws", 2.0, "battery of EO"),
            alter("/initial/observation/EO/0", 5e-5, "sat_props.sigma_BN[0]"),
        ],
    );
}
