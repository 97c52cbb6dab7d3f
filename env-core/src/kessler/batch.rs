//! kessler as lanes of a batch.

use std::sync::Arc;

use serde_json::Value;

use super::constants::{FRAGMENTS, HORIZON, SATELLITES};
use super::event::Event;
use super::flight::{Flight, Status};
use super::reward::{Objective, score};
use super::setup::{Setup, Start};
use super::spaces::MAX_DEBRIS;
use super::tracks::Tracks;
use crate::batch::{
    Axes, Batch, BatchConfig, BatchError, Engine, Feed, Lane, LaneOutput, Observe, Shape, of_task,
};
use crate::chance::Seeded;
use crate::error::ScenarioError;
use crate::scenario::{MAX_LAYOUT_ROWS, Recipe};
use crate::scene::Scene;
use crate::seed::Seed;

/// Values of one satellite in an observation of everything: x, y, vx, vy, fuel, survival.
pub const SATELLITE_VALUES: usize = 6;
/// Columns of debris in an observation of everything: x, y, vx, vy, visible.
pub const DEBRIS_COLUMNS: usize = 5;

/// Most debris there can ever be: what a scenario has, a rogue a step, those of a layout, fragments.
const MAX_BODIES: usize = MAX_DEBRIS as usize + HORIZON as usize + MAX_LAYOUT_ROWS + SATELLITES * FRAGMENTS;

/// A batch of this objective's episodes.
pub(super) fn batch(
    objective: Objective,
    task: &'static str,
    feed: Box<dyn Feed>,
    config: BatchConfig,
) -> Result<Box<dyn Batch>, BatchError> {
    let (recipe, _) = feed.scenario(0, 0);
    let task = (!config.mixed).then_some(task);
    let setup = objective_of(task, &recipe).and_then(|_| Setup::read(&recipe));
    let setup = Arc::new(setup.map_err(|source| BatchError::Scenario { env: 0, source })?);
    let observer = match config.observe {
        Observe::All { bodies } => {
            let bodies = bodies.map_or_else(|| setup.most_debris(), |bodies| bodies as usize);
            if bodies > MAX_BODIES {
                return Err(BatchError::Config { field: "bodies", value: bodies, min: 0, max: MAX_BODIES });
            }
            Observer::All(bodies)
        }
        Observe::Tracks { threats, look_ahead } => {
            let tracks = Tracks::new(threats as usize, look_ahead as usize);
            Observer::Tracks(tracks.map(Box::new).map_err(|e| BatchError::Config {
                field: if e.field == "k" { "threats" } else { "look_ahead" },
                value: e.value,
                min: e.min,
                max: e.max,
            })?)
        }
    };
    let shape = Shape { envs: config.envs, agents: SATELLITES, action: 2, observation: observer.len() };
    let lane = || {
        let nothing = Seeded::new(Seed::in_space(crate::seed::SeedSpace::User, 0));
        let flight = Flight::new(objective, Arc::clone(&setup), &Start::default(), nothing);
        KesslerLane {
            task,
            axes: config.axes,
            flight,
            recipe: Arc::clone(&recipe),
            observer: observer.clone(),
        }
    };
    Ok(Box::new(Engine::new(config, shape, feed, lane)?))
}

/// What is seen, and how it is written.
#[derive(Clone)]
enum Observer {
    /// Columns, of so many bodies.
    All(usize),
    Tracks(Box<Tracks>),
}

impl Observer {
    fn len(&self) -> usize {
        match self {
            Self::All(bodies) => SATELLITES * SATELLITE_VALUES + DEBRIS_COLUMNS * bodies,
            Self::Tracks(tracks) => tracks.total(),
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
                    let named =
                        move |column: super::tracks::Column| format!("satellite_{satellite}_{}", column.name);
                    tracks.columns().into_iter().map(named)
                })
                .collect(),
        }
    }
}

