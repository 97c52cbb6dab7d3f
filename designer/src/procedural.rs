//! [`ProceduralDesigner`]: samples designs from the failure profile and edits earlier ones, to easier and harder siblings where
//! the agent almost always fails or succeeds. It needs no network and never fails, so that it can replace any other designer.

use env_core::keyed_rng::RngPurpose;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;
use tokio::time::Instant;

use crate::brief::{DesignBrief, PastLayout};
use crate::design_language::DesignLanguage;
use crate::designer::{DesignFuture, DesignOutcome, DesignUsage, Designer, JudgedLayout};
use crate::edit_direction::EditDirection;
use crate::gate::Gate;

/// Maximum number of attempts per requested layout.
const ATTEMPTS_PER_LAYOUT: usize = 40;
/// Share of attempts that edit an earlier design, if there is a suitable one.
const EDIT_SHARE: f64 = 0.5;

/// Designer that samples and edits.
#[derive(Debug, Clone, Copy, Default)]
pub struct ProceduralDesigner;

impl ProceduralDesigner {
    /// Returns the designs of the first `count` attempts for a brief, before the gate judges them.
    #[must_use]
    pub fn preview(brief: &DesignBrief, language: &dyn DesignLanguage, count: usize) -> Vec<Value> {
        let parents = Parents::select(brief, language);
        let attempts = (0..count as u64).filter_map(|number| attempt(brief, language, &parents, number));
        attempts.map(|attempted| attempted.design).collect()
    }

    /// Repeats an attempt for a brief, before the gate judges it; `None` if the attempt finds no design.
    #[must_use]
    pub fn repeat_attempt(
        brief: &DesignBrief,
        language: &dyn DesignLanguage,
        number: u64,
    ) -> Option<AttemptedDesign> {
        attempt(brief, language, &Parents::select(brief, language), number)
    }

    /// Returns the number of attempts after which the designer gives up.
    #[must_use]
    pub const fn max_attempts(brief: &DesignBrief) -> u64 {
        (brief.count * ATTEMPTS_PER_LAYOUT) as u64
    }

    /// Designs layouts until enough are admitted or the attempts are used up. Ignores the time limit of the brief.
    #[must_use]
    pub fn design_layouts(brief: &DesignBrief, gate: &mut Gate) -> DesignOutcome {
        let mut run = DesignRun::new(brief, gate);
        while !run.is_finished() {
            run.attempt(gate);
        }
        run.outcome
    }

    /// Like [`ProceduralDesigner::design_layouts`], within the time limit of the brief. Yields to other tasks between attempts.
    async fn design_in_time(brief: &DesignBrief, gate: &mut Gate) -> DesignOutcome {
        let started = Instant::now();
        let mut run = DesignRun::new(brief, gate);
        while !run.is_finished() {
            if let Some(limit) = brief.time_limit.filter(|limit| started.elapsed() >= *limit) {
                let warning = format!("the time limit ended the request after {} s", limit.as_secs());
                run.outcome.warnings.push(warning);
                break;
            }
            run.attempt(gate);
            tokio::task::yield_now().await;
        }
        run.outcome
    }
}

impl Designer for ProceduralDesigner {
    fn name(&self) -> &'static str {
        "procedural"
    }

    fn design<'a>(&'a mut self, brief: &'a DesignBrief, gate: &'a mut Gate) -> DesignFuture<'a> {
        Box::pin(async move { Ok(Self::design_in_time(brief, gate).await) })
    }
}

/// Progress on one brief.
struct DesignRun<'a> {
    brief: &'a DesignBrief,
    parents: Parents<'a>,
    outcome: DesignOutcome,
    attempts: u64,
}

impl<'a> DesignRun<'a> {
    fn new(brief: &'a DesignBrief, gate: &Gate) -> Self {
        let usage = DesignUsage { rounds: 1, ..DesignUsage::default() };
        let outcome = DesignOutcome { usage, ..DesignOutcome::default() };
        Self { brief, parents: Parents::select(brief, gate.language()), outcome, attempts: 0 }
    }

