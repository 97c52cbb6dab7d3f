//! Courses that satellites fly if they burn no more, compared with debris. A foreseen course stays true until a satellite
//! burns, so that a step without a burn compares one point of a course instead of all.

use super::ephemeris::DebrisEphemeris;
use super::look_ahead::{LookAhead, after_burn};
use super::trajectory::TRAJECTORY_POINTS;
use crate::kessler::constants::{CONTACT_2, SATELLITES};
use crate::kessler::kernel::Body;

/// Courses of all satellites of a plan in progress.
pub(super) struct CoastingCourses([CoastingCourse; SATELLITES]);

/// Course of one satellite, as far as it is known.
#[derive(Clone, Copy)]
struct CoastingCourse {
    /// States after each step, of which those from the burn up to `last` are known.
    states: [Body; TRAJECTORY_POINTS],
    /// Last step that is known.
    last: usize,
    /// First step with a contact, at which the course ends.
    contact: Option<usize>,
    /// False if there is no course, or none that the plan in progress follows.
    is_known: bool,
}

impl CoastingCourses {
    /// Courses that are not known yet.
    pub(super) fn new(start: Body) -> Self {
        let states = [start; TRAJECTORY_POINTS];
        Self([CoastingCourse { states, last: 0, contact: None, is_known: false }; SATELLITES])
    }

    /// Forgets all courses, before another plan.
    pub(super) fn forget(&mut self) {
        self.0.iter_mut().for_each(|course| course.is_known = false);
    }

    /// First contact to act on of each satellite after its planned burn, as steps from `row`, counted from 1. Equals
    /// [`LookAhead::contacts_of_plans`] for the satellites that are not lost, whose bodies are given.
    pub(super) fn contacts_of_plans(
        &mut self,
        look_ahead: &LookAhead,
        bodies: [Option<Body>; SATELLITES],
        planned: [Option<(f64, f64)>; SATELLITES],
        ephemeris: &DebrisEphemeris,
        row: usize,
    ) -> [Option<u32>; SATELLITES] {
        for (course, (body, burn)) in self.0.iter_mut().zip(bodies.into_iter().zip(planned)) {
            let Some(body) = body else {
                course.is_known = false;
                continue;
            };
            if burn.is_some() || !course.leads_through(row, body) {
                course.begin(row, after_burn(body, burn.unwrap_or_default().into()));
            }
        }
        let steps = look_ahead.steps.min(look_ahead.act_within) as usize;
        let last = (row + steps).min(ephemeris.rows() - 1).min(TRAJECTORY_POINTS - 1);
        for step in row + 1..=last {
            for course in &mut self.0 {
                course.follow_to(step, ephemeris);
            }
        }
        let steps_from_now = |contact: usize| u32::try_from(contact - row).unwrap_or(u32::MAX);
        self.0.each_ref().map(|course| course.contact.filter(|_| course.is_known).map(steps_from_now))
    }
}

impl CoastingCourse {
    /// True if the course has this state after step `row`, before its contact.
    fn leads_through(&self, row: usize, body: Body) -> bool {
        self.is_known
            && row <= self.last
            && self.contact.is_none_or(|contact| row < contact)
            && self.states[row] == body
    }

    /// Begins with the state after step `row`.
    fn begin(&mut self, row: usize, body: Body) {
        self.states[row] = body;
        (self.last, self.contact, self.is_known) = (row, None, true);
    }

    /// Follows the course to the end of `step`, the next one that is not known; does nothing if it is known, or if there is
    /// no course that far.
    fn follow_to(&mut self, step: usize, ephemeris: &DebrisEphemeris) {
        if !self.is_known || self.contact.is_some() || step <= self.last {
            return;
        }
        let body = self.states[self.last].coast(ephemeris.physics.gravity);
        (self.states[step], self.last) = (body, step);
        if ephemeris.any_within(step, body.x, body.y, CONTACT_2) {
            self.contact = Some(step);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kessler::setup::Physics;

    fn body() -> impl Strategy<Value = Body> {
        (40.0..60.0f64, 0.0..std::f64::consts::TAU, -1.5..1.5f64)
            .prop_map(|(radius, angle, speed)| Body::circular(radius, angle, speed))
    }

    proptest! {
        /// With burns in some steps, of which some are not the planned ones, and a satellite that is lost.
        #[test]
        fn courses_have_the_contacts_of_the_look_ahead(
            debris in prop::collection::vec(body(), 0..60),
            satellites in prop::array::uniform3(body()),
            burns in prop::collection::vec(prop::option::weighted(0.3, -0.5..0.5f64), 3 * 40),
            lost_from in 0..80usize,
            act_within in 2..14u32,
        ) {
            let ephemeris = DebrisEphemeris::propagate(&debris, &[], 40, Physics::DEFAULT);
            ephemeris.prepare_search();
            let look_ahead = LookAhead { steps: act_within + 2, act_within, margin: 1.2 };
            let mut courses = CoastingCourses::new(satellites[0]);
            let mut bodies = satellites;
            for row in 0..40 {
                let planned = std::array::from_fn(|i| burns[3 * row + i].map(|size| (size, 0.1)));
                let expected = look_ahead.contacts_of_plans(bodies, planned, &ephemeris, row);
                let is_lost = |i: usize| i == 1 && row >= lost_from;
                let given = std::array::from_fn(|i| Some(bodies[i]).filter(|_| !is_lost(i)));
                let contacts = courses.contacts_of_plans(&look_ahead, given, planned, &ephemeris, row);
                for i in (0..SATELLITES).filter(|i| !is_lost(*i)) {
                    prop_assert_eq!(contacts[i], expected[i]);
                    // Before a contact a satellite often burns in another way.
                    let burn = if contacts[i].is_some_and(|steps| steps % 2 == 0) { (0.2, -0.2) } else { planned[i].unwrap_or_default() };
                    bodies[i] = after_burn(bodies[i], burn.into()).coast(ephemeris.physics.gravity);
                }
            }
        }
    }
}
