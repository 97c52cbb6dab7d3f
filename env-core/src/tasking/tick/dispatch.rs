//! Choice of the instruction set for a block of lanes.

use pulp::{Simd, WithSimd};

use super::kernel::run_ticks;
use super::parts::TickConstants;
use super::state::{TickInputs, TickState};

/// Number of lanes of a block.
pub const BLOCK_LANES: usize = 8;

/// The widest instruction set of this machine.
#[derive(Debug, Clone, Copy)]
pub enum InstructionSet {
    /// AVX-512: one register holds eight lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512(pulp::x86::V4),
    /// AVX2: two registers hold eight lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
    /// NEON: four registers hold eight lanes.
    #[cfg(target_arch = "aarch64")]
    Neon(pulp::aarch64::Neon),
    /// Plain floating-point numbers, lane by lane.
    Scalar,
}

impl InstructionSet {
    /// Detects the widest instruction set of this machine.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(avx512) = pulp::x86::V4::try_new() {
                return Self::Avx512(avx512);
            }
            if let Some(avx2) = pulp::x86::V3::try_new() {
                return Self::Avx2(avx2);
            }
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(neon) = pulp::aarch64::Neon::try_new() {
            return Self::Neon(neon);
        }
        Self::Scalar
    }

    /// All instruction sets of this machine.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut sets = vec![Self::Scalar];
        #[cfg(target_arch = "x86_64")]
        {
            sets.extend(pulp::x86::V3::try_new().map(Self::Avx2));
            sets.extend(pulp::x86::V4::try_new().map(Self::Avx512));
        }
        #[cfg(target_arch = "aarch64")]
        sets.extend(pulp::aarch64::Neon::try_new().map(Self::Neon));
        sets
    }

    /// Name of the instruction set.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "AVX2",
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => "NEON",
            Self::Scalar => "scalar",
        }
    }
}

/// Memory of a block with a number of lanes.
pub trait BlockLanes<const W: usize> {
    /// Runs up to `ticks` ticks (see [`run_ticks`]). Returns their number.
    fn run(self, set: InstructionSet) -> u32;
}

/// A run of ticks of a block.
#[derive(Debug)]
pub struct TickRun<'a, const W: usize> {
    /// State of the lanes.
    pub state: &'a mut TickState<[f64; W]>,
    /// Inputs of the lanes.
    pub inputs: &'a TickInputs<[f64; W]>,
    /// Constants of the ticks.
    pub constants: &'a TickConstants,
    /// Largest number of ticks.
    pub ticks: u32,
}

/// A run with `N` registers for the lanes.
struct InRegisters<'a, const N: usize, const W: usize>(TickRun<'a, W>);

impl<const N: usize, const W: usize> WithSimd for InRegisters<'_, N, W> {
    type Output = u32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u32 {
        let TickRun { state, inputs, constants, ticks } = self.0;
        run_ticks::<S, N, W>(simd, state, inputs, constants, ticks)
    }
}

impl BlockLanes<1> for TickRun<'_, 1> {
    fn run(self, _: InstructionSet) -> u32 {
        Simd::vectorize(pulp::Scalar::new(), InRegisters::<1, 1>(self))
    }
}

impl BlockLanes<BLOCK_LANES> for TickRun<'_, BLOCK_LANES> {
    fn run(self, set: InstructionSet) -> u32 {
        match set {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(avx512) => Simd::vectorize(avx512, InRegisters::<1, BLOCK_LANES>(self)),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(avx2) => Simd::vectorize(avx2, InRegisters::<2, BLOCK_LANES>(self)),
            #[cfg(target_arch = "aarch64")]
            InstructionSet::Neon(neon) => Simd::vectorize(neon, InRegisters::<4, BLOCK_LANES>(self)),
            InstructionSet::Scalar => {
                Simd::vectorize(pulp::Scalar::new(), InRegisters::<8, BLOCK_LANES>(self))
            }
        }
    }
}
