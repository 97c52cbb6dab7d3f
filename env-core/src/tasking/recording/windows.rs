//! Comparison of windows of access: those that were chosen, the next ones, and the lists of all.

use std::fmt::Arguments;

use serde_json::Value;

use super::read::{ReadResult, member, number, number_of, text_of};
use super::tolerances;
use crate::difference_tally::DifferenceTally;
use crate::tasking::access::{Opportunity, OpportunityKind};
use crate::tasking::simulation::TaskingSim;
use crate::tasking::simulation::journal::SatelliteEvent;

/// Window of the target that an action chose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ChosenWindow {
    /// Index of the target.
    target: usize,
    /// Opening and close, s.
    times_s: [f64; 2],
}

/// Windows of the targets that satellites were tasked with since the last call. The episode keeps a journal.
pub(super) fn take_chosen(sim: &mut TaskingSim) -> Vec<Option<ChosenWindow>> {
    let mut chosen = vec![None; sim.len()];
    for entry in sim.take_journal() {
        if let SatelliteEvent::Tasked { target, open_s, close_s } = entry.event {
            chosen[entry.satellite] = Some(ChosenWindow { target, times_s: [open_s, close_s] });
        }
    }
    chosen
}

/// Compares the target of an action and its window. A satellite without a recorded one was tasked with none.
pub(super) fn compare_selected(
    selected: &Value,
    chosen: Option<&ChosenWindow>,
    name: &str,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let recorded = selected.get(name).filter(|window| !window.is_null());
    let theirs = recorded.map(|window| window["target"].as_str().unwrap_or_default());
    let ours = chosen.map(|window| sim.targets()[window.target].name.as_str());
    tally.compare_outcomes(&ours, &theirs, format_args!("target of {name}"));
    if let (Some(chosen), Some(recorded)) = (chosen, recorded)
        && ours == theirs
    {
        let theirs = [number_of(recorded, "open")?, number_of(recorded, "close")?];
        let what = format_args!("window that {name} chose");
        compare_times(OpportunityKind::Target, chosen.times_s, theirs, what, tally);
    }
    Ok(())
}

/// Compares the opening and the close of a window, s.
fn compare_times(
    kind: OpportunityKind,
    ours: [f64; 2],
    theirs: [f64; 2],
    what: Arguments<'_>,
    tally: &mut DifferenceTally,
) {
    let (quantity, allowed) = match kind {
        OpportunityKind::Target => ("target_window", tolerances::TARGET_WINDOW_S),
        OpportunityKind::GroundStation => ("station_window", tolerances::STATION_WINDOW_S),
    };
    for ((ours, theirs), end) in ours.into_iter().zip(theirs).zip(["opening", "close"]) {
        tally.compare_numbers(quantity, ours, theirs, allowed, format_args!("{end} of the {what}"));
    }
}

/// Compares the next window of a ground station.
pub(super) fn compare_next_station(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let Some(next) = recorded.get("next_ground_station").filter(|next| next.is_object()) else {
        return Ok(());
    };
    let kind = OpportunityKind::GroundStation;
    let Some(ours) = sim.next_windows(index, kind, 1).first().copied() else {
        tally.add_mismatch(format!("{name} has no next ground station, recorded {next}"));
        return Ok(());
    };
    let what = format_args!("next ground station of {name}");
    tally.compare_outcomes(object_name(&ours, sim).as_str(), text_of(next, "station")?, what);
    let theirs = [number_of(next, "open")?, number_of(next, "close")?];
    let times = [ours.open_s, ours.close_s];
    compare_times(kind, times, theirs, format_args!("next window of a station of {name}"), tally);
    Ok(())
}

/// Name of an opportunity's object in BSK-RL.
fn object_name(item: &Opportunity, sim: &TaskingSim) -> String {
    match item.kind {
        OpportunityKind::Target => sim.targets()[item.object].name.clone(),
        OpportunityKind::GroundStation => format!("GroundStation{}", sim.stations()[item.object].name),
    }
}

/// Compares the lists of opportunities at the end of the episode.
pub(super) fn compare_opportunities(
    recording: &Value,
    names: &[String],
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    for (index, name) in names.iter().enumerate() {
        let Some(list) = recording["opportunities"].get(name) else { continue };
        let ours = sim.opportunities(index);
        let end = number_of(list, "window_calculation_time")?;
        // Older recordings of scanning list the windows of the reset.
        if ours.computed_s() < end - tolerances::TIME_S {
            tally.add_mismatch(format!("windows of {name} reach {} s, recorded {end} s", ours.computed_s()));
            continue;
        }
        let mut items: Vec<Opportunity> = ours.all().into_iter().filter(|item| item.open_s < end).collect();
        items.iter_mut().for_each(|item| item.close_s = item.close_s.min(end));
        let theirs = member(list, "windows")?.as_array().ok_or("`windows` is not a list")?;
        tally.compare_outcomes(&items.len(), &theirs.len(), format_args!("number of windows of {name}"));
        if theirs.len() != items.len() {
            continue;
        }
        for (item, row) in items.iter().zip(theirs) {
            compare_window(item, row, name, sim, tally)?;
        }
    }
    Ok(())
}

fn compare_window(
    item: &Opportunity,
    row: &Value,
    name: &str,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let (object, theirs) = (object_name(item, sim), row[1].as_str().unwrap_or_default());
    tally.compare_outcomes(object.as_str(), theirs, format_args!("object of a window of {name}"));
    if object == theirs {
        let (ours, theirs) = ([item.open_s, item.close_s], [number(&row[2])?, number(&row[3])?]);
        compare_times(item.kind, ours, theirs, format_args!("window of {object} for {name}"), tally);
    }
    Ok(())
}
