//! Numbers as people read them in a message.

/// Beyond this, and below one over it, a number is told in scientific notation.
const PLAIN: f64 = 1e15;

/// A number in as few digits as read back to the same bits: plainly, or as `1e300` where that would be a row of zeros.
#[must_use]
pub fn told(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1.0 / PLAIN..PLAIN).contains(&size) || !size.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// A number of the size of 1 in so many significant digits, for words: `0.897`, `0.00123`; plain zeros where it is less
/// than 1e-9.
#[must_use]
pub fn significant(value: f64, digits: usize) -> String {
    let mut decimals = digits.saturating_sub(1);
    let mut size = value.abs();
    while size < 1.0 && decimals < 9 + digits && size > 1e-9 {
        size *= 10.0;
        decimals += 1;
    }
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_tell_a_difference_from_a_threshold() {
        let cases = [
            (0.8996, "0.900"),
            (0.897, "0.897"),
            (0.123_45, "0.123"),
            (0.001_234, "0.00123"),
            (0.0, "0.00"),
            (1.0, "1.00"),
        ];
        for (value, words) in cases {
            assert_eq!(significant(value, 3), words);
        }
    }

    #[test]
    fn numbers_are_short_and_read_back() {
        let cases = [
            (0.0, "0"),
            (-0.05, "-0.05"),
            (999_999_999_999_999.0, "999999999999999"),
            (1e15, "1e15"),
            (-1e300, "-1e300"),
            (f64::MAX, "1.7976931348623157e308"),
            (5e-324, "5e-324"),
            (1e-9, "0.000000001"),
            (f64::INFINITY, "inf"),
        ];
        for (value, words) in cases {
            assert_eq!(told(value), words);
            assert_eq!(words.parse::<f64>().unwrap().to_bits(), value.to_bits());
        }
    }
}
