//! Starts design requests: one that waits, or one that is due.

use std::sync::Arc;

use designer::brief::LevelMastery;
use designer::{FailureProfile, design_language};
use env_core::keyed_rng::RngPurpose;
use env_core::space::{Levels, START_SCALE};
use env_core::{KeyedRng, Recipe, ScenarioError};
use sqlx::SqliteConnection;
use store::design_requests::{
    self, DesignRequestResult, NewDesignRequest, ProfileSnapshot, RequestOrigin, RequestState,
};
use store::servable_layouts::{self, ServableLayout};
use store::{StoreError, design_queue, from_json, to_json, to_u32, to_u64};

use crate::designs::DesignerKind;
use crate::designs::demand::{self, DesignDemand, LastDesignRequest};
use crate::designs::place::Place;
use crate::designs::profile::CollectedProfile;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use clock::Millis;
use curriculum::TaskPlan;

/// Number of finished requests of a run's task that are considered.
const MAX_LOOK_BACK: i64 = 8;

/// A design request that was started, with the part of the brief that is not loaded from the store later.
#[derive(Debug, Clone)]
pub struct StartedDesignRequest {
    /// Number of the request.
    pub id: i64,
    /// Id of the run.
    pub run: String,
    /// Seed of the run.
    pub run_seed: u64,
    /// Id of the task.
    pub task: String,
    /// Level of the params, if the task has levels.
    pub level: Option<u32>,
    /// Place on the rungs of the task to design for.
    pub place: Place,
    /// Designer that the request is for.
    pub designer: DesignerKind,
    /// Number of layouts that are wanted.
    pub wanted: u32,
    /// Recipe of the designs: task, params and physics.
    pub recipe: Arc<Recipe>,
    /// Levels of the task.
    pub levels: Levels,
    /// Failure profile of the agent.
    pub profile: FailureProfile,
    /// Mastery of the agent at this level, if it was measured.
    pub mastery: Option<LevelMastery>,
}

/// Starts a design request: one that waits, or one that is due.
#[derive(Debug)]
pub struct StartDesignRequest {
    /// Id of the run.
    pub run: String,
    /// Number of the request that waits; `None` starts one for the first task that is due.
    pub waiting: Option<i64>,
    /// True if the server or a connected worker has a language model for designs.
    pub has_llm: bool,
}

impl Change for StartDesignRequest {
    /// `None` if nothing is due, or another request of the run is running.
    type Output = Option<StartedDesignRequest>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Option<StartedDesignRequest>, ServiceError> {
        let mut run = tx.run(&self.run).await?;
        if design_queue::count_running(run.conn, &self.run).await? > 0 {
            return Ok(None);
        }
        match self.waiting {
            Some(id) => start_waiting(&mut run, id).await,
            None => start_due(&mut run, self.has_llm).await,
        }
    }
}

/// Starts a request that waits. One whose task cannot be designed for any more fails.
async fn start_waiting(run: &mut RunTx<'_>, id: i64) -> Result<Option<StartedDesignRequest>, ServiceError> {
    let request = design_requests::get(run.conn, &run.state.run, id).await?;
    let Some(request) = request.filter(|request| request.state == RequestState::Waiting) else {
        return Ok(None);
    };
    let plan = run.state.settings.curriculum.tasks.iter().find(|plan| plan.task == request.task);
    let profile = CollectedProfile::load(run.conn, &run.state.run, &request.task).await?;
    let Some(target) = plan.and_then(|plan| DesignTarget::of(&run.state, plan, &profile)) else {
        let error = Some("the run no longer has this task, or the task cannot be designed for".to_owned());
        let failed = DesignRequestResult { error, ..DesignRequestResult::default() };
        design_requests::finish(run.conn, id, &failed, run.now).await?;
        return Ok(None);
    };
    let order = DesignOrder { id, designer: request.designer, wanted: to_u32(request.wanted) };
    target.start(run.conn, &run.state, order, &profile).await.map(Some)
}

/// Starts a request for the first task of the run that is due.
async fn start_due(run: &mut RunTx<'_>, has_llm: bool) -> Result<Option<StartedDesignRequest>, ServiceError> {
    let RunTx { conn, state, now, .. } = run;
    let design = state.settings.design;
    let may_design = design.is_enabled() && state.paused_at.is_none();
    let Some(designer) = crate::designs::designer_kind(design.designer, has_llm).filter(|_| may_design)
    else {
        return Ok(None);
    };
    let active = servable_layouts::active(conn, &state.run).await?;
    for plan in &state.settings.curriculum.tasks {
        let profile = CollectedProfile::load(conn, &state.run, &plan.task).await?;
        let Some(target) = DesignTarget::of(state, plan, &profile) else { continue };
        let demand = target.demand(conn, state, designer, &profile, &active, *now).await?;
        if let Some(wanted) = demand::layouts_wanted(&demand) {
            let request = NewDesignRequest {
                run: state.run.clone(),
                task: plan.task.clone(),
                designer,
                requested_by: RequestOrigin::Worker,
                wanted: i64::from(wanted),
            };
            let id = design_requests::insert(conn, &request, *now).await?;
            let order = DesignOrder { id, designer, wanted };
            return target.start(conn, state, order, &profile).await.map(Some);
        }
    }
    Ok(None)
}

/// Number, designer and size of a request.
#[derive(Clone, Copy)]
struct DesignOrder {
    id: i64,
    designer: DesignerKind,
    /// Number of layouts that are wanted.
    wanted: u32,
}

