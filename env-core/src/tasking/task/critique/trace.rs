//! The trace of an episode: a sample of every tick, and the actions, images, misses and deaths of each satellite.

use super::momentum::WheelMomentum;
use super::sample::{SatelliteRecorder, TickSample};
use super::settling::settling_s;
use super::tasked_action::TaskedAction;
use crate::bracket::EpisodeOutcome;
use crate::error::ReplayError;
use crate::log::ActionLog;
use crate::rollout::step_through;
use crate::task::Scenario;
use crate::tasking::access::{Opportunity, OpportunityKind};
use crate::tasking::simulation::journal::{JournalEntry, SatelliteEvent};
use crate::tasking::simulation::target_set::TargetSet;
use crate::tasking::simulation::{AgentAction, TaskingSim};
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::spaces::IMAGE_ACTIONS;
use crate::tasking::task::task_setup::TaskSetup;

/// Largest number of missed windows for which the time that was short is simulated.
const MAX_SETTLINGS: usize = 64;

/// A finished episode with all that a critique needs of it.
pub(super) struct TaskingTrace {
    /// The episode at its end.
    pub run: TaskRun,
    /// Outcome of the episode.
    pub outcome: EpisodeOutcome,
    /// Actions and state of each satellite.
    pub satellites: Vec<SatelliteTrace>,
    /// The last tick of each step.
    step_ends: Vec<u64>,
    /// Targets that any satellite imaged while it lived.
    imaged: TargetSet,
}

/// Actions and state of a satellite in an episode.
pub(super) struct SatelliteTrace {
    /// Samples by tick, the first of the start.
    pub samples: Vec<TickSample>,
    /// Actions that were applied, in order.
    pub actions: Vec<TracedAction>,
    /// Images that were stored, in order.
    pub images: Vec<TracedImage>,
    /// Windows of tasked targets that closed without an image, in order.
    pub misses: Vec<MissedWindow>,
    /// Death of the satellite, if it died.
    pub death: Option<Death>,
}

/// An action that was applied.
#[derive(Debug, Clone)]
pub(super) struct TracedAction {
    /// Step of the action, from 1.
    pub step: u32,
    /// Tick at which the action was given.
    pub start: u64,
    /// Tick at which the satellite needed the next action, or at which the episode ended.
    pub end: u64,
    /// Kind of the action.
    pub kind: TaskedAction,
    /// True if the last action was the same one, so that it only lasts longer, or if the satellite had nothing to image.
    pub is_repeat: bool,
    /// Targets of the actions that image one, by index; empty if the action images none.
    pub choices: Vec<Opportunity>,
    /// Angle between the instrument and the target at the start, degrees; 0 if the action images none.
    pub slew_deg: f64,
}

/// An image that was stored.
#[derive(Debug, Clone, Copy)]
pub(super) struct TracedImage {
    /// Step of the image, from 1.
    pub step: u32,
    /// Tick at the end of the step.
    pub tick: u64,
    /// Index of the target.
    pub target: usize,
    /// Index of the satellite's action that commanded the image.
    pub action: usize,
}

/// The window of a tasked target that closed without an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct MissedWindow {
    /// Tick at which the step ended.
    pub tick: u64,
    /// Index of the target.
    pub target: usize,
    /// Index of the satellite's action that commanded the image.
    pub action: usize,
    /// Opening of the window, s.
    pub open_s: f64,
    /// Close of the window, s.
    pub close_s: f64,
    /// Time after the close in which the instrument would have pointed at the target, s; `None` if it takes too long.
    pub short_s: Option<f64>,
}

/// Death of a satellite.
#[derive(Debug, Clone)]
pub(super) struct Death {
    /// Tick at the end of the step.
    pub tick: u64,
    /// Names of the checks that failed.
    pub checks: String,
    /// Momentum of the wheels, by its sources.
    pub momentum: WheelMomentum,
}

