//! [`ReportedLayout`]: a layout that a designer and a gate in another process made and judged, and its check.

use env_core::bracket::Bracket;
use env_core::{Scenario, Seed};
use serde_json::Value;

use crate::brief::DesignBrief;
use crate::designer::JudgedLayout;
use crate::gate::{AdmittedLayout, Gate};
use crate::llm_designer;
use crate::procedural::ProceduralDesigner;
use crate::refusal::{GateCheck, Refusal};

/// Layout with a verdict, as another process reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportedLayout {
    /// Name of the layout, for display.
    pub name: String,
    /// Design of the layout; `None` if it was refused and is too long. That of an admitted layout is canonical.
    pub design: Option<Value>,
    /// Number of the attempt, from which the base scenarios follow.
    pub attempt: u64,
    /// Round in which the designer gave it, from 1.
    pub round: u32,
    /// Verdict of the other process.
    pub verdict: ReportedVerdict,
}

/// Verdict of a gate in another process.
#[derive(Debug, Clone, PartialEq)]
pub enum ReportedVerdict {
    /// The gate admitted the layout.
    Admitted {
        /// Seed of the base scenario.
        seed: Seed,
        /// Bracket of the layout's scenario.
        bracket: Box<Bracket>,
    },
    /// The gate refused the layout.
    Refused {
        /// Check of the gate that failed.
        check: GateCheck,
        /// Message of the refusal.
        message: String,
    },
}

/// Designer whose layouts another process reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportedDesigner {
    /// The procedural designer, whose designs follow from the brief.
    Procedural,
    /// A language model, whose designs follow from nothing.
    Llm,
}

/// Amount of the check of a reported layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutCheck {
    /// Everything but the planner, see [`Gate::confirm`]. A refusal is believed.
    Confirm,
    /// The gate judges the layout again, whichever verdict it has.
    Judge,
}

/// Reason why a report is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReportFault {
    /// The design is not that of its attempt.
    #[error("the design is not that of attempt {0}")]
    OtherDesign(u64),
    /// The layout was admitted in a scenario that is none of its attempt.
    #[error("the base scenario is none of attempt {0}")]
    OtherBase(u64),
    /// The layout was admitted, and this process refuses it.
    #[error("an admitted layout does not pass the gate: {0}")]
    NotAdmitted(Refusal),
    /// The verdict differs from that of this process.
    #[error("the verdict on a layout differs")]
    OtherVerdict,
}

impl From<&JudgedLayout> for ReportedLayout {
    fn from(judged: &JudgedLayout) -> Self {
        let verdict = match &judged.verdict {
            Ok(admitted) => ReportedVerdict::Admitted {
                seed: admitted.scenario().seed(),
                bracket: Box::new(admitted.bracket().clone()),
            },
            Err(refusal) => ReportedVerdict::Refused { check: refusal.check(), message: refusal.to_string() },
        };
        // The provenance of an admitted layout is its design as the gate parsed it.
        let parsed = judged.verdict.as_ref().ok().and_then(|admitted| canonical(admitted).cloned());
        Self {
            name: judged.name.clone(),
            design: parsed.or_else(|| judged.design.clone()),
            attempt: judged.attempt,
            round: judged.round,
            verdict,
        }
    }
}

/// Design of an admitted layout, as the gate parsed it.
fn canonical(admitted: &AdmittedLayout) -> Option<&Value> {
    admitted.scenario().recipe().layout()?.provenance.as_ref()
}

impl ReportedLayout {
    /// True if the other process admitted the layout.
    #[must_use]
    pub const fn is_admitted(&self) -> bool {
        matches!(self.verdict, ReportedVerdict::Admitted { .. })
    }

