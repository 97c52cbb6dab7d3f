//! A curriculum in this process, in the place of a server.

use std::collections::HashMap;
use std::sync::Mutex;

use api_types::{
    ClaimedEpisodeCounts, EpisodeCounts, GroupCounts, GroupRole, GroupState, Lease, LeaseDisclosure,
    LeaseForm, LeasePurpose, LeaseStatus, LeasedGroup, MasteryEstimate, ReceiptStatus, ResultReceipt,
    ResultsResponse, TaskMastery,
};
use curriculum::{
    Curriculum, EpisodeTally, GroupOutcome, LearningSignals, ObservedOutcome, Proposal, ScenarioSource,
    SequencedProposal, Settings, Slot, SuccessInterval, TaskPlan,
};
use env_core::admission::{is_contested, is_success};
use env_core::log::Precision;
use env_core::{Bracket, Scenario, SeedSpace, SuccessRule, rollout};
use jobs::prepare::{DrawContext, SeedSource, prepare, unsolvable::UnsolvableParams};

use crate::demo::designs::Designs;
use crate::demo::feed::{Feed, FinishedEpisode};
use crate::demo::train::MEMBERS;

/// Curriculum in this process that serves leases like a server.
pub(super) struct LocalFeed {
    seed: u64,
    state: Mutex<LocalState>,
}

struct LocalState {
    curriculum: Curriculum,
    open: HashMap<String, OpenGroup>,
    flown: HashMap<String, i64>,
}

/// Leased group, stored under the id of its first episode.
#[derive(Clone)]
struct OpenGroup {
    seq: u64,
    proposal: Proposal,
    scenario: Scenario,
    bracket: Bracket,
}

impl LocalFeed {
    pub(super) fn new(seed: u64, tasks: &[&str]) -> Self {
        let plans = tasks.iter().map(|task| TaskPlan::standard(task).unwrap()).collect();
        let settings = Settings { placement: false, ..Settings::ladder(plans) };
        let curriculum = Curriculum::new(seed, settings).unwrap();
        Self {
            seed,
            state: Mutex::new(LocalState { curriculum, open: HashMap::new(), flown: HashMap::new() }),
        }
    }
}

impl Feed for LocalFeed {
    async fn lease(&self, groups: usize, _: u32) -> anyhow::Result<Lease> {
        let mut state = self.state.lock().unwrap();
        let mut lease = Lease {
            lease: "1-abcdef".to_owned(),
            run: "r".to_owned(),
            purpose: LeasePurpose::Train,
            form: LeaseForm::Groups,
            status: LeaseStatus::Active,
            group_size: MEMBERS as i64,
            policy_version: 0,
            expires_at: String::new(),
            recipes: Vec::new(),
            disclosure: LeaseDisclosure::Lease,
            groups: Vec::new(),
            undisclosed: Vec::new(),
            ranges: None,
        };
        for index in 0..groups {
            let SequencedProposal { seq, proposal } = state.curriculum.propose();
            let prepared = prepare(
                SeedSource { space: SeedSpace::Training, run_seed: self.seed, seq },
                &proposal,
                None,
                DrawContext { unsolvable: &UnsolvableParams::default(), is_wanted: &|| true },
            )?;
            let episodes: Vec<String> = (0..MEMBERS).map(|i| format!("ep_{seq}_{i}")).collect();
            lease.recipes.push(prepared.scenario.recipe().to_json());
            lease.groups.push(LeasedGroup {
                group: index as i64,
                recipe: index,
                seed: prepared.scenario.seed().get(),
                scenario: prepared.scenario.id().to_string(),
                task: proposal.task.clone(),
                level: proposal.level.map(i64::from),
                role: GroupRole::Frontier,
                train: true,
                layout: None,
                contested: prepared.is_contested,
                state: GroupState::Open,
                episodes: episodes.clone(),
                bracket: None,
            });
            if prepared.is_contested {
                let slot = Slot {
                    proposal: seq,
                    group: 0,
                    lease: 1,
                    task: proposal.task.clone(),
                    level: proposal.level,
                    epoch: proposal.epoch,
                    role: proposal.role,
                };
                state.curriculum.open_slots(&[slot]);
            }
            let open = OpenGroup { seq, proposal, scenario: prepared.scenario, bracket: prepared.bracket };
            state.open.insert(episodes[0].clone(), open);
        }
        Ok(lease)
    }