    fn is_finished(&self) -> bool {
        let max_attempts = ProceduralDesigner::max_attempts(self.brief);
        self.outcome.admitted() >= self.brief.count || self.attempts >= max_attempts
    }

    /// Makes one design and lets the gate judge it.
    fn attempt(&mut self, gate: &mut Gate) {
        let number = self.attempts;
        self.attempts += 1;
        let attempted = attempt(self.brief, gate.language(), &self.parents, number);
        let Some(AttemptedDesign { base, design }) = attempted else { return };
        let verdict = gate.judge(self.brief, &design, [base]);
        let name = design.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
        let judged = JudgedLayout { name, design: Some(design), attempt: number, round: 1, verdict };
        self.outcome.judged.push(judged);
    }
}

/// Earlier layouts that are worth editing, with the weight of each.
struct Parents<'a> {
    layouts: Vec<&'a PastLayout>,
    weights: Vec<f64>,
}

impl<'a> Parents<'a> {
    /// Selects the layouts with regret. Their weight is 1/rank by regret × novelty, since regrets are similar once a designer
    /// has learned what works (Jiang et al. 2021, section 3).
    fn select(brief: &'a DesignBrief, language: &dyn DesignLanguage) -> Self {
        let (mut layouts, mut values) = (Vec::new(), Vec::new());
        for (index, past) in brief.past_layouts.iter().enumerate() {
            let Some(regret) = past.outcome.aimed_regret() else { continue };
            let others = brief.past_layouts.iter().enumerate().filter(|(other, _)| *other != index);
            let distances = others.map(|(_, other)| language.distance(&past.design, &other.design));
            let novelty = distances.fold(1.0, f64::min);
            let value = regret * novelty;
            if value > 0.0 {
                layouts.push(past);
                values.push(value);
            }
        }
        let rank = |value: &f64| 1 + values.iter().filter(|other| *other > value).count();
        let weights = values.iter().map(|value| 1.0 / rank(value) as f64).collect();
        Self { layouts, weights }
    }
}

/// Design of an attempt, with the base scenario in which the gate judges it.
#[derive(Debug, Clone, PartialEq)]
pub struct AttemptedDesign {
    /// The base scenario of the attempt.
    pub base: Scenario,
    /// The design, with a name.
    pub design: Value,
}

/// Makes the `number`-th design of a brief: an edit of a parent, in the direction that its success rate asks for, or a new sample.
fn attempt(
    brief: &DesignBrief,
    language: &dyn DesignLanguage,
    parents: &Parents<'_>,
    number: u64,
) -> Option<AttemptedDesign> {
    let mut rng = KeyedRng::new(RngPurpose::Design, brief.seed, number);
    let is_edit = rng.bernoulli(EDIT_SHARE);
    let parent = rng.weighted_index(&parents.weights).map(|index| parents.layouts[index]);
    let (base, design) = if let Some(parent) = parent.filter(|_| is_edit) {
        let base = parent.seed.map_or_else(|| brief.base_scenario(number), |seed| brief.scenario(seed));
        let direction = parent.outcome.mean_success().and_then(EditDirection::of_success);
        let design = language.edit(&parent.design, brief, &base, direction, &mut rng);
        (base, design)
    } else {
        let base = brief.base_scenario(number);
        let design = language.sample(brief, &base, &mut rng);
        (base, design)
    };
    let mut design = design?;
    set_default_name(&mut design, number);
    Some(AttemptedDesign { base, design })
}

/// Names a design that has no name after its failure mode and its number.
fn set_default_name(design: &mut Value, number: u64) {
    let mode = design.pointer("/aim/mode").and_then(Value::as_str).unwrap_or("layout").to_owned();
    if let Some(name) = design.get_mut("name").filter(|name| name.as_str() == Some("")) {
        *name = Value::String(format!("{mode} {}", number + 1));
    }
}
