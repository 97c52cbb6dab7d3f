//! kessler as marks: the Earth, satellites with the paths they fly if nobody acts, debris, burns, what is seen.

use super::constants::{EARTH_RADIUS, HORIZON, RADAR_NONE, TARGET_RADIUS};
use super::event::Event;
use super::flight::Flight;
use super::reward::{Objective, score};
use crate::chance::Chance;
use crate::scene::{Ink, Mark, Scene, View};

/// From the middle to the edge, LU: debris is drawn up to 90 LU, rogues arrive at 95, the target is at 100.
const REACH: f64 = 108.0;
/// How far ahead paths are drawn, steps.
const AHEAD: usize = 15;
/// A burn of 1 LU/TU is drawn so long, LU.
const BURN: f64 = 25.0;
/// Debris, LU: half the contact distance, so that discs touch where bodies do.
const SIZE: f64 = 1.0;
/// Numbers of debris in [`Mark::Craft`] begin here.
const DEBRIS: u64 = 1 << 32;

/// The flight now, after these burns (x and y of each satellite).
pub(super) fn scene<C: Chance>(flight: &Flight<C>, acted: &[f32]) -> Scene {
    let setup = flight.setup();
    let mut marks = vec![Mark::Disc { at: (0.0, 0.0), radius: EARTH_RADIUS, ink: Ink::Centre }];
    if flight.objective() == Objective::Rendezvous {
        marks.push(Mark::Ring { at: (0.0, 0.0), radius: TARGET_RADIUS, ink: Ink::Target });
    }
    if let Some(range) = setup.radar_range.filter(|range| *range < RADAR_NONE) {
        let seeing = flight.satellites().iter().filter(|satellite| satellite.active());
        marks.extend(seeing.map(|s| Mark::Ring { at: (s.body.x, s.body.y), radius: range, ink: Ink::Faint }));
    }
    for index in 0..flight.debris().len() {
        let body = flight.debris().body(index);
        let at = (body.x, body.y);
        let ink = if flight.sees(body.x, body.y) { Ink::Debris } else { Ink::Hidden };
        marks.push(Mark::Disc { at, radius: SIZE, ink });
        marks.push(Mark::Craft { id: DEBRIS | u64::from(flight.debris().id(index)), at, ink });
    }
    satellites(flight, acted, &mut marks);
    let flying = flight.satellites().iter().filter(|satellite| satellite.active()).count();
    let fuel: Vec<String> = flight.satellites().iter().map(|s| format!("{:.1}", s.fuel)).collect();
    Scene {
        views: vec![View { title: "", middle: (0.0, 0.0), reach: REACH, marks }],
        told: vec![
            flight.objective().mission().split(':').next().unwrap_or_default().to_owned(),
            format!("step {} of {HORIZON}", flight.steps()),
            format!("flying {flying} of {}", flight.satellites().len()),
            format!("fuel {}", fuel.join("  ")),
            format!("score {:.3}", score(flight.total())),
        ],
        alerts: flight.events().iter().filter_map(Event::alert).collect(),
    }
}

fn satellites<C: Chance>(flight: &Flight<C>, acted: &[f32], marks: &mut Vec<Mark>) {
    let gravity = flight.setup().physics.gravity;
    for (number, satellite) in (0u32..).zip(flight.satellites()) {
        let at = (satellite.body.x, satellite.body.y);
        if !satellite.active() {
            marks.push(Mark::Craft { id: u64::from(number), at, ink: Ink::Lost });
            continue;
        }
        let mut body = satellite.body;
        let mut points = vec![at];
        points.extend((0..AHEAD).map(|_| {
            body = body.coasted(gravity);
            (body.x, body.y)
        }));
        marks.push(Mark::Path { points, ink: Ink::Faint });
        marks.push(Mark::Craft { id: u64::from(number), at, ink: Ink::Agent(number) });
        let burn = acted.chunks_exact(2).nth(number as usize).unwrap_or(&[0.0, 0.0]);
        let (x, y) = (f64::from(burn[0]), f64::from(burn[1]));
        if x != 0.0 || y != 0.0 {
            marks.push(Mark::Arrow { from: at, to: (at.0 + BURN * x, at.1 + BURN * y), ink: Ink::Burn });
        }
    }
}
