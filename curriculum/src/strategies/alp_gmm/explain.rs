//! Explanation of the ALP-GMM strategy.

use super::mixture::Component;
use super::{AlpGmm, FIT_DELAY, LearningProgress};
use crate::core::explanation::Explanation;
use crate::core::scale::LevelScale;
use crate::core::settings::{Settings, TaskPlan};
use crate::core::strategy::StrategyState;

/// Explains the rules and the state of each task.
pub(super) fn explain(strategy: &AlpGmm, settings: &Settings) -> Explanation {
    let summary = "Params are sampled where success has been changing, and a share of them uniformly.";
    let rules = vec![
        "Tasks share the proposals by weight, each at least 5 %; scenarios need not be contested.".to_owned(),
        "Progress is the difference between a group's success rate and that of the nearest earlier group. \
         A component of the mixture is sampled by its mean progress."
            .to_owned(),
        format!("A fit takes effect {FIT_DELAY} outcomes after it started, whenever it was computed."),
    ];
    let empty = LearningProgress::default();
    Explanation::without_levels(settings, AlpGmm::VERSION, summary, rules, |plan| {
        describe_progress(strategy.tasks.get(&plan.task).unwrap_or(&empty), plan)
    })
}

fn describe_progress(progress: &LearningProgress, plan: &TaskPlan) -> String {
    let Some(mixture) = progress.mixture() else {
        return format!(
            "sampled uniformly: no mixture has been fitted to the {} outcomes so far",
            progress.seen
        );
    };
    let best = mixture.components.iter().max_by(|a, b| a.mean_progress().total_cmp(&b.mean_progress()));
    format!(
        "mixture {} with {} components after {} outcomes{}",
        progress.fits,
        mixture.components.len(),
        progress.seen,
        best.map_or_else(String::new, |component| describe_component(component, plan))
    )
}

/// Params at the centre of a component, with its mean progress.
fn describe_component(component: &Component, plan: &TaskPlan) -> String {
    let scale = LevelScale::new(plan);
    let positions: Vec<f64> =
        component.mean.iter().map(|fraction| fraction * scale.last_position()).collect();
    let params = scale.params(&positions);
    let list = scale.names().filter_map(|name| {
        let value = params.iter().find(|(known, _)| known == name)?.1;
        Some(format!("{name} {value:.2}"))
    });
    let list = list.collect::<Vec<_>>().join(", ");
    format!("; success changes most, by {:.2}, near {list}", component.mean_progress())
}
