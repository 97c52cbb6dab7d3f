//! Parts of the distance of two designs that the languages of all worlds share.

use std::collections::BTreeMap;

/// Distance that each differing param adds: another value is another situation, but nearly the same layout.
const PARAM_DISTANCE: f64 = 0.03;

/// Returns the distance that differing params add: 0.03 for each.
pub(crate) fn param_distance(a: &BTreeMap<String, f64>, b: &BTreeMap<String, f64>) -> f64 {
    let changed = a.iter().filter(|(name, value)| b.get(*name) != Some(value)).count()
        + b.keys().filter(|name| !a.contains_key(*name)).count();
    PARAM_DISTANCE * changed as f64
}

/// Returns the mean, over all parts of two designs, of the distance to the nearest part of the other design; 0 without parts.
/// A part has the distance 1 to a design without parts.
pub(crate) fn mean_nearest<T>(a: &[T], b: &[T], distance: impl Fn(&T, &T) -> f64) -> f64 {
    let nearest = |of: &T, among: &[T]| among.iter().map(|other| distance(of, other)).fold(1.0, f64::min);
    let all = a.iter().map(|part| nearest(part, b)).chain(b.iter().map(|part| nearest(part, a)));
    all.sum::<f64>() / (a.len() + b.len()).max(1) as f64
}

/// Returns the root of the mean of the squares.
pub(crate) fn root_mean_square(differences: &[f64]) -> f64 {
    let sum_of_squares: f64 = differences.iter().map(|difference| difference * difference).sum();
    (sum_of_squares / differences.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_changed_param_adds_to_the_distance() {
        let params = |pairs: &[(&str, f64)]| -> BTreeMap<String, f64> {
            pairs.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
        };
        let a = params(&[("fuel", 20.0), ("debris", 5.0)]);
        assert_eq!(param_distance(&a, &a), 0.0);
        let b = params(&[("fuel", 10.0), ("radar_range", 60.0)]);
        assert!((param_distance(&a, &b) - 0.09).abs() < 1e-12);
        assert_eq!(param_distance(&a, &b), param_distance(&b, &a));
    }

    #[test]
    fn nearest_parts_decide_the_distance() {
        let distance = |a: &f64, b: &f64| (a - b).abs();
        assert_eq!(mean_nearest(&[0.1, 0.5], &[0.5, 0.1], distance), 0.0);
        assert!((mean_nearest(&[0.1], &[0.2, 0.4], distance) - 0.5 / 3.0).abs() < 1e-12);
        assert_eq!(mean_nearest(&[0.1], &[], distance), 1.0);
        assert_eq!((root_mean_square(&[3.0, 4.0, 0.0, 0.0]), root_mean_square(&[])), (2.5, 0.0));
    }
}
