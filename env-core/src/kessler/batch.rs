//! Batches of kessler: one environment as a lane of the batch engine.

use std::sync::Arc;

use serde_json::Value;

use super::columns::{DEBRIS_COLUMNS, SATELLITE_VALUES};
use super::constants::{FRAGMENTS, HORIZON, SATELLITES};
use super::event::KesslerEvent;
use super::reward::{Objective, score};
use super::setup::{InitialState, KesslerSetup};
use super::simulation::{KesslerSim, SatelliteStatus};
use super::spaces::{ACTION_SPACE, MAX_DEBRIS};
use super::tracks::TracksEncoder;
use crate::batch::{
    Batch, BatchConfig, BatchEngine, BatchError, BatchLane, BatchShape, LaneOutput, ObservationMode,
    ObservationPart, ScenarioSource, check_task,
};
use crate::episode_rng::SeededRng;
use crate::error::ScenarioError;
use crate::scene::Scene;
use crate::seed::Seed;
use crate::space::Axes;
use crate::task::{MAX_LAYOUT_ROWS, Recipe, Scenario};

/// Largest number of debris bodies of any scenario: drawn, one rogue a step, rows of a layout, and fragments.
const MAX_BODIES: usize = MAX_DEBRIS as usize + HORIZON as usize + MAX_LAYOUT_ROWS + SATELLITES * FRAGMENTS;

/// Creates a batch of episodes with this objective.
///
/// # Errors
/// Returns [`BatchError`] if the first scenario or the configuration is invalid.
pub(super) fn batch(
    objective: Objective,
    task: &'static str,
    source: Box<dyn ScenarioSource>,
    config: BatchConfig,
) -> Result<Box<dyn Batch>, BatchError> {
    let first = source.scenario(0, 0);
    let recipe = first.recipe();
    let task = (!config.mixed_tasks).then_some(task);
    let setup = objective_of(task, recipe).and_then(|_| KesslerSetup::from_recipe(recipe));
    let setup = Arc::new(setup.map_err(|source| BatchError::Scenario { env: 0, source })?);
    let observer = match config.observe {
        ObservationMode::All { bodies } => {
            let bodies = bodies.map_or_else(|| setup.max_debris(), |bodies| bodies as usize);
            if bodies > MAX_BODIES {
                return Err(BatchError::Config { field: "bodies", value: bodies, min: 0, max: MAX_BODIES });
            }
            KesslerObserver::All(bodies)
        }
        ObservationMode::Extended => {
            return Err(BatchError::Unsupported(
                "kessler supports only the observation modes `all` and `tracks`: its satellites have no further values",
            ));
        }
        ObservationMode::Tracks { threats, look_ahead } => {
            let tracks = TracksEncoder::new(threats as usize, look_ahead as usize);
            KesslerObserver::Tracks(tracks.map(Box::new).map_err(|e| BatchError::Config {
                field: if e.field == "k" { "threats" } else { "look_ahead" },
                value: e.value,
                min: e.min,
                max: e.max,
            })?)
        }
    };
    let shape = BatchShape { envs: config.envs, agents: SATELLITES, action: 2, observation: observer.len() };
    let lane = || {
        let rng = SeededRng::new(Seed::in_space(crate::seed::SeedSpace::User, 0));
        let sim = KesslerSim::new(objective, Arc::clone(&setup), &InitialState::default(), rng);
        KesslerLane { task, axes: config.axes, sim, recipe: Arc::clone(recipe), observer: observer.clone() }
    };
    Ok(Box::new(BatchEngine::new(config, shape, ACTION_SPACE, source, lane)?))
}

/// Observation mode, with the memory it needs.
#[derive(Clone)]
enum KesslerObserver {
    /// Columns of all satellites and of this many debris bodies.
    All(usize),
    /// Rows of the most threatening debris per satellite.
    Tracks(Box<TracksEncoder>),
}

impl KesslerObserver {
    fn len(&self) -> usize {
        match self {
            Self::All(bodies) => SATELLITES * SATELLITE_VALUES + DEBRIS_COLUMNS * bodies,
            Self::Tracks(tracks) => tracks.total_cells(),
        }
    }

    fn parts(&self) -> Vec<ObservationPart> {
        let part = |name, shape| ObservationPart { name, shape };
        match self {
            Self::All(bodies) => vec![
                part("satellites", vec![SATELLITES, SATELLITE_VALUES]),
                part("debris", vec![DEBRIS_COLUMNS - 1, *bodies]),
                part("mask", vec![*bodies]),
            ],
            Self::Tracks(tracks) => {
                vec![part("tracks", vec![SATELLITES, tracks.total_cells() / SATELLITES])]
            }
        }
    }

    fn columns(&self) -> Vec<String> {
        match self {
            Self::All(bodies) => {
                let own = (0..SATELLITES).flat_map(|satellite| {
                    ["x", "y", "vx", "vy", "fuel", "survival"]
                        .map(move |name| format!("satellite_{satellite}_{name}"))
                });
                let debris = ["x", "y", "vx", "vy", "visible"]
                    .into_iter()
                    .flat_map(|name| (0..*bodies).map(move |body| format!("debris_{body}_{name}")));
                own.chain(debris).collect()
            }
            Self::Tracks(tracks) => (0..SATELLITES)
                .flat_map(|satellite| {
                    let columns = tracks.columns().into_iter();
                    columns.map(move |column| format!("satellite_{satellite}_{}", column.name))
                })
                .collect(),
        }
    }
}