    /// Checks the layout with the gate of this process, which has the archive of the other gate at that time.
    ///
    /// # Errors
    /// Returns the fault of the report: the other process is broken or forged.
    pub fn check(
        self,
        brief: &DesignBrief,
        gate: &mut Gate,
        designer: ReportedDesigner,
        check: LayoutCheck,
    ) -> Result<JudgedLayout, ReportFault> {
        let is_admitted = self.is_admitted();
        let verdict = match &self.design {
            Some(design) if is_admitted || check == LayoutCheck::Judge => {
                let bases = self.base_scenarios(brief, gate, designer, design)?;
                match check {
                    LayoutCheck::Judge => self.judge_again(brief, gate, design, bases)?,
                    LayoutCheck::Confirm => self.confirm(brief, gate, design, &bases)?,
                }
            }
            _ => match &self.verdict {
                ReportedVerdict::Refused { check, message } => {
                    Err(Refusal::Reported { check: *check, message: message.clone() })
                }
                ReportedVerdict::Admitted { .. } => return Err(ReportFault::OtherDesign(self.attempt)),
            },
        };
        let Self { name, design, attempt, round, .. } = self;
        Ok(JudgedLayout { name, design, attempt, round, verdict })
    }

    /// Returns the base scenarios of the layout's attempt. The design of a procedural attempt is computed again.
    fn base_scenarios(
        &self,
        brief: &DesignBrief,
        gate: &Gate,
        designer: ReportedDesigner,
        design: &Value,
    ) -> Result<Vec<Scenario>, ReportFault> {
        if designer == ReportedDesigner::Llm {
            return Ok(llm_designer::base_scenarios(brief, self.attempt).collect());
        }
        let language = gate.language();
        let attempted = ProceduralDesigner::repeat_attempt(brief, language, self.attempt);
        let attempted = attempted.ok_or(ReportFault::OtherDesign(self.attempt))?;
        let is_same = attempted.design == *design
            || language.parse(&attempted.design, brief).is_ok_and(|parsed| parsed == *design);
        if is_same { Ok(vec![attempted.base]) } else { Err(ReportFault::OtherDesign(self.attempt)) }
    }

    /// Checks an admission without the planner.
    fn confirm(
        &self,
        brief: &DesignBrief,
        gate: &mut Gate,
        design: &Value,
        bases: &[Scenario],
    ) -> Result<Result<AdmittedLayout, Refusal>, ReportFault> {
        let ReportedVerdict::Admitted { seed, bracket } = &self.verdict else {
            return Err(ReportFault::OtherVerdict);
        };
        let base = bases.iter().find(|base| base.seed() == *seed);
        let base = base.ok_or(ReportFault::OtherBase(self.attempt))?;
        let admitted = gate.confirm(brief, design, base, (**bracket).clone());
        admitted.map(Ok).map_err(ReportFault::NotAdmitted)
    }

    /// Judges the layout again, and compares the verdicts.
    fn judge_again(
        &self,
        brief: &DesignBrief,
        gate: &mut Gate,
        design: &Value,
        bases: Vec<Scenario>,
    ) -> Result<Result<AdmittedLayout, Refusal>, ReportFault> {
        let verdict = gate.judge(brief, design, bases);
        let is_same = match (&verdict, &self.verdict) {
            (Ok(admitted), ReportedVerdict::Admitted { seed, bracket }) => {
                admitted.scenario().seed() == *seed && *admitted.bracket() == **bracket
            }
            (Err(refusal), ReportedVerdict::Refused { check, message }) => {
                refusal.check() == *check && refusal.to_string() == *message
            }
            _ => false,
        };
        if is_same { Ok(verdict) } else { Err(ReportFault::OtherVerdict) }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use env_core::Recipe;

    use super::*;
    use crate::{DesignOutcome, design_language};

    /// A brief with layouts that the procedural designer makes of it.
    struct Designed {
        brief: DesignBrief,
        outcome: DesignOutcome,
    }

    /// A gate that knows the design of the first attempt, and refuses it.
    fn gate(brief: &DesignBrief) -> Gate {
        let language = design_language(brief.recipe.task()).unwrap();
        Gate::new(language, ProceduralDesigner::preview(brief, language, 1))
    }

    fn designed() -> Designed {
        let task = env_core::task("kessler/survival").unwrap();
        let recipe = Arc::new(Recipe::at_level(task, 2).unwrap());
        let brief = DesignBrief::new(recipe, 2, 7).at_level(task.levels(), 2);
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut gate(&brief));
        assert!(outcome.admitted() >= 2 && outcome.judged.len() > 2, "{} layouts", outcome.judged.len());
        Designed { brief, outcome }
    }

