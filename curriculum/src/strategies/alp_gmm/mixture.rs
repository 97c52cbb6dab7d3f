//! Gaussian mixtures with full covariances, fitted by expectation maximisation (EM). The number of components is chosen
//! by AIC.

use env_core::KeyedRng;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

use crate::core::settings::hyperparameters::alp_gmm::MAX_COMPONENTS;

/// Largest number of EM steps.
const MAX_EM_STEPS: usize = 100;
/// Smallest gain of a step, as mean log-likelihood of a point, for EM to continue.
const MIN_GAIN: f64 = 1e-4;
/// Added to the diagonal of covariances, so that components on few points keep a volume.
const COVARIANCE_FLOOR: f64 = 1e-5;
/// Largest number of components in a stored range.
const MAX_STORED_COMPONENTS: u32 = MAX_COMPONENTS.range.max_whole();

/// Component of a mixture. Its last dimension is the learning progress.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Component {
    pub(super) weight: f64,
    pub(super) mean: Vec<f64>,
    /// Symmetric matrix, column by column.
    pub(super) covariance: Vec<f64>,
}

/// Mixture of Gaussian components.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Mixture {
    pub(super) components: Vec<Component>,
    /// Akaike's information criterion: 2 × parameters − 2 × log-likelihood (Akaike 1974).
    pub(super) aic: f64,
}

/// Range of the number of components that a fit tries. Stored as `[min, max]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "[u32; 2]", into = "[u32; 2]")]
pub(super) struct ComponentRange {
    pub(super) min: u32,
    pub(super) max: u32,
}

impl Mixture {
    /// Fits a mixture for each number of components in the range and returns the one with the lowest AIC (Portelas et
    /// al. 2019, algorithm 1). `None` if there are too few points.
    pub(super) fn fit_best(
        points: &[Vec<f64>],
        components: ComponentRange,
        rng: &mut KeyedRng,
    ) -> Option<Self> {
        let fits = (components.min..=components.max).filter_map(|k| Self::fit(points, k as usize, rng));
        fits.min_by(|a, b| a.aic.total_cmp(&b.aic))
    }

    /// Fits a mixture of `k` components. `None` if there are too few points, or if a covariance is degenerate.
    fn fit(points: &[Vec<f64>], k: usize, rng: &mut KeyedRng) -> Option<Self> {
        let width = points.first()?.len();
        if k == 0 || points.len() <= k || width == 0 {
            return None;
        }
        let points: Vec<DVector<f64>> =
            points.iter().map(|point| DVector::from_column_slice(point)).collect();
        let mut responsibilities = initial_responsibilities(&points, k, rng);
        let mut fitted: Option<(Vec<Component>, f64)> = None;
        for _ in 0..MAX_EM_STEPS {
            let components = maximise(&points, &responsibilities);
            let expectation = expect(&points, &components)?;
            let previous = fitted.as_ref().map(|(_, log_likelihood)| *log_likelihood);
            let log_likelihood = expectation.log_likelihood;
            fitted = Some((components, log_likelihood));
            responsibilities = expectation.responsibilities;
            if previous.is_some_and(|previous| log_likelihood - previous < MIN_GAIN * points.len() as f64) {
                break;
            }
        }
        let (components, log_likelihood) = fitted?;
        // All weights but one, the means, and half of each covariance.
        let parameters = (k - 1) + k * width + k * width * (width + 1) / 2;
        let aic = 2.0 * parameters as f64 - 2.0 * log_likelihood;
        aic.is_finite().then_some(Self { components, aic })
    }
}

impl Component {
    /// Mean of the learning progress, the last dimension.
    pub(super) fn mean_progress(&self) -> f64 {
        self.mean.last().copied().unwrap_or(0.0)
    }

    /// Samples the first `width` dimensions, whatever the others: the marginal of a Gaussian is a Gaussian. `None` if
    /// its covariance is degenerate.
    pub(super) fn sample(&self, width: usize, rng: &mut KeyedRng) -> Option<Vec<f64>> {
        let marginal = self.matrix().view((0, 0), (width, width)).into_owned();
        let factor = Cholesky::new(marginal)?;
        let noise = DVector::from_fn(width, |_, _| standard_normal(rng));
        let point = factor.l() * noise;
        Some(point.iter().zip(&self.mean).map(|(offset, mean)| mean + offset).collect())
    }

    fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_column_slice(self.mean.len(), self.mean.len(), &self.covariance)
    }
}

impl TryFrom<[u32; 2]> for ComponentRange {
    type Error = String;

    fn try_from([min, max]: [u32; 2]) -> Result<Self, String> {
        if max > MAX_STORED_COMPONENTS {
            return Err(format!("a mixture has at most {MAX_STORED_COMPONENTS} components, got {max}"));
        }
        Ok(Self { min, max })
    }
}

impl From<ComponentRange> for [u32; 2] {
    fn from(range: ComponentRange) -> Self {
        [range.min, range.max]
    }
}

