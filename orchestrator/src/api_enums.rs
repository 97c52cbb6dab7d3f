//! Conversions between the enums of the store and those of the API.
//!
//! The store's enums are what the database contains, the API's what clients receive; the two change at different times.

use api_types as api;

use crate::queries::run_series;

use store::{
    alerts, columns, curriculum, design_requests, episodes, evaluations, events, groups, layouts, leases,
    run_filter, run_list, run_warnings, runs,
};

/// Conversion between an enum of the store and the enum of the API that has the same variants.
///
/// A trait of this crate, because `From` cannot be implemented here for types of two other crates.
pub(crate) trait ConvertEnum<To> {
    /// The variant of the other enum with the same name.
    fn convert(self) -> To;
}

/// Implements [`ConvertEnum`] between two enums whose variants have the same names.
macro_rules! convert_enum {
    ($from:ty => $to:ty { $($variant:ident),+ $(,)? }) => {
        impl ConvertEnum<$to> for $from {
            fn convert(self) -> $to {
                match self {
                    $(Self::$variant => <$to>::$variant,)+
                }
            }
        }
    };
}

convert_enum!(alerts::AlertRule => api::AlertRule { NoResults, MissingShare, LowDisk, LevelDown, EvaluationWorse, WorkerLost });
convert_enum!(columns::ClaimState => api::ClaimState { Claimed, Accepted, Refused, Unproven });
convert_enum!(curriculum::LevelMoveKind => api::LevelMoveKind { Placement, Up, Down });
convert_enum!(design_requests::DesignerKind => api::DesignerKind { Llm, Procedural });
convert_enum!(design_requests::RequestOrigin => api::DesignRequestOrigin { Worker, User });
convert_enum!(design_requests::RequestState => api::DesignRequestState { Waiting, Running, Done, Failed });
convert_enum!(episodes::EpisodeState => api::EpisodeState { Finished, Failed, Late });
convert_enum!(evaluations::EvaluationState => api::EvaluationState { Open, Running, Complete, Failed });
convert_enum!(events::EventKind => api::EventKind { Run, Lease, Group, Move, Claim, Failures, Design, Worker, Warning });
convert_enum!(groups::GroupState => api::GroupState { Open, Complete, Partial, Lost });
convert_enum!(groups::GroupRole => api::GroupRole {
    Placement, Frontier, Rehearsal, Sample, Explore, Replay, Edit, Boundary, Rung, Coverage, Designed, Suite,
});
convert_enum!(api::GroupRole => groups::GroupRole {
    Placement, Frontier, Rehearsal, Sample, Explore, Replay, Edit, Boundary, Rung, Coverage, Designed, Suite,
});
convert_enum!(layouts::LayoutState => api::DesignState { Active, Retired, Refused });
convert_enum!(layouts::LayoutKind => api::LayoutKind { Threat, Decoy });
convert_enum!(leases::Purpose => api::LeasePurpose { Train, Probe, Eval });
convert_enum!(api::LeasePurpose => leases::Purpose { Train, Probe, Eval });
convert_enum!(leases::Disclosure => api::LeaseDisclosure { Lease, Begin });
convert_enum!(api::LeaseDisclosure => leases::Disclosure { Lease, Begin });
convert_enum!(leases::LeaseForm => api::LeaseForm { Groups, Columns });
convert_enum!(leases::LeaseStatus => api::LeaseStatus { Active, Done, Released, Expired });
convert_enum!(run_warnings::WarningKind => api::RunWarningKind { RefusedClaim, UnprovenClaim });
convert_enum!(run_filter::RunActivity => api::RunActivity { Waiting, Running, Idle, Paused, Archived });
convert_enum!(api::RunActivity => run_filter::RunActivity { Waiting, Running, Idle, Paused, Archived });
convert_enum!(api::RunSort => run_list::RunSortKey { Created, Name, Episodes, LastResults, Skill });
convert_enum!(api::RunGroupProperty => run_list::RunGrouping { Strategy, Tasks, Tag, Activity });
convert_enum!(run_series::SeriesResolution => api::SeriesResolution { Episodes, Minutes, Hours });
convert_enum!(::curriculum::RungKind => api::RungKind { Start, Level });
convert_enum!(runs::RunStatus => api::RunStatus { Active, Paused });
