//! The random draws of an episode: a trait with two implementations.
//!
//! [`SeededRng`] draws from ChaCha8 streams keyed by (scenario seed, purpose), so that an additional draw for one purpose
//! does not change the others. [`ScriptedRng`] replays recorded draws.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::seed::Seed;

/// Purpose of a draw. Each purpose has its own stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RngStream {
    /// Initial states of the agents.
    Agents,
    /// Initial states of the generated bodies; each body has a fixed number of draws.
    Bodies,
    /// Redraws of one body whose start was not fair.
    Redraw(u32),
    /// Decision whether a body arrives in a step; one draw per step.
    Arrivals,
    /// Initial state of an arriving body.
    ArrivalPlace,
    /// Velocity changes of fragments.
    Fragments,
    /// Candidates of a planner; never part of an episode.
    Planner,
    /// Actions of stochastic policies; never part of the world.
    Policy,
    /// Placement of additional threats.
    ThreatPlacement,
    /// Error of a conjunction warning. Each warning has its own stream, so that observing it changes no other draw.
    Warning {
        /// Step after which the warning is given.
        step: u32,
        /// Number of the satellite at risk.
        satellite: u32,
        /// Id of the debris.
        debris: u32,
    },
    /// Start of an episode in time.
    Epoch,
    /// Initial orbits of satellites.
    Orbit,
    /// Initial attitudes, rates and wheel speeds of satellites.
    Attitude,
    /// Initial charge and data of satellites.
    Resources,
    /// Positions and priorities of targets.
    Targets,
}

impl RngStream {
    /// Slot in the table of open streams, and ChaCha stream number.
    const fn address(self) -> (usize, u64) {
        match self {
            Self::Agents => (0, 0),
            Self::Bodies => (1, 0),
            Self::Redraw(body) => (2, body as u64),
            Self::Arrivals => (3, 0),
            Self::ArrivalPlace => (4, 0),
            Self::Fragments => (5, 0),
            Self::Planner => (6, 0),
            Self::Policy => (7, 0),
            Self::ThreatPlacement => (8, 0),
            Self::Warning { step, satellite, debris } => {
                (9, (step as u64) << 40 | (satellite as u64) << 32 | debris as u64)
            }
            Self::Epoch => (10, 0),
            Self::Orbit => (11, 0),
            Self::Attitude => (12, 0),
            Self::Resources => (13, 0),
            Self::Targets => (14, 0),
        }
    }
}

/// Number of purposes of draws.
const SLOTS: usize = 15;
/// Number that no stream has.
const CLOSED: u64 = u64::MAX;

/// Random number generator of an episode.
pub trait EpisodeRng {
    /// The next draw of `stream`, uniform in [0, 1).
    fn uniform(&mut self, stream: RngStream) -> f64;

    /// Fills `draws` with the next draws of `stream`, in order.
    fn fill(&mut self, stream: RngStream, draws: &mut [f64]) {
        for draw in draws {
            *draw = self.uniform(stream);
        }
    }

    /// Uniform in [low, high).
    fn uniform_in(&mut self, stream: RngStream, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform(stream)
    }

    /// Fills `draws` with the first draws of `stream`, independently of earlier draws and without consuming them.
    fn peek(&self, stream: RngStream, draws: &mut [f64]);

    /// Two independent standard normal draws, computed from the first two of `stream` without consuming them (Box and Muller
    /// 1958).
    fn peek_normals(&self, stream: RngStream) -> [f64; 2] {
        let mut uniform = [0.0; 2];
        self.peek(stream, &mut uniform);
        normals_of(uniform)
    }

    /// Two independent standard normal draws, computed from the next two of `stream` (Box and Muller 1958).
    fn normals(&mut self, stream: RngStream) -> [f64; 2] {
        let mut uniform = [0.0; 2];
        self.fill(stream, &mut uniform);
        normals_of(uniform)
    }
}

