//! Tracks observations against their definition, computed in another way.

use proptest::prelude::*;
use serde_json::json;

use super::at_level;
use super::staging::{StagedPass, separate_satellites, staged_scenario, start_sim};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::EARTH_RADIUS_2;
use crate::kessler::kernel::{Body, Gravity, min_distance_squared};
use crate::kessler::simulation::KesslerSim;
use crate::kessler::tracks::{CELL_LIMIT, TrackColumn, TracksEncoder};
use crate::kessler::warnings::propagate_debris;
use crate::log::JointAction;
use crate::seed::Seed;
use crate::task::Scenario;
use crate::task::TaskSpec;

/// Largest error of a single-precision forecast, LU. It covers 25 steps of positions up to 100 LU (f32
/// resolves 4e-6), velocity errors that grow with time, and gravity that is steep near the Earth.
const FORECAST_ERROR: f64 = 2e-3;

/// Path of one debris body relative to a satellite within a look-ahead.
struct DebrisPath {
    /// Position relative to the satellite now and after each step.
    positions: Vec<(f64, f64)>,
}

impl DebrisPath {
    fn new(mut s: Body, mut d: Body, sim: &KesslerSim<SeededRng>, look_ahead: usize) -> Self {
        let physics = sim.setup().physics;
        let mut positions = vec![(s.x - d.x, s.y - d.y)];
        for _ in 0..look_ahead {
            let Some(moved) = propagate_debris(d, physics) else { break };
            if s.radius_squared() < EARTH_RADIUS_2 {
                break;
            }
            (s, d) = (s.coast(physics.gravity), moved);
            positions.push((s.x - d.x, s.y - d.y));
        }
        Self { positions }
    }

