//! Gaussian mixtures with full covariances, fitted by expectation maximisation, their number of components by AIC.

use env_core::Draws;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

/// Steps of EM at most.
const STEPS: usize = 100;
/// The mean log-likelihood of a point must rise by this for EM to go on.
const GAIN: f64 = 1e-4;
/// Added to the diagonal of covariances, so that components on few points keep a volume.
const FLOOR: f64 = 1e-5;

/// One component.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Component {
    pub(super) weight: f64,
    pub(super) mean: Vec<f64>,
    /// Column by column; symmetric.
    pub(super) covariance: Vec<f64>,
}

/// A mixture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Mixture {
    pub(super) components: Vec<Component>,
    /// Akaike's criterion: 2 × parameters − 2 × log-likelihood (Akaike 1974).
    pub(super) aic: f64,
}

impl Mixture {
    /// The mixture of `least` to `most` components with the lowest AIC (Portelas et al. 2019, algorithm 1). None of too few points.
    pub(super) fn best(points: &[Vec<f64>], (least, most): (u32, u32), draws: &mut Draws) -> Option<Self> {
        let fits = (least..=most).filter_map(|k| Self::fit(points, k as usize, draws));
        fits.min_by(|a, b| a.aic.total_cmp(&b.aic))
    }

    /// A mixture of so many components.
    pub(super) fn fit(points: &[Vec<f64>], k: usize, draws: &mut Draws) -> Option<Self> {
        let width = points.first()?.len();
        if k == 0 || points.len() <= k || width == 0 {
            return None;
        }
        let points: Vec<DVector<f64>> =
            points.iter().map(|point| DVector::from_column_slice(point)).collect();
        let mut shares = begin(&points, k, draws);
        let mut fitted: Option<(Vec<Component>, f64)> = None;
        for _ in 0..STEPS {
            let components = maximise(&points, &shares);
            let (next, likelihood) = expect(&points, &components)?;
            let before = fitted.as_ref().map(|(_, before)| *before);
            fitted = Some((components, likelihood));
            shares = next;
            if before.is_some_and(|before| likelihood - before < GAIN * points.len() as f64) {
                break;
            }
        }
        let (components, likelihood) = fitted?;
        // Weights but one, means, and the half of covariances.
        let parameters = (k - 1) + k * width + k * width * (width + 1) / 2;
        let aic = 2.0 * parameters as f64 - 2.0 * likelihood;
        aic.is_finite().then_some(Self { components, aic })
    }
}

impl Component {
    fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_column_slice(self.mean.len(), self.mean.len(), &self.covariance)
    }

    /// A draw of the first `width` dimensions, whatever the others: the marginal of a Gaussian is one.
    pub(super) fn sample(&self, width: usize, draws: &mut Draws) -> Option<Vec<f64>> {
        let marginal = self.matrix().view((0, 0), (width, width)).into_owned();
        let factor = Cholesky::new(marginal)?;
        let noise = DVector::from_fn(width, |_, _| normal(draws));
        let point = factor.l() * noise;
        Some(point.iter().zip(&self.mean).map(|(offset, mean)| mean + offset).collect())
    }
}

/// A standard normal draw (Box and Muller 1958).
fn normal(draws: &mut Draws) -> f64 {
    let radius = libm::sqrt(-2.0 * libm::log(1.0 - draws.uniform()));
    radius * libm::cos(std::f64::consts::TAU * draws.uniform())
}

/// Each point to the nearest of k centres far from each other (k-means++: Arthur and Vassilvitskii 2007), as shares of 0 and 1.
fn begin(points: &[DVector<f64>], k: usize, draws: &mut Draws) -> DMatrix<f64> {
    let first = draws.weighted(&vec![1.0; points.len()]).unwrap_or(0);
    let mut centres = vec![points[first].clone()];
    let gap = |point: &DVector<f64>, centre: &DVector<f64>| (point - centre).norm_squared();
    while centres.len() < k {
        let near = |point| centres.iter().map(|centre| gap(point, centre)).fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = points.iter().map(near).collect();
        centres.push(points[draws.weighted(&weights).unwrap_or(0)].clone());
    }
    let mut shares = DMatrix::zeros(points.len(), k);
    for (row, point) in points.iter().enumerate() {
        let nearest = (0..k).min_by(|a, b| gap(point, &centres[*a]).total_cmp(&gap(point, &centres[*b])));
        shares[(row, nearest.unwrap_or(0))] = 1.0;
    }
    shares
}

/// Weights, means and covariances of these shares of points.
fn maximise(points: &[DVector<f64>], shares: &DMatrix<f64>) -> Vec<Component> {
    let width = points.first().map_or(0, DVector::len);
    let of = |column: usize| {
        let shares = shares.column(column);
        let all = shares.sum().max(1e-12);
        let mut mean = DVector::zeros(width);
        for (point, share) in points.iter().zip(shares.iter()) {
            mean += point * *share;
        }
        mean /= all;
        let mut covariance = DMatrix::zeros(width, width);
        for (point, share) in points.iter().zip(shares.iter()).filter(|(_, share)| **share > 0.0) {
            let offset = point - &mean;
            covariance += &offset * offset.transpose() * *share;
        }
        covariance /= all;
        covariance += DMatrix::identity(width, width) * FLOOR;
        Component {
            weight: all / points.len() as f64,
            mean: mean.iter().copied().collect(),
            covariance: covariance.iter().copied().collect(),
        }
    };
    (0..shares.ncols()).map(of).collect()
}

