//! The gate: what a layout must pass before an agent sees it. A refusal is a sentence that goes back to the designer.

use std::collections::BTreeSet;
use std::time::Duration;

use env_core::bracket::{Bracket, MIN_GAP, admit, panel_success};
use env_core::{Scenario, ScenarioError, ScenarioId};
use serde_json::Value;

use crate::Fault;
use crate::brief::Brief;
use crate::language::{Claim, Language};

/// The checks, in order, as they are counted: word and meaning.
pub const CHECKS: [(&str, &str); 8] = [
    ("schema", "its fields and numbers are within bounds"),
    ("compiles", "bodies can be put where its encounters say"),
    ("aim", "its encounters are what its aim says"),
    ("fair", "nothing touches before anybody could act"),
    ("solvable", "the reference planner succeeds within fuel"),
    ("contested", "a threat: who holds loses, and most who act blindly fail"),
    ("decoy", "a decoy: who holds succeeds, and a naive agent wastes fuel"),
    ("new", "it is not one that is known already"),
];

/// How far from everything in the archive a design must be. Bearings of 15°, 4 steps and 1 LU/TU off in all encounters
/// are a distance of 0.05.
pub const MIN_NOVELTY: f64 = 0.05;

/// Why a layout is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A field is missing, wrong or out of bounds.
    #[error("{0}")]
    Schema(Fault),
    /// An encounter cannot be built.
    #[error("{0}")]
    Compiles(Fault),
    /// The encounters are not what the aim says.
    #[error("{0}")]
    Aim(Fault),
    /// Something is lost before anybody could act.
    #[error("{0}")]
    Unfair(ScenarioError),
    /// Somebody is hit by what could not be dodged by who sees only what the agents see.
    #[error("{0}")]
    Unseen(Fault),
    /// The reference planner does not succeed.
    #[error(
        "the planner finds no way to succeed: its best scores {reference:.3} and loses {lost}; ask for fewer threats, \
         later ones or more fuel"
    )]
    Unsolvable {
        /// Its best score.
        reference: f64,
        /// Agents it loses.
        lost: u32,
    },
    /// A layout of threats in which who does nothing loses nobody.
    #[error("doing nothing loses nobody: a threat is wanted that hits")]
    Harmless,
    /// Acting well hardly matters.
    #[error(
        "acting blindly does nearly as well: {blind} of {panel} blind plans succeed (at most {most} may), and the \
         reference is {gap:.3} above the floor (at least {MIN_GAP} is wanted); ask for more threats, of more satellites"
    )]
    Uncontested {
        /// Blind plans that succeed.
        blind: usize,
        /// Blind plans that may.
        most: usize,
        /// Blind plans there are.
        panel: usize,
        /// reference − floor.
        gap: f64,
    },
    /// A decoy that is none.
    #[error("{0}")]
    Decoy(Fault),
    /// One like it is known.
    #[error(
        "it is too much like {like:?}, which is known already: {distance:.3} apart, {MIN_NOVELTY} is wanted; change bearings, \
         steps or satellites"
    )]
    Known {
        /// The name of the one that is known.
        like: String,
        /// How far it is.
        distance: f64,
    },
    /// The very scenario is known.
    #[error("this very scenario is known already; change a body or the seed")]
    Again,
}

impl Refusal {
    /// Which of [`CHECKS`] it failed, counted from 0.
    #[must_use]
    pub const fn rank(&self) -> usize {
        match self {
            Self::Schema(_) => 0,
            Self::Compiles(_) => 1,
            Self::Aim(_) => 2,
            Self::Unfair(_) | Self::Unseen(_) => 3,
            Self::Unsolvable { .. } => 4,
            Self::Harmless | Self::Uncontested { .. } => 5,
            Self::Decoy(_) => 6,
            Self::Known { .. } | Self::Again => 7,
        }
    }

    /// The word of the check it failed.
    #[must_use]
    pub const fn check(&self) -> &'static str {
        CHECKS[self.rank()].0
    }
}

/// A layout that passed. Only the gate makes one.
#[derive(Debug, Clone, PartialEq)]
pub struct Admitted {
    scenario: Scenario,
    bracket: Bracket,
    claim: Claim,
    novelty: Option<f64>,
}

impl Admitted {
    /// The scenario it makes.
    #[must_use]
    pub const fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Panel, floor, reference and witness.
    #[must_use]
    pub const fn bracket(&self) -> &Bracket {
        &self.bracket
    }

    /// What it claims to be, and is.
    #[must_use]
    pub const fn claim(&self) -> Claim {
        self.claim
    }

    /// How far the nearest design of the archive is; none where there was none to compare with.
    #[must_use]
    pub const fn novelty(&self) -> Option<f64> {
        self.novelty
    }
}

/// The gate of one task's world, with the designs it knows.
pub struct Gate {
    language: &'static dyn Language,
    archive: Vec<Value>,
    /// Scenarios without a design that passed.
    by_hand: BTreeSet<ScenarioId>,
}

impl Gate {
    /// A gate that knows these designs.
    #[must_use]
    pub const fn new(language: &'static dyn Language, archive: Vec<Value>) -> Self {
        Self { language, archive, by_hand: BTreeSet::new() }
    }

