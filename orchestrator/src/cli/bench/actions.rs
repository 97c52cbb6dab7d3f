//! Actions drawn beforehand, so that drawing is not measured.

use env_core::JointAction;
use env_core::chance::{Chance, Seeded, Stream};

use super::seed;

/// Joint actions drawn beforehand, flown in turn: prime, so that no episode flies what another did.
const COUNT: usize = 997;

/// Small actions by about half of the agents in every step.
pub(super) struct Actions {
    agents: Vec<Vec<u32>>,
    values: Vec<Vec<f64>>,
    next: usize,
}

impl Actions {
    /// For so many agents, with so many values each, uniform within plus and minus `size`.
    pub(super) fn draw(agents: u32, columns: usize, size: f64) -> Self {
        let mut chance = Seeded::new(seed(u64::from(u32::MAX)));
        let mut drawn = Self { agents: Vec::new(), values: Vec::new(), next: 0 };
        for _ in 0..COUNT {
            let acting: Vec<u32> = (0..agents).filter(|_| chance.uniform(Stream::Policy) < 0.5).collect();
            let value = |_| chance.between(Stream::Policy, -size, size);
            drawn.values.push((0..acting.len() * columns).map(value).collect());
            drawn.agents.push(acting);
        }
        drawn
    }

    /// The next joint action.
    pub(super) fn next(&mut self) -> JointAction<'_> {
        let at = self.next;
        self.next = (at + 1) % COUNT;
        JointAction { agents: &self.agents[at], values: &self.values[at] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn about_half_of_the_agents_act_in_every_step() {
        let mut actions = Actions::draw(3, 2, 0.05);
        let (mut acting, mut values) = (0, 0);
        for _ in 0..COUNT {
            let action = actions.next();
            assert!(action.values.iter().all(|v| v.abs() <= 0.05));
            acting += action.agents.len();
            values += action.values.len();
        }
        // 3 · 997 coins: 1 495.5 ± 27 (one standard deviation).
        assert!((1350..1650).contains(&acting), "{acting}");
        assert_eq!(values, 2 * acting);
        let first = actions.next().values.to_vec();
        assert_eq!(first, Actions::draw(3, 2, 0.05).next().values, "in turn, and the same every time");
    }
}
