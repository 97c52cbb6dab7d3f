//! [`LayoutSky`]: what a picture shows, computed from the scenario and its reference plan.

use std::collections::BTreeSet;

use env_core::task::StepReport;
use env_core::tasking::task::forecast::TaskingForecast;
use env_core::tasking::task::layout::TaskingLayout;
use env_core::tasking::task::telemetry::TaskingTelemetry;
use env_core::{ActionLog, Scenario};

use crate::design_language::LayoutView;
use crate::tasking::design::TaskingDesign;

/// Content of a picture.
pub(super) struct LayoutSky {
    pub(super) design: Option<TaskingDesign>,
    pub(super) forecast: TaskingForecast,
    /// Numbers of the stations that are out of service.
    pub(super) outages: Vec<usize>,
    /// The reference plan of each satellite.
    pub(super) plans: Vec<SatellitePlan>,
    /// Targets that the reference plan images.
    pub(super) imaged: BTreeSet<usize>,
}

/// Course of the reference plan for one satellite.
#[derive(Debug, Default)]
pub(super) struct SatellitePlan {
    /// Tasks one after the other.
    pub(super) tasks: Vec<PlannedTask>,
    /// Resources at the ends of steps.
    pub(super) resources: Vec<ResourceSample>,
}

/// A task of the reference plan.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlannedTask {
    pub(super) kind: PlannedKind,
    pub(super) start_s: f64,
    pub(super) end_s: f64,
}

/// Kind of a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PlannedKind {
    /// Scans, or images a target.
    Work,
    /// Charges the battery in sunlight.
    Charge,
    /// Sends data to a station.
    Downlink,
    /// Slows the wheels with thrusters.
    Desaturate,
}

/// Resources of a satellite at a time, as shares of their limits.
#[derive(Debug, Clone, Copy)]
pub(super) struct ResourceSample {
    pub(super) time_s: f64,
    pub(super) battery: f64,
    pub(super) storage: f64,
    pub(super) wheels: f64,
}

impl LayoutSky {
    /// Computes the content; `None` if the episode cannot start.
    pub(super) fn new(layout: LayoutView<'_>) -> Option<Self> {
        let recipe = layout.scenario.recipe();
        let mut sky = Self {
            design: layout.design.and_then(|design| TaskingDesign::from_json(design).ok()),
            forecast: TaskingForecast::of_scenario(layout.scenario).ok()?,
            outages: TaskingLayout::of_recipe(recipe).ok()?.unwrap_or_default().outages,
            plans: Vec::new(),
            imaged: BTreeSet::new(),
        };
        sky.follow_plan(layout.scenario, &layout.bracket.reference_plan)?;
        Some(sky)
    }

    /// Replays the reference plan.
    fn follow_plan(&mut self, scenario: &Scenario, plan: &ActionLog) -> Option<()> {
        let mut episode = scenario.task().start(scenario).ok()?;
        self.plans = self.forecast.satellites.iter().map(|_| SatellitePlan::default()).collect();
        self.sample(episode.observation().downcast_ref::<TaskingTelemetry>()?, 0.0);
        let mut report = StepReport::default();
        for action in plan.steps() {
            let start_s = episode.observation().downcast_ref::<TaskingTelemetry>()?.time_s;
            if episode.step(action, &mut report).is_err() {
                break;
            }
            self.sample(episode.observation().downcast_ref::<TaskingTelemetry>()?, start_s);
            let truth = episode.truth();
            let imaged = truth.pointer("/map/imaged").and_then(serde_json::Value::as_array);
            let target = |pair: &serde_json::Value| usize::try_from(pair.get(1)?.as_u64()?).ok();
            self.imaged.extend(imaged.into_iter().flatten().filter_map(target));
        }
        Some(())
    }

    /// Adds the resources after a step that began at `start_s`, and its tasks.
    fn sample(&mut self, telemetry: &TaskingTelemetry, start_s: f64) {
        for (plan, satellite) in self.plans.iter_mut().zip(&telemetry.satellites) {
            plan.resources.push(ResourceSample {
                time_s: telemetry.time_s,
                battery: satellite.battery,
                storage: satellite.storage,
                wheels: satellite.wheels.iter().fold(0.0, |most: f64, share| most.max(share.abs())),
            });
            if let Some(action) = satellite.action.as_deref().filter(|_| telemetry.time_s > start_s) {
                plan.add_task(PlannedKind::of(action), start_s, telemetry.time_s);
            }
        }
    }
}

impl SatellitePlan {
    /// Adds a task, or lets the last one of its kind go on.
    fn add_task(&mut self, kind: PlannedKind, start_s: f64, end_s: f64) {
        match self.tasks.last_mut().filter(|last| last.kind == kind && last.end_s >= start_s) {
            Some(last) => last.end_s = end_s,
            None => self.tasks.push(PlannedTask { kind, start_s, end_s }),
        }
    }
}

impl PlannedKind {
    /// Kind of an action by its name.
    fn of(action: &str) -> Self {
        match action {
            "charge" => Self::Charge,
            "downlink" => Self::Downlink,
            "desaturate" => Self::Desaturate,
            _ => Self::Work,
        }
    }
}
