//! The gate: checks that a layout must pass before an agent sees it. Refusals go back to the designer as sentences.

use std::collections::BTreeSet;

use env_core::admission::{admit, count_panel_successes, is_contested, is_solvable};
use env_core::bracket::{Bracket, MIN_GAP};
use env_core::rollout::replay;
use env_core::{Scenario, ScenarioId};
use serde_json::Value;

use crate::brief::DesignBrief;
use crate::design_language::{DesignLanguage, LayoutKind};
use crate::field_error::FieldError;
use crate::refusal::{MIN_NOVELTY, Refusal, RefusalWords};

/// Layout that passed all checks. Only the gate can create one.
#[derive(Debug, Clone, PartialEq)]
pub struct AdmittedLayout {
    scenario: Scenario,
    bracket: Bracket,
    kind: LayoutKind,
    novelty: Option<f64>,
}

impl AdmittedLayout {
    /// Returns the scenario of the layout.
    #[must_use]
    pub const fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Returns panel, floor, reference and reference plan.
    #[must_use]
    pub const fn bracket(&self) -> &Bracket {
        &self.bracket
    }

    /// Returns the kind of the layout, which the gate has verified.
    #[must_use]
    pub const fn kind(&self) -> LayoutKind {
        self.kind
    }

    /// Returns the distance of the nearest design in the archive; `None` if the archive was empty, or the layout
    /// has no design.
    #[must_use]
    pub const fn novelty(&self) -> Option<f64> {
        self.novelty
    }
}

/// Gate of one world, with the archive of designs that it compares with.
pub struct Gate {
    language: &'static dyn DesignLanguage,
    archive: Vec<Value>,
    /// Admitted scenarios without a design.
    admitted_without_design: BTreeSet<ScenarioId>,
}

impl Gate {
    /// Creates a gate with an archive of known designs.
    #[must_use]
    pub const fn new(language: &'static dyn DesignLanguage, archive: Vec<Value>) -> Self {
        Self { language, archive, admitted_without_design: BTreeSet::new() }
    }

    /// Returns the language of the designs that the gate judges.
    #[must_use]
    pub const fn language(&self) -> &'static dyn DesignLanguage {
        self.language
    }

    /// Returns the known designs, with those that the gate has admitted.
    #[must_use]
    pub fn archive(&self) -> &[Value] {
        &self.archive
    }

    /// Judges a design in the first of the base scenarios in which it passes: a layout that is impossible in one may be
    /// possible in the next. An admitted design is added to the archive.
    ///
    /// # Errors
    /// Returns the refusal by the latest check over all base scenarios.
    pub fn judge(
        &mut self,
        brief: &DesignBrief,
        design: &Value,
        bases: impl IntoIterator<Item = Scenario>,
    ) -> Result<AdmittedLayout, Refusal> {
        let design = self.language.parse(design, brief).map_err(Refusal::Schema)?;
        let mut latest: Option<Refusal> = None;
        for base in bases {
            match self.judge_in(&design, &base) {
                Ok(admitted) => {
                    self.archive.push(design);
                    return Ok(admitted);
                }
                // Novelty does not depend on the base scenario.
                Err(known @ Refusal::Known { .. }) => return Err(known),
                Err(refusal) => {
                    if latest.as_ref().is_none_or(|held| held.check() <= refusal.check()) {
                        latest = Some(refusal);
                    }
                }
            }
        }
        // No base scenario, no threat.
        Err(latest.unwrap_or(Refusal::Harmless { words: self.language.refusal_words() }))
    }

    /// Confirms that the gate of another process admitted a design in a base scenario. Everything is checked again, except that the
    /// planner does not run: its plan is replayed, and the panel and the floor of the bracket are taken over. An admitted design is
    /// added to the archive.
    ///
    /// # Errors
    /// Returns a refusal if this gate would not admit the design with this bracket.
    pub fn confirm(
        &mut self,
        brief: &DesignBrief,
        design: &Value,
        base: &Scenario,
        bracket: Bracket,
    ) -> Result<AdmittedLayout, Refusal> {
        let words = self.language.refusal_words();
        let design = self.language.parse(design, brief).map_err(Refusal::Schema)?;
        let (scenario, kind) = self.language.build(&design, base)?;
        check_bracket(&scenario, &bracket).map_err(Refusal::Compiles)?;
        match kind {
            LayoutKind::Threat if !is_contested(&scenario, &bracket) => {
                return Err(uncontested(&scenario, &bracket, words));
            }
            LayoutKind::Threat => self.check_threat(&scenario, &bracket)?,
            LayoutKind::Decoy if !is_acceptable(&scenario, &bracket) => {
                let (reference, lost) = (bracket.reference.score, bracket.reference.lost);
                return Err(Refusal::Unsolvable { reference, lost, words });
            }
            LayoutKind::Decoy => {
                self.language.check_decoy(&scenario, &bracket).map_err(Refusal::Decoy)?;
            }
        }
        let novelty = self.check_novelty(&design)?;
        self.archive.push(design);
        Ok(AdmittedLayout { scenario, bracket, kind, novelty })
    }

    /// Judges a complete scenario. If the provenance of its layout is a design, the scenario must equal the one that is
    /// built from the design.
    ///
    /// # Errors
    /// Returns the first refusal.
    pub fn judge_scenario(&mut self, scenario: &Scenario) -> Result<AdmittedLayout, Refusal> {
        let provenance = scenario.recipe().layout().and_then(|layout| layout.provenance.clone());
        let Some(design) = provenance.filter(|design| self.language.is_design(design)) else {
            return self.judge_without_design(scenario);
        };
        // The brief of the design is not known here. It is not needed: `build` parses the design, and the params in it must
        // lead to this scenario.
        let admitted = self.judge_in(&design, scenario)?;
        if admitted.scenario.id() != scenario.id() {
            let message = "does not lead to the bodies of the layout; leave it out";
            return Err(Refusal::Compiles(FieldError::new("layout.provenance", message)));
        }
        self.archive.push(design);
        Ok(admitted)
    }

    fn judge_without_design(&mut self, scenario: &Scenario) -> Result<AdmittedLayout, Refusal> {
        let bracket = self.judge_threat(scenario)?;
        if !self.admitted_without_design.insert(scenario.id()) {
            return Err(Refusal::Duplicate);
        }
        Ok(AdmittedLayout { scenario: scenario.clone(), bracket, kind: LayoutKind::Threat, novelty: None })
    }

    /// Judges a parsed design in one base scenario.
    fn judge_in(&self, design: &Value, base: &Scenario) -> Result<AdmittedLayout, Refusal> {
        let (scenario, kind) = self.language.build(design, base)?;
        let bracket = match kind {
            LayoutKind::Threat => self.judge_threat(&scenario)?,
            LayoutKind::Decoy => {
                let bracket = solve(&scenario, self.language.refusal_words())?.bracket;
                self.language.check_decoy(&scenario, &bracket).map_err(Refusal::Decoy)?;
                bracket
            }
        };
        Ok(AdmittedLayout { scenario, bracket, kind, novelty: self.check_novelty(design)? })
    }

    /// Checks a threat: fair, solvable, contested, a danger to an agent that acts blindly, and visible in time to act. Returns its
    /// bracket.
    fn judge_threat(&self, scenario: &Scenario) -> Result<Bracket, Refusal> {
        let bracket = check_contested(scenario, self.language.refusal_words())?;
        self.check_threat(scenario, &bracket)?;
        Ok(bracket)
    }

    /// Checks a contested threat: a danger to an agent that acts blindly, and visible in time to act.
    fn check_threat(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), Refusal> {
        if self.language.is_harmless(scenario, bracket) {
            return Err(Refusal::Harmless { words: self.language.refusal_words() });
        }
        // Last, since the planner explains a lack of fuel better.
        self.language.check_reaction(scenario).map_err(Refusal::TooLate)
    }

    fn check_novelty(&self, design: &Value) -> Result<Option<f64>, Refusal> {
        let distances = self.archive.iter().map(|known| (self.language.distance(design, known), known));
        match distances.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((distance, known)) if distance < MIN_NOVELTY => {
                let like = known.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
                Err(Refusal::Known { like, distance, words: self.language.refusal_words() })
            }
            nearest => Ok(nearest.map(|(distance, _)| distance)),
        }
    }
}

