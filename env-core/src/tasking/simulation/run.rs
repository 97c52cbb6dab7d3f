//! Runs the ticks of steps: the satellites of one episode, or of many, side by side in lanes.
//!
//! The satellites of an episode run in neighbouring lanes. When its step ends, its lanes take the next episode, so that unequal
//! durations leave no lane idle. The results do not depend on which episodes share a block.

use super::TaskingSim;
use crate::tasking::tick::block::Block;
use crate::tasking::tick::dispatch::{BLOCK_LANES, BlockLanes, InstructionSet, TickRun};

/// Largest number of ticks that run without a look at the events.
const MAX_TICKS: u64 = 1 << 20;

/// Episodes whose ticks are run.
pub trait RunSet {
    /// Number of episodes to run.
    fn len(&self) -> usize;

    /// The episode of an index.
    fn episode(&mut self, index: usize) -> &mut TaskingSim;

    /// True if there are no episodes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Begins the next step of an episode whose step has ended. Returns false if the episode runs no further ticks.
    fn begin_next_step(&mut self, _index: usize) -> bool {
        false
    }
}

impl RunSet for [&mut TaskingSim] {
    fn len(&self) -> usize {
        <[&mut TaskingSim]>::len(self)
    }

    fn episode(&mut self, index: usize) -> &mut TaskingSim {
        self[index]
    }
}

/// Runs the ticks of one episode's step to its end.
pub fn run_one(sim: &mut TaskingSim, set: InstructionSet) {
    let mut one = [sim];
    if one[0].len() == 1 {
        run_blocks::<1>(&mut one[..], 1, set);
    } else {
        run_all(&mut one[..], set);
    }
}

/// Runs the ticks of one episode's step to its end, and calls `observe` after each.
pub fn run_traced(sim: &mut TaskingSim, observe: &mut dyn FnMut(&TaskingSim)) {
    let satellites = sim.len();
    let blocks = satellites.div_ceil(BLOCK_LANES);
    let blocks = vec![Block::<BLOCK_LANES>::new(sim.setup.clock.tick); blocks];
    let mut lanes = LaneBlocks { blocks, set: InstructionSet::detect() };
    let mut slot = lanes.load(0, sim, 0);
    loop {
        slot.pending += lanes.run(1);
        let goes_on = lanes.advance(&mut slot, sim);
        if goes_on {
            for (i, agent) in sim.agents.iter_mut().enumerate() {
                lanes.blocks[i / BLOCK_LANES].store(i % BLOCK_LANES, &mut agent.satellite.state);
            }
        }
        observe(sim);
        if !goes_on {
            return;
        }
    }
}

/// Runs the ticks of the steps of several episodes to their ends.
pub fn run_all(episodes: &mut (impl RunSet + ?Sized), set: InstructionSet) {
    let largest = (0..episodes.len()).map(|index| episodes.episode(index).len()).max().unwrap_or(0);
    run_blocks::<BLOCK_LANES>(episodes, largest, set);
}

/// An episode in lanes.
struct EpisodeLanes {
    /// Index of the episode.
    episode: usize,
    /// First lane, counted over all blocks.
    first_lane: usize,
    /// Last tick for which the inputs of each satellite hold.
    until: Vec<u64>,
    /// Number of ticks after which the inputs of a satellite change or an event is due.
    due: u64,
    /// Number of ticks that ran since the episode was last processed.
    pending: u64,
}

/// Runs episodes with up to `largest` satellites in blocks of `W` lanes.
fn run_blocks<const W: usize>(episodes: &mut (impl RunSet + ?Sized), largest: usize, set: InstructionSet)
where
    for<'a> TickRun<'a, W>: BlockLanes<W>,
{
    if episodes.is_empty() || largest == 0 {
        return;
    }
    let tick = episodes.episode(0).setup.clock.tick;
    let (blocks, slots) = block_count(W, largest, episodes.len());
    let mut lanes = LaneBlocks { blocks: vec![Block::<W>::new(tick); blocks], set };
    let mut next_episode = 0;
    let mut active: Vec<EpisodeLanes> = Vec::with_capacity(slots);
    let mut free: Vec<usize> = (0..slots.min(episodes.len())).rev().map(|slot| slot * largest).collect();
    loop {
        while next_episode < episodes.len()
            && let Some(first_lane) = free.pop()
        {
            active.push(lanes.load(next_episode, episodes.episode(next_episode), first_lane));
            next_episode += 1;
        }
        if active.is_empty() {
            return;
        }
        let ticks = active.iter().map(|slot| slot.due - slot.pending).min().unwrap_or(1);
        let ran = lanes.run(ticks);
        // An image stops the ticks before any episode is due.
        let has_image = lanes.has_image();
        active.retain_mut(|slot| {
            slot.pending += ran;
            if slot.pending < slot.due && !has_image {
                return true;
            }
            let EpisodeLanes { episode, first_lane, .. } = *slot;
            if lanes.advance(slot, episodes.episode(episode)) {
                return true;
            }
            let goes_on = episodes.begin_next_step(episode);
            if goes_on {
                *slot = lanes.load(episode, episodes.episode(episode), first_lane);
            } else {
                free.push(first_lane);
            }
            goes_on
        });
    }
}

