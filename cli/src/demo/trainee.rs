//! What is trained on one task: a population, and what its members have earned so far.

use clap::ValueEnum;
use env_core::Scenario;
use env_core::policy::{Policy, PolicyError};
use serde::Serialize;

use super::learner::CrossEntropy;

/// Scenarios after which a population is replaced.
const GENERATION: usize = 12;

/// Who flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Kind {
    /// Learns from the scores that come back
    Learn,
    /// Does nothing
    Hold,
    /// Acts by one fixed plan that looks at nothing
    Blind,
    /// The learner's reflex at random numbers, never updated
    Frozen,
}

/// One member's policy.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Member {
    /// The task's reflex at these numbers.
    Reflex(Vec<f64>),
    /// A built-in policy by its name.
    Named(&'static str),
}

impl Member {
    /// A pilot for one episode.
    pub(super) fn pilot(&self, scenario: &Scenario) -> Result<Box<dyn Policy>, PolicyError> {
        match self {
            Self::Reflex(numbers) => Ok((scenario.task().reflex().policy)(numbers)),
            Self::Named(name) => scenario.task().policy(name, scenario, 0),
        }
    }
}

/// How one episode went, as the server says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Outcome {
    pub(super) score: f64,
    pub(super) skill: Option<f64>,
    pub(super) success: bool,
}

/// How a generation fared, on its contested scenarios: shares of success.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Fared {
    /// Of the whole population: what the ladder judges.
    pub(super) population: f64,
    /// Of its elite, chosen on the same scenarios and so a little flattered.
    pub(super) elite: f64,
}

/// What a member has earned in this generation.
#[derive(Debug, Clone, Copy, Default)]
struct Earned {
    /// Sum over scenarios of what it earned above its siblings.
    fitness: f64,
    /// Contested scenarios in which it succeeded.
    successes: u32,
}

/// One task's population.
#[derive(Debug, Clone)]
pub(super) struct Trainee {
    members: Vec<Member>,
    /// None for controls.
    method: Option<CrossEntropy>,
    earned: Vec<Earned>,
    scenarios: usize,
    contested: u32,
    fared: Option<Fared>,
}

impl Trainee {
    /// A population of `size` of a reflex with so many numbers; `seed` is its own.
    pub(super) fn new(kind: Kind, size: usize, numbers: usize, seed: u64) -> Self {
        let mut method = CrossEntropy::new(numbers, seed);
        let members = match kind {
            Kind::Learn => reflexes(method.ask(size)),
            // One draw from what the learner starts from, flown by every sibling.
            Kind::Frozen => reflexes(method.ask(1).into_iter().cycle().take(size).collect()),
            Kind::Hold => vec![Member::Named("hold"); size],
            Kind::Blind => vec![Member::Named("blind"); size],
        };
        let earned = vec![Earned::default(); members.len()];
        let method = (kind == Kind::Learn).then_some(method);
        Self { members, method, earned, scenarios: 0, contested: 0, fared: None }
    }

    /// Who flies now, sibling by sibling.
    pub(super) fn members(&self) -> &[Member] {
        &self.members
    }

    /// Generations learnt from.
    pub(super) fn generation(&self) -> u32 {
        self.method.as_ref().map_or(0, CrossEntropy::generation)
    }

    /// How the last full generation fared.
    pub(super) const fn fared(&self) -> Option<Fared> {
        self.fared
    }

    /// The numbers of the reflex at the centre of the population; none where nobody flies a reflex.
    pub(super) fn numbers(&self) -> Option<&[f64]> {
        match (&self.method, self.members.first()) {
            (Some(method), _) => Some(method.mean()),
            (None, Some(Member::Reflex(numbers))) => Some(numbers),
            _ => None,
        }
    }

