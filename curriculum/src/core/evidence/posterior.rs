//! Posterior distribution over a success rate.

use statrs::distribution::{Beta, ContinuousCDF};

/// Posterior Beta(1 + sum, 1 + n − sum) over a success rate, from a uniform prior (Bayes 1763; Laplace's rule of
/// succession is its mean). Its evidence is `n` observations in [0, 1] that add up to `sum`.
///
/// The success rate of a group counts as that part of a success, and the rest as a failure. Episodes of a group share
/// a scenario and are not independent, so a group is one observation of a level however large it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posterior {
    /// Number of all observations.
    pub n: u32,
    /// Sum of the observations, 0 to `n`.
    pub sum: f64,
}

impl Posterior {
    /// Posterior mean, (1 + sum)/(2 + n).
    #[must_use]
    pub fn mean(self) -> f64 {
        (1.0 + self.sum) / (2.0 + f64::from(self.n))
    }

    /// Posterior mean of p(1 − p), which is largest where a success rate p is near one half.
    #[must_use]
    pub fn mean_variance(self) -> f64 {
        let successes = self.sum.clamp(0.0, f64::from(self.n));
        mean_variance(1.0 + successes, 1.0 + f64::from(self.n) - successes)
    }

    /// Success rate below which a share `p` of the posterior lies.
    #[must_use]
    pub fn quantile(self, p: f64) -> f64 {
        // Rounding may lift a sum of success rates above n by a few ulps; clamping keeps both shapes at 1 or more.
        let successes = self.sum.clamp(0.0, f64::from(self.n));
        Beta::new(1.0 + successes, 1.0 + f64::from(self.n) - successes)
            .expect("shapes of at least 1 are valid")
            .inverse_cdf(p)
    }
}

/// Mean of p(1 − p) under the distribution Beta(a, b): ab/((a + b)(a + b + 1)).
pub(crate) fn mean_variance(a: f64, b: f64) -> f64 {
    a * b / ((a + b) * (a + b + 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_invert_the_distribution() {
        for n in [0u32, 1, 16, 32, 64] {
            for eighths in 0..=8 * n {
                let posterior = Posterior { n, sum: f64::from(eighths) / 8.0 };
                let beta = Beta::new(1.0 + posterior.sum, 1.0 + f64::from(n) - posterior.sum).unwrap();
                for p in [0.1, 0.9] {
                    let back = beta.cdf(posterior.quantile(p));
                    // The incomplete beta function is accurate to about 1e-12.
                    assert!((back - p).abs() < 1e-9, "n {n}, sum {}, p {p}: {back}", posterior.sum);
                }
            }
        }
    }

    /// Compares with closed forms: Beta(1 + n, 1) has the CDF x^(n+1), and Beta(1, 1) is uniform.
    #[test]
    fn quantiles_and_mean_match_closed_forms() {
        assert!((Posterior { n: 0, sum: 0.0 }.quantile(0.1) - 0.1).abs() < 1e-12);
        let all = Posterior { n: 32, sum: 32.0 }.quantile(0.1);
        assert!((all.powi(33) - 0.1).abs() < 1e-12);
        assert!((Posterior { n: 2, sum: 1.0 }.mean() - 0.5).abs() < f64::EPSILON);
    }

    /// Beta(1, 1) is uniform, so that the mean of p(1 − p) is 1/6; many observations approach p(1 − p).
    #[test]
    fn mean_variance_matches_closed_forms() {
        assert!((Posterior { n: 0, sum: 0.0 }.mean_variance() - 1.0 / 6.0).abs() < 1e-15);
        let many = Posterior { n: 1_000_000, sum: 300_000.0 }.mean_variance();
        assert!((many - 0.21).abs() < 1e-5, "{many}");
    }

    #[test]
    fn sum_rounded_past_n_counts_as_full_success() {
        let past = Posterior { n: 3, sum: 3.000_000_000_000_001 }.quantile(0.1);
        assert_eq!(past, Posterior { n: 3, sum: 3.0 }.quantile(0.1));
    }
}
