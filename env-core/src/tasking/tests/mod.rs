//! Tests of the tasking world: replays of BSK-RL's recordings, laws, and equality of lanes.

mod altered_recordings;
mod composition;
mod environments;
mod lanes;
mod laws;
mod recordings;
mod samples;
mod start_rungs;
mod validate_bsk_episodes;
mod validate_bsk_orbit;
mod validate_bsk_sky;
mod validate_bsk_windows;
mod windows;
