//! Formats numbers for messages.

/// Magnitude from which scientific notation is used; below its reciprocal as well.
const MAX_PLAIN: f64 = 1e15;

/// Formats a number with as few digits as parse to the same bits: in decimal notation, or as `1e300` if that would be a row
/// of zeros.
#[must_use]
pub fn format_shortest(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1.0 / MAX_PLAIN..MAX_PLAIN).contains(&size) || !size.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// Formats a number near 1 with a number of significant digits: `0.897`, `0.00123`. A number below 1e-9 gives zeros.
#[must_use]
pub fn format_significant(value: f64, digits: usize) -> String {
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
    fn significant_digits_are_kept() {
        let cases = [
            (0.8996, "0.900"),
            (0.897, "0.897"),
            (0.123_45, "0.123"),
            (0.001_234, "0.00123"),
            (0.0, "0.00"),
            (1.0, "1.00"),
        ];
        for (value, words) in cases {
            assert_eq!(format_significant(value, 3), words);
        }
    }

    #[test]
    fn shortest_form_parses_to_the_same_bits() {
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
            assert_eq!(format_shortest(value), words);
            assert_eq!(words.parse::<f64>().unwrap().to_bits(), value.to_bits());
        }
    }
}
