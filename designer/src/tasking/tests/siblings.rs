//! Easier and harder siblings of designs.

use super::*;
use crate::EditDirection;
use crate::tasking::TaskingDesign;
use crate::test_support::{profile_of_one_mode, siblings};

/// Difficulty of a design: missing charge, speed of the wheels, data, outages and targets.
fn difficulty(design: &Value) -> [i32; 5] {
    let TaskingDesign { start, outages, fields, .. } = TaskingDesign::from_json(design).unwrap();
    let targets: i32 = fields.iter().map(|field| field.targets).sum();
    [-start.battery_percent, start.wheels_percent, start.storage_percent, outages.len() as i32, targets]
}

#[test]
fn siblings_differ_in_one_direction() {
    for (task, mode) in [(SCANNING, "full"), (IMAGING, "low_value")] {
        let mut brief = brief_at_level(task, 5, 1);
        brief.profile = profile_of_one_mode(task, mode, Some(1), None);
        for (direction, sign) in [(EditDirection::Easier, -1), (EditDirection::Harder, 1)] {
            let pairs = siblings(empty_gate().language(), &brief, direction, 25);
            assert!(pairs.len() > 8, "{task} {direction:?}: {}", pairs.len());
            let mut changed = [0; 5];
            for [parent, sibling] in pairs {
                let (before, after) = (difficulty(&parent), difficulty(&sibling));
                let changes: [i32; 5] = std::array::from_fn(|i| sign * (after[i] - before[i]));
                assert!(changes.iter().all(|change| *change >= 0), "{parent} {sibling}");
                (0..5).for_each(|i| changed[i] += u32::from(changes[i] > 0));
            }
            assert!(changed.iter().filter(|count| **count > 0).count() >= 3, "{direction:?}: {changed:?}");
        }
    }
}
