//! Seeds of the scenarios that are drawn for a run.

use env_core::{Seed, SeedSpace};

/// Returns the seed of a draw in a space, derived from (run seed, sequence number, number of the draw).
#[must_use]
pub fn seed_of(space: SeedSpace, run_seed: u64, seq: u64, draw: u64) -> Seed {
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 scenario seeds");
    for part in [run_seed, seq, draw] {
        hasher.update(&part.to_le_bytes());
    }
    let mut bits = [0; 8];
    hasher.finalize_xof().fill(&mut bits);
    Seed::in_space(space, u64::from_le_bytes(bits))
}
