//! Starts and fields of sampled designs. Each failure mode has a way to complete a draft, so that its aim is likely to match.

use std::collections::BTreeMap;

use env_core::tasking::task::forecast::{SatelliteForecast, TaskingForecast};
use env_core::{KeyedRng, Scenario};

use super::aim::{MAX_IDLE_WHEELS, MIN_IDLE_BATTERY, MIN_WHEELS, first_shadow, shadow_energy_wh};
use super::compile::compile;
use super::design::{DesignedStart, TargetField, TaskingDesign};
use super::facts::DesignFacts;
use super::orbit_facts::OrbitFacts;
use super::params::{has_targets, station_count};
use super::units::S_PER_MINUTE;
use super::vocabulary::{BATTERY, DAY, MAX_FIELDS, NODE_HOUR, START_ANGLE, STORAGE, UTC_MINUTE, WHEELS};
use crate::angles::angle_between;

/// Largest distance of a failure's time from the aimed orbit angle, degrees. It is smaller than the tolerance of the aim.
const ANGLE_REACH_DEG: f64 = 20.0;
/// Share of designs with a background of drawn targets, where fields matter most.
const BACKGROUND_SHARE: f64 = 0.3;
/// Minutes at the end of an episode without fields.
const LAST_MINUTES: i32 = 6;

/// Unfinished design in its base scenario.
pub(super) struct Draft<'a> {
    design: TaskingDesign,
    base: &'a Scenario,
    has_targets: bool,
    satellites: i32,
    /// Last minute of the episode.
    last_minute: i32,
}

/// Ranges of the numbers of a sampled field.
struct FieldRanges {
    minutes: [i32; 2],
    offset_km: i32,
    spread_km: [i32; 2],
    targets: [i32; 2],
    priority_low: [i32; 2],
    priority_high: [i32; 2],
}

/// Samples a start with plenty of resources.
pub(super) fn sample_start(rng: &mut KeyedRng) -> DesignedStart {
    DesignedStart {
        day: whole(rng, [DAY.min, DAY.max]),
        utc_minute: whole(rng, [UTC_MINUTE.min, UTC_MINUTE.max]),
        node_hour: whole(rng, [NODE_HOUR.min, NODE_HOUR.max]),
        start_angle_deg: whole(rng, [START_ANGLE.min, START_ANGLE.max]),
        battery_percent: whole(rng, [55, 100]),
        wheels_percent: whole(rng, [5, 40]),
        storage_percent: whole(rng, [5, 50]),
    }
}

impl<'a> Draft<'a> {
    /// Begins a design without fields.
    pub(super) fn new(
        mode: &str,
        aim_angle_deg: Option<i32>,
        start: DesignedStart,
        base: &'a Scenario,
    ) -> Self {
        let recipe = base.recipe();
        let satellites = i32::try_from(recipe.task().agents(recipe)).unwrap_or(1);
        let minutes = recipe.param("time_limit_s").unwrap_or(0.0) / S_PER_MINUTE;
        let design = TaskingDesign {
            name: String::new(),
            mode: mode.to_owned(),
            aim_angle_deg,
            params: BTreeMap::new(),
            start,
            outages: Vec::new(),
            keeps_background: true,
            fields: Vec::new(),
        };
        Self { design, base, has_targets: has_targets(recipe), satellites, last_minute: minutes as i32 }
    }

    /// Completes the design for its failure mode; `None` if that failed.
    pub(super) fn complete(mut self, rng: &mut KeyedRng) -> Option<TaskingDesign> {
        match self.design.mode.as_str() {
            "power" => self.starve(rng)?,
            "wheels" => {
                self.design.start.wheels_percent = whole(rng, [MIN_WHEELS, 92]);
                self.turn_to_aim(0);
            }
            "full" => self.fill_before_pass(rng)?,
            "pass_missed" => self.fill_after_pass(rng)?,
            "idle" => {
                self.design.start.battery_percent = whole(rng, [MIN_IDLE_BATTERY, BATTERY.max]);
                self.design.start.wheels_percent = whole(rng, [WHEELS.min, MAX_IDLE_WHEELS]);
                self.turn_to_aim(0);
            }
            mode => self.add_crowded_fields(mode == "window_missed", rng),
        }
        if self.has_targets && self.design.fields.is_empty() {
            let ranges = FieldRanges {
                minutes: [3, self.last_minute - LAST_MINUTES],
                offset_km: 250,
                spread_km: [60, 400],
                targets: [12, 40],
                priority_low: [5, 40],
                priority_high: [60, 100],
            };
            self.add_fields([1, 3], &ranges, rng);
        }
        Some(self.design)
    }