/// Draws from the standard normal distribution (Box and Muller 1958).
fn standard_normal(rng: &mut KeyedRng) -> f64 {
    let radius = libm::sqrt(-2.0 * libm::log(1.0 - rng.uniform()));
    radius * libm::cos(std::f64::consts::TAU * rng.uniform())
}

/// Assigns each point to the nearest of `k` centres that are far from each other (k-means++: Arthur and Vassilvitskii
/// 2007). Returns a row for each point and a column for each component, with 1 at the assigned one.
fn initial_responsibilities(points: &[DVector<f64>], k: usize, rng: &mut KeyedRng) -> DMatrix<f64> {
    let first = rng.weighted_index(&vec![1.0; points.len()]).unwrap_or(0);
    let mut centres = vec![points[first].clone()];
    let squared_distance = |point: &DVector<f64>, centre: &DVector<f64>| (point - centre).norm_squared();
    while centres.len() < k {
        let to_nearest = |point| {
            centres.iter().map(|centre| squared_distance(point, centre)).fold(f64::INFINITY, f64::min)
        };
        let weights: Vec<f64> = points.iter().map(to_nearest).collect();
        centres.push(points[rng.weighted_index(&weights).unwrap_or(0)].clone());
    }
    let mut responsibilities = DMatrix::zeros(points.len(), k);
    for (row, point) in points.iter().enumerate() {
        let distance = |centre: &usize| squared_distance(point, &centres[*centre]);
        let nearest = (0..k).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        responsibilities[(row, nearest.unwrap_or(0))] = 1.0;
    }
    responsibilities
}

/// M step: weights, means and covariances from the responsibilities.
fn maximise(points: &[DVector<f64>], responsibilities: &DMatrix<f64>) -> Vec<Component> {
    let width = points.first().map_or(0, DVector::len);
    let component = |column: usize| {
        let shares = responsibilities.column(column);
        let total = shares.sum().max(1e-12);
        let mut mean = DVector::zeros(width);
        for (point, share) in points.iter().zip(shares.iter()) {
            mean += point * *share;
        }
        mean /= total;
        let mut covariance = DMatrix::zeros(width, width);
        for (point, share) in points.iter().zip(shares.iter()).filter(|(_, share)| **share > 0.0) {
            let offset = point - &mean;
            covariance += &offset * offset.transpose() * *share;
        }
        covariance /= total;
        covariance += DMatrix::identity(width, width) * COVARIANCE_FLOOR;
        Component {
            weight: total / points.len() as f64,
            mean: mean.iter().copied().collect(),
            covariance: covariance.iter().copied().collect(),
        }
    };
    (0..responsibilities.ncols()).map(component).collect()
}

/// Result of an E step.
struct Expectation {
    /// Share of each component (column) in each point (row).
    responsibilities: DMatrix<f64>,
    /// Log-likelihood of all points.
    log_likelihood: f64,
}

/// E step: responsibilities of the components, and the log-likelihood. `None` if a covariance is degenerate.
fn expect(points: &[DVector<f64>], components: &[Component]) -> Option<Expectation> {
    let densities = components.iter().map(ComponentDensity::new).collect::<Option<Vec<_>>>()?;
    let mut responsibilities = DMatrix::zeros(points.len(), components.len());
    let mut log_likelihood = 0.0;
    for (row, point) in points.iter().enumerate() {
        let logs: Vec<f64> = densities.iter().map(|density| density.log(point)).collect();
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let total = top + libm::log(logs.iter().map(|log| libm::exp(log - top)).sum());
        log_likelihood += total;
        for (column, log) in logs.iter().enumerate() {
            responsibilities[(row, column)] = libm::exp(log - total);
        }
    }
    log_likelihood.is_finite().then_some(Expectation { responsibilities, log_likelihood })
}

/// Density of a component, prepared for evaluation at many points.
struct ComponentDensity {
    mean: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Log of the weight and the normalisation.
    constant: f64,
}

impl ComponentDensity {
    fn new(component: &Component) -> Option<Self> {
        let factor = Cholesky::new(component.matrix())?;
        let width = component.mean.len() as f64;
        let half_log_det: f64 = factor.l_dirty().diagonal().iter().map(|value| libm::log(*value)).sum();
        let constant =
            libm::log(component.weight) - half_log_det - 0.5 * width * libm::log(std::f64::consts::TAU);
        Some(Self { mean: DVector::from_column_slice(&component.mean), factor, constant })
    }

    fn log(&self, point: &DVector<f64>) -> f64 {
        let offset = point - &self.mean;
        let whitened = self.factor.l_dirty().solve_lower_triangular(&offset);
        self.constant - 0.5 * whitened.map_or(f64::INFINITY, |whitened| whitened.norm_squared())
    }
}

#[cfg(test)]
mod tests {
    use env_core::keyed_rng::RngPurpose;
    use proptest::prelude::*;

