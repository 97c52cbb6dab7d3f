//! Failure profile of a run: why its episodes lose score.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::{ActionVerdict, SectorQuantity};

/// Query of the failure profiles.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct FailureProfileQuery {
    /// Id of the only task to return.
    pub task: Option<String>,
    /// Largest number of example episodes for each cell, newest first, from 0 to 64 (default 3). The newest 64 failures of a cell
    /// are kept; several of them may be of one episode.
    #[param(minimum = 0, maximum = 64, default = 3)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, 64>")]
    pub examples: Option<u32>,
}

/// Failure profiles of a run's tasks.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FailureProfiles {
    /// Id of the run.
    pub run: String,
    /// Number of criticised episodes of a task after which the weight of a failure halves.
    pub half_life: f64,
    /// Backlog of the critique.
    #[serde(flatten)]
    pub backlog: CritiqueBacklog,
    /// One profile for each task of the run.
    pub tasks: Vec<FailureProfile>,
}

/// Backlog of a run's critique.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct CritiqueBacklog {
    /// Number of reported episodes that wait for their critique.
    pub waiting: i64,
    /// True if the backlog is so long that only a sample is criticised. The sample depends on the episode id alone, so shares stay
    /// unbiased; counts are not scaled up for skipped episodes.
    pub sampling: bool,
    /// Share of the episodes that is criticised now.
    pub sampled_share: f64,
}

/// Failure profile of a task. A failure has weight 1 when it is added; the weight halves every half-life.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FailureProfile {
    /// Id of the task.
    pub task: String,
    /// Number of criticised episodes, the base of all counts below.
    pub criticised: i64,
    /// Sum of the weights of the criticised episodes.
    pub weight: f64,
    /// Number of episodes that were skipped by sampling.
    pub skipped: i64,
    /// Number of episodes whose critique failed; the server's log has the reasons.
    pub failed: i64,
    /// Number of waiting episodes. criticised + skipped + failed + waiting are the finished episodes of training and probes.
    pub waiting: i64,
    /// Mean value of the judge, from −1 to 1; null before the first episode.
    pub judge: Option<Trend>,
    /// Numbers of actions by verdict.
    pub verdicts: Vec<VerdictCount>,
    /// Angle that the sectors divide.
    pub sector_quantity: SectorQuantity,
    /// The 12 sectors of that angle.
    pub sectors: Vec<ProfileSector>,
    /// Bands of relative speed.
    pub bands: Vec<SpeedBand>,
    /// Failure modes of the task, including those that never occurred.
    pub modes: Vec<FailureModeCounts>,
}

/// Mean or share, over recent episodes and over all.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
pub struct Trend {
    /// Weighted value, over recent episodes.
    pub recent: f64,
    /// Value over all criticised episodes.
    pub overall: f64,
}

/// Number of actions with one verdict.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct VerdictCount {
    /// Verdict on the actions.
    pub verdict: ActionVerdict,
    /// Number of actions with the verdict.
    pub count: i64,
    /// Number of actions per episode.
    pub per_episode: Option<Trend>,
}

/// Sector of a failure profile, as data.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ProfileSector {
    /// Number of the sector, from 0.
    pub sector: u32,
    /// Centre of the sector, degrees; it extends 15° to either side.
    pub angle_deg: f64,
}

/// Band of relative speeds.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct SpeedBand {
    /// Number of the band, from 0.
    pub band: u32,
    /// Lowest speed of the band, inclusive.
    pub from: f64,
    /// Highest speed of the band, exclusive; null for the last.
    pub to: Option<f64>,
    /// Unit of both speeds.
    pub unit: String,
}

/// Failures of one mode.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FailureModeCounts {
    /// Name of the failure mode.
    pub mode: String,
    /// Description in one sentence.
    pub description: String,
    /// Number of these failures.
    pub count: i64,
    /// Sum of the weights of these failures.
    pub weight: f64,
    /// Number of failures per episode.
    pub per_episode: Option<Trend>,
    /// Share of the task's failures, by weight and by count; null before the first failure.
    pub share: Option<Trend>,
    /// Failures by sector and band; empty cells are left out.
    pub cells: Vec<FailureCell>,
    /// The same failures by sector of the inertial frame: sector 0 is centred on +X, 3 on +Y. Empty sectors are left out; empty in
    /// a world without such a frame.
    pub inertial_sectors: Vec<InertialSectorCounts>,
}

/// Failures of one mode from one sector of the inertial frame.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct InertialSectorCounts {
    /// Number of the sector, from 0.
    pub sector: u32,
    /// Number of these failures.
    pub count: u64,
    /// Sum of the weights of these failures.
    pub weight: f64,
}

/// Failures of one mode in one sector and one speed band.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FailureCell {
    /// Sector of the angle, from 0 to 11; null without an angle.
    pub sector: Option<u32>,
    /// Speed band, from 0; null without an encounter.
    pub band: Option<u32>,
    /// Number of these failures.
    pub count: i64,
    /// Sum of the weights of these failures.
    pub weight: f64,
    /// Share of the failures that actions after the body became visible, with the remaining fuel, would have avoided; null
    /// without encounters.
    pub avoidable_share: Option<f64>,
    /// Share of the failures in which the body was never visible; null without encounters.
    pub unseen_share: Option<f64>,
    /// Mean number of steps in which the agent could act after the body became visible; null without encounters.
    pub mean_steps_left: Option<f64>,
    /// Time of the latest failure, RFC 3339.
    pub last_at: String,
    /// Ids of the newest example episodes, newest first.
    pub episodes: Vec<String>,
}

/// Query of the failures behind a profile.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct FailureQuery {
    /// Id of the task.
    pub task: String,
    /// Name of the failure mode.
    pub mode: Option<String>,
    /// Sector of the angle, from 0 to 11.
    #[param(minimum = 0, maximum = 11)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, 11>")]
    pub sector: Option<u32>,
    /// Speed band, from 0.
    pub band: Option<u32>,
    /// Largest number of failures on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}

/// Page of the failures behind a profile.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FailurePage {
    /// Failures, newest first. The newest 64 of each cell of the profile are kept.
    pub failures: Vec<EpisodeFailure>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Failure of an episode.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EpisodeFailure {
    /// Id of the episode.
    pub episode: String,
    /// Name of the failure mode.
    pub mode: String,
    /// Index of the agent that failed.
    pub agent: i64,
    /// Step of the failure, from 1.
    pub step: i64,
    /// Sector of the angle, from 0 to 11; null without an angle.
    pub sector: Option<u32>,
    /// Speed band, from 0; null without an encounter.
    pub band: Option<u32>,
    /// Angle that the sectors of the profile divide, degrees; null if the failure has none.
    pub sector_deg: Option<f64>,
    /// Relative speed, in the world's unit of speed.
    pub relative_speed: Option<f64>,
    /// Number of steps in which the agent could act after the body became visible.
    pub steps_left: Option<i64>,
    /// True if actions after the body became visible would have avoided the failure; null without an encounter, or if the body
    /// was never visible.
    pub avoidable: Option<bool>,
}
