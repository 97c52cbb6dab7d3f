//! Design jobs and their results keep every value on their way, and wrong results are refused.

use std::sync::Arc;
use std::time::Duration;

use designer::brief::{DesignRung, LayoutOutcome, LevelMastery, PastLayout};
use designer::procedural::ProceduralDesigner;
use designer::profile::{FailureCell, ModeProfile};
use designer::reported::ReportedVerdict;
use designer::{DesignBrief, DesignOutcome, FailureProfile};
use env_core::{Recipe, Seed};
use proptest::prelude::*;

use super::*;

/// A job with every part of a brief.
fn job() -> DesignJob {
    let task = env_core::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::at_level(task, 2).unwrap());
    let mut brief = DesignBrief::new(recipe, 2, 7).at_level(task.levels(), 2);
    let cell =
        FailureCell { sector: Some(3), band: None, count: 2, weight: 0.1 + 0.2, ..FailureCell::default() };
    let mode = ModeProfile {
        mode: "collision".to_owned(),
        count: 2,
        weight: 1.5,
        cells: vec![cell],
        ..ModeProfile::default()
    };
    brief.profile = FailureProfile { criticised: 9, weight: 1.5, modes: vec![mode], ..brief.profile };
    brief.mastery = Some(LevelMastery { n: 3, mean: 0.3, q10: 0.1, q90: 1.0 / 3.0 });
    brief.time_limit = Some(Duration::from_secs(540));
    let design = ProceduralDesigner::preview(&brief, design_language(task).unwrap(), 1).remove(0);
    let rung = DesignRung { level: Some(2), start_scale: None };
    let evaluated = LayoutOutcome::Evaluated {
        episodes: 4,
        success_rate: 0.25,
        regret: 0.7,
        aimed_share: Some(0.1),
        is_retired: false,
    };
    let refused = LayoutOutcome::Refused { check: "new".to_owned(), reason: "known".to_owned() };
    for outcome in [evaluated, refused, LayoutOutcome::Untested] {
        let seed = (outcome == LayoutOutcome::Untested).then(|| Seed::user(5).unwrap());
        brief.past_layouts.push(PastLayout { design: design.clone(), rung, seed, outcome });
    }
    // The first attempt of the designer is known, so that the gate refuses it.
    let archive = ProceduralDesigner::preview(&brief, design_language(task).unwrap(), 1);
    DesignJob { run: "run".to_owned(), designer: JobDesigner::Procedural, brief, archive }
}

fn design(job: &DesignJob) -> DesignOutcome {
    ProceduralDesigner::design_layouts(&job.brief, &mut job.gate().unwrap())
}

fn check(output: DesignOutput, job: &DesignJob, is_audited: bool) -> Result<DesignOutcome, DesignFault> {
    output.check(job, &mut job.gate().unwrap(), |_| is_audited)
}

#[test]
fn a_decoded_job_is_the_same_and_has_the_same_result() {
    let job = job();
    let decoded = DesignJob::decode(&job.encode().unwrap()).unwrap();
    assert_eq!(decoded, job);
    let outcome = design(&decoded);
    assert_eq!(outcome, design(&job));
    assert!(outcome.admitted() > 0 && outcome.judged.len() > outcome.admitted());
    let output = DesignOutput::from(&outcome);
    let received = DesignOutput::decode(&output.encode().unwrap()).unwrap();
    assert_eq!(received, output);
    for is_audited in [false, true] {
        let checked = check(received.clone(), &job, is_audited).unwrap();
        assert_eq!(DesignOutput::from(&checked), output, "with the verdicts of the worker");
        let scenarios = |outcome: &DesignOutcome| {
            let admitted = outcome.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok());
            admitted.map(|admitted| (admitted.scenario().id(), admitted.novelty())).collect::<Vec<_>>()
        };
        assert_eq!(scenarios(&checked), scenarios(&outcome));
    }
}

#[test]
fn a_result_that_does_not_fit_is_refused() {
    let job = job();
    let output = DesignOutput::from(&design(&job));
    let with = |change: &dyn Fn(&mut DesignOutput)| {
        let mut output = output.clone();
        change(&mut output);
        check(output, &job, false)
    };
    assert!(with(&|_| {}).is_ok());
    let faults: [&dyn Fn(&mut DesignOutput); 5] = [
        &|output| output.usage.cost = f64::NAN,
        &|output| output.usage.model = Some("m".to_owned()),
        &|output| output.layouts.reverse(),
        &|output| output.layouts[0].attempt = 1 << 40,
        &|output| output.warnings = vec![String::new(); 20_000],
    ];
    for fault in faults {
        assert!(matches!(with(fault), Err(DesignFault::Form(_))));
    }
    let forged = with(&|output| {
        for layout in &mut output.layouts {
            if let ReportedVerdict::Admitted { bracket, .. } = &mut layout.verdict {
                bracket.reference.score += 0.5;
            }
        }
    });
    assert!(matches!(forged, Err(DesignFault::Layout { .. })));
    let other = DesignJob { designer: JobDesigner::Llm, ..job.clone() };
    let dense = output.layouts.iter().zip(0..).all(|(layout, index)| layout.attempt == index);
    assert!(dense || check(output, &other, false).is_err(), "attempts of a model have no gaps");
}

#[test]
fn only_wrong_layouts_differ_when_they_are_judged_again() {
    let job = job();
    let mut output = DesignOutput::from(&design(&job));
    let scenarios = |output: &DesignOutput| {
        let outcome = check(output.clone(), &job, false).unwrap();
        let admitted = outcome.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok());
        admitted.map(|admitted| admitted.scenario().id()).collect::<Vec<_>>()
    };
    let admitted = scenarios(&output);
    let equal = |is_equal: &[bool]| {
        let rejudged = admitted.iter().zip(is_equal);
        rejudged.map(|(&scenario, &is_equal)| RejudgedLayout { scenario, is_equal }).collect::<Vec<_>>()
    };
    assert_eq!(output.clone().judge_admitted(&job).unwrap(), equal(&[true; 2]));
    // The panel of a bracket passes the check, but not a second judgement.
    let first = output.layouts.iter_mut().find(|layout| layout.is_admitted()).unwrap();
    let ReportedVerdict::Admitted { bracket, .. } = &mut first.verdict else { panic!("admitted") };
    bracket.panel[1].score -= 1e-9;
    assert_eq!(scenarios(&output), admitted);
    assert_eq!(output.judge_admitted(&job).unwrap(), equal(&[false, true]));
}

#[test]
fn invalid_jobs_are_refused() {
    let many = DesignJob { brief: DesignBrief { count: MAX_COUNT + 1, ..job().brief }, ..job() };
    assert!(DesignJob::decode(&many.encode().unwrap()).is_err());
    let mut heavy = job();
    heavy.brief.profile.modes[0].weight = f64::INFINITY;
    assert!(DesignJob::decode(&heavy.encode().unwrap()).is_err());
}

proptest! {
    #[test]
    fn damaged_messages_are_refused_without_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let _ = DesignJob::decode(&bytes);
        let _ = DesignOutput::decode(&bytes);
    }
}
