//! A round of asking a designer: begun where it is due, ended with what came of it. What takes time happens in between.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use designer::brief::Standing;
use designer::gate::{Judged, Usage};
use designer::{Profile, language};
use env_core::space::Levels;
use env_core::{Recipe, ScenarioError};
use serde_json::Value;
use sqlx::SqliteConnection;

use super::Which;
use super::profile::Collected;
use super::serve::near;
use super::stock::{self, Last, View};
use crate::clock::Millis;
use crate::counts;
use crate::ids::AskId;
use crate::store::asks::{self, AskRow};
use crate::store::layouts::{self, LayoutRow, Turn};
use crate::store::{StoreError, design_counts, from_json, signed, small, to_json};
use crate::store::{brackets, scenarios};
use crate::training::{Change, Happening, Mind, TrainingError, Work};
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
pub struct Begun {
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
    pub which: Which,
    /// How many layouts are wanted.
    pub wanted: u32,
    /// Task, params and physics.
    pub base: Arc<Recipe>,
    /// The task's table.
    pub levels: Levels,
    /// What the agent fails at.
    pub profile: Profile,
    /// How well it does at this level.
    pub standing: Option<Standing>,
}

/// Begins an ask: the one that waits, or one that is due.
#[derive(Debug)]
pub struct Begin {
    /// Of which run.
    pub run: String,
    /// The one that waits; none: whichever task is due.
    pub ask: Option<i64>,
    /// Whether there is a language model.
    pub has_llm: bool,
}

impl Change for Begin {
    type Answer = Option<Begun>;

    async fn apply(self, work: &mut Work) -> Result<Option<Begun>, TrainingError> {
        let now = work.now;
        let (mind, conn) = work.mind(&self.run).await?;
        if asks::running(conn, &self.run).await? > 0 {
            return Ok(None);
        }
        if let Some(id) = self.ask {
            return begin_waiting(conn, mind, id, now).await;
        }
        let design = mind.settings.design;
        let Some(which) = design.designer.which(self.has_llm).filter(|_| design.on() && !mind.paused) else {
            return Ok(None);
        };
        for plan in &mind.settings.curriculum.tasks {
            let Some(course) = Course::of(mind, plan) else { continue };
            let collected = Collected::read(conn, &self.run, &plan.task).await?;
            let view = view(conn, mind, &course, which, &collected, now).await?;
            if let Some(wanted) = stock::wanted(&view) {
                let ask = AskRow {
                    run: self.run.clone(),
                    task: plan.task.clone(),
                    designer: which.word().to_owned(),
                    asked_by: "worker".to_owned(),
                    wanted: i64::from(wanted),
                    ..AskRow::default()
                };
                let id = asks::insert(conn, &ask, now).await?;
                return course.begin(conn, mind, (id, which, wanted), &collected).await.map(Some);
            }
        }
        Ok(None)
    }
}

async fn begin_waiting(
    conn: &mut SqliteConnection,
    mind: &Mind,
    id: i64,
    now: Millis,
) -> Result<Option<Begun>, TrainingError> {
    let Some(ask) = asks::get(conn, &mind.run, id).await?.filter(|ask| ask.state == "waiting") else {
        return Ok(None);
    };
    let course = mind.settings.curriculum.tasks.iter().find(|plan| plan.task == ask.task);
    let Some((course, which)) = course.and_then(|plan| Course::of(mind, plan)).zip(Which::of(&ask.designer))
    else {
        let error = Some("the run has no such task any more that could be designed for".to_owned());
        asks::end(conn, &AskRow { error, ..ask }, now).await?;
        return Ok(None);
    };
    let collected = Collected::read(conn, &mind.run, &ask.task).await?;
    course.begin(conn, mind, (id, which, small(ask.wanted)), &collected).await.map(Some)
}

/// A task that can be designed for, and where it stands.
struct Course<'a> {
    plan: &'a TaskPlan,
    level: Option<u32>,
    placed: bool,
    base: Arc<Recipe>,
}

