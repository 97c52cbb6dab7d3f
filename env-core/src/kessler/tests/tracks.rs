//! Tracks against their own definition, computed another way.

use proptest::prelude::*;
use serde_json::json;

use super::at_level;
use super::staging::{Pass, apart, flight, staged};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::kessler::constants::EARTH_RADIUS_2;
use crate::kessler::flight::Flight;
use crate::kessler::kernel::{Body, Gravity, distance_2, swept_2};
use crate::kessler::tracks::{LIMIT, Tracks};
use crate::kessler::warnings::debris_moved;
use crate::log::JointAction;
use crate::scenario::Scenario;
use crate::seed::Seed;
use crate::task::TaskSpec;

/// Nearest approach of debris within the look-ahead, and when, one body at a time.
fn nearest(mut s: Body, mut d: Body, flight: &Flight<Seeded>, look_ahead: usize) -> (f64, f64) {
    let physics = flight.setup().physics;
    let mut best = (distance_2(s.x, s.y, d.x, d.y), 0.0);
    for step in 1..=look_ahead {
        let Some(moved) = debris_moved(d, physics) else { break };
        if s.radius_2() < EARTH_RADIUS_2 {
            break;
        }
        (s, d) = (s.coasted(physics.gravity), moved);
        let (dx, dy, wx, wy) = (s.x - d.x, s.y - d.y, s.vx - d.vx, s.vy - d.vy);
        let near = swept_2(dx, dy, wx, wy);
        if near < best.0 {
            let back = ((dx * wx + dy * wy) / (wx * wx + wy * wy)).clamp(0.0, 1.0);
            best = (near, step as f64 - back);
        }
    }
    best
}

/// The most threatening by a full sort.
fn threats(flight: &Flight<Seeded>, s: Body, k: usize, look_ahead: usize) -> Vec<(Body, f64, f64)> {
    let mut all: Vec<(f64, f64, usize, f64)> = (0..flight.debris().len())
        .filter(|&i| flight.sees(flight.debris().body(i).x, flight.debris().body(i).y))
        .map(|i| {
            let d = flight.debris().body(i);
            let (miss_2, time) = nearest(s, d, flight, look_ahead);
            (miss_2, distance_2(s.x, s.y, d.x, d.y), i, time)
        })
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    all.iter().take(k).map(|&(miss_2, _, i, time)| (flight.debris().body(i), miss_2.sqrt(), time)).collect()
}

/// One satellite's row by the columns' own account.
fn expected(
    flight: &Flight<Seeded>,
    number: usize,
    tracks: &Tracks,
    k: usize,
    look_ahead: usize,
) -> Vec<f32> {
    let s = flight.satellites()[number];
    let columns = tracks.columns();
    if !s.active() {
        return vec![0.0; columns.len()];
    }
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
        s.fuel / flight.setup().fuel,
        f64::from(flight.steps()) / 50.0,
        s.survival,
        if goal { r - 100.0 } else { 0.0 },
    ];
    for other in [(number + 1) % 3, (number + 2) % 3].map(|i| flight.satellites()[i]) {
        let told = id == crate::kessler::reward::Objective::Formation && other.active();
        let o = if told { other.body } else { s.body };
        values.extend(parts(o.x - s.body.x, o.y - s.body.y));
        values.extend(parts(o.vx - s.body.vx, o.vy - s.body.vy));
    }
    for (d, miss, time) in threats(flight, s.body, k, look_ahead) {
        values.push(1.0);
        values.extend(parts(d.x - s.body.x, d.y - s.body.y));
        values.extend(parts(d.vx - s.body.vx, d.vy - s.body.vy));
        values.extend([miss, time]);
    }
    let told = values.len();
    let mut cells: Vec<f32> = values
        .iter()
        .zip(&columns)
        .map(|(value, column)| (((value - column.offset) / column.scale) as f32).clamp(-LIMIT, LIMIT))
        .collect();
    cells.resize(columns.len().max(told), 0.0);
    cells
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// At every step of flights with rogues, fragments, decay and radar: what is written is what the columns say, and a
    /// forecast carried along, one begun afresh and one carried over from another episode give the same bits.
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
                prop_assert_eq!(row, &expected(&flight, number, &warm, k, look_ahead)[..]);
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
    // Satellite 0 is at (60, 0) and moves along y: radial is x, in-track is y. f32 keeps seven digits.
    let near = |name: &str, expected: f64| {
        let found = value(name);
        assert!((found - expected).abs() < 1e-5, "{name} is {found}, not {expected}");
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
