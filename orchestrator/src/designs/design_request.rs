//! A round of asking a designer: begun where it is due, ended with what came of it. What takes time happens in between.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use designer::brief::LevelMastery;
use designer::{DesignUsage, JudgedLayout};
use designer::{FailureProfile, design_language};
use env_core::space::Levels;
use env_core::{Recipe, ScenarioError};
use serde_json::Value;
use sqlx::SqliteConnection;

use crate::designs::DesignerKind;
use crate::designs::profile::CollectedProfile;
use crate::designs::serve::near;
use crate::designs::demand;
use crate::designs::demand::{LastDesignRequest, StockView};
use crate::clock::Millis;
use crate::metrics;
use crate::ids::DesignRequestId;
use crate::store::design_counters::{self, GateCount};
use crate::store::design_requests::{self, DesignRequestResult, NewDesignRequest, ProfileSnapshot, RequestOrigin, RequestState};
use crate::store::layout_transitions::{self, LayoutTransition};
use crate::store::layouts::{self, LayoutClaim, LayoutState, NewLayout};
use crate::store::{StoreError, brackets, design_queue, from_json, scenarios, to_i64, to_json, to_u32};
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use curriculum::TaskPlan;

/// Layouts of one ask that are kept, of those let through and of those refused; all are counted.
const KEPT: usize = 64;
/// Bytes of a refused design that is kept.
const MOST_DESIGN: usize = 16 * 1024;
/// Troubles of one ask that are kept.
const TROUBLES: usize = 32;
/// Asks of a run and task that are looked back on.
const LOOK_BACK: i64 = 8;

/// An ask that was begun, with what a designer must know that is not read from the store.
#[derive(Debug, Clone)]
pub struct StartedDesignRequest {
    /// Its number.
    pub ask: i64,
    /// The run.
    pub run: String,
    /// The run's seed.
    pub run_seed: u64,
    /// The task.
    pub task: String,
    /// The level.
    pub level: Option<u32>,
    /// Who is asked.
    pub which: DesignerKind,
    /// How many layouts are wanted.
    pub wanted: u32,
    /// Task, params and physics.
    pub base: Arc<Recipe>,
    /// The task's table.
    pub levels: Levels,
    /// What the agent fails at.
    pub profile: FailureProfile,
    /// How well it does at this level.
    pub standing: Option<LevelMastery>,
}

/// Begins an ask: the one that waits, or one that is due.
#[derive(Debug)]
pub struct StartDesignRequest {
    /// Of which run.
    pub run: String,
    /// The one that waits; none: whichever task is due.
    pub ask: Option<i64>,
    /// Whether there is a language model.
    pub has_llm: bool,
}

impl Change for StartDesignRequest {
    type Output = Option<StartedDesignRequest>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Option<StartedDesignRequest>, ServiceError> {
        let now = tx.now;
        let RunTx { state: mind, conn, .. } = tx.run(&self.run).await?;
        if design_queue::count_running(conn, &self.run).await? > 0 {
            return Ok(None);
        }
        if let Some(id) = self.ask {
            return begin_waiting(conn, mind, id, now).await;
        }
        let design = mind.settings.design;
        let Some(which) = design.designer.which(self.has_llm).filter(|_| design.on() && !mind.is_paused) else {
            return Ok(None);
        };
        for plan in &mind.settings.curriculum.tasks {
            let Some(course) = Course::of(mind, plan) else { continue };
            let collected = CollectedProfile::read(conn, &self.run, &plan.task).await?;
            let view = view(conn, mind, &course, which, &collected, now).await?;
            if let Some(wanted) = demand::wanted(&view) {
                let ask = NewDesignRequest {
                    run: self.run.clone(),
                    task: plan.task.clone(),
                    designer: which,
                    origin: RequestOrigin::Worker,
                    wanted: i64::from(wanted),
                };
                let id = design_requests::insert(conn, &ask, now).await?;
                return course.begin(conn, mind, (id, which, wanted), &collected).await.map(Some);
            }
        }
        Ok(None)
    }
}