impl<'a> Course<'a> {
    fn of(mind: &Mind, plan: &'a TaskPlan) -> Option<Self> {
        let task = env_core::task(&plan.task)?;
        language(task)?;
        let status = mind.curriculum.status().into_iter().find(|status| status.task == plan.task)?;
        let level = status.probing.or(status.level);
        // Settings were checked when they were made: a recipe of them exists.
        let base = base(plan, level).ok()?;
        Some(Self { plan, level, placed: status.placed, base })
    }

    async fn begin(
        &self,
        conn: &mut SqliteConnection,
        mind: &Mind,
        (ask, which, wanted): (i64, Which, u32),
        collected: &Collected,
    ) -> Result<Begun, TrainingError> {
        let profile = collected.profile(&self.plan.task);
        let text = to_json(&profile)?;
        asks::begin(conn, ask, self.level.map(i64::from), &text, collected.sums.criticised).await?;
        let known = mind.curriculum.mastery().into_iter();
        let standing = known
            .filter(|m| m.task == self.plan.task && m.level == self.level && m.n > 0)
            .map(|m| Standing { n: m.n, mean: m.mean, q10: m.q10, q90: m.q90 })
            .next();
        Ok(Begun {
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
    mind: &Mind,
    course: &Course<'_>,
    which: Which,
    collected: &Collected,
    now: Millis,
) -> Result<View, TrainingError> {
    let task = course.plan.task.as_str();
    let active = design_counts::active(conn, &mind.run).await?;
    let held = active.iter().filter(|(of, level, _)| of == task && near(level.map(small), course.level));
    let profile = collected.profile(task);
    Ok(View {
        which,
        placed: course.placed,
        criticised: collected.sums.criticised,
        failures: profile.failures(),
        held: small(held.map(|(_, _, n)| n).sum()),
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
    profile: &Profile,
) -> Result<Option<Last>, StoreError> {
    let over = asks::lately(conn, run, task, LOOK_BACK).await?;
    let Some(newest) = over.first() else { return Ok(None) };
    // What another designer stood in for brought nothing of the one that was asked.
    let barren = over.iter().take_while(|ask| ask.own == 0).count();
    let (distance, criticised) = match asks::last_profile(conn, run, task).await? {
        Some((text, criticised)) => {
            (profile.distance(&from_json::<Profile>("a failure profile", &text)?), criticised)
        }
        None => (1.0, 0),
    };
    Ok(Some(Last { at: newest.at, criticised, distance, barren: barren as u32 }))
}

/// Ends an ask with what came of it. One that is over already is left alone.
#[derive(Debug, Clone)]
pub struct Finish {
    /// The ask.
    pub ask: i64,
    /// Its run.
    pub run: String,
    /// Its task.
    pub task: String,
    /// The level it was for.
    pub level: Option<u32>,
    /// What was thought of, and by whom.
    pub made: Vec<(&'static str, Judged)>,
    /// What it took.
    pub usage: Usage,
    /// What went wrong without ending it.
    pub troubles: Vec<String>,
    /// Why it failed, if it did.
    pub error: Option<String>,
    /// How long all of it took.
    pub took: Duration,
}

impl Change for Finish {
    /// How many were let through.
    type Answer = usize;

    async fn apply(self, work: &mut Work) -> Result<usize, TrainingError> {
        let (conn, now) = (&mut work.conn, work.now);
        let held = asks::get(conn, &self.run, self.ask).await?.filter(|ask| ask.state == "running");
        let Some(ask) = held else { return Ok(0) };
        let (train_groups_at, _) = design_counts::groups(conn, &self.run).await?;
        let mut counts = [0usize; 2]; // refused, admitted
        let mut own = 0;
        let mut verdicts: BTreeMap<&str, i64> = BTreeMap::new();
        for (designer, judged) in &self.made {
            let passed = judged.verdict.is_ok();
            counts[usize::from(passed)] += 1;
            own += i64::from(passed && *designer == ask.designer);
            let verdict = judged.verdict.as_ref().map_or_else(designer::Refusal::check, |_| ADMITTED);
            *verdicts.entry(verdict).or_default() += 1;
            if counts[usize::from(passed)] <= KEPT {
                let row = self.row(designer, judged, train_groups_at);
                keep(conn, &row, judged, now).await?;
            }
        }
        for (verdict, count) in verdicts {
            counts::layouts(verdict, count);
            design_counts::add_verdict(conn, &self.run, &self.task, verdict, count).await?;
        }
        let Usage { model, prompt, rounds, tokens_in, tokens_out, cost, .. } = self.usage;
        let mut troubles: Vec<String> = self.troubles.iter().take(TROUBLES).map(|t| cut(t, 500)).collect();
        if counts[1] > KEPT {
            troubles.push(format!("{} layouts were let through; the first {KEPT} are kept", counts[1]));
        }
        let ended = AskRow {
            admitted: counts[1] as i64,
            own,
            refused: counts[0] as i64,
            model: model.map(|model| cut(&model, 200)),
            prompt: prompt.map(|prompt| cut(&prompt, 200)),
            rounds: i64::from(rounds),
            tokens_in: signed(tokens_in),
            tokens_out: signed(tokens_out),
            // No number is no cost; SQLite would take it for nothing at all.
            cost: if cost.is_finite() { cost } else { 0.0 },
            latency_ms: i64::try_from(self.took.as_millis()).unwrap_or(i64::MAX),
            troubles: to_json(&troubles)?,
            error: self.error.map(|error| cut(&error, 1000)),
            ..ask
        };
        asks::end(conn, &ended, now).await?;
        let told = Happening::Design {
            ask: AskId(self.ask).to_string(),
            task: &self.task,
            designer: &ended.designer,
            admitted: ended.admitted,
            refused: ended.refused,
            error: ended.error.as_deref(),
        };
        work.tell(&self.run, &told)?;
        Ok(counts[1])
    }
}

/// What the gate's counts call what it let through.
pub const ADMITTED: &str = "admitted";

impl Finish {
    fn row(&self, designer: &str, judged: &Judged, train_groups_at: i64) -> LayoutRow {
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
        LayoutRow {
            ask: self.ask,
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
            state: state_of(judged).to_owned(),
            gate_check: refusal.map(|refusal| refusal.check().to_owned()),
            reason: refusal.map(|refusal| cut(&refusal.to_string(), 1000)),
            claim: admitted.map(|a| a.claim().word().to_owned()),
            novelty: admitted.and_then(designer::Admitted::novelty).filter(|novelty| novelty.is_finite()),
            scenario: admitted.map(|a| a.scenario().id().0.to_vec()),
            train_groups_at,
            ..LayoutRow::default()
        }
    }
}

/// What a layout is once the gate has spoken.
const fn state_of(judged: &Judged) -> &'static str {
    if judged.verdict.is_ok() { "active" } else { "refused" }
}

async fn keep(
    conn: &mut SqliteConnection,
    row: &LayoutRow,
    judged: &Judged,
    now: Millis,
) -> Result<(), StoreError> {
    if let (Ok(admitted), Some(id)) = (&judged.verdict, &row.scenario) {
        scenarios::insert(conn, &[admitted.scenario()]).await?;
        brackets::insert(conn, &[(id, admitted.bracket())]).await?;
    }
    let id = layouts::insert(conn, row, now).await?;
    let reason = row.reason.clone().unwrap_or_else(|| "the gate let it through".to_owned());
    layouts::turn(conn, id, &Turn { state: state_of(judged), why: None, reason }, now).await
}

/// At most so many characters of what a designer wrote.
fn cut(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        text.to_owned()
    } else {
        text.chars().take(most.saturating_sub(3)).chain("...".chars()).collect()
    }
}
