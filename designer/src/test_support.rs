//! Checks that the tests of all worlds share.

use env_core::admission::is_success;
use env_core::keyed_rng::RngPurpose;
use env_core::rollout::replay;
use env_core::{KeyedRng, Scenario, SuccessRule};
use serde_json::Value;

use crate::brief::{LayoutOutcome, PastLayout};
use crate::procedural::ProceduralDesigner;
use crate::profile::{FailureCell, ModeProfile};
use crate::{
    AdmittedLayout, DesignBrief, DesignLanguage, EditDirection, FailureProfile, Gate, MIN_NOVELTY,
    design_language,
};

/// Asserts that a page has a table with these rows after the comment `<!-- mark -->`.
pub(crate) fn assert_documented(page: &str, mark: &str, rows: &str) {
    let (_, rest) = page.split_once(&format!("<!-- {mark} -->\n")).expect("the mark is there");
    let (table, _) = rest.split_once("<!-- end -->").expect("and its end");
    let mut lines = table.lines().filter(|line| line.starts_with('|'));
    let (_titles, _dashes) = (lines.next(), lines.next());
    let body: Vec<&str> = lines.collect();
    assert_eq!(body.join("\n").trim(), rows.trim(), "{mark}: replace the rows by:\n{rows}");
}

/// Messages of a prompt that asks for layouts, as one text.
pub(crate) fn prompt_text(brief: &DesignBrief, count: usize) -> String {
    let language = design_language(brief.recipe.task()).unwrap();
    let messages = crate::llm_designer::prompt::opening(brief, language, count);
    messages.iter().map(|message| format!("=== {:?}\n{}\n", message.role, message.content)).collect()
}

/// A profile with failures of one mode only, from one sector and band.
pub(crate) fn profile_of_one_mode(
    task: &str,
    mode: &str,
    sector: Option<u32>,
    band: Option<u32>,
) -> FailureProfile {
    let cell = FailureCell { sector, band, count: 9, weight: 9.0, ..FailureCell::default() };
    let mode = ModeProfile {
        mode: mode.to_owned(),
        count: 9,
        weight: 9.0,
        cells: vec![cell],
        ..ModeProfile::default()
    };
    FailureProfile { task: task.to_owned(), criticised: 50, weight: 50.0, modes: vec![mode] }
}

/// Edits a sampled design again and again, and asserts that each edit is canonical and changes it. Returns the number of edits.
pub(crate) fn count_edits(language: &dyn DesignLanguage, brief: &DesignBrief, attempts: u32) -> u32 {
    let mut rng = KeyedRng::new(RngPurpose::Design, 1, 1);
    let base = brief.base_scenario(0);
    let mut design = language.sample(brief, &base, &mut rng).unwrap();
    let mut edits = 0;
    for _ in 0..attempts {
        let Some(child) = language.edit(&design, brief, &base, None, &mut rng) else { continue };
        assert_ne!(child, design);
        assert_eq!(language.parse(&child, brief).unwrap(), child);
        edits += 1;
        design = child;
    }
    edits
}

/// Samples designs, and returns each with a sibling in a direction, as (parent, sibling). All siblings are canonical.
pub(crate) fn siblings(
    language: &dyn DesignLanguage,
    brief: &DesignBrief,
    direction: EditDirection,
    count: u64,
) -> Vec<[Value; 2]> {
    let pair = |number: u64| {
        let mut rng = KeyedRng::new(RngPurpose::Design, 1, number);
        let base = brief.base_scenario(number);
        let parent = language.sample(brief, &base, &mut rng)?;
        let sibling = language.edit(&parent, brief, &base, Some(direction), &mut rng)?;
        assert_eq!(language.parse(&sibling, brief).unwrap(), sibling);
        assert_ne!(sibling, parent);
        Some([parent, sibling])
    };
    (0..count).filter_map(pair).collect()
}

/// Designs layouts, and then more with the first one as the only earlier layout, which the agent always fails. Returns how many of
/// the new ones are similar to it: nearer than `distance`, but not equal.
pub(crate) fn count_children(
    language: &'static dyn DesignLanguage,
    brief: &DesignBrief,
    count: usize,
    distance: f64,
) -> usize {
    let first = ProceduralDesigner::design_layouts(brief, &mut Gate::new(language, Vec::new()));
    let parent = first.judged.iter().find_map(|judged| judged.verdict.as_ref().ok()).unwrap();
    let design = parent.scenario().recipe().layout().unwrap().provenance.clone().unwrap();
    let outcome = LayoutOutcome::Evaluated {
        episodes: 8,
        success_rate: 0.0,
        regret: 1.0,
        aimed_share: None,
        is_retired: false,
    };
    let seed = Some(parent.scenario().seed());
    let past_layouts = vec![PastLayout { design: design.clone(), rung: brief.rung(), seed, outcome }];
    let brief = DesignBrief { past_layouts, count, ..brief.clone() };
    let next = ProceduralDesigner::design_layouts(&brief, &mut Gate::new(language, vec![design.clone()]));
    let admitted = next.judged.iter().filter(|judged| judged.verdict.is_ok());
    let is_similar = |other: f64| (MIN_NOVELTY..distance).contains(&other);
    admitted.filter(|judged| is_similar(language.distance(judged.design.as_ref().unwrap(), &design))).count()
}

/// Replays an admitted layout from its JSON form with the engine, asserts what the gate found with the planner, and returns the
/// scenario that was read.
pub(crate) fn assert_reference_succeeds(admitted: &AdmittedLayout) -> Scenario {
    let stored = Scenario::from_json(&admitted.scenario().to_json()).unwrap();
    assert_eq!(stored.id(), admitted.scenario().id());
    let bracket = admitted.bracket();
    let reference = replay(&stored, &bracket.reference_plan).unwrap();
    assert_eq!(reference, bracket.reference);
    assert!(is_success(&stored, SuccessRule::Task, bracket, &reference));
    stored
}
