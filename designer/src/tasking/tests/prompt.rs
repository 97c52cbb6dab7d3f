//! Prompts and JSON schemas for a language model, word for word.

use super::*;
use crate::brief::{LayoutOutcome, LevelMastery, PastLayout};
use crate::test_support::{profile_of_one_mode, prompt_text};

#[test]
fn prompt_for_a_known_agent() {
    let mut brief = brief_at_level(CONSTELLATION, 4, 1);
    brief.profile = profile_of_one_mode(CONSTELLATION, "duplicate", Some(3), None);
    brief.mastery = Some(LevelMastery { n: 32, mean: 0.25, q10: 0.17, q90: 0.34 });
    let design = json!({"name": "shared field", "aim": {"mode": "duplicate", "orbit_angle_deg": 90}});
    let outcome = LayoutOutcome::Evaluated {
        episodes: 8,
        success_rate: 0.125,
        regret: 0.6,
        aimed_share: Some(0.5),
        is_retired: false,
    };
    brief.past_layouts = vec![PastLayout { design, rung: brief.rung(), seed: None, outcome }];
    insta::assert_snapshot!(prompt_text(&brief, 2));
    insta::assert_json_snapshot!(empty_gate().language().schema(&brief));
}

/// A task without targets has no fields.
#[test]
fn prompt_for_an_unknown_scanner() {
    let brief = DesignBrief::new(Recipe::new(env_core::task(SCANNING).unwrap()).unwrap().into(), 1, 1);
    insta::assert_snapshot!(prompt_text(&brief, 1));
    insta::assert_json_snapshot!(empty_gate().language().schema(&brief));
}
