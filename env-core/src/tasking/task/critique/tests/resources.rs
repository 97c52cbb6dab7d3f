//! Faults with power, wheels, storage and time.

use super::{RICH_SCANNER, SCANNING, critique_by, critique_of, fly, measured, of_mode, scenario, start};
use crate::critique::{Critique, Verdict};
use crate::tasking::access::OpportunityKind;
use crate::tasking::task::critique::TaskingTrace;
use crate::tasking::task::run::TaskRun;

const SCAN: usize = 0;
const CHARGE: usize = 1;
const DOWNLINK: usize = 2;
const DESATURATE: usize = 3;

/// Scans, and charges in sunlight below half of the battery.
fn careful(run: &mut TaskRun, agent: usize) -> Option<usize> {
    let telemetry = run.satellite_telemetry(agent);
    let is_dark = telemetry.eclipse_end_s < telemetry.eclipse_start_s;
    Some(if telemetry.battery < 0.5 && !is_dark { CHARGE } else { SCAN })
}

fn none_of(critique: &Critique, modes: &[&str]) {
    for mode in modes {
        assert!(of_mode(critique, mode).is_empty(), "{:?}", of_mode(critique, mode));
    }
}

#[test]
fn an_empty_battery_reports_its_losses_and_the_last_chance() {
    let poor = [("battery_wh", 40.0), ("panel_m2", 0.3), ("charge_min", 0.6), ("charge_max", 0.6)];
    let scenario = scenario(SCANNING, &RICH_SCANNER, &poor, 3);
    let critique = critique_by(&scenario, |_, _| Some(SCAN));
    let [failure] = of_mode(&critique, "power")[..] else { panic!("{:?}", critique.failures) };
    assert!((measured(failure, "charge") - 24.0).abs() < 5.0, "{failure:?}");
    assert!(measured(failure, "empty_from") <= measured(failure, "time"));
    assert!(measured(failure, "since") < measured(failure, "empty_from"));
    // The panel points away from the Sun for long while scanning; nothing fires the thrusters.
    assert!(measured(failure, "mispointing") > 1.0, "{failure:?}");
    assert_eq!(measured(failure, "thrusters"), 0.0);
    // Charging from that time on is what the replay below does; the satellite lives.
    let last_chance = measured(failure, "last_chance");
    let charged = fly(&scenario, |run, _| Some(if run.sim.time_s() < last_chance { SCAN } else { CHARGE }));
    none_of(&critique_of(&scenario, &charged), &["power"]);
    assert_eq!((critique.assessment.value, critique.assessment.case), (-1.0, "all_dead"));
    let sector_deg = failure.sector_deg().unwrap();
    assert!(sector_deg % 30.0 == 0.0 && (0.0..360.0).contains(&sector_deg), "{sector_deg}");
    assert!(failure.explanation.contains("W·h") && failure.explanation.contains("would have kept it alive"));
}

#[test]
fn a_charged_battery_is_no_failure() {
    none_of(&critique_by(&scenario(SCANNING, &RICH_SCANNER, &[], 3), careful), &["power", "wheels", "other"]);
}

/// The parts into which a trace splits power are those of the panel in full sunlight.
#[test]
fn losses_of_power_add_up_to_a_full_panel() {
    let params = [("panel_m2", 0.25), ("battery_wh", 2000.0), ("charge_min", 0.5), ("charge_max", 0.5)];
    let scenario = scenario(SCANNING, &RICH_SCANNER, &params, 8);
    let log =
        fly(&scenario, |run, _| Some([SCAN, CHARGE, DESATURATE, DOWNLINK][run.sim.steps() as usize % 4]));
    let trace = TaskingTrace::replay(&scenario, &log).unwrap();
    let samples = &trace.satellites[0].samples;
    assert_eq!(samples.len() as u64, trace.end() + 1);
    let full_w = 1361.0 * 0.25 * 0.2;
    for pair in samples.windows(2) {
        let [before, now] = [pair[0], pair[1]];
        let drawn = [now.thrusters_w, now.wheels_w, now.devices_w].map(f64::from).iter().sum::<f64>();
        let lost = f64::from(now.eclipse_w) + f64::from(now.mispointing_w);
        let panel_w = f64::from(now.battery_j) - f64::from(before.battery_j) + drawn + lost;
        // The distance of the Sun varies by 1.7 %, its flux by 3.4 %; a charge of 3.6 MJ is stored to 0.25 J.
        assert!((panel_w / full_w - 1.0).abs() < 0.045, "{panel_w} W {pair:?}");
    }
}

