//! Learnability for people.

use super::super::explain::{Explanation, TaskStatus};
use super::super::settings::Settings;
use super::{CANDIDATES, Learnability, Pool, VERSION, by_model};

pub(super) fn status(settings: &Settings) -> Vec<TaskStatus> {
    settings.tasks.iter().map(|plan| TaskStatus::unmoved(&plan.task, Vec::new())).collect()
}

pub(super) fn explain(of: &Learnability, settings: &Settings) -> Explanation {
    let model = by_model(settings);
    let summary = match model {
        true => {
            "Half of what is faced is chosen by a model of what succeeds about half the time, half is drawn."
        }
        false => {
            "Half of what is faced are scenarios that succeeded now and then, neither always nor never; half is new."
        }
    };
    let mut rules =
        vec!["Tasks by their weight, each at least 5 %; new scenarios at levels drawn uniformly.".to_owned()];
    rules.push(match model {
        true => "A logistic model over params and the blind panel's success is fitted every 32 outcomes on the last 256 of what was \
                 drawn."
            .to_owned(),
        false => "Of N new scenarios, each flown L times, those with the highest k(L − k)/(L(L − 1)), k of them successes, are kept \
                  until the next N are through. What has 0 is not kept."
            .to_owned(),
    });
    let blank = Pool::default();
    Explanation::of(settings, VERSION, (summary, rules), |plan| {
        now(of.tasks.get(&plan.task).unwrap_or(&blank), settings)
    })
}

fn now(pool: &Pool, settings: &Settings) -> String {
    if by_model(settings) {
        return match &pool.model.fitted {
            None => "the model has too few outcomes yet: all is drawn".to_owned(),
            Some(fitted) => {
                let list: Vec<String> = fitted.iter().map(|value| format!("{value:.2}")).collect();
                format!("coefficients of 1, the params and the panel: {}", list.join(", "))
            }
        };
    }
    let mean = pool.kept.iter().map(|tried| tried.learnability).sum::<f64>() / pool.kept.len().max(1) as f64;
    let kept = match pool.kept.len() {
        0 => "nothing is kept yet".to_owned(),
        kept => format!("{kept} scenarios are kept, their mean learnability {mean:.2}"),
    };
    format!(
        "{kept}; of the next {} candidates {} were tried, {} are under trial",
        settings.tuning.whole(&CANDIDATES),
        pool.tried,
        pool.trials.len()
    )
}
