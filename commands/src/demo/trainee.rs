//! Population that is trained on one task, with the scores of its members in the current generation.

use clap::ValueEnum;
use env_core::Scenario;
use env_core::policy::{Policy, PolicyError};
use serde::Serialize;

use super::learner::CrossEntropy;

/// Scenarios that a population runs before it is replaced.
const SCENARIOS_PER_GENERATION: usize = 12;

/// Kind of learner or control that runs the episodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum LearnerMode {
    /// Learns from the reported scores
    Learn,
    /// Holds: takes no action at all
    Hold,
    /// Follows one fixed plan and ignores all observations
    Blind,
    /// Acts by the learner's reflex with random parameters that are never updated
    Frozen,
}

/// Policy of one member of a population.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Member {
    /// The task's reflex at these numbers.
    Reflex(Vec<f64>),
    /// A built-in policy by its name.
    Named(&'static str),
}

impl Member {
    /// Builds the policy for one episode.
    ///
    /// # Errors
    /// Returns [`PolicyError`] if the task does not have the named policy.
    pub(super) fn policy(&self, scenario: &Scenario) -> Result<Box<dyn Policy>, PolicyError> {
        match self {
            Self::Reflex(numbers) => Ok((scenario.task().reflex().policy)(numbers)),
            Self::Named(name) => scenario.task().policy(name, scenario, 0),
        }
    }
}

/// Result of one episode, as reported by the server.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MemberOutcome {
    pub(super) score: f64,
    pub(super) skill: Option<f64>,
    pub(super) success: bool,
}

/// Share of successes of a generation on its contested scenarios.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct GenerationSuccess {
    /// Share of the whole population, which is what the ladder judges.
    pub(super) population: f64,
    /// Share of the elite. It is biased upwards, since the elite is selected on the same scenarios.
    pub(super) elite: f64,
}

/// Score of a member in the current generation.
#[derive(Debug, Clone, Copy, Default)]
struct MemberScore {
    /// Sum over scenarios of the member's result minus the mean of its siblings.
    fitness: f64,
    /// Contested scenarios in which the member succeeded.
    successes: u32,
}

/// Population of one task and its optimiser.
#[derive(Debug, Clone)]
pub(super) struct Trainee {
    members: Vec<Member>,
    /// Optimiser of the population; `None` for controls.
    method: Option<CrossEntropy>,
    scores: Vec<MemberScore>,
    scenarios: usize,
    contested: u32,
    last_success: Option<GenerationSuccess>,
}

impl Trainee {
    /// Creates a population of `size` members. The task's reflex has `numbers` parameters; `seed` seeds the optimiser.
    pub(super) fn new(kind: LearnerMode, size: usize, numbers: usize, seed: u64) -> Self {
        let mut method = CrossEntropy::new(numbers, seed);
        let members = match kind {
            LearnerMode::Learn => reflexes(method.sample(size)),
            // One draw from the learner's initial distribution, shared by all siblings.
            LearnerMode::Frozen => reflexes(method.sample(1).into_iter().cycle().take(size).collect()),
            LearnerMode::Hold => vec![Member::Named("hold"); size],
            LearnerMode::Blind => vec![Member::Named("blind"); size],
        };
        let scores = vec![MemberScore::default(); members.len()];
        let method = (kind == LearnerMode::Learn).then_some(method);
        Self { members, method, scores, scenarios: 0, contested: 0, last_success: None }
    }

    /// Returns the members of the current population, in sibling order.
    pub(super) fn members(&self) -> &[Member] {
        &self.members
    }

    /// Returns the number of generations that the optimiser has learnt from.
    pub(super) fn generation(&self) -> u32 {
        self.method.as_ref().map_or(0, CrossEntropy::generation)
    }

    /// Returns the share of successes of the last full generation.
    pub(super) const fn last_success(&self) -> Option<GenerationSuccess> {
        self.last_success
    }

    /// Returns the reflex parameters at the centre of the population, or `None` if no member is a reflex.
    pub(super) fn numbers(&self) -> Option<&[f64]> {
        match (&self.method, self.members.first()) {
            (Some(method), _) => Some(method.mean()),
            (None, Some(Member::Reflex(numbers))) => Some(numbers),
            _ => None,
        }
    }

