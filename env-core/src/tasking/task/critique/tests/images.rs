//! Faults with targets and images.

use super::{CONSTELLATION, IMAGING, RICH_IMAGER, critique_by, fly, measured, of_mode, scenario, start};
use crate::task::{Recipe, Scenario};
use crate::tasking::task::critique::TaskingTrace;
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::telemetry::TargetTelemetry;

/// Index of the charge action of imagers.
const CHARGE: usize = 10;

/// Index of the upcoming target with the largest worth.
fn best(run: &mut TaskRun, agent: usize, worth: impl Fn(&TargetTelemetry) -> f64) -> Option<usize> {
    let targets = run.satellite_telemetry(agent).targets;
    let worths = targets.iter().map(worth).enumerate();
    worths.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

#[test]
fn missed_windows_report_the_slew_and_the_time_that_was_short() {
    let slow = [("omega_max_rad_s", 0.02), ("targets", 2500.0)];
    let scenario = scenario(IMAGING, &RICH_IMAGER, &slow, 5);
    let log = fly(&scenario, |run, agent| best(run, agent, |target| -target.close_s));
    let critique = super::critique_of(&scenario, &log);
    let missed = of_mode(&critique, "window_missed");
    assert!(!missed.is_empty(), "{:?}", critique.failures);
    for failure in missed {
        let (tasked, close) = (measured(failure, "tasked"), measured(failure, "close"));
        assert!(tasked < close && measured(failure, "time") >= close, "{failure:?}");
        assert!((measured(failure, "time") - close) <= 1.0, "the step ends at the close: {failure:?}");
        // At 0.02 rad/s a turn by the slew takes longer than the time that was left.
        let turn_s = measured(failure, "slew").to_radians() / 0.02;
        let available_s =
            close - tasked + failure.measures.iter().find(|m| m.name == "short").map_or(300.0, |m| m.value);
        assert!(available_s > 0.8 * turn_s, "{turn_s} s of {failure:?}");
    }
    let prepared = critique_by(&scenario_agile(), |run, agent| best(run, agent, |target| target.open_s));
    assert!(of_mode(&prepared, "window_missed").is_empty(), "{:?}", prepared.failures);
}

fn scenario_agile() -> Scenario {
    scenario(IMAGING, &RICH_IMAGER, &[], 5)
}

#[test]
fn images_of_low_value_name_a_target_that_was_reachable() {
    let scenario = scenario(IMAGING, &RICH_IMAGER, &[("targets", 2500.0)], 7);
    let critique = critique_by(&scenario, |run, agent| best(run, agent, |target| -target.priority));
    let low = of_mode(&critique, "low_value");
    assert!(!low.is_empty(), "{:?}", critique.failures);
    for failure in &low {
        assert!(measured(failure, "better_priority") >= measured(failure, "priority") + 0.1, "{failure:?}");
        // To task the better target instead does store its image.
        let mut run = start(&scenario);
        let better = measured(failure, "better_target") as usize;
        let mut imaged = Vec::new();
        while run.sim.time_s() < measured(failure, "time") + 60.0 && !run.is_done() {
            let is_late = run.sim.time_s() >= measured(failure, "tasked");
            let targets = run.sim.next_windows(0, crate::tasking::access::OpportunityKind::Target, 10);
            let wanted = targets.iter().position(|window| window.object == better).filter(|_| is_late);
            let index = wanted.or_else(|| best(&mut run, 0, |target| -target.priority));
            let actions = run.choose(|_| index);
            run.step(&actions);
            imaged.extend(run.last_step().imaged.iter().map(|[_, target]| *target));
        }
        assert!(imaged.contains(&better), "{failure:?}");
    }
    let greedy = critique_by(&scenario, |run, agent| best(run, agent, |target| target.priority));
    assert!(of_mode(&greedy, "low_value").is_empty(), "{:?}", greedy.failures);
}

fn pair(communication: &str) -> Scenario {
    let recipe = Recipe::with_params(
        super::task(CONSTELLATION),
        RICH_IMAGER.into_iter().chain([("satellites", 2.0), ("spacing_deg", 3.0)]),
    );
    let recipe = recipe.unwrap().with_option("communication", communication).unwrap();
    Scenario::new(recipe, crate::seed::Seed::user(9).unwrap())
}

#[test]
fn duplicates_tell_which_satellite_was_first() {
    let scenario = pair("none");
    let log = fly(&scenario, |run, agent| best(run, agent, |target| target.priority - 0.01 * target.open_s));
    let trace = TaskingTrace::replay(&scenario, &log).unwrap();
    let critique = super::critique_of(&scenario, &log);
    let duplicates = of_mode(&critique, "duplicate");
    assert!(!duplicates.is_empty(), "{:?}", critique.failures);
    let mut preventable = 0;
    for failure in &duplicates {
        let first = measured(failure, "first_satellite") as usize;
        let target = measured(failure, "target") as usize;
        assert_ne!(first as u32, failure.agent);
        let image = trace.satellites[first].images.iter().find(|image| image.target == target).unwrap();
        assert_eq!(trace.time_s(image.tick), measured(failure, "first_time"));
        assert!(measured(failure, "first_time") <= measured(failure, "time"));
        let is_preventable = measured(failure, "first_time") <= measured(failure, "tasked");
        assert_eq!(measured(failure, "preventable"), f64::from(u8::from(is_preventable)));
        preventable += usize::from(is_preventable);
    }
    assert!(preventable > 0, "without communication, satellites repeat what the others did: {duplicates:?}");
    // With communication, no duplicate is preventable; and a satellite that images nothing repeats nothing.
    let told = critique_by(&pair("free"), |run, agent| {
        best(run, agent, |target| target.priority - 0.01 * target.open_s)
    });
    assert!(of_mode(&told, "duplicate").iter().all(|failure| measured(failure, "preventable") == 0.0));
    let alone = critique_by(&scenario, |run, agent| match agent {
        0 => best(run, agent, |target| target.priority),
        _ => Some(CHARGE),
    });
    assert!(of_mode(&alone, "duplicate").is_empty(), "{:?}", alone.failures);
}

#[test]
fn images_that_find_no_room_are_counted() {
    let scenario = scenario(IMAGING, &RICH_IMAGER, &[("storage_images", 3.0)], 5);
    let critique = critique_by(&scenario, |run, agent| best(run, agent, |target| target.open_s));
    let full = of_mode(&critique, "full");
    assert!(!full.is_empty() && measured(full[0], "images") >= 1.0, "{:?}", critique.failures);
}