/// Number of blocks of `width` lanes that run in step, and of episodes with up to `largest` satellites that they hold.
///
/// As few blocks as possible are used, unless more of them leave far fewer lanes idle: an event in any block stops all of them.
fn block_count(width: usize, largest: usize, episodes: usize) -> (usize, usize) {
    /// Largest number of blocks beyond those that one episode needs.
    const MORE_BLOCKS: usize = 3;
    /// Least gain of the lanes in use that outweighs the stops of another block, as a fraction.
    const LEAST_GAIN: [usize; 2] = [7, 5];
    let least = largest.div_ceil(width);
    let held = |blocks: usize| (blocks * width / largest).min(episodes);
    // Lanes in use per lane of the blocks, compared as fractions.
    let is_fuller = |a: usize, b: usize| LEAST_GAIN[1] * held(a) * b > LEAST_GAIN[0] * held(b) * a;
    let best =
        (least + 1..=least + MORE_BLOCKS).fold(least, |best, b| if is_fuller(b, best) { b } else { best });
    (best, held(best))
}

impl EpisodeLanes {
    /// Number of ticks until the inputs of a satellite change or an event is due, at least one.
    fn ticks_to_event(&self, sim: &TaskingSim) -> u64 {
        let inputs = self.until.iter().copied().min().unwrap_or(u64::MAX);
        let event = sim.next_event().unwrap_or(u64::MAX);
        inputs.min(event).saturating_sub(sim.now).clamp(1, MAX_TICKS)
    }
}

/// Blocks of lanes that run in step.
struct LaneBlocks<const W: usize> {
    blocks: Vec<Block<W>>,
    set: InstructionSet,
}

impl<const W: usize> LaneBlocks<W>
where
    for<'a> TickRun<'a, W>: BlockLanes<W>,
{
    /// Loads an episode into lanes.
    fn load(&mut self, episode: usize, sim: &mut TaskingSim, first_lane: usize) -> EpisodeLanes {
        let now = sim.now;
        let mut until = Vec::with_capacity(sim.agents.len());
        for (i, agent) in sim.agents.iter_mut().enumerate() {
            let lane = first_lane + i;
            let block = &mut self.blocks[lane / W];
            until.push(agent.satellite.load(now, block, lane % W, &mut sim.sky));
        }
        let mut slot = EpisodeLanes { episode, first_lane, until, due: 0, pending: 0 };
        slot.due = slot.ticks_to_event(sim);
        slot
    }

    /// True if an awaited image is stored in any lane.
    fn has_image(&self) -> bool {
        self.blocks.iter().any(|block| {
            block
                .state
                .stored
                .iter()
                .zip(&block.inputs.supply.awaited_bits)
                .any(|(stored, bits)| stored > bits)
        })
    }

    /// Runs up to `ticks` ticks in all blocks. Returns their number.
    fn run(&mut self, ticks: u64) -> u64 {
        let mut ticks = u32::try_from(ticks).unwrap_or(u32::MAX);
        if let [block] = &mut self.blocks[..] {
            return u64::from(block.run(ticks, self.set));
        }
        // An image stops one block before the others, which then start over and stop there, too.
        let starts: Vec<_> = self.blocks.iter().map(|block| block.state).collect();
        let mut ran = Vec::with_capacity(starts.len());
        for block in &mut self.blocks {
            ticks = block.run(ticks, self.set);
            ran.push(ticks);
        }
        for ((block, start), ran) in self.blocks.iter_mut().zip(starts).zip(ran) {
            if ran > ticks {
                block.state = start;
                block.run(ticks, self.set);
            }
        }
        u64::from(ticks)
    }

    /// Processes what follows the pending ticks of an episode. Returns false if its step has ended; then its lanes are free.
    fn advance(&mut self, slot: &mut EpisodeLanes, sim: &mut TaskingSim) -> bool {
        sim.now += std::mem::take(&mut slot.pending);
        let now = sim.now;
        for (i, agent) in sim.agents.iter_mut().enumerate() {
            let lane = slot.first_lane + i;
            let block = &mut self.blocks[lane / W];
            if slot.until[i] <= now || agent.satellite.awaits_downlink() {
                // A transmitter runs single ticks in a pass while data are recorded: these are the bits before the last one.
                let before = agent.satellite.state.stored;
                agent.satellite.finish_tick(now, block, lane % W, before, &mut sim.sky);
            }
            agent.satellite.state.stored = block.state.stored[lane % W];
        }
        let is_ended = sim.process_events();
        for (i, agent) in sim.agents.iter_mut().enumerate() {
            let lane = slot.first_lane + i;
            let block = &mut self.blocks[lane / W];
            if is_ended {
                block.store(lane % W, &mut agent.satellite.state);
                block.clear(lane % W);
                if now < slot.until[i] {
                    agent.satellite.skip_transmitter_to(now);
                }
                continue;
            }
            let awaited = agent.satellite.awaited_bits.unwrap_or(f64::INFINITY);
            block.inputs.supply.awaited_bits[lane % W] = awaited;
            if slot.until[i] <= now {
                slot.until[i] = agent.satellite.refresh(now, block, lane % W, &mut sim.sky);
            }
        }
        if !is_ended {
            slot.due = slot.ticks_to_event(sim);
        }
        !is_ended
    }
}
