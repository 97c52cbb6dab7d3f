//! Kessler's language as every designer uses it.

use env_core::bracket::Bracket;
use env_core::critique::ModeSpec;
use env_core::{Draws, Scenario};
use serde_json::Value;

use super::claim::{self, AIMS};
use super::compile::compile;
use super::language::Design;
use super::{edit, listing, novelty, picture, sample, schema};
use crate::Fault;
use crate::brief::Brief;
use crate::gate::Refusal;
use crate::language::{Claim, Language, Listing};
use crate::picture::Subject;

/// The language of kessler's layouts.
#[derive(Debug, Clone, Copy)]
pub struct Kessler;

impl Language for Kessler {
    fn rules(&self, brief: &Brief) -> String {
        schema::rules(brief)
    }

    fn schema(&self, brief: &Brief) -> Value {
        schema::schema(brief)
    }

    fn read(&self, design: &Value, brief: &Brief) -> Result<Value, Fault> {
        read(design, brief).map(|design| design.to_json())
    }

    fn build(&self, design: &Value, sky: &Scenario) -> Result<(Scenario, Claim), Refusal> {
        let design = Design::from_json(design).map_err(Refusal::Schema)?;
        let compiled = compile(&design, sky).map_err(Refusal::Compiles)?;
        claim::aim(&design, &compiled.placed).map_err(|broken| Refusal::Aim(broken.into()))?;
        let claim = if claim::threatens(&design) { Claim::Threat } else { Claim::Decoy };
        Ok((compiled.scenario, claim))
    }

    fn seen(&self, scenario: &Scenario) -> Result<(), Fault> {
        claim::seen(scenario)
    }

    fn decoy(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), Fault> {
        match claim::decoy(scenario, bracket) {
            Ok(honest) => Ok(honest?),
            Err(error) => Err(Fault::new(error.field().to_owned(), error.to_string())),
        }
    }

    fn distance(&self, a: &Value, b: &Value) -> f64 {
        match (Design::from_json(a), Design::from_json(b)) {
            (Ok(a), Ok(b)) => novelty::distance(&a, &b),
            _ => 1.0, // what cannot be read is like nothing
        }
    }

    fn sample(&self, brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<Value> {
        sample::sample(brief, sky, draws).map(|design| design.to_json())
    }

    fn edit(&self, design: &Value, brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<Value> {
        let design = read(design, brief).ok()?;
        edit::edit(&design, brief, sky, draws).map(|design| design.to_json())
    }

    fn listing(&self, design: &Value) -> Option<Listing> {
        Design::from_json(design).ok().map(|design| listing::listing(&design))
    }

    fn picture(&self, subject: Subject<'_>) -> String {
        picture::picture(subject)
    }
}

/// Aims that a layout of the brief's task can have.
pub(super) fn aims(
    brief: &Brief,
) -> impl Iterator<Item = &'static (&'static str, super::Kind, Option<bool>, &'static str)> {
    let modes: &'static [ModeSpec] = brief.base.task().failure_modes();
    let rogues = rogues(brief);
    AIMS.iter()
        .filter(move |aim| modes.iter().any(|mode| mode.name == aim.0) && (rogues || aim.2 != Some(true)))
}

/// Whether rogues may come at all.
pub(super) fn rogues(brief: &Brief) -> bool {
    brief.most("rogue_probability") > 0.0
}

fn read(design: &Value, brief: &Brief) -> Result<Design, Fault> {
    let design = Design::from_json(design)?;
    if !aims(brief).any(|aim| aim.0 == design.aim.mode) {
        let known = aims(brief).map(|aim| aim.0).collect::<Vec<_>>().join(", ");
        let mode = crate::shorten(&design.aim.mode);
        return Err(Fault::new(
            "aim.mode",
            format!("nothing can be laid out for {mode:?} here; one of {known} is wanted"),
        ));
    }
    for (name, value) in &design.params {
        let field = || format!("params.{name}");
        if brief.base.param(name).is_some_and(|held| held.to_bits() == value.to_bits()) {
            continue;
        }
        let Some(limit) = brief.limits.iter().find(|limit| limit.param == *name) else {
            let known = brief.limits.iter().map(|limit| limit.param.as_str()).collect::<Vec<_>>().join(", ");
            let words = if known.is_empty() {
                "no param may be chosen here".to_owned()
            } else {
                format!("it may not be chosen; {known} may")
            };
            return Err(Fault::new(field(), words));
        };
        if !limit.values.contains(value) {
            let values = limit.values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
            return Err(Fault::new(field(), format!("it is {value}; one of {values} is wanted")));
        }
    }
    if let Some(at) = design.encounters.iter().position(|e| e.rogue).filter(|_| !rogues(brief)) {
        return Err(Fault::new(
            format!("encounters.{at}.rogue"),
            "no rogues come at this level; false is wanted",
        ));
    }
    Ok(design)
}
