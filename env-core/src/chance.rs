//! Every random draw an episode makes, through one small trait with two implementations.
//!
//! [`Seeded`] draws from ChaCha8 streams keyed by (scenario seed, purpose), so that one more draw of one kind shifts no
//! other kind. [`Scripted`] gives back draws that were recorded elsewhere.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::seed::Seed;

/// What a draw is for. Each purpose has its own stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stream {
    /// Where the agents start.
    Agents,
    /// Where the generated bodies start, each body a fixed number of draws.
    Bodies,
    /// A second (third …) try for one body whose start was not fair.
    Redraw(u32),
    /// Whether something arrives in a step; one draw a step.
    Arrivals,
    /// Where an arrival appears.
    ArrivalPlace,
    /// The kick of a fragment.
    Fragments,
    /// What a planner tries; never part of an episode.
    Planner,
    /// What a policy with chance in it does; never part of the world.
    Policy,
    /// Where a threat is planted.
    Plant,
    /// What a conjunction warning errs by: a stream for each of them, so that whether anybody looks shifts nothing.
    Warning {
        /// The step after which it is given.
        step: u32,
        /// Whom it warns.
        satellite: u32,
        /// Of what, by its id.
        debris: u32,
    },
}

impl Stream {
    /// (slot in the table of open streams, ChaCha stream number).
    const fn place(self) -> (usize, u64) {
        match self {
            Self::Agents => (0, 0),
            Self::Bodies => (1, 0),
            Self::Redraw(body) => (2, body as u64),
            Self::Arrivals => (3, 0),
            Self::ArrivalPlace => (4, 0),
            Self::Fragments => (5, 0),
            Self::Planner => (6, 0),
            Self::Policy => (7, 0),
            Self::Plant => (8, 0),
            Self::Warning { step, satellite, debris } => {
                (9, (step as u64) << 40 | (satellite as u64) << 32 | debris as u64)
            }
        }
    }
}

const SLOTS: usize = 10;
/// No stream has this number.
const CLOSED: u64 = u64::MAX;

/// A source of draws.
pub trait Chance {
    /// The next draw of `stream`, uniform in [0, 1).
    fn uniform(&mut self, stream: Stream) -> f64;

    /// The next draws of `stream`, in order.
    fn fill(&mut self, stream: Stream, draws: &mut [f64]) {
        for draw in draws {
            *draw = self.uniform(stream);
        }
    }

    /// Uniform in [low, high).
    fn between(&mut self, stream: Stream, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform(stream)
    }

    /// The first draws of `stream`, whatever was drawn of it, without drawing them.
    fn first(&self, stream: Stream, draws: &mut [f64]);

    /// Two independent draws from the standard normal distribution, made of the first two of `stream` without drawing
    /// them (Box and Muller 1958).
    fn first_normals(&self, stream: Stream) -> (f64, f64) {
        let mut uniform = [0.0; 2];
        self.first(stream, &mut uniform);
        // 1 − u is never zero, so that its logarithm is a number.
        let length = (-2.0 * libm::log(1.0 - uniform[0])).sqrt();
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * uniform[1]);
        (length * cos, length * sin)
    }
}

/// Draws decided by a scenario's seed.
#[derive(Debug, Clone)]
pub struct Seeded {
    seed: u64,
    open: [Option<(u64, Box<ChaCha8Rng>)>; SLOTS],
}

impl Seeded {
    /// The draws of this seed, from the start of every stream.
    #[must_use]
    pub fn new(seed: Seed) -> Self {
        Self { seed: seed.get(), open: [const { None }; SLOTS] }
    }

    /// The draws of another seed, from the start of every stream, in the same memory.
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
}

impl Seeded {
    /// The generator of a stream, opened where it is not open.
    #[inline]
    fn open(&mut self, stream: Stream) -> Option<&mut ChaCha8Rng> {
        let (slot, number) = stream.place();
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

    /// Bytes of its open streams.
    pub(crate) fn bytes(&self) -> usize {
        self.open.iter().flatten().count() * size_of::<ChaCha8Rng>()
    }
}

impl Chance for Seeded {
    fn uniform(&mut self, stream: Stream) -> f64 {
        // There always is one: it was opened where it was not.
        self.open(stream).map_or(0.0, |generator| unit(generator.next_u64()))
    }

    fn fill(&mut self, stream: Stream, draws: &mut [f64]) {
        if let Some(generator) = self.open(stream) {
            for draw in draws {
                *draw = unit(generator.next_u64());
            }
        }
    }