async fn begin_waiting(
    conn: &mut SqliteConnection,
    mind: &RunState,
    id: i64,
    now: Millis,
) -> Result<Option<StartedDesignRequest>, ServiceError> {
    let Some(ask) = design_requests::get(conn, &mind.run, id).await?.filter(|ask| ask.state == RequestState::Waiting) else {
        return Ok(None);
    };
    let course = mind.settings.curriculum.tasks.iter().find(|plan| plan.task == ask.task);
    let Some(course) = course.and_then(|plan| Course::of(mind, plan)) else {
        let error = Some("the run has no such task any more that could be designed for".to_owned());
        design_requests::finish(conn, id, &DesignRequestResult { error, ..DesignRequestResult::default() }, now).await?;
        return Ok(None);
    };
    let collected = CollectedProfile::read(conn, &mind.run, &ask.task).await?;
    course.begin(conn, mind, (id, ask.designer, to_u32(ask.wanted)), &collected).await.map(Some)
}

/// A task that can be designed for, and where it stands.
struct Course<'a> {
    plan: &'a TaskPlan,
    level: Option<u32>,
    placed: bool,
    base: Arc<Recipe>,
}

impl<'a> Course<'a> {
    fn of(mind: &RunState, plan: &'a TaskPlan) -> Option<Self> {
        let task = env_core::task(&plan.task)?;
        design_language(task)?;
        let status = mind.curriculum.status().into_iter().find(|status| status.task == plan.task)?;
        let level = status.probing.or(status.level);
        // Settings were checked when they were made: a recipe of them exists.
        let base = base(plan, level).ok()?;
        Some(Self { plan, level, placed: status.placed, base })
    }

    async fn begin(
        &self,
        conn: &mut SqliteConnection,
        mind: &RunState,
        (ask, which, wanted): (i64, DesignerKind, u32),
        collected: &CollectedProfile,
    ) -> Result<StartedDesignRequest, ServiceError> {
        let profile = collected.profile(&self.plan.task);
        let snapshot = ProfileSnapshot { profile: to_json(&profile)?, criticised: collected.sums.criticised };
        design_requests::start(conn, ask, self.level.map(i64::from), &snapshot).await?;
        let known = mind.curriculum.mastery().into_iter();
        let standing = known
            .filter(|m| m.task == self.plan.task && m.level == self.level && m.n > 0)
            .map(|m| LevelMastery { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 })
            .next();
        Ok(StartedDesignRequest {
            ask,
            run: mind.run.clone(),
            run_seed: mind.seed,
            task: self.plan.task.clone(),
            level: self.level,
            which,
            wanted,
            base: Arc::clone(&self.base),
            levels: self.plan.levels.clone(),
            profile,
            standing,
        })
    }
}

fn base(plan: &TaskPlan, level: Option<u32>) -> Result<Arc<Recipe>, ScenarioError> {
    let unknown = || ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: plan.task.clone(),
        choices: String::new(),
    };
    let task = env_core::task(&plan.task).ok_or_else(unknown)?;
    let params = plan.params(level);
    let params = params.iter().map(|(name, value)| (name.as_str(), *value));
    let options = plan.physics.iter().map(|(name, choice)| (name.as_str(), choice.as_str()));
    Ok(Arc::new(Recipe::with_params(task, params)?.with_options(options)?))
}

async fn view(
    conn: &mut SqliteConnection,
    mind: &RunState,
    course: &Course<'_>,
    which: DesignerKind,
    collected: &CollectedProfile,
    now: Millis,
) -> Result<StockView, ServiceError> {
    let task = course.plan.task.as_str();
    let active = design_counters::active(conn, &mind.run).await?;
    let held = active.iter().filter(|of| of.task == task && near(of.level.map(to_u32), course.level));
    let profile = collected.profile(task);
    Ok(StockView {
        which,
        placed: course.placed,
        criticised: collected.sums.criticised,
        failures: profile.total_weight(),
        held: to_u32(held.map(|of| of.count).sum()),
        stock: mind.settings.design.stock,
        last: last(conn, &mind.run, task, &profile).await?,
        now,
    })
}

