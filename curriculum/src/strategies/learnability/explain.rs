//! Explanation of the learnability strategy.

use super::{Learnability, ScenarioPool, ranking_method};
use crate::core::explanation::Explanation;
use crate::core::settings::Settings;
use crate::core::settings::hyperparameters::learnability::{CANDIDATES, RankingMethod};
use crate::core::strategy::StrategyState;

/// Explains the rules and the state of each task.
pub(super) fn explain(strategy: &Learnability, settings: &Settings) -> Explanation {
    let method = ranking_method(settings);
    let summary = match method {
        RankingMethod::Model => {
            "A model chooses half of the scenarios, near one half of predicted success; the other half is \
             fresh."
        }
        RankingMethod::Rollouts => {
            "Half of the proposals repeat scenarios that succeeded sometimes, neither always nor never; \
             half are fresh."
        }
    };
    let mut rules = vec![
        "Tasks share the proposals by weight, each at least 5 %; fresh scenarios are at levels drawn \
         uniformly."
            .to_owned(),
    ];
    rules.push(match method {
        RankingMethod::Model => {
            "A logistic model over params and the blind panel's success is fitted every 8 outcomes; each \
             outcome discounts those before it by 0.99."
                .to_owned()
        }
        RankingMethod::Rollouts => {
            "Of N fresh scenarios, each rolled out L times, those with the highest k(L − k)/(L(L − 1)) \
             for k successes are kept until the next N are complete. Scenarios with 0 are not kept."
                .to_owned()
        }
    });
    let empty = ScenarioPool::default();
    Explanation::without_levels(settings, Learnability::VERSION, summary, rules, |plan| {
        describe_pool(strategy.tasks.get(&plan.task).unwrap_or(&empty), settings)
    })
}

fn describe_pool(pool: &ScenarioPool, settings: &Settings) -> String {
    if ranking_method(settings) == RankingMethod::Model {
        return match &pool.model.fitted {
            None => "the model has too few outcomes yet: all levels are equally likely".to_owned(),
            Some(fitted) => {
                let list: Vec<String> = fitted.iter().map(|value| format!("{value:.2}")).collect();
                format!("coefficients of 1, the params and the panel: {}", list.join(", "))
            }
        };
    }
    let sum = pool.kept.iter().map(|scenario| scenario.learnability).sum::<f64>();
    let mean = sum / pool.kept.len().max(1) as f64;
    let kept = match pool.kept.len() {
        0 => "no scenario is kept yet".to_owned(),
        kept => format!("{kept} scenarios are kept, with a mean learnability of {mean:.2}"),
    };
    format!(
        "{kept}; of the next {} candidates, {} are rated and {} are under trial",
        settings.hyperparameters.integer(&CANDIDATES),
        pool.rated,
        pool.trials.len()
    )
}
