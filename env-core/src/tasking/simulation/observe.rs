//! Observations of an episode's satellites.

use super::TaskingSim;
use super::agent::Agent;
use crate::tasking::access::OpportunityKind;
use crate::tasking::error::TaskingError;
use crate::tasking::observation::opportunity::OpportunityView;
use crate::tasking::observation::spec::{ObservationItem, ObservationSpec};
use crate::tasking::observation::view::{Moment, SatelliteView};
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::setup::environment::{MAX_TIME_S, Rewarder};
use crate::tasking::tick::attitude::body_from_inertial;
use crate::tasking::vector3::{rotate, rotate_back};

impl TaskingSim {
    /// Computes what observations need of this moment.
    pub fn moment(&mut self, index: usize) -> Moment {
        let time_s = self.time_s();
        let Agent { satellite, elements, .. } = &mut self.agents[index];
        satellite.orbit_mut().extend_to(time_s, &mut self.sky);
        let velocity = satellite.velocity(self.now);
        let state = &satellite.state;
        let args = &satellite.spec().args;
        let elements =
            *elements.get_or_insert_with(|| OrbitalElements::from_state(args.mu, &state.position, &velocity));
        let planet = self.sky.earth(time_s).planet_from_inertial();
        let body = body_from_inertial(&state.attitude.sigma);
        let instrument = rotate_back(&body, &args.instrument_axis);
        Moment {
            time_s,
            velocity,
            elements,
            planet,
            sun: self.sky.sun(time_s),
            body,
            planet_position: rotate(&planet, &state.position),
            instrument,
            instrument_fixed: rotate(&planet, &instrument),
        }
    }

    /// A satellite as observations see it.
    #[must_use]
    pub fn view<'a>(&'a self, index: usize, moment: &'a Moment) -> SatelliteView<'a> {
        let satellite = &self.agents[index].satellite;
        SatelliteView {
            spec: satellite.spec(),
            state: &satellite.state,
            stored_bits: satellite.stored().iter().sum(),
            moment,
        }
    }

    /// Computes the opportunities of a satellite until they reach a time, s, block by block.
    ///
    /// # Errors
    /// Returns [`TaskingError::Composition`] if it knows no opportunities, and [`TaskingError::InvalidArgument`] if the time is not
    /// within [`MAX_TIME_S`].
    pub fn compute_opportunities(&mut self, index: usize, until_s: f64) -> Result<(), TaskingError> {
        check_time(until_s)?;
        self.agents[index].compute_to(until_s, &mut self.sky)
    }

    /// Computes the opportunities of a satellite for `duration_s` more in one search, to the end of a block.
    ///
    /// # Errors
    /// Those of [`Self::compute_opportunities`].
    pub fn compute_more_opportunities(&mut self, index: usize, duration_s: f64) -> Result<(), TaskingError> {
        check_time(self.agents[index].opportunities.computed_s() + duration_s)?;
        self.agents[index].compute_block(duration_s, &mut self.sky)
    }

    /// Names of the values of a satellite's observation.
    #[must_use]
    pub fn observation_columns(&self, index: usize) -> Vec<String> {
        let is_resource = |rewarder: &&Rewarder| matches!(rewarder, Rewarder::Resource { .. });
        let weights = self.setup.rewarders.iter().filter(is_resource).count();
        self.agents[index].setup.observation.columns(weights)
    }

    /// Appends the observation of a satellite.
    ///
    /// # Errors
    /// Returns [`TaskingError::NoOpportunity`] if it has no upcoming opportunity of an observed kind.
    pub fn observe(&mut self, index: usize, out: &mut Vec<f64>) -> Result<(), TaskingError> {
        // The description is taken out for the time of the observation, which changes the agent.
        let observation = std::mem::take(&mut self.agents[index].setup.observation);
        let result = self.observe_items(index, &observation, out);
        self.agents[index].setup.observation = observation;
        result
    }

    fn observe_items(
        &mut self,
        index: usize,
        observation: &ObservationSpec,
        out: &mut Vec<f64>,
    ) -> Result<(), TaskingError> {
        let moment = self.moment(index);
        for (_, item) in observation.items() {
            match item {
                ObservationItem::Properties(properties) => {
                    let view = self.view(index, &moment);
                    for entry in properties {
                        let first = out.len();
                        entry.property.write(&view, out);
                        out[first..].iter_mut().for_each(|x| *x /= entry.norm);
                    }
                }
                ObservationItem::Time { norm_s, is_remaining } => {
                    let limit = self.setup.clock.time_limit_s;
                    let time = if *is_remaining { limit - self.time_s() } else { self.time_s() };
                    out.push(time / norm_s.unwrap_or(limit));
                }
                ObservationItem::Eclipse { norm_s } => {
                    let now_s = self.time_s();
                    let agent = &mut self.agents[index];
                    let times = agent.eclipses.next(now_s, agent.satellite.orbit_mut(), &mut self.sky);
                    out.extend(times.map(|time| (time - now_s) / norm_s));
                }
                ObservationItem::ResourceWeights { norm } => {
                    let weights = self.setup.rewarders.iter().filter_map(|rewarder| match rewarder {
                        Rewarder::Resource { weight, .. } => Some(weight / norm),
                        _ => None,
                    });
                    out.extend(weights);
                }
                ObservationItem::Opportunities { .. } => {
                    self.observe_opportunities(index, item, &moment, out)?;
                }
            }
        }
        Ok(())
    }

    fn observe_opportunities(
        &mut self,
        index: usize,
        item: &ObservationItem,
        moment: &Moment,
        out: &mut Vec<f64>,
    ) -> Result<(), TaskingError> {
        let ObservationItem::Opportunities { kind, count, properties } = item else { return Ok(()) };
        let mut found = std::mem::take(&mut self.found);
        let result =
            self.agents[index].next_opportunities(*kind, *count, moment.time_s, &mut self.sky, &mut found);
        let view = self.view(index, moment);
        for opportunity in &found {
            let (position, priority) = match opportunity.kind {
                OpportunityKind::Target => {
                    let target = &self.setup.targets[opportunity.object];
                    (target.position, Some(target.priority))
                }
                OpportunityKind::GroundStation => (self.setup.stations[opportunity.object].position, None),
            };
            let object = OpportunityView { opportunity: *opportunity, position, priority };
            for entry in properties {
                entry.property.write(&view, &object, entry.norm, out);
            }
        }
        self.found = found;
        match result {
            Err(TaskingError::NoOpportunity { .. }) if self.tolerates_missing => {
                let left_s = self.time_limit_s() - moment.time_s;
                for _ in 0..*count {
                    properties.iter().for_each(|entry| entry.property.write_missing(left_s, entry.norm, out));
                }
                Ok(())
            }
            other => other,
        }
    }
}

fn check_time(seconds: f64) -> Result<(), TaskingError> {
    if (0.0..=MAX_TIME_S).contains(&seconds) {
        return Ok(());
    }
    Err(TaskingError::InvalidArgument {
        name: "time".to_owned(),
        requirement: format!("must be from 0 to {MAX_TIME_S} s"),
        value: seconds.to_string(),
    })
}
