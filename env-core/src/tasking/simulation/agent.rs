//! A satellite with its tasking: opportunities, current action and known data.

use super::access_filter::AccessFilter;
use super::journal::{Journal, SatelliteEvent};
use super::target_set::TargetSet;
use std::sync::Arc;

use crate::tasking::access::trajectory::MIN_DURATION_S;
use crate::tasking::access::{
    GroundTrack, Locations, Opportunity, OpportunityKind, OpportunityList, SearchedTrajectory,
};
use crate::tasking::error::TaskingError;
use crate::tasking::observation::eclipse::EclipseForecast;
use crate::tasking::orbit::{OrbitalElements, Sky};
use crate::tasking::satellite::TaskedSatellite;
use crate::tasking::setup::actions::SoftwareAction;
use crate::tasking::setup::environment::{AgentSetup, GenerationTimes};

/// Largest number of blocks that one search for opportunities computes.
const MAX_LOOK_AHEAD: usize = 100;

/// Longest time ahead that is searched for an opportunity: a hundred days, s.
const MAX_AHEAD_S: f64 = 100.0 * 86_400.0;

/// Key of the last action: an action with the same key does not reset the flight software.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ActionKey {
    /// A function of the flight software.
    Software(SoftwareAction),
    /// The image of a target.
    Target(usize),
    /// The broadcast of known data.
    Broadcast,
}

/// An event that ends an action at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TimedEvent {
    /// First tick at or after the time; `None` if it is never reached.
    pub tick: Option<u64>,
    /// Close of the window of the tasked target, s, if the event is one of imaging.
    pub window_close_s: Option<f64>,
}

/// An agent of an episode.
#[derive(Debug, Clone)]
pub(super) struct Agent {
    pub setup: AgentSetup,
    pub satellite: TaskedSatellite,
    pub opportunities: OpportunityList,
    pub targets: Arc<Locations>,
    /// Ground stations with their minimum elevations.
    stations: Arc<Locations>,
    /// Trajectory that is searched for windows.
    trajectory: SearchedTrajectory,
    pub eclipses: EclipseForecast,
    /// Time for which opportunities are computed at the start, s.
    initial_s: f64,
    /// Targets that the satellite knows to be imaged.
    pub imaged: TargetSet,
    /// True if opportunities leave out targets that are known to be imaged. BSK-RL loses this where there are several rewarders.
    pub hides_imaged: bool,
    pub last_action: Option<ActionKey>,
    pub timed_event: Option<TimedEvent>,
    pub broadcast_pending: bool,
    pub needs_action: bool,
    /// Target of the last command to image.
    pub latest_target: Option<usize>,
    pub images: u32,
    pub misses: u32,
    pub is_alive: bool,
    /// Bits that the last step began with: of the instrument's partition, and of all.
    pub logged_bits: [f64; 2],
    /// Orbital elements of the first observation, which BSK-RL never computes again.
    pub elements: Option<OrbitalElements>,
    /// Values of rewarded properties at the end of the last step.
    pub logged_resources: Vec<f64>,
    /// Further condition on opportunities.
    pub access_filter: Option<AccessFilter>,
    /// Record of what happens to the satellite, if it is kept.
    pub journal: Option<Box<Journal>>,
}

impl Agent {
    pub(super) fn new(
        setup: AgentSetup,
        satellite: TaskedSatellite,
        [targets, stations]: [Arc<Locations>; 2],
        time_limit_s: f64,
        hides_imaged: bool,
    ) -> Self {
        let initial_s = setup.class.generation().map_or(0.0, |times| {
            let limit = if time_limit_s.is_finite() { time_limit_s } else { 0.0 };
            times.initial_s.unwrap_or(limit)
        });
        let count = targets.len();
        let [stored, other] = satellite.stored();
        let is_alive = satellite.is_alive();
        Self {
            setup,
            satellite,
            opportunities: OpportunityList::default(),
            targets,
            stations,
            trajectory: SearchedTrajectory::default(),
            eclipses: EclipseForecast::default(),
            initial_s,
            imaged: TargetSet::new(count),
            hides_imaged,
            last_action: None,
            timed_event: None,
            broadcast_pending: false,
            needs_action: true,
            latest_target: None,
            images: 0,
            misses: 0,
            is_alive,
            logged_bits: [stored, stored + other],
            elements: None,
            logged_resources: Vec::new(),
            access_filter: None,
            journal: None,
        }
    }