/// Burns radial out and in-track, turned into x and y.
#[expect(
    clippy::cast_possible_truncation,
    reason = "what is logged is what was done, in the precision of actions"
)]
fn turned(flight: &Flight<Seeded>, actions: &[[f32; 2]]) -> [[f32; 2]; SATELLITES] {
    let mut turned = [[0.0; 2]; SATELLITES];
    for ((turned, action), satellite) in turned.iter_mut().zip(actions).zip(flight.satellites()) {
        let [radial, in_track] = action.map(f64::from);
        let ((rx, ry), (tx, ty)) = satellite.body.frame();
        // Adding zero leaves no minus zero behind: hold is hold.
        *turned = [(radial * rx + in_track * tx) as f32 + 0.0, (radial * ry + in_track * ty) as f32 + 0.0];
    }
    turned
}

/// Tells what was done, where somebody wants to know.
fn copy(actions: &[[f32; 2]], taken: &mut [f32]) {
    if !taken.is_empty() {
        taken.copy_from_slice(actions.as_flattened());
    }
}

/// What a recipe's task rewards, where it is one that is flown here.
fn objective_of(task: Option<&str>, recipe: &Recipe) -> Result<Objective, ScenarioError> {
    let id = recipe.task().id();
    of_task(task.unwrap_or(id), recipe)?;
    super::objective(id).ok_or_else(|| ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: id.to_owned(),
        choices: super::TASKS.each_ref().map(|task| task.card.id).join(", "),
    })
}

struct KesslerLane {
    /// The only task there is; none where all of the world are flown.
    task: Option<&'static str>,
    axes: Axes,
    flight: Flight<Seeded>,
    /// What the flight's setup was read from.
    recipe: Arc<Recipe>,
    observer: Observer,
}

impl Lane for KesslerLane {
    fn start(&mut self, recipe: &Arc<Recipe>, seed: Seed) -> Result<(), ScenarioError> {
        let mut setup = None;
        if !Arc::ptr_eq(recipe, &self.recipe) {
            self.flight.set_objective(objective_of(self.task, recipe)?);
            setup = Some(Arc::new(Setup::read(recipe)?));
            self.recipe = Arc::clone(recipe);
        }
        self.flight.draw(setup, seed)
    }

    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool {
        // Hold is a burn of minus zero: adding that changes no bit, and asking whether to add would be a branch that nobody
        // can foresee.
        let quiet = |value: f32| if value == 0.0 { -0.0 } else { f64::from(value) };
        let (actions, _) = actions.as_chunks::<2>();
        let stepped = if self.axes == Axes::World {
            copy(actions, out.taken);
            self.flight.step_all(|i| actions.get(i).map(|&[x, y]| (quiet(x), quiet(y))))
        } else {
            let turned = turned(&self.flight, actions);
            copy(&turned, out.taken);
            self.flight.step_all(|i| turned.get(i).map(|&[x, y]| (quiet(x), quiet(y))))
        };
        #[expect(clippy::cast_possible_truncation, reason = "rewards are single precision here")]
        let reward = stepped.reward as f32;
        *out.team_reward = reward;
        for (i, satellite) in self.flight.satellites().iter().enumerate() {
            let alive = satellite.status == Status::Active;
            out.rewards[i] = if stepped.active_before[i] { reward } else { 0.0 };
            out.terminated[i] = !alive;
            out.truncated[i] = alive && stepped.done;
        }
        stepped.done
    }

    fn observe(&mut self, out: &mut [f32]) {
        match &mut self.observer {
            Observer::All(bodies) => self.flight.observe_into(out, *bodies),
            Observer::Tracks(tracks) => tracks.write(&self.flight, out),
        }
    }

    fn score(&self) -> f64 {
        score(self.flight.total())
    }

    fn scene(&self, acted: &[f32]) -> Scene {
        super::scene::scene(&self.flight, acted)
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.flight.telemetry(0.0, false)).unwrap_or(Value::Null)
    }

    fn alerts(&self) -> Vec<String> {
        self.flight.events().iter().filter_map(Event::alert).collect()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.flight.state_hash()
    }

    fn columns(&self) -> Vec<String> {
        self.observer.columns()
    }

    fn bytes(&self) -> usize {
        let observer = match &self.observer {
            Observer::All(_) => 0,
            Observer::Tracks(tracks) => tracks.bytes(),
        };
        self.flight.bytes() + self.flight.chance().bytes() + observer
    }
}