#[test]
fn a_fast_wheel_reports_the_sources_of_its_momentum() {
    let wild = [("disturbance_mnm", 10.0), ("wheel_rpm", 3000.0)];
    let scenario = scenario(SCANNING, &RICH_SCANNER, &wild, 4);
    let critique = critique_by(&scenario, |_, _| Some(SCAN));
    let [failure] = of_mode(&critique, "wheels")[..] else { panic!("{:?}", critique.failures) };
    let speed = measured(failure, "speed");
    let sources = ["at_start", "disturbance", "turns", "thrusters"].map(|name| measured(failure, name));
    assert!(speed >= measured(failure, "limit"), "{failure:?}");
    assert!((sources.iter().sum::<f64>() - speed).abs() < 1e-6, "{failure:?}");
    assert_eq!(sources[3], 0.0, "nothing desaturated the wheels");
    let wheel = measured(failure, "wheel") as usize;
    let args = &start(&scenario).sim.satellite(0).spec().args.clone();
    let rpm = args.disturbance_n_m[wheel].abs() * measured(failure, "time") * 6000.0 / 50.0;
    assert!((sources[1].abs() - rpm).abs() < 1e-6, "{rpm} of {failure:?}");
    assert!((sources[0].abs() - args.wheel_speeds_rpm[wheel].abs()).abs() < 1e-9, "{failure:?}");
    none_of(&critique_by(&scenario_without_disturbance(), |_, _| Some(SCAN)), &["wheels"]);
}

fn scenario_without_disturbance() -> crate::task::Scenario {
    scenario(SCANNING, &RICH_SCANNER, &[], 4)
}

#[test]
fn thrusters_are_a_source_of_momentum() {
    let wild = [("disturbance_mnm", 10.0), ("wheel_rpm", 4000.0)];
    let scenario = scenario(SCANNING, &RICH_SCANNER, &wild, 4);
    let critique =
        critique_by(&scenario, |run, _| Some(if run.sim.steps() == 1 { DESATURATE } else { SCAN }));
    let [failure] = of_mode(&critique, "wheels")[..] else { panic!("{:?}", critique.failures) };
    assert!(measured(failure, "thrusters").abs() > 1.0, "{failure:?}");
}

#[test]
fn a_full_storage_reports_the_lost_scans_and_the_missed_pass() {
    let small = [("storage_gbit", 2.0)];
    let scenario = scenario(SCANNING, &RICH_SCANNER, &small, 6);
    let critique = critique_by(&scenario, |_, _| Some(SCAN));
    let [full] = of_mode(&critique, "full")[..] else { panic!("{:?}", critique.failures) };
    // 2 Gbit are 500 s of scanning at 4 Mbit/s. Turning to nadir takes the first minutes.
    let scanned_s = 12_000.0 - measured(full, "scanned");
    assert!((500.0..900.0).contains(&scanned_s), "{full:?}");
    assert!(measured(full, "next_pass") > 0.0 && full.explanation.contains("next pass"), "{full:?}");
    let [missed] = of_mode(&critique, "pass_missed")[..] else { panic!("{:?}", critique.failures) };
    let (open, close) = (measured(missed, "open"), measured(missed, "close"));
    assert!((measured(missed, "unused") - (close - open)).abs() <= 1.5, "{missed:?}");
    assert_eq!(measured(missed, "full_from"), measured(full, "time") - 1.0);
    let run = start(&scenario);
    let passes = run.sim.opportunities(0).upcoming(OpportunityKind::GroundStation, 0.0);
    let longest = passes.iter().map(|pass| pass.close_s.min(12_000.0) - pass.open_s).fold(0.0, f64::max);
    assert!((longest - (close - open)).abs() < 1e-9, "the longest pass is reported");
}