    /// Takes one scenario's outcomes, one per member in order. What a member earned counts against its siblings', since
    /// scenarios differ far more than members do: in skill, where the scenario defines it, else in score.
    pub(super) fn take(&mut self, outcomes: &[Outcome], contested: bool) {
        if outcomes.len() != self.members.len() {
            return; // some sibling was lost: there is nothing fair to compare
        }
        let worth = |outcome: &Outcome| outcome.skill.unwrap_or(outcome.score);
        let mean = outcomes.iter().map(worth).sum::<f64>() / outcomes.len() as f64;
        for (earned, outcome) in self.earned.iter_mut().zip(outcomes) {
            earned.fitness += worth(outcome) - mean;
            earned.successes += u32::from(contested && outcome.success);
        }
        self.scenarios += 1;
        self.contested += u32::from(contested);
    }

    /// Replaces the population once it has met enough scenarios. True if it did.
    pub(super) fn learn(&mut self) -> bool {
        if self.scenarios < GENERATION {
            return false;
        }
        let earned = std::mem::replace(&mut self.earned, vec![Earned::default(); self.members.len()]);
        let all: Vec<usize> = (0..earned.len()).collect();
        let elite = match &mut self.method {
            Some(method) => {
                let asked: Vec<Vec<f64>> = self.members.iter().filter_map(reflex).collect();
                let fitness: Vec<f64> = earned.iter().map(|e| e.fitness).collect();
                let elite = method.tell(&asked, &fitness);
                self.members = reflexes(method.ask(asked.len()));
                elite
            }
            None => all.clone(),
        };
        if self.contested > 0 {
            let share = |places: &[usize]| {
                let successes: u32 = places.iter().map(|&place| earned[place].successes).sum();
                f64::from(successes) / f64::from(self.contested) / places.len() as f64
            };
            self.fared = Some(Fared { population: share(&all), elite: share(&elite) });
        }
        (self.scenarios, self.contested) = (0, 0);
        self.method.is_some()
    }
}

fn reflexes(population: Vec<Vec<f64>>) -> Vec<Member> {
    population.into_iter().map(Member::Reflex).collect()
}

fn reflex(member: &Member) -> Option<Vec<f64>> {
    match member {
        Member::Reflex(numbers) => Some(numbers.clone()),
        Member::Named(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(score: f64) -> Outcome {
        Outcome { score, skill: None, success: score > 0.5 }
    }

    #[test]
    fn a_generation_ends_after_its_scenarios_and_the_elite_is_told_apart() {
        let mut trainee = Trainee::new(Kind::Learn, 6, 12, 1);
        let before = trainee.members().to_vec();
        let outcomes: Vec<Outcome> = (0..6).map(|i| outcome(f64::from(i) / 5.0)).collect();
        for _ in 0..GENERATION {
            assert!(!trainee.learn());
            trainee.take(&outcomes, true);
        }
        assert!(trainee.learn());
        assert_ne!(trainee.members(), before);
        assert_eq!(trainee.generation(), 1);
        assert_eq!(trainee.fared(), Some(Fared { population: 0.5, elite: 1.0 }));
    }

    #[test]
    fn controls_stay_what_they_are() {
        for kind in [Kind::Hold, Kind::Blind, Kind::Frozen] {
            let mut trainee = Trainee::new(kind, 4, 12, 3);
            let before = trainee.members().to_vec();
            assert!(before.windows(2).all(|pair| pair[0] == pair[1]), "{kind:?}");
            for _ in 0..3 * GENERATION {
                trainee.take(&[outcome(0.1), outcome(0.2), outcome(0.3), outcome(0.4)], true);
                assert!(!trainee.learn());
            }
            assert_eq!(trainee.members(), before);
            assert_eq!(trainee.fared(), Some(Fared { population: 0.0, elite: 0.0 }));
        }
    }

    #[test]
    fn frozen_is_a_member_of_the_learners_first_population() {
        let learner = Trainee::new(Kind::Learn, 4, 6, 9);
        assert_eq!(Trainee::new(Kind::Frozen, 4, 6, 9).members()[0], learner.members()[0]);
    }

    #[test]
    fn a_group_that_lost_siblings_is_not_learnt_from() {
        let mut trainee = Trainee::new(Kind::Learn, 4, 12, 1);
        for _ in 0..2 * GENERATION {
            trainee.take(&[outcome(1.0)], true);
        }
        assert!(!trainee.learn());
    }
}