fn check_contested(scenario: &Scenario, words: &'static RefusalWords) -> Result<Bracket, Refusal> {
    let SolvedScenario { bracket, is_contested } = solve(scenario, words)?;
    if is_contested {
        return Ok(bracket);
    }
    Err(uncontested(scenario, &bracket, words))
}

/// Refusal of a scenario in which acting well does not matter enough.
fn uncontested(scenario: &Scenario, bracket: &Bracket, words: &'static RefusalWords) -> Refusal {
    Refusal::Uncontested {
        blind: count_panel_successes(scenario, bracket),
        most: bracket.max_blind_successes(),
        panel: bracket.panel.len(),
        gap: bracket.reference.score - bracket.floor,
        words,
    }
}

/// Checks that a bracket has a panel and finite scores, and that its plan reaches its reference.
fn check_bracket(scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError> {
    let field = |message: &str| FieldError::new("bracket", message);
    let finite = bracket.panel.iter().all(|outcome| outcome.score.is_finite()) && bracket.floor.is_finite();
    if bracket.panel.is_empty() || !finite {
        return Err(field("must have a panel with finite scores"));
    }
    match replay(scenario, &bracket.reference_plan) {
        Ok(outcome) if outcome == bracket.reference => Ok(()),
        Ok(_) => Err(field("must have the outcome of its plan as its reference")),
        Err(_) => Err(field("must have a plan that can be replayed")),
    }
}

/// Fair scenario that the reference planner solves.
struct SolvedScenario {
    bracket: Bracket,
    is_contested: bool,
}

fn solve(scenario: &Scenario, words: &'static RefusalWords) -> Result<SolvedScenario, Refusal> {
    let admission = admit(scenario);
    let bracket = match (admission.fair, admission.bracket) {
        (Ok(()), Some(bracket)) => bracket,
        (Err(error), _) => return Err(Refusal::Unfair(error)),
        (Ok(()), None) => return Err(Refusal::Unsolvable { reference: 0.0, lost: 0, words }),
    };
    if !is_acceptable(scenario, &bracket) {
        let (reference, lost) = (bracket.reference.score, bracket.reference.lost);
        return Err(Refusal::Unsolvable { reference, lost, words });
    }
    Ok(SolvedScenario { bracket, is_contested: admission.contested })
}

/// True if the planner succeeds, or the scenario is not too hard: where success is a skill between blind plans and the planner, a
/// planner that is no better than they are cannot succeed.
fn is_acceptable(scenario: &Scenario, bracket: &Bracket) -> bool {
    let is_easy = scenario.task().blind_can_succeed()
        && bracket.reference.lost == 0
        && bracket.reference.score - bracket.floor < MIN_GAP;
    is_solvable(scenario, bracket) || is_easy
}