    /// Chooses a start shortly before the shadow, and less charge than work takes in it.
    fn starve(&mut self, rng: &mut KeyedRng) -> Option<()> {
        let noon_or_midnight = if rng.bernoulli(0.5) { 12 } else { 24 };
        self.design.start.node_hour = (noon_or_midnight + whole(rng, [-3, 3])).rem_euclid(NODE_HOUR.max + 1);
        self.design.start.start_angle_deg = whole(rng, [15, 95]);
        let sky = self.sky()?;
        let path = sky.satellites.first()?;
        let needed = shadow_energy_wh(path, first_shadow(path)?) / path.resources.battery_wh;
        let share = 0.4 + 0.55 * rng.uniform();
        let percent = (100.0 * needed * share) as i32;
        self.design.start.battery_percent = BATTERY.contains(percent).then_some(percent)?;
        Some(())
    }

    /// Lets the storage be full before the first pass over a station.
    fn fill_before_pass(&mut self, rng: &mut KeyedRng) -> Option<()> {
        self.add_outages([2, 5], rng);
        let sky = self.sky()?;
        let path = sky.satellites.first()?;
        let first = DesignFacts::passes(path).first().map_or(sky.time_limit_s, |pass| pass.open_s);
        self.fill_within(path, [0.0, first], rng)
    }

    /// Lets the storage be full between the end of a pass and the next one.
    fn fill_after_pass(&mut self, rng: &mut KeyedRng) -> Option<()> {
        self.add_outages([1, 5], rng);
        let sky = self.sky()?;
        let path = sky.satellites.first()?;
        let facts = DesignFacts { design: &self.design, forecast: &sky, has_targets: self.has_targets };
        let gaps: Vec<_> = facts.gaps(path).into_iter().filter(|[from_s, _]| *from_s > 0.0).take(4).collect();
        let gap = *gaps.get(rng.below(u32::try_from(gaps.len()).ok()?) as usize)?;
        self.fill_within(path, gap, rng)
    }

    /// Chooses the data at the start, and for imagers fields, so that the storage is full at a time in a gap between passes, s.
    fn fill_within(
        &mut self,
        path: &SatelliteForecast,
        [from_s, to_s]: [f64; 2],
        rng: &mut KeyedRng,
    ) -> Option<()> {
        /// Shortest gap in which work can fill a storage, s.
        const MIN_GAP_S: f64 = 900.0;
        if to_s - from_s < MIN_GAP_S {
            return None;
        }
        let resources = &path.resources;
        let work = if self.has_targets {
            self.add_fields_around([(from_s / S_PER_MINUTE) as i32, (to_s / S_PER_MINUTE) as i32], rng);
            f64::from(whole(rng, [8, 25]))
        } else {
            let near_aim: Vec<f64> = path
                .track
                .iter()
                .filter(|point| point.time_s > from_s + 0.2 * (to_s - from_s) && point.time_s < to_s)
                .filter(|point| self.is_near_aim(point.orbit_angle_deg))
                .map(|point| point.time_s)
                .collect();
            *near_aim.get((rng.uniform() * near_aim.len() as f64) as usize)?
        };
        let room = 100.0 * work * resources.work_bits / resources.storage_bits;
        let percent = 100 - libm::round(room) as i32;
        self.design.start.storage_percent = STORAGE.contains(percent).then_some(percent)?;
        Some(())
    }

