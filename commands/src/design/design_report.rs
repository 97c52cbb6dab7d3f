//! Results of designing, layout by layout.

use std::collections::BTreeMap;
use std::time::Duration;

use designer::{DesignTable, DesignUsage, GateCheck, JudgedLayout, LayoutKind, Refusal, design_language};
use env_core::admission::count_panel_successes;
use env_core::{Bracket, Scenario};
use serde_json::{Value, json};

/// Results of one call of the command.
#[derive(Debug)]
pub(super) struct DesignReport {
    pub(super) designer: &'static str,
    pub(super) rows: Vec<LayoutResult>,
    pub(super) usage: DesignUsage,
    /// Warnings that did not end the command.
    pub(super) warnings: Vec<String>,
    /// Time of designing, including the gate.
    pub(super) elapsed: Duration,
}

/// Layout with the gate's verdict.
#[derive(Debug)]
pub(super) struct LayoutResult {
    pub(super) name: String,
    pub(super) designer: &'static str,
    pub(super) task: &'static str,
    pub(super) round: u32,
    /// Design as its designer wrote it.
    pub(super) design: Option<Value>,
    /// Scenario of the layout; `None` if the design could not be built.
    pub(super) scenario: Option<Scenario>,
    pub(super) verdict: Result<GateReport, Refusal>,
}

/// Measurements of a layout that passed the gate.
#[derive(Debug)]
pub(super) struct GateReport {
    pub(super) bracket: Bracket,
    pub(super) kind: LayoutKind,
    pub(super) novelty: Option<f64>,
}

/// Admitted layout with its gate report and scenario.
#[derive(Debug, Clone, Copy)]
pub(super) struct AdmittedLayout<'a> {
    pub(super) layout: &'a LayoutResult,
    pub(super) gate: &'a GateReport,
    pub(super) scenario: &'a Scenario,
}

impl DesignReport {
    /// Returns the layouts that passed the gate, in order.
    pub(super) fn admitted(&self) -> impl Iterator<Item = AdmittedLayout<'_>> {
        self.rows.iter().filter_map(|layout| {
            let gate = layout.verdict.as_ref().ok()?;
            Some(AdmittedLayout { layout, gate, scenario: layout.scenario.as_ref()? })
        })
    }

    /// Counts the refused layouts by check, in the order of the checks. Checks without refusals are left out.
    pub(super) fn refused_by_check(&self) -> Vec<(GateCheck, usize)> {
        let refused = |check: GateCheck| {
            self.rows.iter().filter(|row| row.verdict.as_ref().is_err_and(|why| why.check() == check)).count()
        };
        let counts = GateCheck::ALL.iter().map(|check| (*check, refused(*check)));
        counts.filter(|(_, count)| *count > 0).collect()
    }

    /// Builds the JSON object of `--json`.
    pub(super) fn json(&self) -> Value {
        let usage = &self.usage;
        let refused: BTreeMap<_, _> =
            self.refused_by_check().into_iter().map(|(check, count)| (check.as_str(), count)).collect();
        json!({
            "designer": self.designer,
            "layouts": self.rows.iter().map(LayoutResult::json).collect::<Vec<_>>(),
            "summary": {
                "admitted": self.admitted().count(),
                "refused": refused,
                "rounds": usage.rounds,
                "tokens_in": usage.tokens_in,
                "tokens_out": usage.tokens_out,
                "cost": usage.cost,
                "model": usage.model,
                "prompt_version": usage.prompt,
                "seconds": self.elapsed.as_secs_f64(),
            },
            "warnings": self.warnings,
        })
    }
}

impl LayoutResult {
    /// Creates the result of a judged layout.
    pub(super) fn new(designer: &'static str, task: &'static str, judged: JudgedLayout) -> Self {
        let JudgedLayout { name, design, round, verdict, .. } = judged;
        let scenario = verdict.as_ref().ok().map(|admitted| admitted.scenario().clone());
        let verdict = verdict.map(|admitted| GateReport {
            bracket: admitted.bracket().clone(),
            kind: admitted.kind(),
            novelty: admitted.novelty(),
        });
        Self { name, designer, task, round, design, scenario, verdict }
    }

    /// Returns the scenario's design in canonical form, or the original design if there is no scenario.
    pub(super) fn canonical_design(&self) -> Option<&Value> {
        let made = self.scenario.as_ref().and_then(|scenario| scenario.recipe().layout());
        made.and_then(|layout| layout.provenance.as_ref()).or(self.design.as_ref())
    }

    /// Returns the aim and the encounters as a table, if the task has a design language.
    pub(super) fn listing(&self) -> Option<DesignTable> {
        let language = design_language(env_core::task(self.task)?)?;
        language.table(self.canonical_design()?)
    }

    fn json(&self) -> Value {
        let passed = self.verdict.as_ref().ok();
        let refusal = self.verdict.as_ref().err();
        let succeed =
            self.scenario.as_ref().zip(passed).map(|(s, passed)| count_panel_successes(s, &passed.bracket));
        json!({
            "name": self.name,
            "designer": self.designer,
            "round": self.round,
            "task": self.task,
            "design": self.design,
            "kind": passed.map(|passed| passed.kind.as_str()),
            "admitted": passed.is_some(),
            "check": refusal.map(|refusal| refusal.check().as_str()),
            "refusal": refusal.map(ToString::to_string),
            "scenario": self.scenario.as_ref().map(Scenario::to_json),
            "scenario_id": self.scenario.as_ref().map(|scenario| scenario.id().to_string()),
            "hold": passed.map(|passed| passed.bracket.hold_score()),
            "floor": passed.map(|passed| passed.bracket.floor),
            "reference": passed.map(|passed| passed.bracket.reference.score),
            "panel_successes": succeed,
            "novelty": passed.and_then(|passed| passed.novelty),
        })
    }
}