/// The shares of points that components have, and the log-likelihood of all. None where a covariance is degenerate.
fn expect(points: &[DVector<f64>], components: &[Component]) -> Option<(DMatrix<f64>, f64)> {
    let prepared: Option<Vec<Density>> = components.iter().map(Density::of).collect();
    let prepared = prepared?;
    let mut shares = DMatrix::zeros(points.len(), components.len());
    let mut likelihood = 0.0;
    for (row, point) in points.iter().enumerate() {
        let logs: Vec<f64> = prepared.iter().map(|density| density.log(point)).collect();
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let all = top + libm::log(logs.iter().map(|log| libm::exp(log - top)).sum());
        likelihood += all;
        for (column, log) in logs.iter().enumerate() {
            shares[(row, column)] = libm::exp(log - all);
        }
    }
    likelihood.is_finite().then_some((shares, likelihood))
}

/// A component ready to be evaluated.
struct Density {
    mean: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Log of weight and normalisation.
    constant: f64,
}

impl Density {
    fn of(component: &Component) -> Option<Self> {
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
    use env_core::draws::Purpose;

    use super::*;

    fn draws() -> Draws {
        Draws::new(Purpose::Course, 5, 5)
    }

    fn clouds(centres: &[[f64; 2]], spread: f64, each: usize) -> Vec<Vec<f64>> {
        let mut draws = draws();
        let mut points = Vec::new();
        for n in 0..each * centres.len() {
            let centre = centres[n % centres.len()];
            points.push(centre.iter().map(|at| at + spread * normal(&mut draws)).collect());
        }
        points
    }

    /// One component is the closed form: the mean and covariance of the points.
    #[test]
    fn validate_one_component_is_mean_and_covariance() {
        let points = clouds(&[[0.3, 0.7]], 0.1, 200);
        let mixture = Mixture::fit(&points, 1, &mut draws()).unwrap();
        let component = &mixture.components[0];
        let mean = |at: usize| points.iter().map(|point| point[at]).sum::<f64>() / 200.0;
        let cross = |a: usize, b: usize| {
            points.iter().map(|p| (p[a] - mean(a)) * (p[b] - mean(b))).sum::<f64>() / 200.0
        };
        for at in 0..2 {
            assert!((component.mean[at] - mean(at)).abs() < 1e-12);
            assert!((component.covariance[3 * at] - cross(at, at) - FLOOR).abs() < 1e-12);
        }
        assert!((component.covariance[1] - cross(0, 1)).abs() < 1e-12);
    }

    #[test]
    fn clouds_are_found_and_counted_by_aic() {
        let centres = [[0.2, 0.2], [0.8, 0.2], [0.5, 0.9]];
        let points = clouds(&centres, 0.04, 100);
        let mixture = Mixture::best(&points, (2, 10), &mut draws()).unwrap();
        for centre in centres {
            let near = mixture.components.iter().any(|component| {
                component.weight > 0.1
                    && component.mean.iter().zip(&centre).all(|(a, b)| (a - b).abs() < 0.03)
            });
            assert!(near, "{centre:?}: {mixture:?}");
        }
        // The criterion of Akaike forgives more components than there are, and never fewer.
        assert!(mixture.components.len() >= 3, "{}", mixture.components.len());
        let two = Mixture::fit(&points, 2, &mut draws()).unwrap();
        assert!(mixture.aic < two.aic);
    }

    #[test]
    fn the_likelihood_never_falls() {
        let points = clouds(&[[0.2, 0.2], [0.6, 0.5]], 0.15, 60);
        let points: Vec<DVector<f64>> = points.iter().map(|p| DVector::from_column_slice(p)).collect();
        let mut shares = begin(&points, 4, &mut draws());
        let mut before = f64::NEG_INFINITY;
        for _ in 0..40 {
            let (next, likelihood) = expect(&points, &maximise(&points, &shares)).unwrap();
            // The floor under covariances is no part of the likelihood.
            assert!(likelihood > before - 0.05, "{likelihood} after {before}");
            (shares, before) = (next, likelihood);
        }
    }

    #[test]
    fn samples_follow_the_marginal() {
        let component =
            Component { weight: 1.0, mean: vec![0.4, 9.0], covariance: vec![0.04, 0.0, 0.0, 1.0] };
        let mut draws = draws();
        let drawn: Vec<f64> = (0..20_000).map(|_| component.sample(1, &mut draws).unwrap()[0]).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        // Four standard deviations of the two estimates.
        assert!((mean - 0.4).abs() < 0.0057 && (variance - 0.04).abs() < 0.0016, "{mean} {variance}");
    }

    #[test]
    fn what_cannot_be_fitted_is_none_and_what_is_all_the_same_is_fitted() {
        assert!(Mixture::fit(&[], 2, &mut draws()).is_none());
        assert!(Mixture::fit(&[vec![0.5], vec![0.6]], 2, &mut draws()).is_none());
        let same = vec![vec![0.5, 0.0]; 50];
        let mixture = Mixture::best(&same, (2, 4), &mut draws()).unwrap();
        assert!(mixture.components.iter().all(|c| c.mean.iter().all(|value| value.is_finite())));
    }
}
