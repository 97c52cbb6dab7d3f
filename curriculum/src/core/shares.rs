//! Shares of the tasks in the proposals.

use super::settings::{Settings, TaskPlan};

/// Lowest share of a task. A task that the agent never meets is never learnt, and its mastery says nothing.
const MIN_SHARE: f64 = 0.05;

/// Share of each task, by weight. No task gets less than 5 %, or than an equal part if there are more than 20 tasks.
///
/// Tasks below the minimum are raised to it, and the others share the rest by weight; this repeats until no task is
/// below.
pub(crate) fn task_shares(settings: &Settings) -> Vec<f64> {
    let count = settings.tasks.len();
    let min_share = MIN_SHARE.min(1.0 / count as f64);
    // Scaled by the largest weight, so that the sum of huge weights does not overflow.
    let largest = settings.tasks.iter().map(|plan| plan.weight).fold(0.0, f64::max);
    let weights: Vec<f64> = settings.tasks.iter().map(|plan| plan.weight / largest).collect();
    let mut at_minimum = vec![false; count];
    loop {
        let raised = at_minimum.iter().filter(|&&is_raised| is_raised).count();
        if raised == count {
            return vec![1.0 / count as f64; count];
        }
        let rest = 1.0 - raised as f64 * min_share;
        let sum: f64 = weights
            .iter()
            .zip(&at_minimum)
            .filter(|(_, is_raised)| !**is_raised)
            .map(|(weight, _)| weight)
            .sum();
        let shares: Vec<f64> = weights
            .iter()
            .zip(&at_minimum)
            .map(|(weight, &is_raised)| if is_raised { min_share } else { rest * weight / sum })
            .collect();
        let mut is_settled = true;
        for (share, is_raised) in shares.iter().zip(&mut at_minimum) {
            if !*is_raised && *share < min_share {
                *is_raised = true;
                is_settled = false;
            }
        }
        if is_settled {
            return shares;
        }
    }
}

/// Picks the task whose share contains `draw`, a number in [0, 1).
pub(crate) fn pick_task(settings: &Settings, draw: f64) -> &TaskPlan {
    let mut left = draw;
    for (plan, share) in settings.tasks.iter().zip(task_shares(settings)) {
        if left < share {
            return plan;
        }
        left -= share;
    }
    // The shares add up to 1 except for rounding.
    settings.tasks.last().expect("settings without a task are refused")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighted(weights: &[f64]) -> Settings {
        let plan = TaskPlan::standard("kessler/survival").unwrap();
        Settings::ladder(weights.iter().map(|&weight| TaskPlan { weight, ..plan.clone() }).collect())
    }

    fn assert_close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {expected:?}");
    }

    #[test]
    fn shares_are_proportional_to_weights() {
        assert_close(&task_shares(&weighted(&[1.0, 1.0, 1.0, 1.0])), &[0.25; 4]);
        assert_close(&task_shares(&weighted(&[1.0, 3.0])), &[0.25, 0.75]);
        assert_close(&task_shares(&weighted(&[7.0])), &[1.0]);
    }

    #[test]
    fn no_task_falls_below_the_minimum_share() {
        assert_close(&task_shares(&weighted(&[1e300, 1e-300, 1.0])), &[0.90, 0.05, 0.05]);
        assert_close(
            &task_shares(&weighted(&[f64::MAX, f64::MAX, f64::MIN_POSITIVE])),
            &[0.475, 0.475, 0.05],
        );
        // Raising the first task to 5 % pushes the second, at 5.2 % before, below it: it is raised too.
        let squeezed = task_shares(&weighted(&[0.001, 5.2, 94.8]));
        assert!(squeezed.iter().all(|&share| share >= 0.05 - 1e-12), "{squeezed:?}");
        assert_close(&[squeezed.iter().sum()], &[1.0]);
    }

    #[test]
    fn more_than_twenty_tasks_share_equally() {
        let mut weights = vec![1.0; 40];
        weights[0] = 1000.0;
        assert_close(&task_shares(&weighted(&weights)), &[1.0 / 40.0; 40]);
    }
}
