//! Share of the time of an imaging episode in which windows of access are searched.

use std::time::Instant;

use anyhow::Context;
use env_core::Seed;
use env_core::episode_rng::SeededRng;
use env_core::tasking::access::trajectory::SAMPLE_S;
use env_core::tasking::access::{
    AccessLimit, Locations, OpportunityKind, OpportunityList, SearchedTrajectory,
};
use env_core::tasking::environments::TaskingEnvironment;
use env_core::tasking::orbit::{Orbit, Sky};
use env_core::tasking::setup::Setup;

use super::{ENVS, SECONDS, Stepper};
use crate::Row;

/// Largest share of windows in an imaging episode.
const GOAL: f64 = 0.3;
/// Number of scenarios whose windows are searched in turns.
const SCENARIOS: u64 = 16;

/// Measures the share in episodes of a batch, with their resets and observations.
pub(super) fn row(environment: TaskingEnvironment) -> anyhow::Result<Row> {
    let mut searches = (0..SCENARIOS)
        .map(|seed| {
            let seed = Seed::user(seed).context("the seed is too large")?;
            Ok(WindowSearches::new(&environment.setup(&mut SeededRng::new(seed))))
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let mut stepper = Stepper::new(environment, ENVS)?;
    let taken = stepper.run_for(SECONDS)?;
    let episode_s = taken / (stepper.satellite_seconds / searches[0].limit_s);
    let begun = Instant::now();
    let (mut searched, mut windows) = (0_u32, 0);
    while begun.elapsed().as_secs_f64() < SECONDS / 3.0 {
        for search in &mut searches {
            windows += search.run();
            searched += 1;
        }
    }
    let search_s = begun.elapsed().as_secs_f64() / f64::from(searched);
    let share = search_s / episode_s;
    Ok(Row {
        label: format!("windows of {}", environment.id()),
        measured: format!(
            "{:.1} % of an episode in a batch: {:.0} µs of {:.0} µs, {} windows",
            100.0 * share,
            search_s * 1e6,
            episode_s * 1e6,
            windows / searched as usize,
        ),
        goal: format!("≤ {:.0} % of an episode", 100.0 * GOAL),
        ratio: Some(GOAL / share),
    })
}

/// Locations and orbit of a scenario's first satellite, between which windows are searched.
struct WindowSearches {
    targets: Locations,
    stations: Locations,
    orbit: Orbit,
    sky: Sky,
    limit_s: f64,
}

impl WindowSearches {
    fn new(setup: &Setup) -> Self {
        let args = &setup.agents[0].satellite.args;
        let limit_s = setup.clock.time_limit_s;
        let mut sky = Sky::new(setup.epoch.tdb_s());
        let (position, velocity) = args.orbit.state(args.mu);
        let mut orbit = Orbit::new(setup.gravity, position, velocity, &sky, setup.clock.tick.seconds());
        orbit.extend_to(limit_s, &mut sky);
        let limits =
            setup.stations.iter().map(|station| AccessLimit::new(station.min_elevation_rad, f64::INFINITY));
        Self {
            targets: Locations::new(
                setup.targets.iter().map(|target| target.position).collect(),
                args.target_min_elevation_rad,
            ),
            stations: Locations::with_limits(
                setup.stations.iter().map(|station| station.position).collect(),
                limits.collect(),
            ),
            orbit,
            sky,
            limit_s,
        }
    }

    /// Searches all windows of the episode, as a reset does. Returns their number.
    fn run(&mut self) -> usize {
        let mut trajectory = SearchedTrajectory::default();
        let samples = (self.limit_s / SAMPLE_S) as usize + 1;
        trajectory.extend_to(samples, &mut self.orbit, &mut self.sky);
        let mut list = OpportunityList::default();
        let places =
            [(OpportunityKind::Target, &self.targets), (OpportunityKind::GroundStation, &self.stations)];
        list.add_block(self.limit_s, places, &trajectory);
        list.all().len()
    }
}