    fn first(&self, stream: Stream, draws: &mut [f64]) {
        let (slot, number) = stream.place();
        let mut generator = Self::generator(self.seed, slot, number);
        draws.fill_with(|| unit(generator.next_u64()));
    }
}

/// The top 53 bits as a multiple of 2⁻⁵³: exact, so the same on every platform.
#[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64 exactly")]
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Draws recorded elsewhere, given back in order, stream by stream.
#[derive(Debug, Clone, Default)]
pub struct Scripted {
    queues: [std::collections::VecDeque<f64>; SLOTS],
    missing: u32,
}

impl Scripted {
    /// No draws yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends a draw in [0, 1] to a stream.
    pub fn push(&mut self, stream: Stream, draw: f64) {
        self.queues[stream.place().0].push_back(draw);
    }

    /// How often a draw was asked for that the script does not hold (½ was given).
    #[must_use]
    pub const fn missing(&self) -> u32 {
        self.missing
    }
}

impl Chance for Scripted {
    fn uniform(&mut self, stream: Stream) -> f64 {
        self.queues[stream.place().0].pop_front().unwrap_or_else(|| {
            self.missing += 1;
            0.5
        })
    }

    fn first(&self, stream: Stream, draws: &mut [f64]) {
        let mut script = self.queues[stream.place().0].iter().copied();
        draws.fill_with(|| script.next().unwrap_or(0.5));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first draws of each stream: committed, so that no change of a dependency moves a scenario.
    #[test]
    fn regress_golden_first_draws() {
        let mut chance = Seeded::new(Seed::new(42).unwrap());
        let streams = [
            Stream::Agents,
            Stream::Bodies,
            Stream::Redraw(0),
            Stream::Redraw(7),
            Stream::Arrivals,
            Stream::ArrivalPlace,
            Stream::Fragments,
            Stream::Planner,
            Stream::Policy,
            Stream::Plant,
            Stream::Warning { step: 0, satellite: 0, debris: 0 },
            Stream::Warning { step: 7, satellite: 2, debris: 300 },
        ];
        let draws: Vec<String> = streams
            .iter()
            .map(|&s| format!("{s:?} {:?} {:?}", chance.uniform(s), chance.uniform(s)))
            .collect();
        insta::assert_debug_snapshot!(draws);
    }

    #[test]
    fn one_more_draw_of_one_kind_shifts_no_other() {
        let seed = Seed::new(7).unwrap();
        let (mut a, mut b) = (Seeded::new(seed), Seeded::new(seed));
        for _ in 0..100 {
            b.uniform(Stream::Fragments);
        }
        for _ in 0..10 {
            assert_eq!(a.uniform(Stream::Bodies).to_bits(), b.uniform(Stream::Bodies).to_bits());
        }
    }

    #[test]
    fn looking_at_first_draws_draws_nothing() {
        let stream = Stream::Warning { step: 3, satellite: 1, debris: 12 };
        let mut chance = Seeded::new(Seed::new(7).unwrap());
        let (mut before, mut after) = ([0.0; 3], [0.0; 3]);
        chance.first(stream, &mut before);
        let drawn = [(); 3].map(|()| chance.uniform(stream));
        chance.first(stream, &mut after);
        assert_eq!((before, before), (drawn, after));
        let mut script = Scripted::new();
        script.push(stream, 0.25);
        script.first(stream, &mut before);
        assert_eq!((before, script.missing(), script.uniform(stream)), ([0.25, 0.5, 0.5], 0, 0.25));
    }

    #[test]
    fn normals_are_normal() {
        let chance = Seeded::new(Seed::new(1).unwrap());
        let n = 50_000u32;
        let (mut mean, mut square, mut cross, mut beyond) = (0.0, 0.0, 0.0, 0u32);
        for debris in 0..n {
            let (a, b) = chance.first_normals(Stream::Warning { step: 1, satellite: 0, debris });
            mean += (a + b) / f64::from(2 * n);
            square += (a * a + b * b) / f64::from(2 * n);
            cross += a * b / f64::from(n);
            beyond += u32::from(a.abs() > 1.959_964) + u32::from(b.abs() > 1.959_964);
        }
        // Five standard deviations each: of the mean of 2n draws 1/√2n, of their mean square √2/√2n, of the mean of n
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
        let mut chance = Seeded::new(Seed::new(1).unwrap());
        let n = 100_000;
        let mean = (0..n).map(|_| chance.uniform(Stream::Bodies)).sum::<f64>() / f64::from(n);
        // The mean of n uniform draws has a standard deviation of √(1/12n) = 0.0009: five of them.
        assert!((mean - 0.5).abs() < 0.0046, "{mean}");
    }
}
