//! [`EditDirection`]: whether an edit makes a layout easier or harder, and edits of params in a direction.

use std::collections::BTreeMap;

use env_core::KeyedRng;
use env_core::space::Harder;

use crate::brief::{DesignBrief, EASE_BELOW, HARDEN_ABOVE, ParamChoice};
use crate::mutation::pick_choice;

/// Direction in which edits change the difficulty of a layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EditDirection {
    /// The edited layout is easier than its parent.
    Easier,
    /// The edited layout is harder than its parent.
    Harder,
}

impl EditDirection {
    /// Returns the direction for siblings of a layout on which the agent has this success rate: easier below 0.3, harder above
    /// 0.7, `None` between, where edits may change the difficulty either way.
    #[must_use]
    pub fn of_success(success_rate: f64) -> Option<Self> {
        if success_rate < EASE_BELOW {
            Some(Self::Easier)
        } else if success_rate > HARDEN_ABOVE {
            Some(Self::Harder)
        } else {
            None
        }
    }

    /// Returns a change of a number whose larger values are harder: −`size` to ease, `size` to harden.
    pub(crate) fn change(self, size: u32) -> i64 {
        match self {
            Self::Easier => -i64::from(size),
            Self::Harder => i64::from(size),
        }
    }
}

/// Edit of a design `D` that makes its layout easier or harder. It changes nothing if it does not apply.
pub(crate) type DifficultyEdit<D> = fn(&mut D, &DesignBrief, EditDirection, &mut KeyedRng);

/// Edits a design to a sibling: one or two neutral edits, which keep it from being too similar to its parent, and one to three in a
/// direction. Each edit of a kind is as likely as the others; what a neutral edit returns is ignored.
pub(crate) fn apply_sibling_edits<D, R>(
    design: &mut D,
    brief: &DesignBrief,
    direction: EditDirection,
    rng: &mut KeyedRng,
    neutral_edits: &[fn(&mut D, &DesignBrief, &mut KeyedRng) -> R],
    edits: &[DifficultyEdit<D>],
) {
    for _ in 0..rng.range_inclusive(1, 2) {
        neutral_edits[rng.below(neutral_edits.len() as u32) as usize](design, brief, rng);
    }
    for _ in 0..rng.range_inclusive(1, 3) {
        edits[rng.below(edits.len() as u32) as usize](design, brief, direction, rng);
    }
}

/// Sets one of the params of a design to the next easier or harder one of its choices; nothing changes if there is none.
pub(crate) fn step_param(
    params: &mut BTreeMap<String, f64>,
    brief: &DesignBrief,
    choices: &[&ParamChoice],
    direction: EditDirection,
    rng: &mut KeyedRng,
) {
    let Some(choice) = pick_choice(choices, rng) else { return };
    let specs = brief.recipe.task().params();
    let Some(spec) = specs.iter().find(|spec| spec.name == choice.param) else { return };
    let current = params.get(&choice.param).copied().unwrap_or_else(|| brief.param(&choice.param));
    let next = if (spec.harder == Harder::Up) == (direction == EditDirection::Harder) {
        choice.values.iter().find(|value| **value > current)
    } else {
        choice.values.iter().rev().find(|value| **value < current)
    };
    if let Some(next) = next {
        params.insert(choice.param.clone(), *next);
    }
}

#[cfg(test)]
mod tests {
    use env_core::Recipe;
    use env_core::keyed_rng::RngPurpose;

    use super::*;

    #[test]
    fn direction_follows_the_success_rate() {
        let directions = [0.0, 0.29, 0.3, 0.5, 0.7, 0.71, 1.0].map(EditDirection::of_success);
        let (easier, harder) = (Some(EditDirection::Easier), Some(EditDirection::Harder));
        assert_eq!(directions, [easier, easier, None, None, None, harder, harder]);
    }

    #[test]
    fn params_step_to_the_next_choice() {
        let task = env_core::task("kessler/survival").unwrap();
        let brief = DesignBrief::new(Recipe::new(task).unwrap().into(), 1, 1);
        let fuel = ParamChoice { param: "fuel".to_owned(), values: vec![5.0, 10.0, 20.0] };
        let mut rng = KeyedRng::new(RngPurpose::Design, 1, 1);
        let mut step = |from: f64, direction| {
            let mut params = BTreeMap::from([("fuel".to_owned(), from)]);
            step_param(&mut params, &brief, &[&fuel], direction, &mut rng);
            params["fuel"]
        };
        // Less fuel is harder.
        assert_eq!([step(10.0, EditDirection::Harder), step(10.0, EditDirection::Easier)], [5.0, 20.0]);
        assert_eq!([step(5.0, EditDirection::Harder), step(20.0, EditDirection::Easier)], [5.0, 20.0]);
    }
}