impl TaskingTrace {
    /// Replays an episode, and records it.
    ///
    /// # Errors
    /// Returns an error if the scenario cannot start or the log is not one of this scenario.
    pub(super) fn replay(scenario: &Scenario, log: &ActionLog) -> Result<Self, ReplayError> {
        let mut run = TaskRun::start(TaskSetup::read(scenario.recipe())?, scenario.seed())?;
        run.sim.keep_journal();
        let mut tracer = Tracer::new(&run.sim);
        step_through(log, |action| {
            let actions = run.read_actions(action)?;
            tracer.begin_step(&mut run, &actions);
            let recorders = &mut tracer.recorders;
            run.step_observed(&actions, &mut |sim| record_tick(recorders, sim));
            tracer.end_step(&mut run);
            Ok(run.is_done())
        })?;
        let end = run.sim.now();
        let mut satellites = tracer.satellites;
        for (satellite, recorder) in satellites.iter_mut().zip(tracer.recorders) {
            satellite.samples = recorder.samples;
            satellite.actions.iter_mut().for_each(|action| action.end = action.end.min(end));
        }
        let mut imaged = TargetSet::new(run.sim.targets().len());
        satellites
            .iter()
            .flat_map(|satellite| &satellite.images)
            .for_each(|image| imaged.insert(image.target));
        Ok(Self { outcome: run.outcome(), run, satellites, step_ends: tracer.step_ends, imaged })
    }

    /// Time of a tick since the start, s.
    pub(super) fn time_s(&self, tick: u64) -> f64 {
        self.run.sim.tick_length().time_s(tick)
    }

    /// The step that contains a tick, from 1.
    pub(super) fn step_at(&self, tick: u64) -> u32 {
        let before = self.step_ends.partition_point(|end| *end < tick);
        (before + 1).min(self.step_ends.len().max(1)) as u32
    }

    /// Number of steps of the episode.
    pub(super) const fn steps(&self) -> u32 {
        self.run.sim.steps()
    }

    /// True if any satellite imaged a target while it lived.
    pub(super) fn is_imaged(&self, target: usize) -> bool {
        self.imaged.contains(target)
    }

    /// The last tick of the episode.
    pub(super) const fn end(&self) -> u64 {
        self.run.sim.now()
    }
}

impl SatelliteTrace {
    /// Index of the last action that images a target; 0 if there is none.
    fn last_image_action(&self) -> usize {
        self.actions.iter().rposition(|action| !action.choices.is_empty()).unwrap_or_default()
    }

    /// The last tick at which the satellite was alive or died.
    pub(super) fn last_tick(&self) -> u64 {
        self.death.as_ref().map_or(self.samples.len().saturating_sub(1) as u64, |death| death.tick)
    }

    /// The sample after a tick; the last one beyond the end.
    pub(super) fn sample(&self, tick: u64) -> TickSample {
        let index = usize::try_from(tick).unwrap_or(usize::MAX);
        self.samples.get(index).or(self.samples.last()).copied().unwrap_or_default()
    }

    /// Orbit angle after a tick, degrees.
    pub(super) fn orbit_angle_deg(&self, tick: u64) -> f64 {
        f64::from(self.sample(tick).orbit_angle_deg)
    }
}

fn record_tick(recorders: &mut [SatelliteRecorder], sim: &TaskingSim) {
    let sun = sim.sun_position();
    for (index, recorder) in recorders.iter_mut().enumerate() {
        recorder.record(sim, index, &sun);
    }
}

/// Follows the steps of an episode.
struct Tracer {
    recorders: Vec<SatelliteRecorder>,
    satellites: Vec<SatelliteTrace>,
    step_ends: Vec<u64>,
    /// Index of the last action of each satellite.
    last_index: Vec<Option<usize>>,
    /// Window of the target that each satellite is to image.
    tasked: Vec<Option<Opportunity>>,
    /// Number of missed windows for which the time that was short was simulated.
    settlings: usize,
}

impl Tracer {
    fn new(sim: &TaskingSim) -> Self {
        let sun = sim.sun_position();
        let satellite = || SatelliteTrace {
            samples: Vec::new(),
            actions: Vec::new(),
            images: Vec::new(),
            misses: Vec::new(),
            death: None,
        };
        Self {
            recorders: (0..sim.len()).map(|index| SatelliteRecorder::new(sim, index, &sun)).collect(),
            satellites: (0..sim.len()).map(|_| satellite()).collect(),
            step_ends: Vec::new(),
            last_index: vec![None; sim.len()],
            tasked: vec![None; sim.len()],
            settlings: 0,
        }
    }

