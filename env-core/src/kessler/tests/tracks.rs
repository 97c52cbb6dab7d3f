//! Tracks against their own definition, computed another way.

use proptest::prelude::*;
use serde_json::json;

use super::at_level;
use super::staging::{Pass, apart, flight, staged};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::kessler::constants::EARTH_RADIUS_2;
use crate::kessler::flight::Flight;
use crate::kessler::kernel::{Body, Gravity, swept_2};
use crate::kessler::tracks::{Column, LIMIT, Tracks};
use crate::kessler::warnings::debris_moved;
use crate::log::JointAction;
use crate::scenario::Scenario;
use crate::seed::Seed;
use crate::task::TaskSpec;

/// How far what is foreseen in single precision may be off, LU: 25 steps of places up to 100 LU, of which f32 knows 4e-6, the
/// errors of velocities growing with time, a pull that is steep near the Earth.
const FORESEEN: f64 = 2e-3;

/// How far debris is from a satellite, one body at a time, within a look-ahead.
struct Course {
    /// Where it is seen from the satellite, now and after each step.
    places: Vec<(f64, f64)>,
}

impl Course {
    fn of(mut s: Body, mut d: Body, flight: &Flight<Seeded>, look_ahead: usize) -> Self {
        let physics = flight.setup().physics;
        let mut places = vec![(s.x - d.x, s.y - d.y)];
        for _ in 0..look_ahead {
            let Some(moved) = debris_moved(d, physics) else { break };
            if s.radius_2() < EARTH_RADIUS_2 {
                break;
            }
            (s, d) = (s.coasted(physics.gravity), moved);
            places.push((s.x - d.x, s.y - d.y));
        }
        Self { places }
    }

    /// The least distance: straight from place to place.
    fn miss(&self) -> f64 {
        let first = self.places[0];
        self.places.windows(2).fold(first.0.hypot(first.1), |least, step| {
            let ((ax, ay), (bx, by)) = (step[0], step[1]);
            least.min(swept_2(bx, by, bx - ax, by - ay).sqrt())
        })
    }

    /// The distance at a time.
    fn at(&self, time: f64) -> f64 {
        let step = (time.floor() as usize).min(self.places.len() - 1);
        let (from, to) = (self.places[step], self.places[(step + 1).min(self.places.len() - 1)]);
        let share = time - step as f64;
        (from.0 + share * (to.0 - from.0)).hypot(from.1 + share * (to.1 - from.1))
    }
}

/// A satellite's own columns, by their own account.
fn expected(flight: &Flight<Seeded>, number: usize, tracks: &Tracks) -> Vec<f32> {
    let s = flight.satellites()[number];
    let ((rx, ry), (tx, ty)) = s.body.frame();
    let parts = |x: f64, y: f64| [x * rx + y * ry, x * tx + y * ty];
    let r = s.body.radius();
    let id = flight.objective();
    let goal = id == crate::kessler::reward::Objective::Rendezvous && number == 0;
    let [vr, vt] = parts(s.body.vx, s.body.vy);
    let mut values = vec![
        1.0,
        r,
        vr,
        vt - (1000.0 / r.max(20.0)).sqrt(),
        s.fuel,
        f64::from(flight.steps()),
        s.survival,
        if goal { r - 100.0 } else { 0.0 },
    ];
    for other in [(number + 1) % 3, (number + 2) % 3].map(|i| flight.satellites()[i]) {
        let told = id == crate::kessler::reward::Objective::Formation && other.active();
        let o = if told { other.body } else { s.body };
        values.extend(parts(o.x - s.body.x, o.y - s.body.y));
        values.extend(parts(o.vx - s.body.vx, o.vy - s.body.vy));
    }
    let scale = |(at, column): (usize, &Column)| match at {
        4 => flight.setup().fuel,
        5 => 50.0,
        _ => column.scale,
    };
    let columns = tracks.columns();
    let columns = columns.iter().enumerate().map(|at| (at.1.offset, scale(at)));
    let cells = values.iter().zip(columns);
    cells
        .map(|(value, (offset, scale))| (((value - offset) * (1.0 / scale)) as f32).clamp(-LIMIT, LIMIT))
        .collect()
}

