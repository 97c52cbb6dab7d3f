//! Mutations of JSON values and of bytes.

use std::ops::Range;

use serde_json::{Map, Value, json};

use crate::random::Random;

/// Largest length of a mutated input in bytes, except for the large values that are drawn rarely.
pub const MAX_INPUT_BYTES: usize = 16 * 1024;
/// One value in so many is large: it fills buffers and exceeds limits, and costs as much time as a hundred others.
const LARGE_ONE_IN: usize = 512;

/// Numbers at the limits of types and formats, as text.
const EXTREME_NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-1",
    "1",
    "1.5",
    "255",
    "256",
    "65536",
    "2147483648",
    "4294967295",
    "4294967296",
    "9007199254740993",
    "9223372036854775807",
    "9223372036854775808",
    "-9223372036854775808",
    "-9223372036854775809",
    "18446744073709551615",
    "18446744073709551616",
    "1e308",
    "1e309",
    "-1e309",
    "5e-324",
    "1e-400",
    "0.1e1",
    "00",
    "+1",
    "1_0",
    "NaN",
    "Infinity",
    "-Infinity",
];
/// Words and bytes that formats give a meaning.
const TOKENS: &[&[u8]] = &[
    b"{",
    b"}",
    b"[",
    b"]",
    b"\"",
    b",",
    b":",
    b"\\",
    b"\n",
    b"\r\n",
    b"\0",
    b" ",
    b"-",
    b"_",
    b".",
    b"=",
    b"null",
    b"true",
    b"false",
    b"{}",
    b"[]",
    b"\"\"",
    b"\\u0000",
    b"\\ud800",
    b"\\n",
    b"\xef\xbb\xbf",
    b"\xff",
    b"\xc3\xa9",
    b"\xe2\x80\xae",
    b"```",
    b"<think>",
    b"</think>",
    b"%00",
    b"%ff",
    b"..",
    b"\x80",
    b"\x90",
    b"\xc0",
    b"\xc1",
    b"\xc6\xff\xff\xff\xff",
    b"\xdd\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff",
    b"\xcb\x7f\xf8\0\0\0\0\0\0",
    b"\xd4\0\0",
];

/// Mutates one place of a value.
pub fn mutate_value(value: &mut Value, random: &mut Random) {
    let descend = random.below(8) > 0;
    match value {
        Value::Object(fields) if descend && !fields.is_empty() => mutate_fields(fields, random),
        Value::Array(items) if descend && !items.is_empty() => {
            let at = random.below(items.len());
            match random.below(10) {
                0 => drop(items.remove(at)),
                1 => items.extend(std::iter::repeat_n(unusual_value(random), 3)),
                2 => items.push(items[at].clone()),
                3 => items.swap(at, 0),
                _ => mutate_value(&mut items[at], random),
            }
        }
        _ => *value = unusual_value(random),
    }
}

fn mutate_fields(fields: &mut Map<String, Value>, random: &mut Random) {
    let at = random.below(fields.len());
    let Some(key) = fields.keys().nth(at).cloned() else { return };
    match random.below(10) {
        0 => drop(fields.remove(&key)),
        1 => drop(fields.insert(format!("{key}_"), unusual_value(random))),
        2 => {
            // Another field receives this value.
            let other = fields.keys().nth(random.below(fields.len())).cloned();
            if let (Some(other), Some(value)) = (other, fields.get(&key).cloned()) {
                fields.insert(other, value);
            }
        }
        _ => {
            if let Some(value) = fields.get_mut(&key) {
                mutate_value(value, random);
            }
        }
    }
}

/// Draws a value that most fields reject.
fn unusual_value(random: &mut Random) -> Value {
    let is_large = random.one_in(LARGE_ONE_IN);
    match random.below(20) {
        0 => json!(null),
        1 => json!(-1),
        2 => json!(u64::MAX),
        3 => json!(i64::MIN),
        4 => json!(1e308),
        5 => json!(-0.0),
        6 => json!(""),
        7 => json!("\u{0}\u{202e}é\u{fffd}"),
        8 => json!("x".repeat(if is_large { 70_000 } else { 70 })),
        9 => json!([]),
        10 => json!({}),
        11 => json!(true),
        12 => (0..if is_large { 126 } else { 3 }).fold(json!(1), |inner, _| json!([inner])),
        13 => json!(vec![0; if is_large { 3000 } else { 5 }]),
        14 => json!("1-aaaaaa"),
        15 => json!({"": {"": []}}),
        16 => json!(random.below(1000)),
        17 => json!(random.below(1000) as f64 / 7.0),
        18 => json!(*random.choose(EXTREME_NUMBERS)),
        _ => json!(u32::MAX),
    }
}

/// Mutates one to five places of a byte string.
pub fn mutate_bytes(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(5) {
        mutate_place(bytes, random);
        if bytes.len() > MAX_INPUT_BYTES {
            bytes.truncate(MAX_INPUT_BYTES);
        }
    }
}

fn mutate_place(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    let part = part_from(at, bytes.len(), random);
    match random.below(12) {
        0 => bytes.insert(at, random.bits() as u8),
        1 if at < bytes.len() => bytes[at] = random.bits() as u8,
        2 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        3 => drop(bytes.drain(part)),
        4 => repeat(bytes, part, random),
        5 => {
            let token = *random.choose(TOKENS);
            replace(bytes, at..at, token);
        }
        6 => {
            let token = *random.choose(TOKENS);
            replace(bytes, part.start..bytes.len().min(part.start + token.len()), token);
        }
        7 | 8 => replace_number(bytes, at, random),
        9 => {
            let word = *random.choose(&WORDS);
            replace(bytes, at..bytes.len().min(at + 4), word);
        }
        10 if random.one_in(4) => bytes.truncate(at),
        10 if at < bytes.len() => bytes[at] = bytes[at].wrapping_add(1),
        _ => {
            let other = random.below(bytes.len() + 1).min(bytes.len().saturating_sub(1));
            if at < bytes.len() {
                bytes.swap(at, other);
            }
        }
    }
}

/// Little-endian words at the limits of lengths.
const WORDS: [&[u8]; 6] =
    [&[0; 4], &[255; 4], &[255, 255, 255, 127], &[0, 0, 0, 128], &[0, 0, 1, 0], &[1, 0, 0, 0]];

/// Draws a range from an index, short in most cases.
fn part_from(at: usize, length: usize, random: &mut Random) -> Range<usize> {
    let max = if random.one_in(8) { length } else { 8 };
    at..length.min(at + 1 + random.below(max))
}

fn replace(bytes: &mut Vec<u8>, part: Range<usize>, by: &[u8]) {
    bytes.splice(part, by.iter().copied());
}

/// Repeats a part: twice in most cases, rarely many times.
fn repeat(bytes: &mut Vec<u8>, part: Range<usize>, random: &mut Random) {
    let times = if random.one_in(LARGE_ONE_IN) { 4096 } else { 1 + random.below(3) };
    let times = times.min(MAX_INPUT_BYTES / part.len().max(1));
    let copies = bytes[part.clone()].repeat(times);
    replace(bytes, part.end..part.end, &copies);
}

/// Replaces the first number from an index on by an extreme one.
fn replace_number(bytes: &mut Vec<u8>, at: usize, random: &mut Random) {
    let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else {
        return;
    };
    let is_number = |byte: &u8| byte.is_ascii_digit() || b".eE+-".contains(byte);
    let length = bytes[start..].iter().take_while(|byte| is_number(byte)).count();
    replace(bytes, start..start + length, random.choose(EXTREME_NUMBERS).as_bytes());
}