#[test]
fn used_passes_and_a_large_storage_are_no_failures() {
    let small = scenario(SCANNING, &RICH_SCANNER, &[("storage_gbit", 2.0)], 6);
    let sends = |run: &mut TaskRun, _: usize| {
        let telemetry = run.satellite_telemetry(0);
        Some(if telemetry.station_open_s <= 0.0 { DOWNLINK } else { SCAN })
    };
    let critique = critique_by(&small, sends);
    assert!(!of_mode(&critique, "full").is_empty(), "the storage is full between passes");
    let unused = of_mode(&critique, "pass_missed").iter().map(|f| measured(f, "unused")).fold(0.0, f64::max);
    // A scan of 180 s that began before the pass goes on in it.
    assert!(unused < 180.0, "{unused}");
    let large = scenario(SCANNING, &RICH_SCANNER, &[], 6);
    none_of(&critique_by(&large, |_, _| Some(SCAN)), &["full", "pass_missed", "idle"]);
}

#[test]
fn idle_actions_are_merged_and_measured() {
    let full_battery = [("charge_min", 1.0), ("charge_max", 1.0)];
    let scenario_full = scenario(SCANNING, &RICH_SCANNER, &full_battery, 2);
    let critique =
        critique_by(&scenario_full, |run, _| Some(if run.sim.time_s() < 5000.0 { SCAN } else { CHARGE }));
    let idle = of_mode(&critique, "idle");
    assert!(idle.iter().any(|failure| failure.explanation.contains("battery was full")), "{idle:?}");
    assert!(idle.len() <= 4, "consecutive actions are one failure: {idle:?}");
    let slow =
        critique_by(&scenario_full, |run, _| Some(if run.sim.steps() == 3 { DESATURATE } else { SCAN }));
    let [failure] = of_mode(&slow, "idle")[..] else { panic!("{:?}", slow.failures) };
    assert_eq!((measured(failure, "idle"), failure.step), (60.0, 4));
    assert!(failure.explanation.contains("fastest wheel"), "{failure:?}");
}

#[test]
fn rest_in_eclipse_is_idle_unless_its_energy_is_needed() {
    let rests = |run: &mut TaskRun, agent: usize| {
        let telemetry = run.satellite_telemetry(agent);
        Some(if telemetry.eclipse_end_s < telemetry.eclipse_start_s { CHARGE } else { SCAN })
    };
    let rich = critique_by(&scenario(SCANNING, &RICH_SCANNER, &[], 3), rests);
    let idle = of_mode(&rich, "idle");
    assert!(idle.iter().any(|failure| failure.explanation.contains("in eclipse")), "{idle:?}");
    let poor = [("battery_wh", 60.0), ("panel_m2", 0.1), ("charge_min", 0.9), ("charge_max", 0.9)];
    let poor = critique_by(&scenario(SCANNING, &RICH_SCANNER, &poor, 3), rests);
    assert!(!of_mode(&poor, "power").is_empty(), "the test needs a battery that runs empty");
    assert!(of_mode(&poor, "idle").is_empty(), "{:?}", poor.failures);
}

#[test]
fn actions_that_kill_are_harmful() {
    let poor = [("battery_wh", 40.0), ("panel_m2", 0.5), ("charge_min", 0.5), ("charge_max", 0.5)];
    let scenario = scenario(SCANNING, &RICH_SCANNER, &poor, 3);
    // Charges for a while, and then scans until it dies: the scan that ends charging is harmful, its repetitions change nothing.
    let critique =
        critique_by(&scenario, |run, _| Some(if run.sim.time_s() < 600.0 { CHARGE } else { SCAN }));
    assert!(!of_mode(&critique, "power").is_empty(), "{:?}", critique.failures);
    let scans: Vec<_> = critique.actions.iter().filter(|action| action.step > 5).collect();
    assert_eq!(scans[0].verdict, Verdict::Harmful, "{:?}", scans[0]);
    assert!(scans[1..].iter().all(|action| action.verdict == Verdict::Harmless && action.gain == 0.0));
}