/// Whether these cells tell of the K pieces that come nearest, each as it is.
fn are_the_worst(
    cells: &[f32],
    flight: &Flight<Seeded>,
    s: Body,
    (k, look_ahead): (usize, usize),
) -> Result<(), TestCaseError> {
    let ((rx, ry), (tx, ty)) = s.frame();
    let scaled = |value: f64, scale: f64| (value * (1.0 / scale)) as f32;
    let parts = |x: f64, y: f64, scale: f64| {
        [x * rx + y * ry, x * tx + y * ty].map(|part| scaled(part, scale).clamp(-LIMIT, LIMIT))
    };
    let mut left: Vec<([f32; 4], Course)> = (0..flight.debris().len())
        .map(|i| flight.debris().body(i))
        .filter(|d| flight.sees(d.x, d.y))
        .map(|d| {
            let place = parts(d.x - s.x, d.y - s.y, 50.0);
            let speed = parts(d.vx - s.vx, d.vy - s.vy, 5.0);
            ([place[0], place[1], speed[0], speed[1]], Course::of(s, d, flight, look_ahead))
        })
        .collect();
    let told = left.len().min(k);
    let (threats, nothing) = cells.split_at(told * 7);
    prop_assert!(nothing.iter().all(|cell| *cell == 0.0));
    let mut before = 0.0;
    for threat in threats.chunks(7) {
        prop_assert_eq!(threat[0], 1.0);
        let is = |(seen, course): &([f32; 4], Course)| {
            let miss = f64::from(scaled(course.miss(), 10.0).min(LIMIT)) * 10.0;
            *seen == threat[1..5] && (miss - f64::from(threat[5]) * 10.0).abs() < FORESEEN
        };
        let found = left.iter().position(is);
        prop_assert!(found.is_some(), "there is no debris like {:?}", threat);
        let (_, course) = left.swap_remove(found.unwrap());
        prop_assert!(threat[5] >= before, "in order");
        before = threat[5];
        // Where it stays as near for long, any time of these will do.
        let when = f64::from(threat[6]) * look_ahead as f64;
        prop_assert!(
            (course.at(when) - course.miss()).abs() < 2.0 * FORESEEN,
            "when: {} of {:?}",
            when,
            threat
        );
    }
    if let Some(last) = threats.chunks(7).last() {
        let least = left.iter().map(|(_, course)| course.miss()).fold(f64::INFINITY, f64::min);
        let last = f64::from(last[5]) * 10.0;
        prop_assert!(least > last.min(2.0 * 10.0) - FORESEEN, "{} is nearer than {}", least, last);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// At every step of flights with rogues, fragments, decay and radar: what is written is what the columns say, and one that
    /// wrote before, one begun afresh and one that wrote another episode give the same bits.
    #[test]
    fn tracks_are_what_their_columns_say_warm_or_cold(
        task in 0..TASKS.len(),
        level in 0usize..10,
        seed in 0u64..1 << 40,
        physics in prop::sample::select(vec![("compat", "none"), ("compat", "upstream"), ("gravity", "j2"), ("risk", "pc"), ("contact", "swept")]),
        k in 0usize..12,
        look_ahead in 1usize..25,
        size in prop::sample::select(vec![0.0, 0.2, 1.0]),
    ) {
        let scenario = at_level(TASKS[task].id(), level, seed);
        let recipe = scenario.recipe().as_ref().clone().with_option(physics.0, physics.1).unwrap();
        let recipe = recipe.with_param("rogue_probability", 0.1).unwrap().with_param("rogue_speed", 0.4).unwrap();
        let mut flight = flight(&Scenario::new(recipe, scenario.seed()));
        let mut burns = Seeded::new(Seed::user(seed).unwrap());
        let mut warm = Tracks::new(k, look_ahead).unwrap();
        // Carried over from an episode at the same place under other laws.
        let mut other = warm.clone();
        let plain = super::staging::flight(&scenario);
        let mut out = vec![0.0; warm.total()];
        other.write(&plain, &mut out);
        loop {
            let mut cells = vec![f32::NAN; warm.total()];
            warm.write(&flight, &mut cells);
            for fresh in [&mut Tracks::new(k, look_ahead).unwrap(), &mut other, &mut warm] {
                fresh.write(&flight, &mut out);
                prop_assert!(out.iter().zip(&cells).all(|(a, b)| a.to_bits() == b.to_bits()));
            }
            for (number, row) in cells.chunks(warm.len()).enumerate() {
                let satellite = flight.satellites()[number];
                if satellite.active() {
                    let (own, threats) = row.split_at(16);
                    prop_assert_eq!(own, &expected(&flight, number, &warm)[..]);
                    are_the_worst(threats, &flight, satellite.body, (k, look_ahead))?;
                } else {
                    prop_assert!(row.iter().all(|cell| *cell == 0.0));
                }
            }
            prop_assert!(cells.iter().all(|cell| cell.abs() <= LIMIT && !(*cell == 0.0 && cell.is_sign_negative())));
            if flight.done() { break }
            let values: [f64; 6] = std::array::from_fn(|_| burns.between(Stream::Policy, -size, size));
            flight.step(JointAction { agents: &[0, 1, 2], values: &values }).unwrap();
        }
    }
}

/// A pass of known geometry, column by column.
#[test]
fn validate_tracks_of_a_pass_by_hand() {
    let pass = Pass { time: 4.5, miss: 1.5, speed: 6.0, heading: -1.2 };
    let debris = [pass.start(apart()[0], Gravity::Point), Body { x: 0.0, y: -90.0, vx: 3.3, vy: 0.0 }];
    let flight = flight(&staged(&apart(), &debris, &json!({}), &json!({}), 1));
    let mut tracks = Tracks::new(3, 15).unwrap();
    let mut cells = vec![0.0f32; tracks.total()];
    tracks.write(&flight, &mut cells);
    let columns = tracks.columns();
    let value = |name: &str| {
        let i = columns.iter().position(|c| c.name == name).unwrap();
        f64::from(cells[i]) * columns[i].scale + columns[i].offset
    };
    // Satellite 0 is at (60, 0) and moves along y: radial is x, in-track is y. f32 keeps seven digits, of what is foreseen six.
    let near = |name: &str, expected: f64| {
        let found = value(name);
        let off = if name.ends_with("_miss") || name.ends_with("_time") { 1e-4 } else { 1e-5 };
        assert!((found - expected).abs() < off, "{name} is {found}, not {expected}");
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
    near("debris_0_in_track_speed", debris[0].vy - apart()[0].vy);
    near("debris_0_miss", 1.5);
    near("debris_0_time", 4.5);
    near("debris_1_present", 1.0);
    near("debris_2_present", 0.0);
    near("debris_2_miss", 0.0);
}

/// A buffer of another size is filled as far as it goes, and zeroed beyond.
#[test]
fn any_buffer_will_do() {
    let flight = flight(&at_level("kessler/survival", 3, 1));
    let mut tracks = Tracks::default();
    let mut whole = vec![0.0f32; tracks.total()];
    tracks.write(&flight, &mut whole);
    for length in [0, 1, 16, 17, tracks.len(), tracks.len() + 3, tracks.total() - 1, tracks.total() + 5] {
        let mut cells = vec![f32::NAN; length];
        tracks.write(&flight, &mut cells);
        let shared = length.min(whole.len());
        assert_eq!(cells[..shared], whole[..shared]);
        assert!(cells[shared..].iter().all(|&cell| cell == 0.0));
    }
}

#[test]
fn numbers_that_cannot_be_had_are_refused() {
    let refused = |k, look_ahead| Tracks::new(k, look_ahead).unwrap_err().to_string();
    insta::assert_snapshot!(refused(1001, 15), @"k is 1001, outside 0 to 1000");
    insta::assert_snapshot!(refused(8, 0), @"look_ahead is 0, outside 1 to 50");
    insta::assert_snapshot!(refused(8, 51), @"look_ahead is 51, outside 1 to 50");
}

/// The page that documents the columns has them all, in order, with unit and scale.
#[test]
fn the_page_has_every_column() {
    let page = include_str!("../../../../docs/kessler.md");
    let tracks = Tracks::new(1, 15).unwrap();
    let mut rows = Vec::new();
    for (number, column) in tracks.columns().iter().enumerate() {
        let number = if number < 16 { number.to_string() } else { format!("16 + 7i + {}", number - 16) };
        let name = column.name.replace("debris_0", "debris_i");
        rows.push(format!(
            "| {number} | `{name}` | {} | {} | {} | {} |",
            column.unit, column.offset, column.scale, column.about
        ));
    }
    for row in &rows {
        assert!(page.contains(row), "docs/kessler.md lacks, or says otherwise:\n{}", rows.join("\n"));
    }
}