    /// Least distance on the two straight lines that meet at the nearest position.
    fn miss(&self) -> f64 {
        let distance = |at: usize| self.positions[at].0.hypot(self.positions[at].1);
        let nearest = (0..self.positions.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap();
        let lines =
            self.positions[nearest.saturating_sub(1)..].windows(2).take(if nearest == 0 { 1 } else { 2 });
        lines.fold(distance(nearest), |least, step| {
            let ((ax, ay), (bx, by)) = (step[0], step[1]);
            least.min(min_distance_squared(bx, by, bx - ax, by - ay).sqrt())
        })
    }

    /// Least distance on the straight lines between all positions.
    fn least_distance(&self) -> f64 {
        let first = self.positions[0];
        self.positions.windows(2).fold(first.0.hypot(first.1), |least, step| {
            let ((ax, ay), (bx, by)) = (step[0], step[1]);
            least.min(min_distance_squared(bx, by, bx - ax, by - ay).sqrt())
        })
    }

    /// Distance at a time, LU.
    fn distance_at(&self, time: f64) -> f64 {
        let step = (time.floor() as usize).min(self.positions.len() - 1);
        let (from, to) = (self.positions[step], self.positions[(step + 1).min(self.positions.len() - 1)]);
        let share = time - step as f64;
        (from.0 + share * (to.0 - from.0)).hypot(from.1 + share * (to.1 - from.1))
    }
}

/// Expected cells of a satellite's own columns.
fn expected_own_cells(sim: &KesslerSim<SeededRng>, number: usize, tracks: &TracksEncoder) -> Vec<f32> {
    let s = sim.satellites()[number];
    let ((rx, ry), (tx, ty)) = s.body.local_axes();
    let parts = |x: f64, y: f64| [x * rx + y * ry, x * tx + y * ty];
    let r = s.body.radius();
    let id = sim.objective();
    let goal = id == crate::kessler::reward::Objective::Rendezvous && number == 0;
    let [vr, vt] = parts(s.body.vx, s.body.vy);
    let mut values = vec![
        1.0,
        r,
        vr,
        vt - (1000.0 / r.max(20.0)).sqrt(),
        s.fuel,
        f64::from(sim.steps()),
        s.survival,
        if goal { r - 100.0 } else { 0.0 },
    ];
    for other in [(number + 1) % 3, (number + 2) % 3].map(|i| sim.satellites()[i]) {
        let is_shown = id == crate::kessler::reward::Objective::Formation && other.is_active();
        let o = if is_shown { other.body } else { s.body };
        values.extend(parts(o.x - s.body.x, o.y - s.body.y));
        values.extend(parts(o.vx - s.body.vx, o.vy - s.body.vy));
    }
    let scale = |(at, column): (usize, &TrackColumn)| match at {
        4 => sim.setup().fuel,
        5 => 50.0,
        _ => column.scale,
    };
    let columns = tracks.columns();
    let columns = columns.iter().enumerate().map(|at| (at.1.offset, scale(at)));
    let cells = values.iter().zip(columns);
    cells
        .map(|(value, (offset, scale))| {
            (((value - offset) * (1.0 / scale)) as f32).clamp(-CELL_LIMIT, CELL_LIMIT)
        })
        .collect()
}

/// Checks that these cells describe the `k` debris bodies that come nearest.
fn check_threats(
    cells: &[f32],
    sim: &KesslerSim<SeededRng>,
    s: Body,
    k: usize,
    look_ahead: usize,
) -> Result<(), TestCaseError> {
    let ((rx, ry), (tx, ty)) = s.local_axes();
    let scaled = |value: f64, scale: f64| (value * (1.0 / scale)) as f32;
    let parts = |x: f64, y: f64, scale: f64| {
        [x * rx + y * ry, x * tx + y * ty].map(|part| scaled(part, scale).clamp(-CELL_LIMIT, CELL_LIMIT))
    };
    let mut left: Vec<([f32; 4], DebrisPath)> = (0..sim.debris().len())
        .map(|i| sim.debris().body(i))
        .filter(|d| sim.is_visible(d.x, d.y))
        .map(|d| {
            let place = parts(d.x - s.x, d.y - s.y, 50.0);
            let speed = parts(d.vx - s.vx, d.vy - s.vy, 5.0);
            ([place[0], place[1], speed[0], speed[1]], DebrisPath::new(s, d, sim, look_ahead))
        })
        .collect();
    let shown = left.len().min(k);
    let (threats, nothing) = cells.split_at(shown * 7);
    prop_assert!(nothing.iter().all(|cell| *cell == 0.0));
    let mut before = 0.0;
    for threat in threats.chunks(7) {
        prop_assert_eq!(threat[0], 1.0);
        let matches = |(state, path): &([f32; 4], DebrisPath)| {
            let miss = f64::from(scaled(path.miss(), 10.0).min(CELL_LIMIT)) * 10.0;
            *state == threat[1..5] && (miss - f64::from(threat[5]) * 10.0).abs() < FORECAST_ERROR
        };
        let index = left.iter().position(matches);
        prop_assert!(index.is_some(), "no debris matches {:?}", threat);
        let (_, path) = left.swap_remove(index.unwrap());
        prop_assert!(threat[5] >= before, "threats are ordered by miss");
        before = threat[5];
        // If the distance stays minimal for some time, any time of these is right.
        let when = f64::from(threat[6]) * look_ahead as f64;
        prop_assert!(
            (path.distance_at(when) - path.miss()).abs() < 2.0 * FORECAST_ERROR,
            "when: {} of {:?}",
            when,
            threat
        );
    }
    if let Some(last) = threats.chunks(7).last() {
        let least = left.iter().map(|(_, path)| path.miss()).fold(f64::INFINITY, f64::min);
        let last = f64::from(last[5]) * 10.0;
        prop_assert!(least > last.min(2.0 * 10.0) - FORECAST_ERROR, "{} is nearer than {}", least, last);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// At every step of episodes with rogues, fragments, decay and radar the cells match their columns. The bits are the same after
    /// another encoder of this thread encoded another episode.
    #[test]
    fn tracks_match_their_columns_with_any_encoder(
        task in 0..KESSLER_TASKS.len(),
        level in 0usize..10,
        seed in 0u64..1 << 40,
        physics in prop::sample::select(vec![("compat", "none"), ("compat", "upstream"), ("gravity", "j2"), ("risk", "pc"), ("contact", "swept")]),
        k in 0usize..12,
        look_ahead in 1usize..25,
        size in prop::sample::select(vec![0.0, 0.2, 1.0]),
    ) {
        let scenario = at_level(KESSLER_TASKS[task].id(), level, seed);
        let recipe = scenario.recipe().as_ref().clone().with_option(physics.0, physics.1).unwrap();
        let recipe = recipe.with_param("rogue_probability", 0.1).unwrap().with_param("rogue_speed", 0.4).unwrap();
        let mut sim = start_sim(&Scenario::new(recipe, scenario.seed()));
        let mut burns = SeededRng::new(Seed::user(seed).unwrap());
        let tracks = TracksEncoder::new(k, look_ahead).unwrap();
        // An encoder of another size, for an episode under other physics.
        let other = TracksEncoder::new(k + 5, look_ahead + 3).unwrap();
        let plain = super::staging::start_sim(&scenario);
        let mut out = vec![0.0; tracks.total_cells()];
        loop {
            let mut cells = vec![f32::NAN; tracks.total_cells()];
            tracks.write(&sim, &mut cells);
            other.write(&plain, &mut out);
            tracks.write(&sim, &mut out);
            prop_assert!(out.iter().zip(&cells).all(|(a, b)| a.to_bits() == b.to_bits()));
            for (number, row) in cells.chunks(tracks.len()).enumerate() {
                let satellite = sim.satellites()[number];
                if satellite.is_active() {
                    let (own, threats) = row.split_at(16);
                    prop_assert_eq!(own, &expected_own_cells(&sim, number, &tracks)[..]);
                    check_threats(threats, &sim, satellite.body, k, look_ahead)?;
                } else {
                    prop_assert!(row.iter().all(|cell| *cell == 0.0));
                }
            }
            prop_assert!(cells.iter().all(|cell| cell.abs() <= CELL_LIMIT && !(*cell == 0.0 && cell.is_sign_negative())));
            if sim.is_done() { break }
            let values: [f64; 6] = std::array::from_fn(|_| burns.uniform_in(RngStream::Policy, -size, size));
            sim.step(JointAction { agents: &[0, 1, 2], values: &values }).unwrap();
        }
    }
}

/// The miss of a body is that near its nearest position. Bodies within 20 LU, whose miss is not clamped, hardly ever come nearer elsewhere
/// in their look-ahead, and then by little: docs/worlds/kessler.md states the result of this test.
#[test]
fn validate_misses_beside_the_nearest_position() {
    let (mut near, mut nearer_elsewhere, mut largest) = (0, 0, 0.0f64);
    for seed in 0..60 {
        let recipe = at_level("kessler/survival", 3, seed).recipe().as_ref().clone();
        let recipe = recipe.with_param("debris", 50.0).unwrap();
        let mut sim = start_sim(&Scenario::new(recipe, Seed::user(seed).unwrap()));
        while !sim.is_done() {
            let bodies = (0..sim.debris().len()).map(|i| sim.debris().body(i));
            for body in bodies {
                for satellite in sim.satellites().iter().filter(|satellite| satellite.is_active()) {
                    let path = DebrisPath::new(satellite.body, body, &sim, 15);
                    let (miss, least) = (path.miss(), path.least_distance());
                    near += usize::from(least < 20.0);
                    nearer_elsewhere += usize::from(least < miss.min(20.0));
                    largest = largest.max(if least < 20.0 { miss - least } else { 0.0 });
                }
            }
            sim.step(JointAction { agents: &[], values: &[] }).unwrap();
        }
    }
    assert!(
        near > 10_000 && nearer_elsewhere * 1000 < near && largest < 0.02,
        "{nearer_elsewhere} of {near}, by {largest}"
    );
}

/// Tracks of a close approach with known geometry, column by column.
#[test]
fn validate_tracks_of_a_known_approach() {
    let pass = StagedPass { time: 4.5, miss: 1.5, speed: 6.0, heading: -1.2 };
    let debris =
        [pass.start(separate_satellites()[0], Gravity::Point), Body { x: 0.0, y: -90.0, vx: 3.3, vy: 0.0 }];
    let sim = start_sim(&staged_scenario(&separate_satellites(), &debris, &json!({}), &json!({}), 1));
    let tracks = TracksEncoder::new(3, 15).unwrap();
    let mut cells = vec![0.0f32; tracks.total_cells()];
    tracks.write(&sim, &mut cells);
    let columns = tracks.columns();
    let value = |name: &str| {
        let i = columns.iter().position(|c| c.name == name).unwrap();
        f64::from(cells[i]) * columns[i].scale + columns[i].offset
    };
    // Satellite 0 is at (60, 0) and moves along y: radial is x, in-track is y. f32 keeps seven digits,
    // forecasts six.
    let near = |name: &str, expected: f64| {
        let actual = value(name);
        let tolerance = if name.ends_with("_miss") || name.ends_with("_time") { 1e-4 } else { 1e-5 };
        assert!((actual - expected).abs() < tolerance, "{name} is {actual}, not {expected}");
    };
    for (name, expected) in
        [("active", 1.0), ("radius", 60.0), ("radial_speed", 0.0), ("in_track_excess", 0.0)]
    {
        near(name, expected);
    }
    for (name, expected) in [("fuel", 1.0), ("step", 0.0), ("survival", 1.0), ("target_error", 0.0)] {
        near(name, expected);
    }
    near("debris_0_present", 1.0);
    near("debris_0_radial", debris[0].x - 60.0);
    near("debris_0_in_track", debris[0].y);
    near("debris_0_radial_speed", debris[0].vx);
    near("debris_0_in_track_speed", debris[0].vy - separate_satellites()[0].vy);
    near("debris_0_miss", 1.5);
    near("debris_0_time", 4.5);
    near("debris_1_present", 1.0);
    near("debris_2_present", 0.0);
    near("debris_2_miss", 0.0);
}

/// A buffer of another size is filled as far as it goes, and zeroed beyond.
#[test]
fn buffer_of_any_size_is_filled_or_zeroed() {
    let sim = start_sim(&at_level("kessler/survival", 3, 1));
    let tracks = TracksEncoder::default();
    let mut whole = vec![0.0f32; tracks.total_cells()];
    tracks.write(&sim, &mut whole);
    for length in
        [0, 1, 16, 17, tracks.len(), tracks.len() + 3, tracks.total_cells() - 1, tracks.total_cells() + 5]
    {
        let mut cells = vec![f32::NAN; length];
        tracks.write(&sim, &mut cells);
        let shared = length.min(whole.len());
        assert_eq!(cells[..shared], whole[..shared]);
        assert!(cells[shared..].iter().all(|&cell| cell == 0.0));
    }
}

#[test]
fn sizes_out_of_range_are_rejected() {
    let error = |k, look_ahead| TracksEncoder::new(k, look_ahead).unwrap_err().to_string();
    insta::assert_snapshot!(error(1001, 15), @"k must be from 0 to 1000, got 1001");
    insta::assert_snapshot!(error(8, 0), @"look_ahead must be from 1 to 50, got 0");
    insta::assert_snapshot!(error(8, 51), @"look_ahead must be from 1 to 50, got 51");
}

/// `docs/worlds/kessler.md` documents all columns, in order, with unit and scale.
#[test]
fn documentation_lists_every_column() {
    let page = include_str!("../../../../docs/worlds/kessler.md");
    let tracks = TracksEncoder::new(1, 15).unwrap();
    let mut rows = Vec::new();
    for (number, column) in tracks.columns().iter().enumerate() {
        let number = if number < 16 { number.to_string() } else { format!("16 + 7i + {}", number - 16) };
        let name = column.name.replace("debris_0", "debris_i");
        rows.push(format!(
            "| {number} | `{name}` | {} | {} | {} | {} |",
            column.unit, column.offset, column.scale, column.description
        ));
    }
    for row in &rows {
        assert!(page.contains(row), "docs/worlds/kessler.md must contain:\n{}", rows.join("\n"));
    }
}