    async fn report(&self, _: u32, results: Vec<FinishedEpisode>) -> anyhow::Result<ResultsResponse> {
        let mut state = self.state.lock().unwrap();
        let (mut receipts, mut all_moves) = (Vec::new(), Vec::new());
        for group in results.chunks(MEMBERS) {
            let open = state.open.remove(&group[0].id).unwrap();
            let judged: Vec<ResultReceipt> = group.iter().map(|finished| judge(&open, finished)).collect();
            let successes = judged.iter().filter(|receipt| receipt.success == Some(true)).count();
            let ObservedOutcome { moves, .. } = state.curriculum.observe(&outcome(&open, successes));
            *state.flown.entry(open.proposal.task.clone()).or_default() += MEMBERS as i64;
            receipts.extend(judged);
            all_moves.extend(moves);
        }
        Ok(ResultsResponse { results: receipts, moves: all_moves, groups: Vec::new(), refills: Vec::new() })
    }

    async fn designs(&self) -> anyhow::Result<Designs> {
        Ok(Designs::default())
    }

    async fn mastery(&self) -> anyhow::Result<Vec<TaskMastery>> {
        let state = self.state.lock().unwrap();
        let mastery = state.curriculum.mastery();
        let task = |status: curriculum::TaskStatus| {
            let estimate = mastery.iter().find(|m| m.task == status.task && m.level == status.level);
            let episodes = state.flown.get(&status.task).copied().unwrap_or(0);
            TaskMastery {
                task: status.task.clone(),
                level: status.level,
                probe_level: status.probe_level,
                placement_done: status.placement_done,
                mean_rung: None,
                params: status.params.iter().cloned().collect(),
                mastery: estimate.map(|m| MasteryEstimate {
                    level: m.level,
                    n: m.n,
                    mean: m.mean,
                    q10: m.q10,
                    q90: m.q90,
                    missing: m.missing,
                    open: m.open,
                    seen: u64::from(m.n),
                }),
                levels: Vec::new(),
                results: EpisodeCounts { episodes, ..EpisodeCounts::default() },
                designed_results: EpisodeCounts::default(),
                claimed_results: ClaimedEpisodeCounts::default(),
                group_counts: GroupCounts::default(),
                warnings: status.warnings.clone(),
                held_back: status.held_back.clone(),
                status,
            }
        };
        Ok(state.curriculum.status().into_iter().map(task).collect())
    }
}

fn judge(open: &OpenGroup, finished: &FinishedEpisode) -> ResultReceipt {
    let result = finished.clone().into_result();
    let steps = result.actions.unwrap().steps;
    let log = rollout::read_log(&open.scenario, &steps, Precision::F64, None).unwrap();
    let outcome = rollout::replay(&open.scenario, &log).unwrap();
    ResultReceipt {
        episode: result.episode,
        status: ReceiptStatus::Counted,
        code: None,
        detail: None,
        score: Some(outcome.score),
        skill: open.bracket.skill(outcome.score),
        success: Some(is_success(&open.scenario, SuccessRule::Task, &open.bracket, &outcome)),
    }
}

fn outcome(open: &OpenGroup, successes: usize) -> GroupOutcome {
    GroupOutcome {
        is_designed: false,
        proposal: open.seq,
        group: 0,
        task: open.proposal.task.clone(),
        level: open.proposal.level,
        start_rung: None,
        chain: None,
        epoch: open.proposal.epoch,
        role: open.proposal.role,
        contested: is_contested(&open.scenario, &open.bracket),
        finished: MEMBERS as u32,
        successes: successes as u32,
        steps: 0,
        evidence: is_contested(&open.scenario, &open.bracket).then(|| {
            let (size, successes) = (MEMBERS as u32, successes as u32);
            SuccessInterval::of_episodes(EpisodeTally { size, finished: size, successes, abandoned: 0 })
        }),
        usable: true,
        mean_score: 0.0,
        mean_skill: None,
        source: ScenarioSource::Fresh,
        params: Vec::new(),
        signals: LearningSignals::default(),
    }
}
