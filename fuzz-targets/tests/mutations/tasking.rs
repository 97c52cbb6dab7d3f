//! The episodes of tasking reach every option and event.

use std::collections::BTreeSet;

use fuzz_targets::targets::tasking::{fly_episode, random_bytes};

/// Number of random inputs.
const INPUTS: u64 = 400;

/// Options and events that random inputs must have.
const EXPECTED: [&str; 36] = [
    "NoReward",
    "ResourceReward",
    "ScanningTimeReward",
    "UniqueImageReward",
    "several rewarders",
    "cities",
    "time limit below the longest step",
    "MultiDegreeCommunication",
    "LOSCommunication",
    "heterogeneous satellites",
    "Satellite",
    "AccessSatellite",
    "ImagingSatellite",
    "BasicDynamicsModel",
    "BasicFSWModel",
    "SteeringFSWModel",
    "ContinuousImagingFSWModel",
    "instrument without commands",
    "Scan",
    "Charge",
    "Downlink",
    "Desat",
    "NadirPoint",
    "Drift",
    "Image",
    "Broadcast",
    "DiscreteFSWAction with reset_task",
    "communication",
    "communication by broadcast",
    "images",
    "scanned data",
    "deaths",
    "time limits",
    "negative rewards",
    "refused target",
    "action by target",
];

#[test]
fn random_episodes_have_every_option_and_event() {
    let seen: BTreeSet<&str> = (0..INPUTS)
        .filter_map(|seed| fly_episode(&random_bytes(seed)))
        .flat_map(|found| found.seen)
        .collect();
    let missing: Vec<&str> = EXPECTED.into_iter().filter(|name| !seen.contains(name)).collect();
    assert!(missing.is_empty(), "{INPUTS} episodes without {missing:?}");
}