/// Two independent standard normal numbers of two uniform ones.
fn normals_of(uniform: [f64; 2]) -> [f64; 2] {
    // 1 − u is never zero, so its logarithm is finite.
    let length = (-2.0 * libm::log(1.0 - uniform[0])).sqrt();
    let (sin, cos) = libm::sincos(std::f64::consts::TAU * uniform[1]);
    [length * cos, length * sin]
}

/// Draws that a scenario's seed determines.
#[derive(Debug, Clone)]
pub struct SeededRng {
    seed: u64,
    open: [Option<(u64, Box<ChaCha8Rng>)>; SLOTS],
}

impl SeededRng {
    /// Creates the generator of a seed, at the start of every stream.
    #[must_use]
    pub fn new(seed: Seed) -> Self {
        Self { seed: seed.get(), open: [const { None }; SLOTS] }
    }

    /// Switches to another seed, at the start of every stream, in the same memory.
    pub fn reseed(&mut self, seed: Seed) {
        self.seed = seed.get();
        for (number, _) in self.open.iter_mut().flatten() {
            *number = CLOSED;
        }
    }

    fn generator(seed: u64, slot: usize, number: u64) -> ChaCha8Rng {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&(slot as u64).to_le_bytes());
        key[16..].copy_from_slice(b"sparring chance1");
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(number);
        generator
    }

    /// The generator of a stream; opens the stream if needed.
    #[inline]
    fn open(&mut self, stream: RngStream) -> Option<&mut ChaCha8Rng> {
        let (slot, number) = stream.address();
        let open = &mut self.open[slot];
        match open {
            Some((of, _)) if *of == number => {}
            Some((of, generator)) => {
                *of = number;
                **generator = Self::generator(self.seed, slot, number);
            }
            None => *open = Some((number, Box::new(Self::generator(self.seed, slot, number)))),
        }
        open.as_mut().map(|(_, generator)| &mut **generator)
    }

    /// Memory of the open streams, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.open.iter().flatten().count() * size_of::<ChaCha8Rng>()
    }
}

impl EpisodeRng for SeededRng {
    fn uniform(&mut self, stream: RngStream) -> f64 {
        // `open` always returns a generator.
        self.open(stream).map_or(0.0, |generator| unit(generator.next_u64()))
    }

    fn fill(&mut self, stream: RngStream, draws: &mut [f64]) {
        if let Some(generator) = self.open(stream) {
            for draw in draws {
                *draw = unit(generator.next_u64());
            }
        }
    }

    fn peek(&self, stream: RngStream, draws: &mut [f64]) {
        let (slot, number) = stream.address();
        let mut generator = Self::generator(self.seed, slot, number);
        draws.fill_with(|| unit(generator.next_u64()));
    }
}

/// Converts the top 53 bits to a multiple of 2⁻⁵³, which is exact, so equal on every platform.
#[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64 exactly")]
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Recorded draws, returned in order from a queue per stream.
#[derive(Debug, Clone, Default)]
pub struct ScriptedRng {
    queues: [std::collections::VecDeque<f64>; SLOTS],
    missing: u32,
}

impl ScriptedRng {
    /// Creates a generator without draws.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends a draw in [0, 1] to the queue of a stream.
    pub fn push_draw(&mut self, stream: RngStream, draw: f64) {
        self.queues[stream.address().0].push_back(draw);
    }

    /// Number of draws that were requested from an empty queue; each returned ½.
    #[must_use]
    pub const fn missing_draws(&self) -> u32 {
        self.missing
    }
}

impl EpisodeRng for ScriptedRng {
    fn uniform(&mut self, stream: RngStream) -> f64 {
        self.queues[stream.address().0].pop_front().unwrap_or_else(|| {
            self.missing += 1;
            0.5
        })
    }

