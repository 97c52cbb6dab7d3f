//! How far a model and the rules agree on the same steps.

use serde::Serialize;

/// Scores beyond this, either way, are praise or blame.
pub const NEUTRAL: f64 = 0.25;

/// What a score amounts to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Band {
    /// Below −0.25.
    Blame,
    /// Between.
    Neutral,
    /// Above 0.25.
    Praise,
}

impl Band {
    /// All, the worst first.
    pub const ALL: [Self; 3] = [Self::Blame, Self::Neutral, Self::Praise];

    /// Of a score.
    #[must_use]
    pub fn of(score: f64) -> Self {
        if score < -NEUTRAL {
            Self::Blame
        } else if score > NEUTRAL {
            Self::Praise
        } else {
            Self::Neutral
        }
    }
}

/// How far two judges agree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Steps that both judged.
    pub steps: usize,
    /// Mean of the model's scores.
    pub model_mean: f64,
    /// Mean of the rules' scores.
    pub rules_mean: f64,
    /// Mean absolute difference.
    pub mean_difference: f64,
    /// Pearson's correlation; none where one of them always says the same.
    pub correlation: Option<f64>,
    /// The share of steps in the same band.
    pub same_band: f64,
    /// Cohen's kappa over the bands, weighted by the square of how far they are apart (Cohen 1968, Psychological Bulletin 70:
    /// 213–220): 1 agreement, 0 chance; none where chance alone would agree everywhere.
    pub kappa: Option<f64>,
    /// Steps by band: rows the model's, columns the rules', blame first.
    pub bands: [[usize; 3]; 3],
}

/// How far pairs (the model's score, the rules') agree; none where there are no pairs.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "numbers of steps are far below 2^53")]
pub fn agreement(pairs: &[(f64, f64)]) -> Option<Agreement> {
    if pairs.is_empty() {
        return None;
    }
    let n = pairs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (model_mean, rules_mean) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let moment = |of: &dyn Fn(f64, f64) -> f64| {
        pairs.iter().map(|&(a, b)| of(a - model_mean, b - rules_mean)).sum::<f64>() / n
    };
    let (both, model, rules) = (moment(&|a, b| a * b), moment(&|a, _| a * a), moment(&|_, b| b * b));
    let mut bands = [[0; 3]; 3];
    for &(model, rules) in pairs {
        bands[Band::of(model) as usize][Band::of(rules) as usize] += 1;
    }
    Some(Agreement {
        steps: pairs.len(),
        model_mean,
        rules_mean,
        mean_difference: mean(|(a, b)| (a - b).abs()),
        // Rounding leaves a little where all are alike.
        correlation: (model > 1e-12 && rules > 1e-12).then(|| both / (model * rules).sqrt()),
        same_band: (0..3).map(|band| bands[band][band]).sum::<usize>() as f64 / n,
        kappa: kappa(&bands),
        bands,
    })
}

#[expect(clippy::cast_precision_loss, reason = "numbers of steps are far below 2^53")]
fn kappa(bands: &[[usize; 3]; 3]) -> Option<f64> {
    let row = |i: usize| bands[i].iter().sum::<usize>() as f64;
    let column = |j: usize| bands.iter().map(|row| row[j]).sum::<usize>() as f64;
    let n: f64 = (0..3).map(row).sum();
    let weighted = |count: &dyn Fn(usize, usize) -> f64| -> f64 {
        (0..3_usize)
            .flat_map(|i| (0..3).map(move |j| (i, j)))
            .map(|(i, j)| i.abs_diff(j).pow(2) as f64 * count(i, j))
            .sum()
    };
    let seen = weighted(&|i, j| bands[i][j] as f64);
    let chance = weighted(&|i, j| row(i) * column(j) / n);
    (chance > 0.0).then(|| 1.0 - seen / chance)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Closed forms: perfect agreement is 1, the opposite −1, one that always says the same is no better than chance.
    #[test]
    fn agreement_in_closed_form() {
        assert_eq!(agreement(&[]), None);
        let scores = [-1.0, -0.5, 0.0, 0.5, 1.0];
        let same = agreement(&scores.map(|s| (s, s))).unwrap();
        assert_eq!((same.kappa, same.same_band, same.mean_difference), (Some(1.0), 1.0, 0.0));
        assert!((same.correlation.unwrap() - 1.0).abs() < 1e-12);
        let opposite = agreement(&scores.map(|s| (s, -s))).unwrap();
        assert!(
            (opposite.kappa.unwrap() + 1.0).abs() < 1e-12
                && (opposite.correlation.unwrap() + 1.0).abs() < 1e-12
        );
        assert_eq!(opposite.bands, [[0, 0, 2], [0, 1, 0], [2, 0, 0]]);
        let constant = agreement(&scores.map(|s| (0.1, s))).unwrap();
        assert_eq!((constant.correlation, constant.kappa), (None, Some(0.0)));
        let alike = agreement(&[(0.9, 0.8), (1.0, 0.7)]).unwrap();
        assert_eq!((alike.kappa, alike.same_band), (None, 1.0));
    }

    /// Cohen 1968, weights of squared distance, on a table computed by hand: seen four of distance 1 and one of
    /// distance 2, 8; by chance (rows 3, 3, 4; columns 4, 3, 3) (4·(9 + 16) + 9 + 12 + 9 + 12)/10 = 14.2.
    #[test]
    fn kappa_of_a_table() {
        let kappa = kappa(&[[2, 1, 0], [1, 1, 1], [1, 1, 2]]).unwrap();
        assert!((kappa - (1.0 - 8.0 / 14.2)).abs() < 1e-12, "{kappa}");
    }
}
