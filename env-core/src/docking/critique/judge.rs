//! The deterministic judge, from −1 to 1: docking is 0.8 to 1, a crash is −1. In docking waiting never helps, so the case
//! "no action needed" does not occur.

use super::trajectory::DockingTrajectory;
use crate::critique::Judgement;
use crate::docking::end_conditions::DeputyStatus;
use crate::docking::relative_motion::distance;

/// The mean over the deputies:
///
/// - docked: 0.8 to 1, more the earlier
/// - timed out: 0 to −0.5 by the share of the distance that is left
/// - still active when two others collided: −0.5
/// - stopped for its speed: −0.8
/// - out of bounds: −0.9
/// - crashed or collided: −1
pub(super) fn judge(trajectory: &DockingTrajectory) -> Judgement {
    let deputies = trajectory.deputy_count();
    let verdicts: Vec<DeputyVerdict> = (0..deputies).map(|deputy| judge_deputy(trajectory, deputy)).collect();
    let value = verdicts.iter().map(|verdict| verdict.value).sum::<f64>() / deputies as f64;
    let worst = verdicts.iter().min_by(|a, b| a.value.total_cmp(&b.value));
    let case = worst.map_or("docked", |verdict| verdict.case);
    let docked = verdicts.iter().filter(|verdict| verdict.case == "docked").count();
    let explanation = if docked == deputies {
        format!("All {deputies} docked within {} s.", trajectory.sim.steps())
    } else {
        format!("{docked} of {deputies} docked; the worst of the others: {}.", case.replace('_', " "))
    };
    Judgement { value: value.clamp(-1.0, 1.0), case, explanation }
}

/// Verdict on one deputy: its value from −1 to 1, and its case.
struct DeputyVerdict {
    value: f64,
    case: &'static str,
}

fn judge_deputy(trajectory: &DockingTrajectory, deputy: usize) -> DeputyVerdict {
    let left = trajectory.last_step(deputy);
    let (value, case) = match trajectory.sim.status(deputy) {
        DeputyStatus::Docked => {
            let early = 1.0 - f64::from(left) / f64::from(trajectory.sim.setup().time_limit);
            (0.8 + 0.2 * early, "docked")
        }
        DeputyStatus::Active | DeputyStatus::TimedOut => {
            let whole = distance(trajectory.state(deputy, 0));
            (-0.5 * (distance(trajectory.state(deputy, left)) / whole).min(1.0), "timeout")
        }
        DeputyStatus::Saturated => (-0.8, "saturation"),
        DeputyStatus::OutOfBounds => (-0.9, "out_of_bounds"),
        DeputyStatus::Crashed => (-1.0, "crash"),
        DeputyStatus::Collided if trajectory.collided_pairs().any(|(a, b)| a == deputy || b == deputy) => {
            (-1.0, "collision")
        }
        DeputyStatus::Collided => (-0.5, "collision"),
    };
    DeputyVerdict { value, case }
}
