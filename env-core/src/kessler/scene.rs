//! Drawing of kessler: the Earth, satellites with their paths under hold, debris, burns and radar ranges.

use super::constants::{EARTH_RADIUS, HORIZON, RADAR_NONE, TARGET_RADIUS};
use super::event::KesslerEvent;
use super::reward::{Objective, score};
use super::simulation::KesslerSim;
use crate::episode_rng::EpisodeRng;
use crate::scene::{Primitive, Scene, Style, View};

/// Distance from the middle of the view to its edge, LU. Debris starts within 90 LU, rogues arrive at 95, the
/// target is at 100.
const VIEW_REACH: f64 = 108.0;
/// Length of the drawn hold paths, steps.
const PATH_STEPS: usize = 15;
/// Length of the arrow of a burn of 1 LU/TU, LU.
const ARROW_LENGTH: f64 = 25.0;
/// Radius of a debris disc, LU: half the contact distance, so that discs touch when bodies do.
const DEBRIS_DISC_RADIUS: f64 = 1.0;
/// Offset of the craft ids of debris; satellites use their numbers.
const DEBRIS_ID_OFFSET: u64 = 1 << 32;

/// Scene after the last step. `burns` holds dvx and dvy of each satellite's last burn, LU/TU.
pub(super) fn scene<R: EpisodeRng>(sim: &KesslerSim<R>, burns: &[f32]) -> Scene {
    let setup = sim.setup();
    let mut marks = vec![Primitive::Disc { at: (0.0, 0.0), radius: EARTH_RADIUS, style: Style::Center }];
    if sim.objective() == Objective::Rendezvous {
        marks.push(Primitive::Ring { at: (0.0, 0.0), radius: TARGET_RADIUS, style: Style::Target });
    }
    if let Some(range) = setup.radar_range.filter(|range| *range < RADAR_NONE) {
        let active_satellites = sim.satellites().iter().filter(|satellite| satellite.is_active());
        marks.extend(active_satellites.map(|s| Primitive::Ring {
            at: (s.body.x, s.body.y),
            radius: range,
            style: Style::Guide,
        }));
    }
    for index in 0..sim.debris().len() {
        let body = sim.debris().body(index);
        let at = (body.x, body.y);
        let style = if sim.is_visible(body.x, body.y) { Style::Debris } else { Style::HiddenDebris };
        marks.push(Primitive::Disc { at, radius: DEBRIS_DISC_RADIUS, style });
        marks.push(Primitive::Marker { id: DEBRIS_ID_OFFSET | u64::from(sim.debris().id(index)), at, style });
    }
    draw_satellites(sim, burns, &mut marks);
    let active = sim.satellites().iter().filter(|satellite| satellite.is_active()).count();
    let fuel: Vec<String> = sim.satellites().iter().map(|s| format!("{:.1}", s.fuel)).collect();
    Scene {
        views: vec![View { title: "", center: (0.0, 0.0), half_extent: VIEW_REACH, primitives: marks }],
        status_lines: vec![
            sim.objective().mission_text().split(':').next().unwrap_or_default().to_owned(),
            format!("step {} of {HORIZON}", sim.steps()),
            format!("flying {active} of {}", sim.satellites().len()),
            format!("fuel {}", fuel.join("  ")),
            format!("score {:.3}", score(sim.total_reward())),
        ],
        alerts: sim.events().iter().filter_map(KesslerEvent::alert).collect(),
    }
}

/// Draws the satellites, their hold paths and their last burns.
fn draw_satellites<R: EpisodeRng>(sim: &KesslerSim<R>, burns: &[f32], marks: &mut Vec<Primitive>) {
    let gravity = sim.setup().physics.gravity;
    for (number, satellite) in (0u32..).zip(sim.satellites()) {
        let at = (satellite.body.x, satellite.body.y);
        if !satellite.is_active() {
            marks.push(Primitive::Marker { id: u64::from(number), at, style: Style::Lost });
            continue;
        }
        let mut body = satellite.body;
        let mut points = vec![at];
        points.extend((0..PATH_STEPS).map(|_| {
            body = body.coast(gravity);
            (body.x, body.y)
        }));
        marks.push(Primitive::Path { points, style: Style::Guide });
        marks.push(Primitive::Marker { id: u64::from(number), at, style: Style::Agent(number) });
        let burn = burns.chunks_exact(2).nth(number as usize).unwrap_or(&[0.0, 0.0]);
        let (x, y) = (f64::from(burn[0]), f64::from(burn[1]));
        if x != 0.0 || y != 0.0 {
            marks.push(Primitive::Arrow {
                from: at,
                to: (at.0 + ARROW_LENGTH * x, at.1 + ARROW_LENGTH * y),
                style: Style::Burn,
            });
        }
    }
}
