//! How tasks share the proposals.

use super::settings::{Settings, TaskPlan};

/// No task gets less: a task that is never met is never learnt, and its mastery says nothing.
const MIN_SHARE: f64 = 0.05;

/// The share of each task, by weight, none below 5 % (or an equal part, where there are more than 20 tasks). Tasks
/// below the floor are lifted to it and the others share the rest by weight, again until none falls below.
pub(super) fn shares(settings: &Settings) -> Vec<f64> {
    let count = settings.tasks.len();
    let floor = MIN_SHARE.min(1.0 / count as f64);
    // Against the largest, so that huge weights do not overflow their sum.
    let largest = settings.tasks.iter().map(|plan| plan.weight).fold(0.0, f64::max);
    let weights: Vec<f64> = settings.tasks.iter().map(|plan| plan.weight / largest).collect();
    let mut lifted = vec![false; count];
    loop {
        let fixed = lifted.iter().filter(|&&is| is).count();
        if fixed == count {
            return vec![1.0 / count as f64; count];
        }
        let rest = 1.0 - fixed as f64 * floor;
        let sum: f64 = weights.iter().zip(&lifted).filter(|(_, is)| !**is).map(|(weight, _)| weight).sum();
        let shares: Vec<f64> = weights
            .iter()
            .zip(&lifted)
            .map(|(weight, &is)| if is { floor } else { rest * weight / sum })
            .collect();
        let mut settled = true;
        for (share, is) in shares.iter().zip(&mut lifted) {
            if !*is && *share < floor {
                *is = true;
                settled = false;
            }
        }
        if settled {
            return shares;
        }
    }
}

/// The task on which a draw in [0, 1) falls.
pub(super) fn pick(settings: &Settings, draw: f64) -> &TaskPlan {
    let mut left = draw;
    for (plan, share) in settings.tasks.iter().zip(shares(settings)) {
        if left < share {
            return plan;
        }
        left -= share;
    }
    // Shares add up to 1 but for rounding.
    settings.tasks.last().expect("settings without a task are refused")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighted(weights: &[f64]) -> Settings {
        let plan = TaskPlan::standard("kessler/survival").unwrap();
        Settings::ladder(weights.iter().map(|&weight| TaskPlan { weight, ..plan.clone() }).collect())
    }

    fn close(found: &[f64], wanted: &[f64]) {
        assert_eq!(found.len(), wanted.len());
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {wanted:?}");
    }

    #[test]
    fn equal_weights_share_equally_and_others_by_weight() {
        close(&shares(&weighted(&[1.0, 1.0, 1.0, 1.0])), &[0.25; 4]);
        close(&shares(&weighted(&[1.0, 3.0])), &[0.25, 0.75]);
        close(&shares(&weighted(&[7.0])), &[1.0]);
    }

    #[test]
    fn no_task_falls_below_its_floor() {
        close(&shares(&weighted(&[1e300, 1e-300, 1.0])), &[0.90, 0.05, 0.05]);
        close(&shares(&weighted(&[f64::MAX, f64::MAX, f64::MIN_POSITIVE])), &[0.475, 0.475, 0.05]);
        // Lifting the first to 5 % pushes the second, at 5.2 % before, below it: it is lifted too.
        let squeezed = shares(&weighted(&[0.001, 5.2, 94.8]));
        assert!(squeezed.iter().all(|&share| share >= 0.05 - 1e-12), "{squeezed:?}");
        close(&[squeezed.iter().sum()], &[1.0]);
    }

    #[test]
    fn more_than_twenty_tasks_share_what_there_is() {
        let mut weights = vec![1.0; 40];
        weights[0] = 1000.0;
        close(&shares(&weighted(&weights)), &[1.0 / 40.0; 40]);
    }
}