    /// Name of the satellite.
    pub(super) fn name(&self) -> &str {
        self.satellite.name()
    }

    /// The trajectory that is searched for windows.
    pub(super) const fn search_track(&self) -> &GroundTrack {
        self.trajectory.track()
    }

    /// Deletes the events of the satellite, as BSK-RL does when it dies; those of later actions count.
    pub(super) fn delete_events(&mut self) {
        (self.timed_event, self.satellite.awaited_bits) = (None, None);
    }

    fn generation(&self) -> Result<GenerationTimes, TaskingError> {
        self.setup.class.generation().ok_or_else(|| {
            TaskingError::Composition(format!(
                "satellite {} must be an AccessSatellite to have opportunities",
                self.name()
            ))
        })
    }

    /// Computes the opportunities of the start.
    pub(super) fn compute_initial(&mut self, sky: &mut Sky) -> Result<(), TaskingError> {
        if self.setup.class.generation().is_some() {
            self.compute_block(self.initial_s, sky)?;
        }
        Ok(())
    }

    /// Computes opportunities for `duration_s` more, to the end of a block.
    pub(super) fn compute_block(&mut self, duration_s: f64, sky: &mut Sky) -> Result<(), TaskingError> {
        let times = self.generation()?;
        let from_s = self.opportunities.computed_s();
        let Some(end_s) = self.opportunities.next_block_end(duration_s, times.block_s) else {
            return Ok(());
        };
        if let Some(journal) = &mut self.journal {
            journal.add_now(SatelliteEvent::Search { from_s, to_s: end_s });
        }
        self.eclipses.extend_to(end_s.max(MIN_DURATION_S), self.satellite.orbit_mut(), sky);
        let samples = self.eclipses.sample_count();
        self.trajectory.extend_to(samples, self.satellite.orbit_mut(), sky);
        let places =
            [(OpportunityKind::Target, &*self.targets), (OpportunityKind::GroundStation, &*self.stations)];
        self.opportunities.add_block(end_s, places, &self.trajectory);
        Ok(())
    }

    /// Computes opportunities until they reach a time, s.
    pub(super) fn compute_to(&mut self, seconds: f64, sky: &mut Sky) -> Result<(), TaskingError> {
        let block_s = self.generation()?.block_s;
        while self.opportunities.computed_s() < seconds {
            self.compute_block(block_s, sky)?;
        }
        Ok(())
    }

    /// The next `count` opportunities of a kind, without targets that are known to be imaged. Fewer are padded with the last.
    pub(super) fn next_opportunities(
        &mut self,
        kind: OpportunityKind,
        count: usize,
        now_s: f64,
        sky: &mut Sky,
        found: &mut Vec<Opportunity>,
    ) -> Result<(), TaskingError> {
        let times = self.generation()?;
        found.clear();
        for _ in 0..MAX_LOOK_AHEAD {
            found.clear();
            let hides_imaged = self.hides_imaged && kind == OpportunityKind::Target;
            let is_wanted = |item: &&Opportunity| {
                !(hides_imaged && self.imaged.contains(item.object))
                    && self.access_filter.as_ref().is_none_or(|filter| filter.accepts(item))
            };
            found.extend(self.opportunities.upcoming(kind, now_s).iter().filter(is_wanted).take(count));
            if found.len() >= count {
                return Ok(());
            }
            let computed_s = self.opportunities.computed_s();
            if computed_s >= self.initial_s + times.max_beyond_s || computed_s - now_s > MAX_AHEAD_S {
                break;
            }
            self.compute_block(times.block_s, sky)?;
        }
        let Some(last) = found.last().copied() else {
            return Err(TaskingError::NoOpportunity {
                satellite: self.name().to_owned(),
                types: match kind {
                    OpportunityKind::Target => "target".to_owned(),
                    OpportunityKind::GroundStation => "ground_station".to_owned(),
                },
            });
        };
        found.resize(count, last);
        Ok(())
    }
}
