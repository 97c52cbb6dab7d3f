//! Difference between the Sun's position in JPL's ephemeris DE440 (Park et al. 2021, *Astron. J.* 161, 105) and the series of
//! [`super::sun`], which errs by up to 15 km.

use super::vector3::Vector3;

/// Nodes of three little-endian 16-bit integers, m; `scripts/sun-correction` writes the file.
static NODES: &[u8] = include_bytes!("data/sun_correction.bin");
/// Bytes of a node.
const NODE_BYTES: usize = 6;
/// Time of the first node after J2000, days.
const FIRST_DAY: f64 = -2.0;
/// Days between two nodes. Cubic polynomials through four nodes err by less than 110 m.
const STEP_DAYS: f64 = 2.0;
/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Correction of the Sun's position relative to the Earth on the equator of J2000, m, at a time since J2000 in TDB.
///
/// It is zero before 2000 and after 4 January 2023: BSK-RL draws epochs from 2000 to 2021.
pub(super) fn sun_correction(tdb_s: f64) -> Vector3<f64> {
    let place = (tdb_s / DAY_S - FIRST_DAY) / STEP_DAYS;
    let before = libm::floor(place);
    if before < 1.0 || before + 2.0 >= (NODES.len() / NODE_BYTES) as f64 {
        return [0.0; 3];
    }
    let (first, t) = (before as usize - 1, place - before);
    // Lagrange's polynomials of the nodes −1, 0, 1 and 2.
    let weights = [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ];
    let mut sum = [0.0; 3];
    for (node, weight) in NODES.chunks_exact(NODE_BYTES).skip(first).zip(weights) {
        for (total, bytes) in sum.iter_mut().zip(node.chunks_exact(2)) {
            *total += weight * bytes.try_into().map_or(0.0, |bytes| f64::from(i16::from_le_bytes(bytes)));
        }
    }
    sum
}
