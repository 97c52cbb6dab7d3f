//! Epochs: UTC texts as BSK-RL writes them, and barycentric dynamical time.

use super::error::TaskingError;

/// Months as BSK-RL and SPICE write them.
const MONTHS: [&str; 12] =
    ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];

/// Year and month of the first day after each leap second since 1972, when the difference TAI − UTC was 10 s (IERS Bulletin C).
const LEAP_SECONDS: [(i32, u32); 27] = [
    (1972, 7),
    (1973, 1),
    (1974, 1),
    (1975, 1),
    (1976, 1),
    (1977, 1),
    (1978, 1),
    (1979, 1),
    (1980, 1),
    (1981, 7),
    (1982, 7),
    (1983, 7),
    (1985, 7),
    (1988, 1),
    (1990, 1),
    (1991, 1),
    (1992, 7),
    (1993, 7),
    (1994, 7),
    (1996, 1),
    (1997, 7),
    (1999, 1),
    (2006, 1),
    (2009, 1),
    (2012, 7),
    (2015, 7),
    (2017, 1),
];

/// First year of valid epochs, in which leap seconds began.
const FIRST_YEAR: i32 = 1972;
/// Last year of valid epochs: the Sun's series covers 1900–2100.
const LAST_YEAR: i32 = 2099;

/// A moment in coordinated universal time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// Year, 1972 to 2099.
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
    /// Reads a text such as `2004 MAY 17 05:21:09.359 (UTC)`, or one of ISO 8601 such as `2004-05-17T05:21:09.359`.
    ///
    /// # Errors
    /// Returns [`TaskingError::Epoch`] if the text is not of these forms or the year is out of range.
    pub fn parse(text: &str) -> Result<Self, TaskingError> {
        let epoch = Self::parse_parts(text).filter(Self::is_valid);
        epoch.ok_or_else(|| TaskingError::Epoch { text: text.chars().take(60).collect() })
    }

    /// Reads the parts of a text; `None` if it is not of a known form.
    fn parse_parts(text: &str) -> Option<Self> {
        let words: Vec<&str> = text.split(|c: char| c.is_whitespace() || c == 'T').collect();
        let words: Vec<&str> = match words.first().filter(|word| word.contains('-')) {
            // A date of ISO 8601 has its three parts in one word.
            Some(date) => date.split('-').chain(words[1..].iter().copied()).collect(),
            None => text.split_whitespace().collect(),
        };
        let (year, month, day, clock, zone) = match words[..] {
            [year, month, day, clock] => (year, month, day, clock.trim_end_matches('Z'), "UTC"),
            [year, month, day, clock, zone] => (year, month, day, clock, zone),
            _ => return None,
        };
        let is_named = |name: &str| name.eq_ignore_ascii_case(month);
        let month = match MONTHS.iter().position(|name| is_named(name)) {
            Some(index) => index as u32 + 1,
            None => month.parse().ok().filter(|month| (1..=12).contains(month))?,
        };
        let mut clock = clock.splitn(3, ':');
        let epoch = Self {
            year: year.parse().ok()?,
            month,
            day: day.parse().ok()?,
            hour: clock.next()?.parse().ok()?,
            minute: clock.next()?.parse().ok()?,
            second: clock.next()?.parse().ok()?,
        };
        matches!(zone, "(UTC)" | "UTC").then_some(epoch)
    }

    /// Creates the epoch of a day of a year, counted from 1, and a time of the day, s. Days beyond the year's end are those of the next one.
    #[must_use]
    pub fn of_day(mut year: i32, day: u32, second_of_day: f64) -> Self {
        let (mut month, mut day) = (1, day.max(1));
        while day > days_of_month(year, month) {
            day -= days_of_month(year, month);
            (year, month) = if month == 12 { (year + 1, 1) } else { (year, month + 1) };
        }
        let seconds = second_of_day.clamp(0.0, 86_399.999_999);
        let minutes = (seconds / 60.0) as u32;
        let second = seconds - f64::from(minutes) * 60.0;
        Self { year, month, day, hour: minutes / 60, minute: minutes % 60, second }
    }

    /// Day of the year, counted from 1.
    #[must_use]
    pub fn day_of_year(&self) -> u32 {
        (1..self.month).map(|month| days_of_month(self.year, month)).sum::<u32>() + self.day
    }

    /// Time since the day began, s.
    #[must_use]
    pub fn second_of_day(&self) -> f64 {
        f64::from(self.hour) * 3600.0 + f64::from(self.minute) * 60.0 + self.second
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
        let leap_seconds = LEAP_SECONDS.iter().filter(|from| (self.year, self.month) >= **from).count();
        let tai_minus_utc = 10.0 + leap_seconds as f64;
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
        for text in ["", "2004 MAY", "2004 MAI 17 05:21:09", "2004 FEB 30 00:00:00", "1971 MAY 17 05:21:09"] {
            assert!(Epoch::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn iso_epochs_are_read() {
        for text in ["2004-05-17T05:21:09.359", "2004-05-17 05:21:09.359", "2004-05-17T05:21:09.359Z"] {
            assert_eq!(Epoch::parse(text).unwrap().to_string(), "2004 MAY 17 05:21:09.359 (UTC)", "{text}");
        }
        for text in
            ["2004-13-17T05:21:09", "2004-05T05:21:09", "2004-05-17T05:21", "2004-05-17T05:21:09+01:00"]
        {
            assert!(Epoch::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn leap_seconds_are_added() {
        // TAI − UTC: 10 s in 1972, 25 s from 1990 January 1, 32 s in 2000, 37 s since 2017.
        for (text, expected) in [
            ("1972 JAN 01 00:00:00", -883_655_957.8),
            ("1989 DEC 31 23:59:59", -315_575_944.8),
            ("1990 JAN 01 00:00:00", -315_575_942.8),
            ("2017 JAN 01 00:00:00", 536_500_869.2),
        ] {
            assert!((Epoch::parse(text).unwrap().tdb_s() - expected).abs() < 0.1, "{text}");
        }
    }

    #[test]
    fn days_of_a_year_become_dates_and_back() {
        for (year, day, text) in [
            (2004, 1, "2004 JAN 01"),
            (2004, 60, "2004 FEB 29"),
            (2005, 60, "2005 MAR 01"),
            (2005, 365, "2005 DEC 31"),
            (2005, 366, "2006 JAN 01"),
        ] {
            let epoch = Epoch::of_day(year, day, 5.0 * 3600.0 + 21.0 * 60.0 + 9.25);
            assert_eq!(epoch.to_string(), format!("{text} 05:21:09.250 (UTC)"));
            if epoch.year == year {
                assert_eq!((epoch.day_of_year(), epoch.second_of_day()), (day, 19_269.25));
            }
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