    /// Records the outcomes of one scenario, one per member in order. Fitness is relative to the siblings' mean, because
    /// scenarios differ far more than members do. It is measured in skill if the scenario defines it, else in score.
    pub(super) fn record(&mut self, outcomes: &[MemberOutcome], contested: bool) {
        if outcomes.len() != self.members.len() {
            return; // a sibling was lost, so a fair comparison is impossible
        }
        let worth = |outcome: &MemberOutcome| outcome.skill.unwrap_or(outcome.score);
        let mean = outcomes.iter().map(worth).sum::<f64>() / outcomes.len() as f64;
        for (scores, outcome) in self.scores.iter_mut().zip(outcomes) {
            scores.fitness += worth(outcome) - mean;
            scores.successes += u32::from(contested && outcome.success);
        }
        self.scenarios += 1;
        self.contested += u32::from(contested);
    }

    /// Replaces the population once it has run enough scenarios. Returns true if the optimiser produced a new one.
    pub(super) fn learn(&mut self) -> bool {
        if self.scenarios < SCENARIOS_PER_GENERATION {
            return false;
        }
        let scores = std::mem::replace(&mut self.scores, vec![MemberScore::default(); self.members.len()]);
        let all: Vec<usize> = (0..scores.len()).collect();
        let elite = match &mut self.method {
            Some(method) => {
                let population: Vec<Vec<f64>> = self.members.iter().filter_map(reflex).collect();
                let fitness: Vec<f64> = scores.iter().map(|e| e.fitness).collect();
                let elite = method.update(&population, &fitness);
                self.members = reflexes(method.sample(population.len()));
                elite
            }
            None => all.clone(),
        };
        if self.contested > 0 {
            let share = |members: &[usize]| {
                let successes: u32 = members.iter().map(|&member| scores[member].successes).sum();
                f64::from(successes) / f64::from(self.contested) / members.len() as f64
            };
            self.last_success = Some(GenerationSuccess { population: share(&all), elite: share(&elite) });
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

    fn outcome(score: f64) -> MemberOutcome {
        MemberOutcome { score, skill: None, success: score > 0.5 }
    }

    #[test]
    fn generation_ends_after_its_scenarios_and_reports_the_elite() {
        let mut trainee = Trainee::new(LearnerMode::Learn, 6, 12, 1);
        let before = trainee.members().to_vec();
        let outcomes: Vec<MemberOutcome> = (0..6).map(|i| outcome(f64::from(i) / 5.0)).collect();
        for _ in 0..SCENARIOS_PER_GENERATION {
            assert!(!trainee.learn());
            trainee.record(&outcomes, true);
        }
        assert!(trainee.learn());
        assert_ne!(trainee.members(), before);
        assert_eq!(trainee.generation(), 1);
        assert_eq!(trainee.last_success(), Some(GenerationSuccess { population: 0.5, elite: 1.0 }));
    }

    #[test]
    fn controls_never_change() {
        for kind in [LearnerMode::Hold, LearnerMode::Blind, LearnerMode::Frozen] {
            let mut trainee = Trainee::new(kind, 4, 12, 3);
            let before = trainee.members().to_vec();
            assert!(before.windows(2).all(|pair| pair[0] == pair[1]), "{kind:?}");
            for _ in 0..3 * SCENARIOS_PER_GENERATION {
                trainee.record(&[outcome(0.1), outcome(0.2), outcome(0.3), outcome(0.4)], true);
                assert!(!trainee.learn());
            }
            assert_eq!(trainee.members(), before);
            assert_eq!(trainee.last_success(), Some(GenerationSuccess { population: 0.0, elite: 0.0 }));
        }
    }

    #[test]
    fn frozen_equals_a_member_of_the_first_population() {
        let learner = Trainee::new(LearnerMode::Learn, 4, 6, 9);
        assert_eq!(Trainee::new(LearnerMode::Frozen, 4, 6, 9).members()[0], learner.members()[0]);
    }

    #[test]
    fn incomplete_group_is_not_learnt_from() {
        let mut trainee = Trainee::new(LearnerMode::Learn, 4, 12, 1);
        for _ in 0..2 * SCENARIOS_PER_GENERATION {
            trainee.record(&[outcome(1.0)], true);
        }
        assert!(!trainee.learn());
    }
}
