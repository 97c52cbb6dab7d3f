//! Angles in degrees: turns the short way, whole degrees, and the sectors of a failure profile.

use env_core::KeyedRng;
use env_core::critique::PROFILE_SECTORS;

/// Largest change of an angle that is drawn near the middle of a sector, in degrees. A sector reaches 15 degrees either way.
const SECTOR_JITTER_DEG: u32 = 10;

/// Returns the turn from one direction to another the short way, in degrees in (−180, 180].
pub(crate) fn turn_between(from_deg: f64, to_deg: f64) -> f64 {
    let turn = (to_deg - from_deg) % 360.0;
    if turn > 180.0 {
        turn - 360.0
    } else if turn <= -180.0 {
        turn + 360.0
    } else {
        turn
    }
}

/// Returns the angle between two directions in degrees, 0 to 180.
pub(crate) fn angle_between(a_deg: f64, b_deg: f64) -> f64 {
    turn_between(a_deg, b_deg).abs()
}

/// Returns an angle as a whole number of degrees from 0 to 359.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number from 0 to 359")]
pub(crate) fn whole_degrees(angle_deg: f64) -> u16 {
    let rounded = libm::round(angle_deg);
    (rounded - libm::floor(rounded / 360.0) * 360.0).min(359.0) as u16
}

/// Returns the middle of a sector of a failure profile, in whole degrees.
pub(crate) const fn sector_middle_deg(sector: u32) -> u32 {
    sector * 360 / PROFILE_SECTORS
}

/// Draws an angle within 10 degrees of the middle of a sector, in whole degrees.
pub(crate) fn draw_near_middle(middle_deg: u32, rng: &mut KeyedRng) -> u16 {
    let change = f64::from(rng.range_inclusive(0, 2 * SECTOR_JITTER_DEG)) - f64::from(SECTOR_JITTER_DEG);
    whole_degrees(f64::from(middle_deg) + change)
}

#[cfg(test)]
mod tests {
    use env_core::critique::profile_sector;
    use env_core::keyed_rng::RngPurpose;

    use super::*;

    #[test]
    fn angles_wrap() {
        assert_eq!([-1.0, 359.6, 720.4, -360.0].map(whole_degrees), [359, 0, 0, 0]);
        assert_eq!([angle_between(350.0, -350.0), angle_between(90.0, 270.0)], [20.0, 180.0]);
        assert_eq!([turn_between(10.0, 350.0), turn_between(350.0, 10.0)], [-20.0, 20.0]);
        assert_eq!([turn_between(0.0, 180.0), turn_between(180.0, 0.0)], [180.0, 180.0]);
    }

    #[test]
    fn angles_near_a_middle_are_in_its_sector() {
        let mut rng = KeyedRng::new(RngPurpose::Design, 1, 1);
        for sector in 0..PROFILE_SECTORS {
            let drawn = (0..50).map(|_| draw_near_middle(sector_middle_deg(sector), &mut rng));
            assert!(drawn.map(f64::from).all(|angle| profile_sector(angle) == sector), "{sector}");
        }
    }
}
