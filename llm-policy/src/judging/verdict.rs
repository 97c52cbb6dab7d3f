//! The verdict on one step, and its effect on what a client receives.

/// Share of the reward that a verdict moves, either way: reward/1.2·(1 + 0.2·score), as in the public kessler-env.
const REWARD_WEIGHT: f64 = 0.2;
/// Maximum length of the reasoning in an alert, in characters.
const MAX_ALERT_CHARS: usize = 300;

/// Verdict on one step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepVerdict {
    /// Score from −1 to 1.
    pub score: f64,
    /// Reason for the score.
    pub reasoning: String,
}

impl StepVerdict {
    /// Returns the reward that a client receives for a step with this reward of the world.
    #[must_use]
    pub fn weighted_reward(&self, reward: f64) -> f64 {
        reward / (1.0 + REWARD_WEIGHT) * (1.0 + REWARD_WEIGHT * self.score)
    }

    /// Returns the alert that a client receives: one line with the shortened reasoning and the score.
    #[must_use]
    pub fn alert(&self) -> String {
        let reasoning: String = self.reasoning.split_whitespace().collect::<Vec<_>>().join(" ");
        let short: String = reasoning.chars().take(MAX_ALERT_CHARS).collect();
        let more = if short.len() < reasoning.len() { "…" } else { "" };
        format!("[JUDGE]: {short}{more} (Score: {:.2})", self.score)
    }
}
