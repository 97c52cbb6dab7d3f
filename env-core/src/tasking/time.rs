//! Epochs: UTC texts as BSK-RL writes them, and barycentric dynamical time.

use super::error::TaskingError;

/// Months as BSK-RL and SPICE write them.
const MONTHS: [&str; 12] =
    ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];

/// Leap seconds since 1999: year, month and the difference TAI − UTC from the first of that month, s (IERS Bulletin C).
const LEAP_SECONDS: [(i32, u32, f64); 6] =
    [(1999, 1, 32.0), (2006, 1, 33.0), (2009, 1, 34.0), (2012, 7, 35.0), (2015, 7, 36.0), (2017, 1, 37.0)];

/// First year of valid epochs.
const FIRST_YEAR: i32 = 1999;
/// Last year of valid epochs: the Sun's series covers 1900–2100.
const LAST_YEAR: i32 = 2099;

/// A moment in coordinated universal time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// Year, 1999 to 2099.
    pub year: i32,
    /// Month, 1 to 12.
    pub month: u32,
    /// Day of the month, from 1.
    pub day: u32,
    /// Hour, 0 to 23.
    pub hour: u32,
    /// Minute, 0 to 59.
    pub minute: u32,
    /// Second, 0 to less than 60.
    pub second: f64,
}

impl Epoch {
    /// Reads a text such as `2004 MAY 17 05:21:09.359 (UTC)`.
    ///
    /// # Errors
    /// Returns [`TaskingError::Epoch`] if the text is not of this form or the year is out of range.
    pub fn parse(text: &str) -> Result<Self, TaskingError> {
        let invalid = || TaskingError::Epoch { text: text.chars().take(60).collect() };
        let mut words = text.split_whitespace();
        let mut word = || words.next().ok_or_else(invalid);
        let year: i32 = word()?.parse().map_err(|_| invalid())?;
        let month = word()?.to_ascii_uppercase();
        let month = MONTHS.iter().position(|name| *name == month).ok_or_else(invalid)? as u32 + 1;
        let day: u32 = word()?.parse().map_err(|_| invalid())?;
        let mut clock = word()?.splitn(3, ':');
        let mut part = || clock.next().ok_or_else(invalid);
        let (hour, minute) = (part()?, part()?);
        let second: f64 = part()?.parse().map_err(|_| invalid())?;
        let epoch = Self {
            year,
            month,
            day,
            hour: hour.parse().map_err(|_| invalid())?,
            minute: minute.parse().map_err(|_| invalid())?,
            second,
        };
        let zone_is_valid = matches!((words.next(), words.next()), (None | Some("(UTC)" | "UTC"), None));
        if zone_is_valid && epoch.is_valid() { Ok(epoch) } else { Err(invalid()) }
    }

    fn is_valid(&self) -> bool {
        (FIRST_YEAR..=LAST_YEAR).contains(&self.year)
            && (1..=days_of_month(self.year, self.month)).contains(&self.day)
            && self.hour < 24
            && self.minute < 60
            && (0.0..60.0).contains(&self.second)
    }

    /// Barycentric dynamical time, seconds since J2000 (2000 January 1, 12:00 TDB).
    ///
    /// TDB − TT is the one term of SPICE's leap-second kernel: 1.657 ms · sin(M + 0.01671 sin M).
    #[must_use]
    pub fn tdb_s(&self) -> f64 {
        let leap =
            LEAP_SECONDS.iter().rev().find(|(year, month, _)| (self.year, self.month) >= (*year, *month));
        let tai_minus_utc = leap.map_or(LEAP_SECONDS[0].2, |entry| entry.2);
        let days = days_since_2000(self.year, self.month, self.day);
        let of_day = f64::from(self.hour) * 3600.0 + f64::from(self.minute) * 60.0 + self.second;
        let tt = f64::from(days) * 86_400.0 - 43_200.0 + of_day + tai_minus_utc + 32.184;
        let anomaly = 6.239_996 + 1.990_968_71e-7 * tt;
        tt + 1.657e-3 * libm::sin(anomaly + 1.671e-2 * libm::sin(anomaly))
    }
}

impl std::fmt::Display for Epoch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { year, day, hour, minute, second, .. } = self;
        let month = MONTHS[(self.month as usize - 1).min(11)];
        write!(f, "{year} {month} {day:02} {hour:02}:{minute:02}:{second:06.3} (UTC)")
    }
}

/// Number of days of a month in the Gregorian calendar.
const fn days_of_month(year: i32, month: u32) -> u32 {
    match month {
        2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Days from 2000 January 1 to a date of the Gregorian calendar.
fn days_since_2000(year: i32, month: u32, day: u32) -> i32 {
    let years: i32 = (2000.min(year)..2000.max(year))
        .map(|year| (1..=12).map(|month| days_of_month(year, month) as i32).sum::<i32>())
        .sum();
    let months: i32 = (1..month).map(|month| days_of_month(year, month) as i32).sum();
    if year < 2000 { -years + months + day as i32 - 1 } else { years + months + day as i32 - 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn epoch_is_read_and_written() {
        let text = "2004 MAY 17 05:21:09.359 (UTC)";
        assert_eq!(Epoch::parse(text).unwrap().to_string(), text);
        assert_eq!(Epoch::parse("2000 JAN 01 12:00:00").unwrap().tdb_s().round(), 64.0);
        for text in ["", "2004 MAY", "2004 MAI 17 05:21:09", "2004 FEB 30 00:00:00", "1998 MAY 17 05:21:09"] {
            assert!(Epoch::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn days_are_counted_across_leap_years() {
        assert_eq!(days_since_2000(2000, 1, 1), 0);
        assert_eq!(days_since_2000(2001, 1, 1), 366);
        assert_eq!(days_since_2000(1999, 12, 31), -1);
        assert_eq!(days_since_2000(2100, 3, 1), 36_584);
    }
}
