//! Easier and harder siblings of designs.

use super::*;
use crate::EditDirection;
use crate::docking::DockingDesign;
use crate::test_support::siblings;

/// Difficulty of a design: number of deputies, sum of speeds or, if the aim is a timeout, of distances, and thrust and time that
/// are missing.
fn difficulty(design: &Value, brief: &DesignBrief) -> [f64; 4] {
    let DockingDesign { aim, params, deputies, .. } = DockingDesign::from_json(design).unwrap();
    let approach = deputies.iter().map(|deputy| match aim.mode.as_str() {
        "timeout" => f64::from(deputy.distance),
        _ => f64::from(deputy.closing_speed.abs() + deputy.cross_speed),
    });
    let param = |name: &str| params.get(name).copied().unwrap_or_else(|| brief.param(name));
    [deputies.len() as f64, approach.sum(), -param("thrust_bound"), -param("time_limit_s")]
}

#[test]
fn siblings_differ_in_one_direction() {
    for mode in ["crash", "timeout", "saturation"] {
        let mut brief = brief_at_level("docking/multiagent", 5, 1);
        brief.profile = aimed_profile("docking/multiagent", mode);
        for (direction, sign) in [(EditDirection::Easier, -1.0), (EditDirection::Harder, 1.0)] {
            let pairs = siblings(language(), &brief, direction, 40);
            assert!(pairs.len() > 20, "{mode} {direction:?}: {}", pairs.len());
            let mut changed = [0; 4];
            for [parent, sibling] in pairs {
                let (before, after) = (difficulty(&parent, &brief), difficulty(&sibling, &brief));
                let changes: [f64; 4] = std::array::from_fn(|i| sign * (after[i] - before[i]));
                // A copy of a deputy is up to 5 m nearer.
                let is_copied = direction == EditDirection::Harder && changes[0] > 0.0;
                assert!(changes.iter().all(|change| *change >= 0.0) || is_copied, "{parent} {sibling}");
                (0..4).for_each(|i| changed[i] += u32::from(changes[i] > 0.0));
            }
            assert!(changed[..2].iter().all(|count| *count > 0), "{mode} {direction:?}: {changed:?}");
        }
    }
}