    use super::*;

    fn test_rng() -> KeyedRng {
        KeyedRng::new(RngPurpose::Curriculum, 5, 5)
    }

    fn clusters(centres: &[[f64; 2]], spread: f64, each: usize) -> Vec<Vec<f64>> {
        let mut rng = test_rng();
        let mut points = Vec::new();
        for n in 0..each * centres.len() {
            let centre = centres[n % centres.len()];
            points.push(centre.iter().map(|at| at + spread * standard_normal(&mut rng)).collect());
        }
        points
    }

    /// A single component has a closed form: the mean and covariance of the points.
    #[test]
    fn one_component_is_the_mean_and_covariance() {
        let points = clusters(&[[0.3, 0.7]], 0.1, 200);
        let mixture = Mixture::fit(&points, 1, &mut test_rng()).unwrap();
        let component = &mixture.components[0];
        let mean = |at: usize| points.iter().map(|point| point[at]).sum::<f64>() / 200.0;
        let cross = |a: usize, b: usize| {
            points.iter().map(|p| (p[a] - mean(a)) * (p[b] - mean(b))).sum::<f64>() / 200.0
        };
        for at in 0..2 {
            assert!((component.mean[at] - mean(at)).abs() < 1e-12);
            assert!((component.covariance[3 * at] - cross(at, at) - COVARIANCE_FLOOR).abs() < 1e-12);
        }
        assert!((component.covariance[1] - cross(0, 1)).abs() < 1e-12);
    }

    #[test]
    fn aic_finds_all_clusters() {
        let centres = [[0.2, 0.2], [0.8, 0.2], [0.5, 0.9]];
        let points = clusters(&centres, 0.04, 100);
        let mixture =
            Mixture::fit_best(&points, ComponentRange { min: 2, max: 10 }, &mut test_rng()).unwrap();
        for centre in centres {
            let near = mixture.components.iter().any(|component| {
                component.weight > 0.1
                    && component.mean.iter().zip(&centre).all(|(a, b)| (a - b).abs() < 0.03)
            });
            assert!(near, "{centre:?}: {mixture:?}");
        }
        // Akaike's criterion may choose more components than there are clusters, but never fewer.
        assert!(mixture.components.len() >= 3, "{}", mixture.components.len());
        let two = Mixture::fit(&points, 2, &mut test_rng()).unwrap();
        assert!(mixture.aic < two.aic);
    }

    #[test]
    fn em_steps_never_lower_the_likelihood() {
        let points = clusters(&[[0.2, 0.2], [0.6, 0.5]], 0.15, 60);
        let points: Vec<DVector<f64>> = points.iter().map(|p| DVector::from_column_slice(p)).collect();
        let mut responsibilities = initial_responsibilities(&points, 4, &mut test_rng());
        let mut before = f64::NEG_INFINITY;
        for _ in 0..40 {
            let expectation = expect(&points, &maximise(&points, &responsibilities)).unwrap();
            let likelihood = expectation.log_likelihood;
            // The floor under the covariances is no part of the likelihood.
            assert!(likelihood > before - 0.05, "{likelihood} after {before}");
            (responsibilities, before) = (expectation.responsibilities, likelihood);
        }
    }

    #[test]
    fn samples_follow_the_marginal_distribution() {
        let component =
            Component { weight: 1.0, mean: vec![0.4, 9.0], covariance: vec![0.04, 0.0, 0.0, 1.0] };
        let mut rng = test_rng();
        let drawn: Vec<f64> = (0..20_000).map(|_| component.sample(1, &mut rng).unwrap()[0]).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        // Four standard deviations of the two estimates.
        assert!((mean - 0.4).abs() < 0.0057 && (variance - 0.04).abs() < 0.0016, "{mean} {variance}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn enough_points_always_give_a_mixture(
            points in proptest::collection::vec((0u8..3, 0u8..3), 21..40),
            min in 1u32..=20,
        ) {
            let points: Vec<Vec<f64>> =
                points.iter().map(|(a, b)| vec![f64::from(*a) / 2.0, f64::from(*b) / 2.0]).collect();
            let mixture = Mixture::fit_best(&points, ComponentRange { min, max: min }, &mut test_rng());
            prop_assert!(mixture.is_some());
        }
    }

    #[test]
    fn too_few_points_give_none_and_equal_points_a_mixture() {
        assert!(Mixture::fit(&[], 2, &mut test_rng()).is_none());
        assert!(Mixture::fit(&[vec![0.5], vec![0.6]], 2, &mut test_rng()).is_none());
        let same = vec![vec![0.5, 0.0]; 50];
        let mixture = Mixture::fit_best(&same, ComponentRange { min: 2, max: 4 }, &mut test_rng()).unwrap();
        assert!(mixture.components.iter().all(|c| c.mean.iter().all(|value| value.is_finite())));
    }
}