/// How the last asks of a run's task went.
async fn last(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    profile: &FailureProfile,
) -> Result<Option<LastDesignRequest>, StoreError> {
    let over = design_requests::latest_finished(conn, run, task, LOOK_BACK).await?;
    let Some(newest) = over.first() else { return Ok(None) };
    // What another designer stood in for brought nothing of the one that was asked.
    let barren = over.iter().take_while(|ask| ask.own == 0).count();
    let (distance, criticised) = match design_requests::last_profile(conn, run, task).await? {
        Some(before) => {
            let read: FailureProfile = from_json("a failure profile", &before.profile)?;
            (profile.distance(&read), before.criticised)
        }
        None => (1.0, 0),
    };
    Ok(Some(LastDesignRequest { at: newest.at, criticised, distance, barren: barren as u32 }))
}

/// Ends an ask with what came of it. One that is over already is left alone.
#[derive(Debug, Clone)]
pub struct FinishDesignRequest {
    /// The ask.
    pub ask: i64,
    /// Its run.
    pub run: String,
    /// Its task.
    pub task: String,
    /// The level it was for.
    pub level: Option<u32>,
    /// What was thought of, and by whom.
    pub made: Vec<(&'static str, JudgedLayout)>,
    /// What it took.
    pub usage: DesignUsage,
    /// What went wrong without ending it.
    pub troubles: Vec<String>,
    /// Why it failed, if it did.
    pub error: Option<String>,
    /// How long all of it took.
    pub took: Duration,
}

impl Change for FinishDesignRequest {
    /// How many were let through.
    type Output = usize;

