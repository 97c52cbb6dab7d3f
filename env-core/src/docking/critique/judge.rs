//! The deterministic judge from −1 to 1: a danger averted is 0.8 to 1, a danger missed is −1.
//! In docking nothing is averted by waiting, so "no action needed" never is the case.

use super::flown::Course;
use crate::critique::Judged;
use crate::docking::flight::Status;
use crate::docking::relative::distance;

/// The mean over the deputies: docked 0.8 to 1, the earlier the more; timed out 0 to −0.5 by how much of the way was left;
/// still flying when two others collided −0.5; stopped for speed −0.8; out of bounds −0.9; crashed or collided −1.
pub(super) fn of(course: &Course) -> Judged {
    let deputies = course.count();
    let values: Vec<(f64, &'static str)> = (0..deputies).map(|deputy| one(course, deputy)).collect();
    let value = values.iter().map(|(value, _)| value).sum::<f64>() / deputies as f64;
    let case = values.iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or("docked", |(_, case)| case);
    let docked = values.iter().filter(|(_, case)| *case == "docked").count();
    let words = if docked == deputies {
        format!("All {deputies} docked within {} s.", course.flight.steps())
    } else {
        format!("{docked} of {deputies} docked; the worst of the others: {}.", case.replace('_', " "))
    };
    Judged { value: value.clamp(-1.0, 1.0), case, words }
}

fn one(course: &Course, deputy: usize) -> (f64, &'static str) {
    let left = course.left(deputy);
    match course.flight.status(deputy) {
        Status::Docked => {
            let early = 1.0 - f64::from(left) / f64::from(course.flight.setup().time_limit);
            (0.8 + 0.2 * early, "docked")
        }
        Status::Active | Status::TimedOut => {
            let whole = distance(course.state(deputy, 0));
            (-0.5 * (distance(course.state(deputy, left)) / whole).min(1.0), "timeout")
        }
        Status::Saturated => (-0.8, "saturation"),
        Status::OutOfBounds => (-0.9, "out_of_bounds"),
        Status::Crashed => (-1.0, "crash"),
        Status::Collided if course.pairs().any(|(a, b)| a == deputy || b == deputy) => (-1.0, "collision"),
        Status::Collided => (-0.5, "collision"),
    }
}
