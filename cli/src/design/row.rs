//! What came of designing, layout by layout.

use std::collections::BTreeMap;
use std::time::Duration;

use designer::{DesignTable, DesignUsage, GateCheck, JudgedLayout, LayoutKind, Refusal, design_language};
use env_core::admission::count_panel_successes;
use env_core::{Bracket, Scenario};
use serde_json::{Value, json};

/// All of it.
#[derive(Debug)]
pub(super) struct Outcome {
    pub(super) designer: &'static str,
    pub(super) rows: Vec<Row>,
    pub(super) usage: DesignUsage,
    /// What went wrong without ending it.
    pub(super) troubles: Vec<String>,
    /// How long it took, gate included.
    pub(super) took: Duration,
}

/// One layout.
#[derive(Debug)]
pub(super) struct Row {
    pub(super) name: String,
    pub(super) designer: &'static str,
    pub(super) task: &'static str,
    pub(super) round: u32,
    /// As it was thought of.
    pub(super) design: Option<Value>,
    /// What it makes, where it came to that.
    pub(super) scenario: Option<Scenario>,
    pub(super) verdict: Result<Passed, Refusal>,
}

/// What the gate says of a layout that passed.
#[derive(Debug)]
pub(super) struct Passed {
    pub(super) bracket: Bracket,
    pub(super) claim: LayoutKind,
    pub(super) novelty: Option<f64>,
}

impl Passed {
    /// A threat of which nothing else is known.
    pub(super) const fn threat(bracket: Bracket) -> Self {
        Self { bracket, claim: LayoutKind::Threat, novelty: None }
    }
}

/// An admitted layout.
pub(super) type Admitted<'a> = (&'a Row, &'a Passed, &'a Scenario);

impl Outcome {
    /// The layouts that passed, in order.
    pub(super) fn admitted(&self) -> impl Iterator<Item = Admitted<'_>> {
        self.rows.iter().filter_map(|row| Some((row, row.verdict.as_ref().ok()?, row.scenario.as_ref()?)))
    }

    /// How many each check refused, in the order of the checks; those that refused none are left out.
    pub(super) fn refused(&self) -> Vec<(&'static str, usize)> {
        let refused = |check: GateCheck| {
            self.rows.iter().filter(|row| row.verdict.as_ref().is_err_and(|why| why.check() == check)).count()
        };
        let counts = GateCheck::ALL.iter().map(|check| (check.as_str(), refused(*check)));
        counts.filter(|(_, count)| *count > 0).collect()
    }

    /// The answer for machines.
    pub(super) fn json(&self) -> Value {
        let usage = &self.usage;
        let refused: BTreeMap<_, _> = self.refused().into_iter().collect();
        json!({
            "designer": self.designer,
            "layouts": self.rows.iter().map(Row::json).collect::<Vec<_>>(),
            "summary": {
                "admitted": self.admitted().count(),
                "refused": refused,
                "rounds": usage.rounds,
                "tokens_in": usage.tokens_in,
                "tokens_out": usage.tokens_out,
                "cost": usage.cost,
                "model": usage.model,
                "prompt": usage.prompt,
                "seconds": self.took.as_secs_f64(),
            },
            "troubles": self.troubles,
        })
    }
}

impl Row {
    /// What a designer's layout came to.
    pub(super) fn of(designer: &'static str, task: &'static str, judged: JudgedLayout) -> Self {
        let JudgedLayout { name, design, round, verdict } = judged;
        let scenario = verdict.as_ref().ok().map(|admitted| admitted.scenario().clone());
        let verdict = verdict.map(|admitted| Passed {
            bracket: admitted.bracket().clone(),
            claim: admitted.kind(),
            novelty: admitted.novelty(),
        });
        Self { name, designer, task, round, design, scenario, verdict }
    }

    /// Its design as it was understood: that of the scenario, in its canonical form, where there is one.
    pub(super) fn understood(&self) -> Option<&Value> {
        let made = self.scenario.as_ref().and_then(|scenario| scenario.recipe().layout());
        made.and_then(|layout| layout.provenance.as_ref()).or(self.design.as_ref())
    }

    /// Its aim and encounters for people.
    pub(super) fn listing(&self) -> Option<DesignTable> {
        let language = design_language(env_core::task(self.task)?)?;
        language.table(self.understood()?)
    }

    fn json(&self) -> Value {
        let passed = self.verdict.as_ref().ok();
        let refusal = self.verdict.as_ref().err();
        let succeed = self.scenario.as_ref().zip(passed).map(|(s, passed)| count_panel_successes(s, &passed.bracket));
        json!({
            "name": self.name,
            "designer": self.designer,
            "round": self.round,
            "task": self.task,
            "design": self.design,
            "claim": passed.map(|passed| passed.claim.as_str()),
            "admitted": passed.is_some(),
            "check": refusal.map(|refusal| refusal.check().as_str()),
            "refusal": refusal.map(ToString::to_string),
            "scenario": self.scenario.as_ref().map(Scenario::to_json),
            "scenario_id": self.scenario.as_ref().map(|scenario| scenario.id().to_string()),
            "hold": passed.map(|passed| passed.bracket.hold_score()),
            "floor": passed.map(|passed| passed.bracket.floor),
            "reference": passed.map(|passed| passed.bracket.reference.score),
            "panel_success": succeed,
            "novelty": passed.and_then(|passed| passed.novelty),
        })
    }
}