    async fn apply(self, tx: &mut WriteTx) -> Result<usize, ServiceError> {
        let (conn, now) = (&mut tx.conn, tx.now);
        let held = design_requests::get(conn, &self.run, self.ask).await?.filter(|ask| ask.state == RequestState::Running);
        let Some(ask) = held else { return Ok(0) };
        let train_groups_at = design_counters::groups(conn, &self.run).await?.all;
        let mut counts = [0usize; 2]; // refused, admitted
        let mut own = 0;
        let mut verdicts: BTreeMap<&str, i64> = BTreeMap::new();
        for (designer, judged) in &self.made {
            let passed = judged.verdict.is_ok();
            counts[usize::from(passed)] += 1;
            own += i64::from(passed && *designer == ask.designer.as_str());
            let verdict = judged.verdict.as_ref().map_or_else(|refusal| refusal.check().as_str(), |_| ADMITTED);
            *verdicts.entry(verdict).or_default() += 1;
            if counts[usize::from(passed)] <= KEPT {
                let row = self.row(designer, judged, train_groups_at);
                keep(conn, &row, judged, now).await?;
            }
        }
        for (verdict, count) in verdicts {
            metrics::record_layouts(verdict, count);
            let added = GateCount { task: self.task.clone(), verdict: verdict.to_owned(), count };
            design_counters::add_verdict(conn, &self.run, &added).await?;
        }
        let DesignUsage { model, prompt, rounds, tokens_in, tokens_out, cost, .. } = self.usage;
        let mut troubles: Vec<String> = self.troubles.iter().take(TROUBLES).map(|t| cut(t, 500)).collect();
        if counts[1] > KEPT {
            troubles.push(format!("{} layouts were let through; the first {KEPT} are kept", counts[1]));
        }
        let ended = DesignRequestResult {
            admitted: counts[1] as i64,
            own,
            refused: counts[0] as i64,
            model: model.map(|model| cut(&model, 200)),
            prompt: prompt.map(|prompt| cut(&prompt, 200)),
            rounds: i64::from(rounds),
            tokens_in: to_i64(tokens_in),
            tokens_out: to_i64(tokens_out),
            // No number is no cost; SQLite would take it for nothing at all.
            cost: if cost.is_finite() { cost } else { 0.0 },
            latency_ms: i64::try_from(self.took.as_millis()).unwrap_or(i64::MAX),
            troubles,
            error: self.error.map(|error| cut(&error, 1000)),
        };
        design_requests::finish(conn, self.ask, &ended, now).await?;
        let told = RunEvent::Design {
            ask: DesignRequestId(self.ask).to_string(),
            task: &self.task,
            designer: ask.designer,
            admitted: ended.admitted,
            refused: ended.refused,
            error: ended.error.as_deref(),
        };
        tx.emit(&self.run, &told)?;
        Ok(counts[1])
    }
}

/// What the gate's counts call what it let through.
pub const ADMITTED: &str = "admitted";

impl FinishDesignRequest {
    fn row(&self, designer: &str, judged: &JudgedLayout, train_groups_at: i64) -> NewLayout {
        let given = judged.design.as_ref();
        let admitted = judged.verdict.as_ref().ok();
        // The bodies' provenance is the design as the gate read it.
        let read = admitted.and_then(|a| a.scenario().recipe().layout()?.provenance.as_ref());
        let design = read.or(given);
        let text =
            design.map(Value::to_string).filter(|text| admitted.is_some() || text.len() <= MOST_DESIGN);
        let at = |path: &str| design.and_then(|design| design.pointer(path));
        let word = |path: &str| at(path).and_then(Value::as_str).map(|word| cut(word, 60));
        let refusal = judged.verdict.as_ref().err();
        NewLayout {
            request: self.ask,
            run: self.run.clone(),
            task: self.task.clone(),
            level: self.level.map(i64::from),
            designer: designer.to_owned(),
            name: cut(&judged.name, 200),
            design: text,
            mode: word("/aim/mode"),
            bearing_deg: at("/aim/bearing_deg").and_then(Value::as_i64).filter(|b| (0..360).contains(b)),
            frame: word("/frame"),
            round: i64::from(judged.round),
            state: state_of(judged),
            gate_check: refusal.map(|refusal| refusal.check().as_str().to_owned()),
            reason: refusal.map(|refusal| cut(&refusal.to_string(), 1000)),
            claim: admitted.map(|a| claim_of(a.kind())),
            novelty: admitted.and_then(designer::AdmittedLayout::novelty).filter(|novelty| novelty.is_finite()),
            scenario: admitted.map(|a| a.scenario().id().0.to_vec()),
            train_groups_at,
        }
    }
}

/// What a layout is once the gate has spoken.
const fn state_of(judged: &JudgedLayout) -> LayoutState {
    if judged.verdict.is_ok() { LayoutState::Active } else { LayoutState::Refused }
}

/// The claim of a layout as it is stored.
const fn claim_of(claim: designer::LayoutKind) -> LayoutClaim {
    match claim {
        designer::LayoutKind::Threat => LayoutClaim::Threat,
        designer::LayoutKind::Decoy => LayoutClaim::Decoy,
    }
}

async fn keep(
    conn: &mut SqliteConnection,
    row: &NewLayout,
    judged: &JudgedLayout,
    now: Millis,
) -> Result<(), StoreError> {
    if let (Ok(admitted), Some(id)) = (&judged.verdict, &row.scenario) {
        scenarios::insert(conn, &[admitted.scenario()]).await?;
        brackets::insert(conn, &[(id, admitted.bracket())]).await?;
    }
    let id = layouts::insert(conn, row, now).await?;
    let reason = row.reason.clone().unwrap_or_else(|| "the gate let it through".to_owned());
    layout_transitions::change_state(conn, id, &LayoutTransition { state: state_of(judged), why: None, reason }, now).await
}

/// At most so many characters of what a designer wrote.
fn cut(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        text.to_owned()
    } else {
        text.chars().take(most.saturating_sub(3)).chain("...".chars()).collect()
    }
}