/// A task that can be designed for, where the agent is on its rungs.
struct DesignTarget<'a> {
    plan: &'a TaskPlan,
    /// Level of the params.
    level: Option<u32>,
    place: Place,
    is_placed: bool,
    recipe: Arc<Recipe>,
}

impl<'a> DesignTarget<'a> {
    /// Returns the target of a task; `None` if nothing designs for it.
    fn of(state: &RunState, plan: &'a TaskPlan, collected: &CollectedProfile) -> Option<Self> {
        let task = env_core::task(&plan.task)?;
        design_language(task)?;
        let status = state.curriculum.status().into_iter().find(|status| status.task == plan.task)?;
        let tasks = &state.settings.curriculum.tasks;
        let index = tasks.iter().position(|of| of.task == plan.task)?;
        let number = to_u64(collected.counters.criticised) * tasks.len() as u64 + index as u64;
        let mut rng = KeyedRng::new(RngPurpose::DesignPlace, state.seed, number);
        let start_rungs = plan.start_rungs();
        let rung = state.curriculum.sample_rung(&plan.task, &mut rng);
        let start_rung = rung.filter(|_| !start_rungs.is_empty());
        let level = match (rung, start_rung) {
            (None, _) => status.probe_level.or(status.level),
            (_, None) => rung,
            // A start rung can be at any level.
            (_, Some(_)) => Some(rng.below(plan.hardest_level() + 1)),
        };
        let scale = start_rung.and_then(|rung| start_rungs.get(rung as usize)).copied();
        // An easier start belongs to no level.
        let place = Place { level: level.filter(|_| scale.is_none_or(|scale| scale >= 1.0)), start_rung };
        // The settings were validated when they were set, so a recipe exists.
        let recipe = recipe_at(plan, level, scale).ok()?;
        Some(Self { plan, level, place, is_placed: status.placement_done, recipe })
    }

    /// Marks a request as running, and returns it with its brief's inputs.
    async fn start(
        &self,
        conn: &mut SqliteConnection,
        state: &RunState,
        DesignOrder { id, designer, wanted }: DesignOrder,
        collected: &CollectedProfile,
    ) -> Result<StartedDesignRequest, ServiceError> {
        let profile = collected.profile(&self.plan.task);
        let snapshot =
            ProfileSnapshot { profile: to_json(&profile)?, criticised: collected.counters.criticised };
        design_requests::start(conn, id, self.level.map(i64::from), &snapshot).await?;
        let mastery = state
            .curriculum
            .mastery()
            .into_iter()
            .find(|m| m.task == self.plan.task && m.level.is_some() && m.level == self.place.level && m.n > 0)
            .map(|m| LevelMastery { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 });
        Ok(StartedDesignRequest {
            id,
            run: state.run.clone(),
            run_seed: state.seed,
            task: self.plan.task.clone(),
            level: self.level,
            place: self.place,
            designer,
            wanted,
            recipe: Arc::clone(&self.recipe),
            levels: self.plan.levels.clone(),
            profile,
            mastery,
        })
    }

    /// Returns what the decision to design for the task rests on.
    async fn demand(
        &self,
        conn: &mut SqliteConnection,
        state: &RunState,
        designer: DesignerKind,
        collected: &CollectedProfile,
        active: &[ServableLayout],
        now: Millis,
    ) -> Result<DesignDemand, ServiceError> {
        let task = self.plan.task.as_str();
        let near = active
            .iter()
            .filter(|of| of.task == task && Place::from_stored(of.level, of.start_rung).is_near(self.place));
        let profile = collected.profile(task);
        Ok(DesignDemand {
            designer,
            is_placed: self.is_placed,
            criticised: collected.counters.criticised,
            failure_weight: profile.total_weight(),
            active: to_u32(near.count() as i64),
            reserve: state.settings.design.reserve,
            last: last_request(conn, &state.run, task, &profile).await?,
            now,
        })
    }
}

/// Returns the recipe of a task at a level, and at a start scale if there is one.
fn recipe_at(plan: &TaskPlan, level: Option<u32>, scale: Option<f64>) -> Result<Arc<Recipe>, ScenarioError> {
    let unknown = || ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: plan.task.clone(),
        choices: String::new(),
    };
    let task = env_core::task(&plan.task).ok_or_else(unknown)?;
    let params = plan.params(level);
    let params = params.iter().map(|(name, value)| (name.as_str(), *value));
    let params = params.chain(scale.map(|scale| (START_SCALE.name, scale)));
    let options = plan.physics.iter().map(|(name, choice)| (name.as_str(), choice.as_str()));
    Ok(Arc::new(Recipe::with_params(task, params)?.with_options(options)?))
}

/// Returns how the last requests for a run's task went.
async fn last_request(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    profile: &FailureProfile,
) -> Result<Option<LastDesignRequest>, StoreError> {
    let finished = design_requests::latest_finished(conn, run, task, MAX_LOOK_BACK).await?;
    let Some(newest) = finished.first() else { return Ok(None) };
    // Layouts of a substitute do not count for the requested designer.
    let barren = finished.iter().take_while(|request| request.admitted_without_fallback == 0).count();
    let (distance, criticised) = match design_requests::last_profile(conn, run, task).await? {
        Some(snapshot) => {
            let old: FailureProfile = from_json("a failure profile", &snapshot.profile)?;
            (profile.distance(&old), snapshot.criticised)
        }
        None => (1.0, 0),
    };
    Ok(Some(LastDesignRequest { at: newest.at, criticised, distance, empty_streak: barren as u32 }))
}