    /// The language it reads.
    #[must_use]
    pub const fn language(&self) -> &'static dyn Language {
        self.language
    }

    /// Passes a design through, under the first of these skies that takes it: what cannot be under one may be under the
    /// next. What passes is known from then on.
    ///
    /// # Errors
    /// The refusal that came furthest.
    pub fn judge(
        &mut self,
        brief: &Brief,
        design: &Value,
        skies: impl IntoIterator<Item = Scenario>,
    ) -> Result<Admitted, Refusal> {
        let design = self.language.read(design, brief).map_err(Refusal::Schema)?;
        let mut furthest: Option<Refusal> = None;
        for sky in skies {
            match self.under(&design, &sky) {
                Ok(admitted) => {
                    self.archive.push(design);
                    return Ok(admitted);
                }
                // Whether it is new does not depend on the sky.
                Err(known @ Refusal::Known { .. }) => return Err(known),
                Err(refusal) => {
                    if furthest.as_ref().is_none_or(|held| held.rank() <= refusal.rank()) {
                        furthest = Some(refusal);
                    }
                }
            }
        }
        Err(furthest.unwrap_or(Refusal::Harmless)) // without a sky nothing happens
    }

    /// Passes a scenario through that somebody else has made. Where its layout says by which design, that must be so.
    ///
    /// # Errors
    /// The first refusal.
    pub fn judge_scenario(&mut self, scenario: &Scenario) -> Result<Admitted, Refusal> {
        let thought = scenario.recipe().layout().and_then(|layout| layout.provenance.clone());
        let Some(design) = thought.filter(|design| design.get("encounters").is_some()) else {
            let bracket = self.hits(scenario)?;
            if self.by_hand.contains(&scenario.id()) {
                return Err(Refusal::Again);
            }
            self.by_hand.insert(scenario.id());
            return Ok(Admitted { scenario: scenario.clone(), bracket, claim: Claim::Threat, novelty: None });
        };
        // What its brief allowed is not known here (rogues of a level to come, say), and need not be: building reads the
        // design, and whatever it says of params must come to this very scenario.
        let admitted = self.under(&design, scenario)?;
        if admitted.scenario.id() != scenario.id() {
            let words =
                "the bodies are not what the encounters of its provenance come to; leave the provenance out";
            return Err(Refusal::Compiles(Fault::new("layout.provenance", words)));
        }
        self.archive.push(design);
        Ok(admitted)
    }

    fn under(&self, design: &Value, sky: &Scenario) -> Result<Admitted, Refusal> {
        let (scenario, claim) = self.language.build(design, sky)?;
        let bracket = match claim {
            Claim::Threat => self.hits(&scenario)?,
            Claim::Decoy => {
                let bracket = solved(&scenario)?.bracket;
                self.language.decoy(&scenario, &bracket).map_err(Refusal::Decoy)?;
                bracket
            }
        };
        Ok(Admitted { scenario, bracket, claim, novelty: self.new_enough(design)? })
    }

    /// Passes a threat of this world: what [`threat`] asks, that it hits, and that what hits can be seen.
    fn hits(&self, scenario: &Scenario) -> Result<Bracket, Refusal> {
        let bracket = threat(scenario)?;
        if bracket.panel.first().is_none_or(|hold| hold.lost == 0) {
            return Err(Refusal::Harmless);
        }
        // Last, as too little fuel for any dodge is said better by who looks for a plan.
        self.language.seen(scenario).map_err(Refusal::Unseen)?;
        Ok(bracket)
    }

    fn new_enough(&self, design: &Value) -> Result<Option<f64>, Refusal> {
        let distances = self.archive.iter().map(|known| (self.language.distance(design, known), known));
        match distances.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((distance, known)) if distance < MIN_NOVELTY => {
                let like = known.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
                Err(Refusal::Known { like, distance })
            }
            nearest => Ok(nearest.map(|(distance, _)| distance)),
        }
    }
}

/// A scenario that the reference solves.
struct Solved {
    bracket: Bracket,
    contested: bool,
}

fn solved(scenario: &Scenario) -> Result<Solved, Refusal> {
    let admission = admit(scenario);
    let bracket = match (admission.fair, admission.bracket) {
        (Ok(()), Some(bracket)) => bracket,
        (Err(error), _) => return Err(Refusal::Unfair(error)),
        (Ok(()), None) => return Err(Refusal::Unsolvable { reference: 0.0, lost: 0 }),
    };
    if !admission.solvable {
        return Err(Refusal::Unsolvable { reference: bracket.reference.score, lost: bracket.reference.lost });
    }
    Ok(Solved { bracket, contested: admission.contested })
}

/// Passes a scenario of any world as a threat: fair, solvable, contested. The bracket holds the witness.
///
/// # Errors
/// The first refusal, in that order.
pub fn threat(scenario: &Scenario) -> Result<Bracket, Refusal> {
    let Solved { bracket, contested } = solved(scenario)?;
    if contested {
        return Ok(bracket);
    }
    Err(Refusal::Uncontested {
        blind: panel_success(scenario, &bracket),
        most: bracket.most_blind_successes(),
        panel: bracket.panel.len(),
        gap: bracket.reference.score - bracket.floor,
    })
}

/// A layout that a designer thought of, and what the gate said.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// Its name, for people.
    pub name: String,
    /// The design as it was given; none for a scenario without one.
    pub design: Option<Value>,
    /// In which round it was given: 1, and one more for every repair.
    pub round: u32,
    /// What the gate said.
    pub verdict: Result<Admitted, Refusal>,
}

/// What designing took.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Usage {
    /// The model, where one was asked.
    pub model: Option<String>,
    /// The version of its prompt.
    pub prompt: Option<String>,
    /// Rounds.
    pub rounds: u32,
    /// Tokens in.
    pub tokens_in: u64,
    /// Tokens out.
    pub tokens_out: u64,
    /// What they cost, in the currency that prices are configured in.
    pub cost: f64,
    /// How long it took.
    pub latency: Duration,
}
