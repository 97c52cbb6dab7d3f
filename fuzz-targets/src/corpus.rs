//! [`Corpus`]: the inputs from which new ones are mutated.

use serde_json::Value;

use crate::mutation::{MAX_INPUT_BYTES, mutate_bytes, mutate_value};
use crate::random::Random;

/// Number of accepted mutations that are kept. Mutations of them reach deeper than mutations of the seeds.
const KEPT_INPUTS: usize = 256;
/// Largest kept mutation in bytes, or the largest seed if that is larger. Without a bound inputs would grow.
const MAX_KEPT_BYTES: usize = 2048;

/// Encoding of a structured seed.
#[derive(Debug, Clone, Copy)]
enum Encoding {
    Json,
    MessagePack,
}

/// Seeds, and mutations of them that the parser accepted.
pub struct Corpus {
    seeds: Vec<Vec<u8>>,
    /// Seeds that are JSON or MessagePack.
    values: Vec<(Encoding, Value)>,
    /// Accepted mutations; the newest replaces a random one.
    kept: Vec<Vec<u8>>,
    max_kept_bytes: usize,
    random: Random,
}

impl Corpus {
    /// Creates the corpus of these seeds. The same seed of the random numbers gives the same inputs.
    #[must_use]
    pub fn new(seeds: Vec<Vec<u8>>, random: u64) -> Self {
        let values = seeds.iter().filter_map(|seed| parse_seed(seed)).collect();
        let largest = seeds.iter().map(Vec::len).max().unwrap_or(0);
        let max_kept_bytes = largest.clamp(MAX_KEPT_BYTES, MAX_INPUT_BYTES);
        Self { seeds, values, kept: Vec::new(), max_kept_bytes, random: Random(random) }
    }

    /// Returns the next mutated input.
    pub fn next_input(&mut self) -> Vec<u8> {
        let random = &mut self.random;
        if !self.values.is_empty() && random.one_in(3) {
            let (encoding, value) = random.choose(&self.values);
            let (encoding, mut value) = (*encoding, value.clone());
            for _ in 0..=random.below(2) {
                mutate_value(&mut value, random);
            }
            let mut bytes = encode(encoding, &value);
            if random.one_in(8) {
                mutate_bytes(&mut bytes, random);
            }
            return bytes;
        }
        let mut bytes = self.choose_input();
        if self.random.one_in(8) {
            let other = self.choose_input();
            splice(&mut bytes, &other, &mut self.random);
        }
        mutate_bytes(&mut bytes, &mut self.random);
        bytes
    }

    /// Keeps an accepted mutation.
    pub fn keep(&mut self, input: Vec<u8>) {
        if input.len() > self.max_kept_bytes {
            return;
        }
        if self.kept.len() < KEPT_INPUTS {
            self.kept.push(input);
        } else {
            let at = self.random.below(KEPT_INPUTS);
            self.kept[at] = input;
        }
    }

    fn choose_input(&mut self) -> Vec<u8> {
        let of = if self.kept.is_empty() || self.random.one_in(2) { &self.seeds } else { &self.kept };
        if of.is_empty() { Vec::new() } else { self.random.choose(of).clone() }
    }
}

/// Replaces the end of an input by the end of another one.
fn splice(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    bytes.truncate(random.below(bytes.len() + 1));
    bytes.extend(&other[random.below(other.len() + 1)..]);
}

/// Parses a seed that is an object or a list in one of the encodings.
fn parse_seed(seed: &[u8]) -> Option<(Encoding, Value)> {
    let is_structured = |value: &Value| value.is_object() || value.is_array();
    let json = serde_json::from_slice(seed).ok().map(|value| (Encoding::Json, value));
    let packed = || {
        let value = rmp_serde::from_slice(seed).ok()?;
        Some((Encoding::MessagePack, value))
    };
    json.or_else(packed).filter(|(_, value)| is_structured(value))
}

fn encode(encoding: Encoding, value: &Value) -> Vec<u8> {
    match encoding {
        Encoding::Json => value.to_string().into_bytes(),
        Encoding::MessagePack => rmp_serde::to_vec(value).unwrap_or_default(),
    }
}
