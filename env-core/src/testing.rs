//! Helpers that the tests of several worlds share.

use proptest::prelude::*;
use serde_json::Value;

use crate::log::ActionLog;
use crate::rollout::replay;
use crate::seed::Seed;
use crate::task::{Recipe, Scenario, StepReport, TaskSpec};

/// The JSON of a compressed fixture.
pub(crate) fn decompress(compressed: &[u8]) -> Value {
    serde_json::from_reader(flate2::read::GzDecoder::new(compressed)).unwrap()
}

/// A scenario of a task at a level of its default table.
pub(crate) fn at_level(task: &str, level: usize, seed: u64) -> Scenario {
    let task = crate::task(task).unwrap();
    let recipe = Recipe::at_level(task, level).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// Final states of some episodes of these tasks, to the bit; `log` supplies the actions for a scenario and a seed.
pub(crate) fn final_states(
    tasks: &[impl TaskSpec],
    log: impl Fn(&Scenario, u64) -> ActionLog,
) -> Vec<String> {
    let mut golden = Vec::new();
    for (task, level) in tasks.iter().flat_map(|task| [0, 3, 6, 9].map(|level| (task, level))) {
        for seed in [1, 2] {
            let scenario = at_level(task.id(), level, seed);
            let log = log(&scenario, seed);
            let mut episode = task.start(&scenario).unwrap();
            let mut report = StepReport::default();
            while !episode.done() {
                episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
            }
            let hash = blake3::Hash::from_bytes(episode.state_hash()).to_hex();
            golden.push(format!(
                "{} L{level} seed {seed}: scenario {} steps {} total {:?} state {}",
                task.id(),
                &scenario.id().to_string()[..16],
                episode.steps(),
                episode.outcome().total_reward,
                &hash[..16]
            ));
        }
    }
    golden
}

/// Brackets of some scenarios of these tasks, to the bit.
pub(crate) fn brackets(tasks: &[impl TaskSpec], levels: &[usize]) -> Vec<String> {
    let mut golden = Vec::new();
    for (task, &level) in tasks.iter().flat_map(|task| levels.iter().map(move |level| (task, level))) {
        let scenario = at_level(task.id(), level, 11);
        let bracket = task.bracket(&scenario).unwrap();
        assert_eq!(replay(&scenario, &bracket.reference_plan).unwrap(), bracket.reference);
        golden.push(format!(
            "v{} {} L{level}: hold {:?} floor {:?} reference {:?}",
            bracket.planner_version,
            task.id(),
            bracket.hold_score(),
            bracket.floor,
            bracket.reference.score
        ));
    }
    golden
}

/// Strategy for arbitrary JSON, a few levels deep, with some known leaves and keys.
pub(crate) fn any_json(
    known: impl Strategy<Value = Value> + 'static,
    keys: &'static [&'static str],
) -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        "[a-z_]{0,12}".prop_map(Value::from),
        known,
    ];
    leaf.prop_recursive(4, 40, 6, move |inner| {
        let key = prop::sample::select(keys).prop_map(str::to_owned);
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            prop::collection::btree_map(key, inner, 0..5)
                .prop_map(|map| Value::Object(map.into_iter().collect())),
        ]
    })
}
