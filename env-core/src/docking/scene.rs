//! docking as marks: the chief, its deputies in two planes with the paths they fly if nobody acts, thrusts.

use super::constants::DOCKING_RADIUS_M;
use super::flight::{Flight, Status};
use super::relative::{distance, speed, speed_limit};
use crate::scene::{Ink, Mark, Point, Scene, View};

/// How far ahead paths are drawn, s.
const AHEAD_S: u32 = 60;
/// A path is drawn through every so many seconds.
const EVERY_S: u32 = 10;
/// The least from the middle to the edge, m.
const LEAST: f64 = 20.0;
/// A thrust of 1 N is drawn as this share of the view.
const THRUST: f64 = 0.15;

/// What is across and what is up, as columns of a state.
const PLANES: [(&str, usize, usize); 2] =
    [("in-track across, radial up", 1, 0), ("in-track across, cross-track up", 1, 2)];

/// The flight now, after these thrusts (three of each deputy).
pub(super) fn scene(flight: &Flight, acted: &[f32]) -> Scene {
    let flying = flight.deputies().iter().filter(|deputy| deputy.flies());
    let far = flying.clone().map(|deputy| distance(&deputy.state)).fold(LEAST, f64::max);
    // The next of 20, 40, 80, 160 … m: the scale changes rarely, and is told by the title's ring.
    let mut reach = LEAST;
    while reach < far * 1.1 {
        reach *= 2.0;
    }
    let told = flight.deputies().iter().enumerate().map(|(number, deputy)| {
        let d = distance(&deputy.state);
        let status = deputy.ends.status();
        if status == Status::Active {
            format!("{number}: {d:.1} m, {:.2} m/s, limit {:.2}", speed(&deputy.state), speed_limit(d))
        } else {
            format!("{number}: {status:?}")
        }
    });
    let head =
        format!("{} s of {}, score {:.3}", flight.steps(), flight.setup().time_limit, flight.flown().score);
    Scene {
        views: PLANES.iter().map(|plane| view(flight, acted, plane, reach)).collect(),
        told: std::iter::once(head).chain(told).collect(),
        alerts: flight.events().iter().map(super::event::Event::alert).collect(),
    }
}

fn view(flight: &Flight, acted: &[f32], plane: &(&'static str, usize, usize), reach: f64) -> View {
    let &(title, across, up) = plane;
    let at = |state: &[f64; 6]| -> Point { (state[across], state[up]) };
    let mut marks = vec![
        Mark::Ring { at: (0.0, 0.0), radius: reach / 2.0, ink: Ink::Faint },
        Mark::Disc { at: (0.0, 0.0), radius: DOCKING_RADIUS_M.max(reach / 80.0), ink: Ink::Centre },
        Mark::Ring { at: (0.0, 0.0), radius: DOCKING_RADIUS_M, ink: Ink::Target },
    ];
    for (number, deputy) in (0u32..).zip(flight.deputies()) {
        let here = at(&deputy.state);
        if !deputy.flies() {
            let ink = if deputy.ends.status() == Status::Docked { Ink::Agent(number) } else { Ink::Lost };
            marks.push(Mark::Craft { id: u64::from(number), at: here, ink });
            continue;
        }
        let path = (0..=AHEAD_S / EVERY_S).map(|n| {
            let to = super::relative::Transition::over(f64::from(n * EVERY_S));
            let state = to.phi * nalgebra::SVector::<f64, 6>::from(deputy.state);
            (state[across], state[up])
        });
        marks.push(Mark::Path { points: path.collect(), ink: Ink::Faint });
        marks.push(Mark::Craft { id: u64::from(number), at: here, ink: Ink::Agent(number) });
        let thrust = acted.chunks_exact(3).nth(number as usize).unwrap_or(&[0.0; 3]);
        let (x, y) = (f64::from(thrust[across]), f64::from(thrust[up]));
        if x != 0.0 || y != 0.0 {
            let to = (here.0 + THRUST * reach * x, here.1 + THRUST * reach * y);
            marks.push(Mark::Arrow { from: here, to, ink: Ink::Burn });
        }
    }
    View { title, middle: (0.0, 0.0), reach, marks }
}
