//! Mutations of values and bytes with a seeded random number generator.

use serde_json::{Value, json};

/// Random number generator with fixed seeds (SplitMix64: Steele, Lea and Flood 2014).
pub(super) struct Random(pub(super) u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub(super) fn choose<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }
}

/// Mutates one place of a value.
pub(super) fn mutate_value(value: &mut Value, random: &mut Random) {
    let descend = random.below(4) > 0;
    match value {
        Value::Object(fields) if descend && !fields.is_empty() => {
            let key = fields.keys().nth(random.below(fields.len())).unwrap().clone();
            match random.below(8) {
                0 => drop(fields.remove(&key)),
                1 => drop(fields.insert(format!("{key}_"), invalid_value(random))),
                _ => mutate_value(fields.get_mut(&key).unwrap(), random),
            }
        }
        Value::Array(items) if descend && !items.is_empty() => {
            let at = random.below(items.len());
            match random.below(8) {
                0 => drop(items.remove(at)),
                1 => items.extend(std::iter::repeat_n(invalid_value(random), 3)),
                _ => mutate_value(&mut items[at], random),
            }
        }
        _ => *value = invalid_value(random),
    }
}

/// Mutates up to five places of a byte string.
pub(super) fn mutate_bytes(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len() + 1);
        match random.below(4) {
            0 => bytes.truncate(at),
            1 => bytes.insert(at, random.next() as u8),
            2 if at < bytes.len() => bytes[at] = random.next() as u8,
            _ => bytes.extend(random.next().to_le_bytes()),
        }
    }
}

/// Draws a value that most fields reject.
fn invalid_value(random: &mut Random) -> Value {
    match random.below(16) {
        0 => json!(null),
        1 => json!(-1),
        2 => json!(u64::MAX),
        3 => json!(i64::MIN),
        4 => json!(1e308),
        5 => json!(-0.0),
        6 => json!(""),
        7 => json!("\u{0}\u{202e}é\u{fffd}"),
        8 => json!("x".repeat(70_000)),
        9 => json!([]),
        10 => json!({}),
        11 => json!(true),
        12 => (0..100).fold(json!(1), |inner, _| json!([inner])),
        13 => json!(vec![0; 3000]),
        14 => json!("1-aaaaaa"),
        _ => json!({"": {"": []}}),
    }
}
