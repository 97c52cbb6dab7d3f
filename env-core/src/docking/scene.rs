//! Scene of an episode: the chief and its deputies in two planes, their paths without further thrust, and thrusts.

use super::constants::DOCKING_RADIUS_M;
use super::end_conditions::DeputyStatus;
use super::relative_motion::{distance, speed, speed_limit};
use super::simulation::DockingSim;
use crate::scene::{Point, Primitive, Scene, Style, View};

/// Length of the drawn paths, s.
const PATH_LENGTH_S: u32 = 60;
/// Interval between the points of a path, s.
const PATH_INTERVAL_S: u32 = 10;
/// Smallest distance from the centre to the edge of a view, m.
const MIN_HALF_EXTENT_M: f64 = 20.0;
/// Length of the arrow of a thrust of 1 N, as a share of the view's half extent.
const THRUST_ARROW_RATIO: f64 = 0.15;

/// A plane of a view, by the indices of its axes in a state.
struct Plane {
    title: &'static str,
    across: usize,
    up: usize,
}

const PLANES: [Plane; 2] = [
    Plane { title: "in-track across, radial up", across: 1, up: 0 },
    Plane { title: "in-track across, cross-track up", across: 1, up: 2 },
];

/// Builds the scene after these thrusts (three values for each deputy).
pub(super) fn build_scene(sim: &DockingSim, actions: &[f32]) -> Scene {
    let active = sim.deputies().iter().filter(|deputy| deputy.is_active());
    let far = active.map(|deputy| distance(&deputy.state)).fold(MIN_HALF_EXTENT_M, f64::max);
    // 20, 40, 80, 160 … m, so that the scale changes rarely; a ring at half of it shows the scale.
    let mut reach = MIN_HALF_EXTENT_M;
    while reach < far * 1.1 {
        reach *= 2.0;
    }
    let deputy_lines = sim.deputies().iter().enumerate().map(|(number, deputy)| {
        let d = distance(&deputy.state);
        let status = deputy.end_conditions.status();
        if status == DeputyStatus::Active {
            format!("{number}: {d:.1} m, {:.2} m/s, limit {:.2}", speed(&deputy.state), speed_limit(d))
        } else {
            format!("{number}: {status:?}")
        }
    });
    let head = format!("{} s of {}, score {:.3}", sim.steps(), sim.setup().time_limit, sim.outcome().score);
    Scene {
        views: PLANES.iter().map(|plane| build_view(sim, actions, plane, reach)).collect(),
        status_lines: std::iter::once(head).chain(deputy_lines).collect(),
        alerts: sim.events().iter().map(super::event::DockingEvent::alert).collect(),
    }
}

fn build_view(sim: &DockingSim, actions: &[f32], plane: &Plane, reach: f64) -> View {
    let &Plane { title, across, up } = plane;
    let at = |state: &[f64; 6]| -> Point { (state[across], state[up]) };
    let mut marks = vec![
        Primitive::Ring { at: (0.0, 0.0), radius: reach / 2.0, style: Style::Guide },
        Primitive::Disc { at: (0.0, 0.0), radius: DOCKING_RADIUS_M.max(reach / 80.0), style: Style::Center },
        Primitive::Ring { at: (0.0, 0.0), radius: DOCKING_RADIUS_M, style: Style::Target },
    ];
    for (number, deputy) in (0u32..).zip(sim.deputies()) {
        let here = at(&deputy.state);
        if !deputy.is_active() {
            let style = if deputy.end_conditions.status() == DeputyStatus::Docked {
                Style::Agent(number)
            } else {
                Style::Lost
            };
            marks.push(Primitive::Marker { id: u64::from(number), at: here, style });
            continue;
        }
        let path = (0..=PATH_LENGTH_S / PATH_INTERVAL_S).map(|n| {
            let to = super::relative_motion::Transition::over(f64::from(n * PATH_INTERVAL_S));
            let state = to.phi * nalgebra::SVector::<f64, 6>::from(deputy.state);
            (state[across], state[up])
        });
        marks.push(Primitive::Path { points: path.collect(), style: Style::Guide });
        marks.push(Primitive::Marker { id: u64::from(number), at: here, style: Style::Agent(number) });
        let thrust = actions.chunks_exact(3).nth(number as usize).unwrap_or(&[0.0; 3]);
        let (x, y) = (f64::from(thrust[across]), f64::from(thrust[up]));
        if x != 0.0 || y != 0.0 {
            let to = (here.0 + THRUST_ARROW_RATIO * reach * x, here.1 + THRUST_ARROW_RATIO * reach * y);
            marks.push(Primitive::Arrow { from: here, to, style: Style::Burn });
        }
    }
    View { title, center: (0.0, 0.0), half_extent: reach, primitives: marks }
}
