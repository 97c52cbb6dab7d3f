//! ALP-GMM for people.

use super::super::explain::Explanation;
use super::super::scale::Scale;
use super::super::settings::{Settings, TaskPlan};
use super::{AlpGmm, LATER, Task, VERSION};

pub(super) fn explain(of: &AlpGmm, settings: &Settings) -> Explanation {
    let rules = vec![
        "Tasks by their weight, each at least 5 %; scenarios as they come.".to_owned(),
        "Progress is how far a success share is from that of the nearest draw before. A mixture is drawn by the mean progress of \
         its components."
            .to_owned(),
        format!("A fit is in force {LATER} outcomes after it was begun, whenever it was computed."),
    ];
    let blank = Task::default();
    Explanation::of(
        settings,
        VERSION,
        ("Params are drawn where success has been changing, and now and then anywhere.", rules),
        |plan| now(of.tasks.get(&plan.task).unwrap_or(&blank), plan),
    )
}

fn now(task: &Task, plan: &TaskPlan) -> String {
    let Some(mixture) = &task.mixture else {
        return format!("drawn uniformly: no mixture was fitted to the {} outcomes that are in", task.seen);
    };
    let best = mixture.components.iter().max_by(|a, b| {
        let progress = |mean: &[f64]| mean.last().copied().unwrap_or(0.0);
        progress(&a.mean).total_cmp(&progress(&b.mean))
    });
    let where_ = best.map_or_else(String::new, |component| {
        let scale = Scale::of(plan);
        let places: Vec<f64> = component.mean.iter().map(|share| share * scale.top()).collect();
        let params = scale.params(&places);
        let list = scale.names().filter_map(|name| {
            let value = params.iter().find(|(known, _)| known == name)?.1;
            Some(format!("{name} {value:.2}"))
        });
        let progress = component.mean.last().copied().unwrap_or(0.0);
        format!("; success changes most, by {progress:.2}, about {}", list.collect::<Vec<_>>().join(", "))
    });
    format!(
        "mixture {} of {} components after {} outcomes{where_}",
        task.fits,
        mixture.components.len(),
        task.seen
    )
}
