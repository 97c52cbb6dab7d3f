//! Agreement of the model judge with the rules on the same steps.

use serde::Serialize;

/// Largest absolute score that counts as neutral.
pub const MAX_NEUTRAL_SCORE: f64 = 0.25;

/// Scores of both judges on the same step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScorePair {
    /// Score of the model.
    pub model: f64,
    /// Score of the rules.
    pub rules: f64,
}

/// Band of a score.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Band {
    /// Bad step: score below −0.25.
    Blame,
    /// Neutral step: score from −0.25 to 0.25.
    Neutral,
    /// Good step: score above 0.25.
    Praise,
}

impl Band {
    /// All bands, the worst first.
    pub const ALL: [Self; 3] = [Self::Blame, Self::Neutral, Self::Praise];

    /// Returns the band of a score.
    #[must_use]
    pub fn of(score: f64) -> Self {
        if score < -MAX_NEUTRAL_SCORE {
            Self::Blame
        } else if score > MAX_NEUTRAL_SCORE {
            Self::Praise
        } else {
            Self::Neutral
        }
    }
}

/// Statistics of the agreement between model and rules.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Number of steps that both judged.
    pub steps: usize,
    /// Mean of the model's scores.
    pub model_mean: f64,
    /// Mean of the rules' scores.
    pub rules_mean: f64,
    /// Mean absolute difference of the scores.
    pub mean_difference: f64,
    /// Pearson's correlation; `None` if the scores of one judge are constant.
    pub correlation: Option<f64>,
    /// Share of steps whose scores are in the same band.
    pub same_band: f64,
    /// Cohen's kappa over the bands, weighted by the squared distance of the bands (Cohen 1968, Psychological Bulletin 70:
    /// 213–220): 1 is agreement, 0 is chance. `None` if chance alone would agree everywhere.
    pub kappa: Option<f64>,
    /// Number of steps by band: the model's in rows, the rules' in columns, blame first.
    pub bands: [[usize; 3]; 3],
}

impl Agreement {
    /// Computes the agreement over pairs of scores; `None` without pairs.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "numbers of steps are far below 2^53")]
    pub fn of(pairs: &[ScorePair]) -> Option<Self> {
        if pairs.is_empty() {
            return None;
        }
        let n = pairs.len() as f64;
        let mean = |of: fn(&ScorePair) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let (model_mean, rules_mean) = (mean(|pair| pair.model), mean(|pair| pair.rules));
        let moment = |of: &dyn Fn(f64, f64) -> f64| {
            pairs.iter().map(|pair| of(pair.model - model_mean, pair.rules - rules_mean)).sum::<f64>() / n
        };
        let covariance = moment(&|model, rules| model * rules);
        let (model_variance, rules_variance) =
            (moment(&|model, _| model * model), moment(&|_, rules| rules * rules));
        let mut bands = [[0; 3]; 3];
        for pair in pairs {
            bands[Band::of(pair.model) as usize][Band::of(pair.rules) as usize] += 1;
        }
        // Rounding leaves a small variance of constant scores.
        let varies = model_variance > 1e-12 && rules_variance > 1e-12;
        Some(Self {
            steps: pairs.len(),
            model_mean,
            rules_mean,
            mean_difference: mean(|pair| (pair.model - pair.rules).abs()),
            correlation: varies.then(|| covariance / (model_variance * rules_variance).sqrt()),
            same_band: (0..3).map(|band| bands[band][band]).sum::<usize>() as f64 / n,
            kappa: weighted_kappa(&bands),
            bands,
        })
    }
}

/// Computes Cohen's kappa with squared weights from a table of bands.
#[expect(clippy::cast_precision_loss, reason = "numbers of steps are far below 2^53")]
fn weighted_kappa(bands: &[[usize; 3]; 3]) -> Option<f64> {
    let row = |i: usize| bands[i].iter().sum::<usize>() as f64;
    let column = |j: usize| bands.iter().map(|row| row[j]).sum::<usize>() as f64;
    let n: f64 = (0..3).map(row).sum();
    let weighted = |count: &dyn Fn(usize, usize) -> f64| -> f64 {
        (0..3_usize)
            .flat_map(|i| (0..3).map(move |j| (i, j)))
            .map(|(i, j)| i.abs_diff(j).pow(2) as f64 * count(i, j))
            .sum()
    };
    let observed = weighted(&|i, j| bands[i][j] as f64);
    let chance = weighted(&|i, j| row(i) * column(j) / n);
    (chance > 0.0).then(|| 1.0 - observed / chance)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(model: f64, rules: f64) -> ScorePair {
        ScorePair { model, rules }
    }

    /// Closed forms: equal scores give 1, opposite scores −1, and a constant judge is no better than chance.
    #[test]
    fn agreement_matches_closed_forms() {
        assert_eq!(Agreement::of(&[]), None);
        let scores = [-1.0, -0.5, 0.0, 0.5, 1.0];
        let same = Agreement::of(&scores.map(|s| pair(s, s))).unwrap();
        assert_eq!((same.kappa, same.same_band, same.mean_difference), (Some(1.0), 1.0, 0.0));
        assert!((same.correlation.unwrap() - 1.0).abs() < 1e-12);
        let opposite = Agreement::of(&scores.map(|s| pair(s, -s))).unwrap();
        assert!(
            (opposite.kappa.unwrap() + 1.0).abs() < 1e-12
                && (opposite.correlation.unwrap() + 1.0).abs() < 1e-12
        );
        assert_eq!(opposite.bands, [[0, 0, 2], [0, 1, 0], [2, 0, 0]]);
        let constant = Agreement::of(&scores.map(|s| pair(0.1, s))).unwrap();
        assert_eq!((constant.correlation, constant.kappa), (None, Some(0.0)));
        let alike = Agreement::of(&[pair(0.9, 0.8), pair(1.0, 0.7)]).unwrap();
        assert_eq!((alike.kappa, alike.same_band), (None, 1.0));
    }

    /// Cohen 1968 with squared weights, by hand. The observed sum is 8. The expected one, with rows 3, 3, 4 and columns
    /// 4, 3, 3, is (4·(9 + 16) + 9 + 12 + 9 + 12)/10 = 14.2.
    #[test]
    fn kappa_matches_a_table_computed_by_hand() {
        let kappa = weighted_kappa(&[[2, 1, 0], [1, 1, 1], [1, 1, 2]]).unwrap();
        assert!((kappa - (1.0 - 8.0 / 14.2)).abs() < 1e-12, "{kappa}");
    }
}
