//! The driver finds planted faults.

use std::fs;
use std::time::Duration;

use fuzz_targets::Target;
use fuzz_targets::corpus::Corpus;
use fuzz_targets::driver::{FailureKind, Plan, TIMEOUT, fuzz};

const PLAN: Plan = Plan { inputs: 100_000, seed: 0, timeout: TIMEOUT };

fn seeds() -> Vec<Vec<u8>> {
    vec![b"{\"name\":\"value\",\"list\":[1,2,3]}".to_vec()]
}

#[test]
fn panic_on_a_rare_byte_is_found() {
    let target = Target::new(
        "planted",
        |bytes| {
            assert!(!bytes.contains(&0xf7), "the planted panic");
            true
        },
        seeds,
    );
    let failure = fuzz(&target, PLAN).expect_err("the byte is drawn");
    assert_eq!(failure.kind, FailureKind::Panic);
    assert!(failure.input.contains(&0xf7));
    assert!(failure.to_string().contains("\\xf7"), "{failure}");
    let folder = std::env::temp_dir().join(format!("sparring-fuzz-{}", std::process::id()));
    let path = failure.save(&folder).expect("the folder can be written");
    assert_eq!(fs::read(path).expect("the file exists"), failure.input);
    fs::remove_dir_all(folder).expect("the folder exists");
}

#[test]
fn panic_behind_valid_json_is_found() {
    let target = Target::new(
        "planted",
        |bytes| {
            let Ok(value) = serde_json::from_slice::<serde_json::Value>(bytes) else { return false };
            assert!(value["list"][1] != -1, "the planted panic");
            true
        },
        seeds,
    );
    assert_eq!(fuzz(&target, PLAN).expect_err("the number is drawn").kind, FailureKind::Panic);
}

#[test]
fn slow_input_and_rejected_seed_fail() {
    let slow = |_: &[u8]| {
        std::thread::sleep(Duration::from_millis(20));
        true
    };
    let failure =
        fuzz(&Target::new("slow", slow, seeds), Plan { timeout: Duration::from_millis(10), ..PLAN })
            .expect_err("each run is slow");
    assert_eq!(failure.kind, FailureKind::Timeout);
    let failure = fuzz(&Target::new("strict", |_| false, seeds), PLAN).expect_err("no seed is accepted");
    assert_eq!(failure.kind, FailureKind::RejectedSeed);
}

#[test]
fn same_seed_gives_the_same_inputs() {
    let inputs = |seed| {
        let mut corpus = Corpus::new(seeds(), seed);
        (0..1000).map(|_| corpus.next_input()).collect::<Vec<_>>()
    };
    assert_eq!(inputs(1), inputs(1));
    assert_ne!(inputs(1), inputs(2));
}
