//! Table of a task's sampler: the latest draws and successes at each rung.

use curriculum::{RungKind, RungState, SamplerState};
use maud::{Markup, html};

/// Renders the sampler of a task.
pub(super) fn sampler_table(sampler: &SamplerState) -> Markup {
    let SamplerState { name, reason, state, kind, rungs, proposals, .. } = sampler;
    let has_chains = rungs.iter().any(|rung| rung.chains.is_some());
    let is_start = *kind == Some(RungKind::Start);
    html! {
        h3 { "Sampler: " (name) }
        p .soft {
            @if let Some(reason) = reason { "Chosen by auto, because " (reason) ". " }
            "State: " (state) "."
            @if kind.is_none() { " The strategy draws params instead of rungs." }
            @else { " Shares are of the last " (proposals) " proposals of the task; success rates are of about 64 episodes." }
        }
        @if !rungs.is_empty() {
            details { summary { "Rungs of the sampler (" (rungs.len()) ")" }
                div .wide { table {
                    thead { tr {
                        th .n { @if is_start { "Rung" } @else { "Level" } }
                        @if is_start { th .n { "Start scale" } }
                        th .n { "Share of proposals" } th .n { "Next proposal" }
                        @if has_chains { th .n { "Chains" } }
                        th .n { "Success rate" } th .n { "Recent episodes" }
                    } }
                    tbody { @for rung in rungs { (rung_row(rung, *proposals)) } }
                } }
            }
        }
    }
}

fn rung_row(rung: &RungState, proposals: u32) -> Markup {
    let percent =
        |share: Option<f64>| share.map_or_else(|| "–".to_owned(), |share| format!("{:.1} %", 100.0 * share));
    let share = (proposals > 0).then(|| f64::from(rung.draws) / f64::from(proposals));
    html! { tr {
        td .n { (rung.rung) }
        @if let Some(scale) = rung.start_scale { td .n { (scale) } }
        td .n { (percent(share)) }
        td .n { (percent(rung.probability)) }
        @if let Some(chains) = rung.chains { td .n { (chains) } }
        td .n { (percent((rung.attempts > 0.0).then(|| rung.successes / rung.attempts))) }
        td .n { (format!("{:.1}", rung.attempts)) }
    } }
}