    /// Adds fields to a gap between passes, minutes, and further ones after it, so that it matters to send data in between.
    fn add_fields_around(&mut self, [from, to]: [i32; 2], rng: &mut KeyedRng) {
        let last = self.last_minute - LAST_MINUTES;
        let within = FieldRanges {
            minutes: [(from + 3).max(2), (to - 3).min(last)],
            offset_km: 150,
            spread_km: [60, 250],
            targets: [15, 40],
            priority_low: [20, 50],
            priority_high: [60, 100],
        };
        self.add_fields([2, 4], &within, rng);
        if to + 10 < last {
            let after = FieldRanges { minutes: [to + 5, last], priority_low: [40, 60], ..within };
            self.add_fields([1, 3], &after, rng);
        }
        self.design.keeps_background = rng.bernoulli(BACKGROUND_SHARE);
    }

    /// Adds fields with more targets than can be imaged; spread wide with similar priorities, or dense with different ones.
    fn add_crowded_fields(&mut self, is_wide: bool, rng: &mut KeyedRng) {
        self.design.keeps_background = rng.bernoulli(BACKGROUND_SHARE);
        let minutes = [3, self.last_minute - LAST_MINUTES];
        let ranges = if is_wide {
            FieldRanges {
                minutes,
                offset_km: 250,
                spread_km: [150, 350],
                targets: [20, 50],
                priority_low: [40, 70],
                priority_high: [70, 100],
            }
        } else {
            FieldRanges {
                minutes,
                offset_km: 150,
                spread_km: [60, 250],
                targets: [20, 45],
                priority_low: [3, 15],
                priority_high: [70, 100],
            }
        };
        self.add_fields([3, 6], &ranges, rng);
        self.turn_to_aim(self.design.fields.first().map_or(0, |field| field.minute));
    }

    /// Moves the start so that the satellite is at the aimed orbit angle at a minute.
    fn turn_to_aim(&mut self, minute: i32) {
        if let Some(aimed) = self.design.aim_angle_deg {
            let moved =
                libm::round(f64::from(minute) * OrbitFacts::of(self.base.task()).deg_per_minute) as i32;
            self.design.start.start_angle_deg = (aimed - moved).rem_euclid(START_ANGLE.max + 1);
        }
    }

    fn is_near_aim(&self, orbit_angle_deg: f64) -> bool {
        self.design
            .aim_angle_deg
            .is_none_or(|aimed| angle_between(orbit_angle_deg, f64::from(aimed)) <= ANGLE_REACH_DEG)
    }

    fn add_fields(&mut self, count: [i32; 2], ranges: &FieldRanges, rng: &mut KeyedRng) {
        let [first, last] = ranges.minutes;
        for _ in 0..whole(rng, count).min(MAX_FIELDS as i32) {
            let field = TargetField {
                satellite: whole(rng, [0, self.satellites - 1]),
                minute: whole(rng, [first, last.max(first)]),
                offset_km: whole(rng, [-ranges.offset_km, ranges.offset_km]),
                spread_km: whole(rng, ranges.spread_km),
                targets: whole(rng, ranges.targets),
                priority_low: whole(rng, ranges.priority_low),
                priority_high: whole(rng, ranges.priority_high),
            };
            if !self.design.fields.contains(&field) {
                self.design.fields.push(field);
            }
        }
    }

    /// Puts stations of the task out of service; at least one stays.
    fn add_outages(&mut self, count: [i32; 2], rng: &mut KeyedRng) {
        let stations = station_count(self.base.recipe()) as i32;
        let count = whole(rng, count).min(stations - 1);
        while (self.design.outages.len() as i32) < count {
            let station = whole(rng, [0, stations - 1]);
            if !self.design.outages.contains(&station) {
                self.design.outages.push(station);
            }
        }
        self.design.outages.sort_unstable();
    }

    /// The sky of the design so far, without targets.
    fn sky(&self) -> Option<TaskingForecast> {
        compile(&self.design, self.base).ok().map(|compiled| compiled.forecast)
    }
}

/// Samples a whole number of a range.
pub(super) fn whole(rng: &mut KeyedRng, [min, max]: [i32; 2]) -> i32 {
    let width = u32::try_from(max - min).unwrap_or(0);
    min + rng.range_inclusive(0, width) as i32
}
