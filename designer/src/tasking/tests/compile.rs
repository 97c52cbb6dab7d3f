//! Compiled designs start as they say, wherever the seed puts the rest.

use env_core::tasking::task::forecast::TaskingForecast;
use env_core::tasking::task::layout::TaskingLayout;
use proptest::prelude::*;

use super::*;
use crate::angles::angle_between;
use crate::tasking::vocabulary::{
    BATTERY, DAY, MINUTE, NODE_HOUR, OFFSET, SPREAD, START_ANGLE, STORAGE, TARGETS, UTC_MINUTE, WHEELS,
};
use crate::tasking::{DesignedStart, TargetField, TaskingDesign, compile};

/// Any start within the bounds.
fn start() -> impl Strategy<Value = DesignedStart> {
    (
        DAY.min..=DAY.max,
        UTC_MINUTE.min..=UTC_MINUTE.max,
        NODE_HOUR.min..=NODE_HOUR.max,
        START_ANGLE.min..=START_ANGLE.max,
        BATTERY.min..=BATTERY.max,
        WHEELS.min..=WHEELS.max,
        STORAGE.min..=STORAGE.max,
    )
        .prop_map(
            |(
                day,
                utc_minute,
                node_hour,
                start_angle_deg,
                battery_percent,
                wheels_percent,
                storage_percent,
            )| {
                DesignedStart {
                    day,
                    utc_minute,
                    node_hour,
                    start_angle_deg,
                    battery_percent,
                    wheels_percent,
                    storage_percent,
                }
            },
        )
}

/// Any field within the bounds, in an episode of 145 minutes.
fn field() -> impl Strategy<Value = TargetField> {
    (
        MINUTE.min..=140,
        OFFSET.min..=OFFSET.max,
        SPREAD.min..=SPREAD.max,
        TARGETS.min..=TARGETS.max,
        1..=50_i32,
    )
        .prop_map(|(minute, offset_km, spread_km, targets, priority_low)| TargetField {
            satellite: 0,
            minute,
            offset_km,
            spread_km,
            targets,
            priority_low,
            priority_high: 2 * priority_low,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn compiled_start_is_what_the_design_says(
        task in prop::sample::select(TASKS.to_vec()),
        seed in 0u64..1000,
        start in start(),
        field in field(),
    ) {
        let base = brief_at_level(task, 2, seed).base_scenario(0);
        let mut design = TaskingDesign::from_json(&design_json(task, "idle")).unwrap();
        design.start = start;
        if task != SCANNING {
            design.fields = vec![field];
        }
        let compiled = compile(&design, &base).unwrap();
        let scenario = stored(&compiled.scenario);
        let sky = TaskingForecast::of_scenario(&scenario).unwrap();
        let path = &sky.satellites[0];
        // The Sun is seen from the satellite, and nodes are of the frame of date: hundredths of a degree.
        prop_assert!(angle_between(path.track[0].orbit_angle_deg, f64::from(start.start_angle_deg)) < 0.1);
        let resources = &path.resources;
        prop_assert!((100.0 * resources.charge_wh / resources.battery_wh - f64::from(start.battery_percent)).abs() < 1e-9);
        prop_assert!((100.0 * resources.wheel_share - f64::from(start.wheels_percent)).abs() < 1e-9);
        // Data are whole bits.
        prop_assert!((100.0 * resources.stored_bits / resources.storage_bits - f64::from(start.storage_percent)).abs() < 1e-6);
        let epoch = TaskingLayout::of_scenario(&scenario).unwrap().epoch.unwrap();
        prop_assert_eq!((epoch.day, epoch.second), (start.day as u32, 60.0 * f64::from(start.utc_minute)));
        if task != SCANNING {
            prop_assert_eq!(sky.targets.len(), field.targets as usize);
            let [x, y, z] = path.point_at(60.0 * f64::from(field.minute)).unwrap().direction;
            for target in &sky.targets {
                let (sin_latitude, cos_latitude) = libm::sincos(target.latitude_deg.to_radians());
                let (sin_longitude, cos_longitude) = libm::sincos(target.longitude_deg.to_radians());
                let cosine = cos_latitude * (cos_longitude * x + sin_longitude * y) + sin_latitude * z;
                let away_km = 6378.0 * libm::acos(cosine.clamp(-1.0, 1.0));
                let most = f64::from(field.offset_km.abs() + field.spread_km);
                prop_assert!(away_km <= most + 2.0, "{away_km} of {most}");
                let priorities = f64::from(field.priority_low) / 100.0..=f64::from(field.priority_high) / 100.0;
                prop_assert!(priorities.contains(&target.priority));
            }
        }
    }
}

/// A field to the right of a satellite that flies east is in the south.
#[test]
fn fields_are_to_the_right_of_the_motion() {
    let base = brief_at_level(IMAGING, 2, 3).base_scenario(0);
    let mut design = TaskingDesign::from_json(&design_json(IMAGING, "idle")).unwrap();
    let sky = compile(&design, &base).unwrap().forecast;
    // At its northernmost point the satellite flies east.
    let track = &sky.satellites[0].track;
    let north = track.iter().max_by(|a, b| a.direction[2].total_cmp(&b.direction[2])).unwrap();
    let (_, latitude) = north.place();
    for (offset_km, sign) in [(400, -1.0), (-400, 1.0)] {
        let minute = (north.time_s / 60.0) as i32;
        let field = TargetField { minute, offset_km, spread_km: 1, targets: 1, ..design.fields[0] };
        design.fields = vec![field];
        let target = compile(&design, &base).unwrap().forecast.targets[0];
        let moved_km = 111.2 * (target.latitude_deg - latitude);
        assert!((moved_km - 400.0 * sign).abs() < 40.0, "{offset_km}: {moved_km}");
    }
}

#[test]
fn impossible_designs_are_refused_by_field() {
    let base = brief_at_level(SCANNING, 7, 1).base_scenario(0);
    let mut design = TaskingDesign::from_json(&design_json(SCANNING, "idle")).unwrap();
    let refused = |design: &TaskingDesign, base: &Scenario| compile(design, base).unwrap_err().field;
    design.outages = vec![5];
    assert_eq!(refused(&design, &base), "outages", "the level has 5 stations");
    design.outages = vec![0, 1, 2, 3, 4];
    assert_eq!(refused(&design, &base), "outages", "one must stay");
    design.outages.clear();
    design.fields = TaskingDesign::from_json(&design_json(IMAGING, "idle")).unwrap().fields;
    assert_eq!(refused(&design, &base), "fields", "scanning has no targets");
    let base = brief_at_level(CONSTELLATION, 2, 1).base_scenario(0);
    let fields = design.fields.clone();
    design.fields[1].satellite = 3;
    assert_eq!(refused(&design, &base), "fields.1.satellite");
    design.fields = vec![fields[0], TargetField { minute: 900, ..fields[1] }];
    assert_eq!(refused(&design, &base), "fields.1.minute");
    design.fields = vec![fields[0], fields[0]];
    assert_eq!(refused(&design, &base), "fields.1");
    design.fields.clear();
    design.keeps_background = false;
    assert_eq!(refused(&design, &base), "fields");
    design.params.insert("battery_wh".to_owned(), -1.0);
    assert_eq!(refused(&design, &base), "params.battery_wh");
}
