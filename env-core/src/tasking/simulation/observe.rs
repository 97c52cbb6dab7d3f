//! Observations of an episode's satellites.

use super::TaskingSim;
use super::agent::Agent;
use crate::tasking::access::OpportunityKind;
use crate::tasking::error::TaskingError;
use crate::tasking::observation::opportunity::OpportunityView;
use crate::tasking::observation::spec::{ObservationItem, ObservationSpec};
use crate::tasking::observation::view::SatelliteView;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::setup::environment::Rewarder;

impl TaskingSim {
    /// Calls a function with the state of a satellite.
    pub fn with_view<T>(&mut self, index: usize, f: impl FnOnce(&SatelliteView<'_>) -> T) -> T {
        let time = self.time_s();
        let Agent { satellite, elements, .. } = &mut self.agents[index];
        satellite.orbit_mut().extend_to(time, &mut self.sky);
        let velocity = satellite.velocity(self.now);
        let elements = *elements.get_or_insert_with(|| {
            OrbitalElements::from_state(satellite.spec().args.mu, &satellite.state.position, &velocity)
        });
        let view = SatelliteView {
            spec: satellite.spec(),
            state: &satellite.state,
            stored_bits: satellite.stored().iter().sum(),
            velocity,
            elements,
            planet: self.sky.earth(time).planet_from_inertial(),
            sun: self.sky.sun(time),
            time_s: time,
        };
        f(&view)
    }

    /// Computes the opportunities of a satellite until they reach a time, s.
    ///
    /// # Errors
    /// Returns [`TaskingError::Composition`] if it knows no opportunities.
    pub fn compute_opportunities(&mut self, index: usize, until_s: f64) -> Result<(), TaskingError> {
        self.agents[index].compute_to(until_s, &mut self.sky)
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
        for (_, item) in observation.items() {
            match item {
                ObservationItem::Properties(properties) => self.with_view(index, |view| {
                    for entry in properties {
                        let first = out.len();
                        entry.property.write(view, out);
                        out[first..].iter_mut().for_each(|x| *x /= entry.norm);
                    }
                }),
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
                ObservationItem::Opportunities { .. } => self.observe_opportunities(index, item, out)?,
            }
        }
        Ok(())
    }

    fn observe_opportunities(
        &mut self,
        index: usize,
        item: &ObservationItem,
        out: &mut Vec<f64>,
    ) -> Result<(), TaskingError> {
        let ObservationItem::Opportunities { kind, count, properties } = item else { return Ok(()) };
        let mut found = Vec::new();
        let now_s = self.time_s();
        self.agents[index].next_opportunities(*kind, *count, now_s, &mut self.sky, &mut found)?;
        let objects: Vec<OpportunityView> = found
            .iter()
            .map(|opportunity| match opportunity.kind {
                OpportunityKind::Target => {
                    let target = &self.setup.targets[opportunity.object];
                    OpportunityView {
                        opportunity: *opportunity,
                        position: target.position,
                        priority: Some(target.priority),
                    }
                }
                OpportunityKind::GroundStation => OpportunityView {
                    opportunity: *opportunity,
                    position: self.setup.stations[opportunity.object].position,
                    priority: None,
                },
            })
            .collect();
        self.with_view(index, |view| {
            for object in &objects {
                for entry in properties {
                    entry.property.write(view, object, entry.norm, out);
                }
            }
        });
        Ok(())
    }
}
