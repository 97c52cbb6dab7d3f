//! Questions about an episode's satellites and sky.

use super::TaskingSim;
use super::access_filter::AccessFilter;
use super::target_set::TargetSet;
use crate::tasking::access::trajectory::SAMPLE_S;
use crate::tasking::access::{GroundTrack, Opportunity, OpportunityKind};
use crate::tasking::error::TaskingError;
use crate::tasking::observation::eclipse::{NO_ECLIPSE, sampled_illumination};
use crate::tasking::observation::opportunity::angle_to;
use crate::tasking::observation::spec::ObservationSpec;
use crate::tasking::observation::view::Moment;
use crate::tasking::orbit::Sky;
use crate::tasking::satellite::eclipse::illumination;
use crate::tasking::setup::environment::Links;
use crate::tasking::vector3::{Matrix3, Vector3, rotate};

impl TaskingSim {
    /// Makes observations independent of each other, and a missing opportunity no error: an action that needs one lets the satellite
    /// go on, and an observation has the end of the episode instead of its window.
    pub fn observe_independently(&mut self) {
        self.tolerates_missing = true;
        let limit_s = self.time_limit_s();
        self.agents.iter_mut().for_each(|agent| agent.eclipses.search_first_to(limit_s));
    }

    /// The sky of the episode.
    pub(crate) const fn sky(&self) -> &Sky {
        &self.sky
    }

    /// True if satellites can learn from others which targets are imaged.
    pub(crate) fn shares_images(&self) -> bool {
        self.setup.communicator.links != Links::None
    }

    /// Lets a satellite know that a target is imaged, as if another one had told it.
    pub(crate) fn learn_image(&mut self, index: usize, target: usize) {
        self.agents[index].imaged.insert(target);
    }

    /// Planet-fixed path of a satellite as searched for windows, which differs from the true one by some tens of metres.
    pub(crate) fn search_track(&self, index: usize) -> &GroundTrack {
        self.agents[index].search_track()
    }

    /// Computes the windows of the ground stations that satellites transmit to up to the time limit, so that copies of the episode
    /// share them.
    pub(crate) fn compute_station_windows(&mut self) {
        /// Time beyond the limit for which transmitters look ahead, s.
        const LOOK_AHEAD_S: f64 = 660.0;
        let until_s = self.time_limit_s() + LOOK_AHEAD_S;
        if until_s.is_finite() {
            for agent in &mut self.agents {
                agent.satellite.stations_to(until_s, &mut self.sky);
            }
        }
    }

    /// Sets a further condition on the opportunities of a satellite, or removes it.
    pub fn set_access_filter(&mut self, index: usize, filter: Option<AccessFilter>) {
        self.agents[index].access_filter = filter;
    }

    /// Time limit of the episode, s; may be infinite.
    #[must_use]
    pub fn time_limit_s(&self) -> f64 {
        self.setup.clock.time_limit_s
    }

    /// Times at which the next eclipse begins and the next one ends, s; `None` if there is none within hours.
    pub fn next_eclipse(&mut self, index: usize) -> Option<[f64; 2]> {
        let now_s = self.time_s();
        let agent = &mut self.agents[index];
        let times = agent.eclipses.next(now_s, agent.satellite.orbit_mut(), &mut self.sky);
        (times != NO_ECLIPSE).then_some(times)
    }

    /// Share of the Sun that a satellite sees at a sample, every 30 s, of the trajectory that is searched for eclipses, 0 to 1.
    pub(crate) fn sampled_illumination(&mut self, index: usize, sample: usize) -> f64 {
        let orbit = self.agents[index].satellite.orbit_mut();
        orbit.extend_to(sample as f64 * SAMPLE_S, &mut self.sky);
        sampled_illumination(sample, orbit, &self.sky)
    }

    /// Description of a satellite's observation.
    #[must_use]
    pub fn observation_spec(&self, index: usize) -> &ObservationSpec {
        &self.agents[index].setup.observation
    }

    /// Targets whose image was rewarded.
    #[must_use]
    pub const fn rewarded_images(&self) -> &TargetSet {
        &self.rewarded
    }

    /// The next `count` opportunities of a kind, as BSK-RL finds them: without targets that are known to be imaged and those that the
    /// access filter does not accept. Fewer are padded with the last.
    ///
    /// # Errors
    /// Returns [`TaskingError::NoOpportunity`] if there is none, and [`TaskingError::Composition`] if the satellite knows no
    /// opportunities.
    pub fn next_opportunities(
        &mut self,
        index: usize,
        kind: OpportunityKind,
        count: usize,
    ) -> Result<Vec<Opportunity>, TaskingError> {
        let mut found = Vec::new();
        let now_s = self.time_s();
        self.agents[index].next_opportunities(kind, count, now_s, &mut self.sky, &mut found)?;
        Ok(found)
    }

    /// The next windows of a kind, at most `count`, without targets that are known to be imaged.
    pub fn next_windows(&mut self, index: usize, kind: OpportunityKind, count: usize) -> Vec<Opportunity> {
        self.next_opportunities(index, kind, count).unwrap_or_default()
    }

    /// Angle between the instrument and a target at a moment, rad.
    #[must_use]
    pub fn angle_to(&self, target: usize, moment: &Moment) -> f64 {
        angle_to(moment, &self.setup.targets[target].position)
    }

    /// Position of a satellite in the planet-fixed frame, m.
    #[must_use]
    pub fn planet_position(&self, index: usize) -> Vector3<f64> {
        rotate(&self.planet_from_inertial(), &self.agents[index].satellite.state.position)
    }

    /// Share of sunlight that the panel of a satellite received in the last tick, 0 to 1. Basilisk computes it from the positions of
    /// the tick before, and there is none at the start.
    #[must_use]
    pub fn illumination(&self, index: usize) -> f64 {
        let Some(tick) = self.now.checked_sub(1) else { return 1.0 };
        let time_s = self.setup.clock.tick.time_s(tick);
        let position = self.agents[index].satellite.orbit().arc(time_s).position(time_s);
        illumination(&position, &self.sky.sun(time_s))
    }

    /// Rotation from the inertial to the planet-fixed frame.
    #[must_use]
    pub fn planet_from_inertial(&self) -> Matrix3<f64> {
        self.sky.earth(self.time_s()).planet_from_inertial()
    }

    /// Position of the Sun relative to the Earth in the inertial frame, m.
    #[must_use]
    pub fn sun_position(&self) -> Vector3<f64> {
        self.sky.sun(self.time_s())
    }

    /// Memory of the episode, about, in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let windows = |index: usize| size_of_val(&self.opportunities(index).all()[..]);
        let nodes = |index: usize| 2 * size_of_val(self.agents[index].satellite.orbit().nodes());
        let agents: usize = (0..self.len()).map(|index| windows(index) + nodes(index)).sum();
        agents + size_of_val(&self.setup.targets[..]) + self.len() * size_of::<super::agent::Agent>()
    }
}