    fn peek(&self, stream: RngStream, draws: &mut [f64]) {
        let mut script = self.queues[stream.address().0].iter().copied();
        draws.fill_with(|| script.next().unwrap_or(0.5));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first draws of each stream are committed, so that no change of a dependency changes a scenario.
    #[test]
    fn regress_golden_first_draws() {
        let mut rng = SeededRng::new(Seed::new(42).unwrap());
        let streams = [
            RngStream::Agents,
            RngStream::Bodies,
            RngStream::Redraw(0),
            RngStream::Redraw(7),
            RngStream::Arrivals,
            RngStream::ArrivalPlace,
            RngStream::Fragments,
            RngStream::Planner,
            RngStream::Policy,
            RngStream::ThreatPlacement,
            RngStream::Warning { step: 0, satellite: 0, debris: 0 },
            RngStream::Warning { step: 7, satellite: 2, debris: 300 },
        ];
        let draws: Vec<String> =
            streams.iter().map(|&s| format!("{s:?} {:?} {:?}", rng.uniform(s), rng.uniform(s))).collect();
        insta::assert_debug_snapshot!(draws);
    }

    #[test]
    fn streams_are_independent() {
        let seed = Seed::new(7).unwrap();
        let (mut a, mut b) = (SeededRng::new(seed), SeededRng::new(seed));
        for _ in 0..100 {
            b.uniform(RngStream::Fragments);
        }
        for _ in 0..10 {
            assert_eq!(a.uniform(RngStream::Bodies).to_bits(), b.uniform(RngStream::Bodies).to_bits());
        }
    }

    #[test]
    fn peeking_consumes_no_draws() {
        let stream = RngStream::Warning { step: 3, satellite: 1, debris: 12 };
        let mut rng = SeededRng::new(Seed::new(7).unwrap());
        let (mut before, mut after) = ([0.0; 3], [0.0; 3]);
        rng.peek(stream, &mut before);
        let drawn = [(); 3].map(|()| rng.uniform(stream));
        rng.peek(stream, &mut after);
        assert_eq!((before, before), (drawn, after));
        let mut script = ScriptedRng::new();
        script.push_draw(stream, 0.25);
        script.peek(stream, &mut before);
        assert_eq!((before, script.missing_draws(), script.uniform(stream)), ([0.25, 0.5, 0.5], 0, 0.25));
    }

    #[test]
    fn normals_have_the_normal_distribution() {
        let rng = SeededRng::new(Seed::new(1).unwrap());
        let n = 50_000u32;
        let (mut mean, mut square, mut cross, mut beyond) = (0.0, 0.0, 0.0, 0u32);
        for debris in 0..n {
            let [a, b] = rng.peek_normals(RngStream::Warning { step: 1, satellite: 0, debris });
            mean += (a + b) / f64::from(2 * n);
            square += (a * a + b * b) / f64::from(2 * n);
            cross += a * b / f64::from(n);
            beyond += u32::from(a.abs() > 1.959_964) + u32::from(b.abs() > 1.959_964);
        }
        // Bounds of five standard deviations: of the mean of 2n draws 1/√2n, of their mean square √2/√2n, of the mean of n
        // products 1/√n, and of the share beyond the 97.5 % quantile √(0.05·0.95/2n).
        let root = f64::from(2 * n).sqrt();
        assert!(mean.abs() < 5.0 / root, "{mean}");
        assert!((square - 1.0).abs() < 5.0 * 2.0f64.sqrt() / root, "{square}");
        assert!(cross.abs() < 5.0 / f64::from(n).sqrt(), "{cross}");
        let share = f64::from(beyond) / f64::from(2 * n);
        assert!((share - 0.05).abs() < 5.0 * (0.05f64 * 0.95).sqrt() / root, "{share}");
    }

    #[test]
    fn draws_are_uniform() {
        let mut rng = SeededRng::new(Seed::new(1).unwrap());
        let n = 100_000;
        let mean = (0..n).map(|_| rng.uniform(RngStream::Bodies)).sum::<f64>() / f64::from(n);
        // The mean of n uniform draws has a standard deviation of √(1/12n) = 0.0009: five of them.
        assert!((mean - 0.5).abs() < 0.0046, "{mean}");
    }
}