    /// Adds the actions that a step begins with.
    fn begin_step(&mut self, run: &mut TaskRun, actions: &[Option<AgentAction>]) {
        for (agent, action) in actions.iter().enumerate() {
            let Some(AgentAction::Index(index)) = *action else { continue };
            let added = self.new_action(run, agent, index);
            let start = added.start;
            let actions = &mut self.satellites[agent].actions;
            if let Some(last) = actions.last_mut() {
                last.end = last.end.min(start);
            }
            actions.push(added);
        }
    }

    fn new_action(&mut self, run: &mut TaskRun, agent: usize, index: usize) -> TracedAction {
        let sim = &mut run.sim;
        let kind = TaskedAction::of(index, sim.action_count(agent));
        let images = kind == TaskedAction::Work && !sim.targets().is_empty();
        let choices = match images {
            true => sim.next_windows(agent, OpportunityKind::Target, IMAGE_ACTIONS),
            false => Vec::new(),
        };
        let slew_deg = choices.get(index).map_or(0.0, |window| {
            let moment = sim.moment(agent);
            sim.angle_to(window.object, &moment).to_degrees()
        });
        // Without an opportunity, the satellite goes on with its task.
        let has_effect = !images || !choices.is_empty();
        // A desaturation that follows another one starts again.
        let goes_on = !images && kind != TaskedAction::Desaturate;
        let is_repeat = !has_effect || (goes_on && self.last_index[agent] == Some(index));
        if has_effect {
            self.last_index[agent] = Some(index);
        }
        let (step, start) = (sim.steps() + 1, sim.now());
        TracedAction { step, start, end: u64::MAX, kind, is_repeat, choices, slew_deg }
    }

    /// Adds what happened in a step.
    fn end_step(&mut self, run: &mut TaskRun) {
        let (step, now) = (run.sim.steps(), run.sim.now());
        self.step_ends.push(now);
        for (agent, satellite) in self.satellites.iter_mut().enumerate() {
            if let Some(action) = satellite.actions.last_mut()
                && run.sim.needs_action(agent)
            {
                action.end = action.end.min(now);
            }
        }
        let last = run.last_step();
        for [agent, target] in last.imaged.iter().copied().filter(|[agent, _]| last.were_alive[*agent]) {
            let satellite = &mut self.satellites[agent];
            let action = satellite.last_image_action();
            satellite.images.push(TracedImage { step, tick: now, target, action });
        }
        for (agent, checks) in &last.deaths {
            let impulse = &self.recorders[*agent].thruster_impulse;
            let momentum = WheelMomentum::of(run.sim.satellite(*agent), impulse, run.sim.time_s());
            self.satellites[*agent].death = Some(Death { tick: now, checks: checks.clone(), momentum });
        }
        for entry in run.sim.take_journal() {
            self.add_entry(run, entry);
        }
    }

    /// Follows the windows of tasked targets.
    fn add_entry(&mut self, run: &TaskRun, entry: JournalEntry) {
        let agent = entry.satellite;
        match entry.event {
            SatelliteEvent::Tasked { target, open_s, close_s } => {
                let kind = OpportunityKind::Target;
                self.tasked[agent] = Some(Opportunity { kind, object: target, open_s, close_s });
            }
            SatelliteEvent::Imaged { .. } => self.tasked[agent] = None,
            SatelliteEvent::Missed { .. } => {
                if let Some(window) = self.tasked[agent].take()
                    && self.satellites[agent].death.is_none()
                {
                    self.add_miss(run, agent, &window);
                }
            }
            SatelliteEvent::Search { .. } | SatelliteEvent::TimeUp => {}
        }
    }

    fn add_miss(&mut self, run: &TaskRun, agent: usize, window: &Opportunity) {
        let satellite = &mut self.satellites[agent];
        let action = satellite.last_image_action();
        let start = satellite.actions.get(action).map_or(0, |action| action.start);
        let since = usize::try_from(start).unwrap_or(usize::MAX).saturating_add(1);
        let samples = self.recorders[agent].samples.get(since..).unwrap_or_default();
        if samples.iter().any(|sample| sample.is_rejected) {
            return; // The storage was full.
        }
        self.settlings += 1;
        let short_s = if self.settlings <= MAX_SETTLINGS { settling_s(&run.sim, agent) } else { None };
        satellite.misses.push(MissedWindow {
            tick: run.sim.now(),
            target: window.object,
            action,
            open_s: window.open_s,
            close_s: window.close_s,
            short_s,
        });
    }
}
