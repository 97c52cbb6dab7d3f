//! Tests that every format has to pass, and helpers that the tests of this crate share.

mod hostile;
mod numbers;
mod observations;

use std::io::Read;

use env_core::{Recipe, Scenario, Seed};
use proptest::prelude::*;
use serde_json::Value;

/// Decompresses a recorded fixture.
pub(crate) fn decompress(compressed: &[u8]) -> Value {
    let mut text = String::new();
    flate2::read::GzDecoder::new(compressed).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// A scenario of a task at a level of its default table.
pub(crate) fn at_level(task: &str, level: usize, seed: u64) -> Scenario {
    let recipe = Recipe::at_level(env_core::task(task).unwrap(), level).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// Strategy for arbitrary JSON, a few levels deep; some of its leaves and keys are known to the reader under test.
fn any_json(
    leaves: impl Strategy<Value = Value> + 'static,
    keys: &'static [&'static str],
) -> impl Strategy<Value = Value> {
    let scalar = (any::<bool>(), any::<i64>(), any::<f64>(), "[a-z_]{0,12}", 0..5usize).prop_map(
        |(truth, integer, float, text, choice)| match choice {
            0 => Value::Null,
            1 => truth.into(),
            2 => integer.into(),
            3 => float.into(),
            _ => text.into(),
        },
    );
    prop_oneof![5 => scalar, 1 => leaves].prop_recursive(4, 40, 6, move |inner| {
        let pair = (prop::sample::select(keys), inner.clone());
        prop_oneof![
            prop::collection::vec(inner, 0..6).prop_map(Value::from),
            prop::collection::vec(pair, 0..5)
                .prop_map(|pairs| pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()),
        ]
    })
}
