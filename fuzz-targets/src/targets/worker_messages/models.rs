//! Messages of jobs for which a language model may be asked: designs and rollouts.

use std::sync::{Arc, LazyLock};

use designer::brief::{DesignRung, LayoutOutcome, PastLayout};
use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignOutcome};
use env_core::{Recipe, Scenario, Seed, SeedSpace};
use jobs::design::{DesignJob, DesignOutput, JobDesigner};
use jobs::seeds::seed_of;
use rollout::{ChatSampling, PolicySources, RolledOutGroup, RolloutJob, RolloutPolicy};

use super::is_stable;

const TASK: &str = "kessler/survival";
/// Magic number of zstd, and a descriptor: one segment, with its size in four bytes.
const FRAME_HEAD: [u8; 5] = [0x28, 0xb5, 0x2f, 0xfd, 0xa0];
/// Largest block of a frame of zstd.
const MAX_BLOCK_BYTES: usize = 128 << 10;

fn recipe() -> Arc<Recipe> {
    let task = env_core::task(TASK).expect("the task exists");
    Arc::new(Recipe::at_level(task, 2).expect("the task has levels"))
}

/// A job for each designer, with an earlier layout.
fn design_jobs() -> &'static [DesignJob] {
    static JOBS: LazyLock<Vec<DesignJob>> = LazyLock::new(|| {
        let mut brief = DesignBrief::new(recipe(), 1, 7).at_level(recipe().task().levels(), 2);
        let language = designer::design_language(recipe().task()).expect("the world can be designed for");
        let known = ProceduralDesigner::preview(&brief, language, 1);
        let rung = DesignRung { level: Some(2), start_scale: None };
        let (seed, outcome) = (Seed::user(5).ok(), LayoutOutcome::Untested);
        let past = known.iter().map(|design| PastLayout {
            design: design.clone(),
            rung,
            seed,
            outcome: outcome.clone(),
        });
        brief.past_layouts = past.collect();
        let job = |designer| DesignJob {
            run: "run".to_owned(),
            designer,
            brief: brief.clone(),
            archive: known.clone(),
        };
        [JobDesigner::Procedural, JobDesigner::Llm].map(job).to_vec()
    });
    &JOBS
}

pub(super) fn design_job(bytes: &[u8]) -> bool {
    is_stable(DesignJob::decode(bytes), DesignJob::encode, DesignJob::decode)
}

pub(super) fn design_job_seeds() -> Vec<Vec<u8>> {
    design_jobs().iter().map(|job| job.encode().expect("a job can be written")).collect()
}

/// A result is stable, and the server checks it without a panic: it uses the layouts, or refuses them.
pub(super) fn design_result(bytes: &[u8]) -> bool {
    let Ok(output) = DesignOutput::decode(bytes) else { return false };
    is_stable(DesignOutput::decode(bytes), DesignOutput::encode, DesignOutput::decode);
    for job in design_jobs() {
        let mut gate = job.gate().expect("the world can be designed for");
        if let Ok(outcome) = output.clone().check(job, &mut gate, |_| false) {
            let known = job.archive.len() + outcome.admitted();
            assert_eq!(gate.archive().len(), known, "the archive has the admitted layouts");
        }
    }
    true
}

pub(super) fn design_result_seeds() -> Vec<Vec<u8>> {
    let job = &design_jobs()[0];
    let mut gate = job.gate().expect("the world can be designed for");
    let outcome = ProceduralDesigner::design_layouts(&job.brief, &mut gate);
    let written = |judged: &[designer::JudgedLayout]| {
        let outcome = DesignOutcome { judged: judged.to_vec(), ..outcome.clone() };
        DesignOutput::from(&outcome).encode().expect("a result can be written")
    };
    let last = outcome.judged.len().saturating_sub(1);
    vec![written(&[]), written(&outcome.judged[last..]), written(&outcome.judged[..last.min(2)])]
}

fn rollout_jobs() -> &'static [RolloutJob] {
    static JOBS: LazyLock<Vec<RolloutJob>> = LazyLock::new(|| {
        let sampling = ChatSampling { temperature: Some(0.5), history: 2, max_tokens: None };
        let policies = [
            RolloutPolicy::Reference("hold".to_owned()),
            RolloutPolicy::Reference("onnx:model.onnx@0123456789ab".to_owned()),
            RolloutPolicy::Chat(sampling),
        ];
        let job = |policy| RolloutJob {
            run: "run".to_owned(),
            policy_version: 3,
            scenario: Scenario::new(recipe(), seed_of(SeedSpace::Training, 3, 1, 0)),
            policy,
            seeds: vec![1],
            records_observations: true,
        };
        policies.map(job).to_vec()
    });
    &JOBS
}

pub(super) fn rollout_job(bytes: &[u8]) -> bool {
    is_stable(RolloutJob::decode(bytes), RolloutJob::encode, RolloutJob::decode)
}

pub(super) fn rollout_job_seeds() -> Vec<Vec<u8>> {
    rollout_jobs().iter().map(|job| job.encode().expect("a job can be written")).collect()
}

/// A group is read as it is sent, or from its JSON, of which mutations get further.
pub(super) fn rollout_result(bytes: &[u8]) -> bool {
    let frame = frame(bytes);
    let accepted = rollout_jobs().iter().flat_map(|job| {
        [bytes, &frame].map(|message| {
            let Ok(group) = RolledOutGroup::decode(job, message) else { return false };
            assert_eq!(group.outcomes.len(), job.seeds.len(), "it has other episodes");
            group.encode().expect("a group that was read can be written");
            true
        })
    });
    accepted.fold(false, |any, accepted| any | accepted)
}

/// A frame of zstd without compression.
fn frame(json: &[u8]) -> Vec<u8> {
    let size = u32::try_from(json.len()).unwrap_or(u32::MAX);
    let mut frame = [&FRAME_HEAD[..], &size.to_le_bytes()].concat();
    let mut blocks = json.chunks(MAX_BLOCK_BYTES).peekable();
    while let Some(block) = blocks.next() {
        let is_last = u32::from(blocks.peek().is_none());
        let head = (block.len() as u32) << 3 | is_last;
        frame.extend(&head.to_le_bytes()[..3]);
        frame.extend(block);
    }
    frame
}

/// A group of a built-in policy as JSON and as a message, and one that the infrastructure lost.
pub(super) fn rollout_result_seeds() -> Vec<Vec<u8>> {
    let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread starts");
    let runtime = tokio::runtime::Builder::new_current_thread().build().expect("the runtime starts");
    let sources = PolicySources::default();
    let job = Arc::new(rollout_jobs()[0].clone());
    let group = runtime.block_on(sources.roll_out(&job, &threads)).expect("the policy exists");
    let json = |group: &RolledOutGroup| serde_json::to_vec(group).expect("a group has a JSON form");
    let mut lost = group.clone();
    for outcome in &mut lost.outcomes {
        outcome.episode = Err("the endpoint did not answer".to_owned());
    }
    vec![json(&group), json(&lost), group.encode().expect("the group is small")]
}