    fn check(
        brief: &DesignBrief,
        layout: &ReportedLayout,
        check: LayoutCheck,
    ) -> Result<JudgedLayout, ReportFault> {
        layout.clone().check(brief, &mut gate(brief), ReportedDesigner::Procedural, check)
    }

    #[test]
    fn checked_reports_have_the_verdicts_of_this_process() {
        let Designed { brief, outcome } = designed();
        for amount in [LayoutCheck::Confirm, LayoutCheck::Judge] {
            let mut gate = gate(&brief);
            for judged in &outcome.judged {
                let report = ReportedLayout::from(judged);
                let checked = report.check(&brief, &mut gate, ReportedDesigner::Procedural, amount).unwrap();
                assert_eq!((&checked.name, checked.attempt), (&judged.name, judged.attempt));
                match (&checked.verdict, &judged.verdict) {
                    (Ok(checked), Ok(judged)) => assert_eq!(checked, judged),
                    (Err(checked), Err(judged)) => {
                        assert_eq!(
                            (checked.check(), checked.to_string()),
                            (judged.check(), judged.to_string())
                        );
                    }
                    pair => panic!("{pair:?}"),
                }
            }
            assert_eq!(gate.archive().len(), 1 + outcome.admitted());
        }
    }

    #[test]
    fn forged_reports_are_found() {
        let Designed { brief, outcome } = designed();
        let first = |is_admitted| {
            let judged = outcome.judged.iter().find(|judged| judged.verdict.is_ok() == is_admitted).unwrap();
            ReportedLayout::from(judged)
        };
        let admitted = first(true);
        let ReportedVerdict::Admitted { seed, bracket } = admitted.verdict.clone() else {
            panic!("admitted")
        };
        let with = |seed, change: &dyn Fn(&mut Bracket)| {
            let mut bracket = bracket.clone();
            change(&mut bracket);
            ReportedLayout { verdict: ReportedVerdict::Admitted { seed, bracket }, ..admitted.clone() }
        };
        let confirmed = |layout: &ReportedLayout| check(&brief, layout, LayoutCheck::Confirm);
        assert!(confirmed(&admitted).is_ok());
        let wrong_base = with(Seed::user(5).unwrap(), &|_| {});
        assert_eq!(confirmed(&wrong_base), Err(ReportFault::OtherBase(admitted.attempt)));
        let raised = with(seed, &|bracket| bracket.reference.score += 0.01);
        assert!(matches!(confirmed(&raised), Err(ReportFault::NotAdmitted(_))));
        let without_panel = with(seed, &|bracket| bracket.panel.clear());
        assert!(matches!(confirmed(&without_panel), Err(ReportFault::NotAdmitted(_))));
        let other = ReportedLayout { attempt: admitted.attempt + 1, ..admitted.clone() };
        assert_eq!(confirmed(&other), Err(ReportFault::OtherDesign(other.attempt)));
        // Only a second judgement finds a wrong panel, or a refusal without a reason.
        let panel = with(seed, &|bracket| bracket.panel[1].score -= 1e-9);
        assert!(confirmed(&panel).is_ok());
        assert_eq!(check(&brief, &panel, LayoutCheck::Judge), Err(ReportFault::OtherVerdict));
        let verdict = ReportedVerdict::Refused { check: GateCheck::New, message: "no".to_owned() };
        let refused = ReportedLayout { verdict, ..admitted.clone() };
        assert!(confirmed(&refused).is_ok_and(|judged| judged.verdict.is_err()));
        assert_eq!(check(&brief, &refused, LayoutCheck::Judge), Err(ReportFault::OtherVerdict));
        let ReportedLayout { attempt, design, .. } = first(false);
        let claimed = ReportedLayout { attempt, design, ..admitted };
        assert!(confirmed(&claimed).is_err(), "a refused layout is not admitted");
    }
}