/// Converts burns radial out and in-track to burns along x and y.
#[expect(
    clippy::cast_possible_truncation,
    reason = "executed actions are logged in the precision of actions"
)]
fn to_world_axes(sim: &KesslerSim<SeededRng>, actions: &[[f32; 2]]) -> [[f32; 2]; SATELLITES] {
    let mut burns = [[0.0; 2]; SATELLITES];
    for ((burn, action), satellite) in burns.iter_mut().zip(actions).zip(sim.satellites()) {
        let [radial, in_track] = action.map(f64::from);
        let ((rx, ry), (tx, ty)) = satellite.body.local_axes();
        // Adding zero turns −0 into 0, so that a hold action stays a hold.
        *burn = [(radial * rx + in_track * tx) as f32 + 0.0, (radial * ry + in_track * ty) as f32 + 0.0];
    }
    burns
}

/// Copies the executed actions to the caller's buffer, if there is one.
fn report_actions(actions: &[[f32; 2]], executed: &mut [f32]) {
    if !executed.is_empty() {
        executed.copy_from_slice(actions.as_flattened());
    }
}

/// Returns the objective of a recipe's task.
///
/// # Errors
/// Returns [`ScenarioError`] if the batch does not run this task.
fn objective_of(task: Option<&str>, recipe: &Recipe) -> Result<Objective, ScenarioError> {
    let id = recipe.task().id();
    check_task(task.unwrap_or(id), recipe)?;
    Objective::of_task(id).ok_or_else(|| ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: id.to_owned(),
        choices: Objective::ALL.map(Objective::task_id).join(", "),
    })
}

/// One environment of a batch.
struct KesslerLane {
    /// Task of all episodes; `None` if the batch mixes the tasks of the world.
    task: Option<&'static str>,
    axes: Axes,
    sim: KesslerSim<SeededRng>,
    /// Recipe from which the setup of `sim` was parsed.
    recipe: Arc<Recipe>,
    observer: KesslerObserver,
}

impl BatchLane for KesslerLane {
    fn start(&mut self, scenario: &Scenario) -> Result<(), ScenarioError> {
        let recipe = scenario.recipe();
        let mut setup = None;
        if !Arc::ptr_eq(recipe, &self.recipe) {
            self.sim.set_objective(objective_of(self.task, recipe)?);
            setup = Some(Arc::new(KesslerSetup::from_recipe(recipe)?));
            self.recipe = Arc::clone(recipe);
        }
        self.sim.reset_from_seed(setup, scenario.seed())
    }

    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool {
        // A hold is a burn of −0: adding it changes no bit. A check for zero would be an unpredictable
        // branch.
        let to_delta = |value: f32| if value == 0.0 { -0.0 } else { f64::from(value) };
        let (actions, _) = actions.as_chunks::<2>();
        let stepped = if self.axes == Axes::World {
            report_actions(actions, out.executed_actions);
            self.sim.step_with(|i| actions.get(i).map(|&[x, y]| (to_delta(x), to_delta(y))))
        } else {
            let burns = to_world_axes(&self.sim, actions);
            report_actions(&burns, out.executed_actions);
            self.sim.step_with(|i| burns.get(i).map(|&[x, y]| (to_delta(x), to_delta(y))))
        };
        #[expect(clippy::cast_possible_truncation, reason = "rewards are single precision here")]
        let reward = stepped.reward as f32;
        *out.team_reward = reward;
        for (i, satellite) in self.sim.satellites().iter().enumerate() {
            let alive = satellite.status == SatelliteStatus::Active;
            out.rewards[i] = if stepped.active_before[i] { reward } else { 0.0 };
            out.terminated[i] = !alive;
            out.truncated[i] = alive && stepped.done;
        }
        out.elapsed.fill(1.0);
        stepped.done
    }

    fn needs_action(&self, out: &mut [bool]) {
        let is_done = self.sim.is_done();
        for (needs_action, satellite) in out.iter_mut().zip(self.sim.satellites()) {
            *needs_action = satellite.is_active() && !is_done;
        }
    }

    fn observe(&mut self, out: &mut [f32]) {
        match &mut self.observer {
            KesslerObserver::All(bodies) => self.sim.observe_into(out, *bodies),
            KesslerObserver::Tracks(tracks) => tracks.write(&self.sim, out),
        }
    }

    fn score(&self) -> f64 {
        score(self.sim.total_reward())
    }

    fn scene(&self, acted: &[f32]) -> Scene {
        super::scene::scene(&self.sim, acted)
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.sim.telemetry(0.0, false)).unwrap_or(Value::Null)
    }

    fn alerts(&self) -> Vec<String> {
        self.sim.events().iter().filter_map(KesslerEvent::alert).collect()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.sim.state_hash()
    }

    fn columns(&self) -> Vec<String> {
        self.observer.columns()
    }

    fn parts(&self) -> Vec<ObservationPart> {
        self.observer.parts()
    }

    fn bytes(&self) -> usize {
        self.sim.bytes() + self.sim.rng().bytes()
    }
}
