//! Bodies in blocks, each of a whole number of the machine's vectors, one block after the other in memory: what a pass
//! over all of them reads is one stream, and it has no remainder.

use super::constants::SATELLITES;
use super::kernel::{Body, Gravity};
use super::pass;

/// Bodies of a block: the widest vectors of today hold eight f64.
pub(super) const BLOCK: usize = 8;
/// Where bodies are put that are not there: far from everything, and still a number.
pub(super) const NOWHERE: f64 = 1e12;
/// Debris that is not there.
pub(super) const ABSENT: Body = Body { x: NOWHERE, y: NOWHERE, vx: 0.0, vy: 0.0 };

/// Eight bodies, column by column.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Block {
    pub x: [f64; BLOCK],
    pub y: [f64; BLOCK],
    pub vx: [f64; BLOCK],
    pub vy: [f64; BLOCK],
}

impl Block {
    /// Nobody there.
    pub(super) const EMPTY: Self =
        Self { x: [NOWHERE; BLOCK], y: [NOWHERE; BLOCK], vx: [0.0; BLOCK], vy: [0.0; BLOCK] };

    /// x, y, vx or vy.
    #[inline(always)]
    pub(super) const fn column<const C: usize>(&self) -> &[f64; BLOCK] {
        match C {
            0 => &self.x,
            1 => &self.y,
            2 => &self.vx,
            _ => &self.vy,
        }
    }

    /// The body in a place below [`BLOCK`].
    pub(super) const fn body(&self, i: usize) -> Body {
        Body { x: self.x[i], y: self.y[i], vx: self.vx[i], vy: self.vy[i] }
    }

    /// Puts a body in a place below [`BLOCK`].
    pub(super) const fn set(&mut self, i: usize, body: Body) {
        self.x[i] = body.x;
        self.y[i] = body.y;
        self.vx[i] = body.vx;
        self.vy[i] = body.vy;
    }
}

/// Bodies in order.
#[derive(Debug, Clone, Default)]
pub(super) struct Cloud {
    blocks: Vec<Block>,
    len: usize,
}

impl Cloud {
    /// How many there are.
    pub(super) const fn len(&self) -> usize {
        self.len
    }

    /// Bodies there is room for.
    pub(super) fn capacity(&self) -> usize {
        self.blocks.capacity() * BLOCK
    }

    /// Bytes of the blocks.
    pub(super) fn bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<Block>()
    }

    /// The body at an index below `len`.
    pub(super) fn body(&self, i: usize) -> Body {
        self.blocks[i / BLOCK].body(i % BLOCK)
    }

    /// All, in order.
    pub(super) fn bodies(&self) -> impl Iterator<Item = Body> {
        (0..self.len).map(|i| self.body(i))
    }

    /// Moves the body at an index below `len`.
    pub(super) fn set(&mut self, i: usize, body: Body) {
        self.blocks[i / BLOCK].set(i % BLOCK, body);
    }

    /// The blocks; places from `len` on are [`NOWHERE`].
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The blocks, to move what is in them.
    pub(super) fn blocks_mut(&mut self) -> &mut [Block] {
        &mut self.blocks
    }

    /// None, with room for so many.
    pub(super) fn clear(&mut self, room: usize) {
        self.blocks.clear();
        self.blocks.reserve(room.div_ceil(BLOCK));
        self.len = 0;
    }

    /// A block of `there` bodies after the others, which must fill theirs.
    pub(super) fn push_block(&mut self, mut block: Block, there: usize) {
        for i in there..BLOCK {
            block.set(i, ABSENT);
        }
        self.blocks.push(block);
        self.len += there;
    }

    /// One more.
    pub(super) fn push(&mut self, body: Body) {
        if self.len == self.blocks.len() * BLOCK {
            self.blocks.push(Block::EMPTY);
        }
        self.len += 1;
        self.set(self.len - 1, body);
    }

    /// Takes out the body at an index below `len`; those after it move up.
    pub(super) fn remove(&mut self, i: usize) {
        for at in i + 1..self.len {
            self.set(at - 1, self.body(at));
        }
        self.len -= 1;
        self.set(self.len, ABSENT);
    }
}

/// How near each of these bodies comes to satellites on these paths, LU: a row of `paths` is where they are after a step,
/// the first where everything starts. Nobody burns, and what falls into the Earth comes out again: who asks wants bodies
/// that keep clear.
#[must_use]
pub fn least_distances(
    bodies: &[Body],
    paths: &[[Body; SATELLITES]],
    gravity: Gravity,
    swept: bool,
) -> Vec<f64> {
    let mut cloud = Cloud::default();
    cloud.clear(bodies.len());
    bodies.iter().for_each(|body| cloud.push(*body));
    let mut least = Vec::with_capacity(cloud.blocks.len() * BLOCK);
    pass::nearest(gravity, swept, &cloud.blocks, paths, |_, nearest_2| {
        least.extend(nearest_2.iter().map(|d2| d2.sqrt()));
    });
    least.truncate(bodies.len());
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_holds_what_a_list_holds() {
        let body = |n: f64| Body { x: n, y: n + 0.25, vx: n + 0.5, vy: n + 0.75 };
        let (mut cloud, mut list) = (Cloud::default(), Vec::new());
        for turn in 0..200usize {
            if turn % 3 == 2 {
                let at = turn * 7 % list.len();
                cloud.remove(at);
                list.remove(at);
            } else {
                cloud.push(body(turn as f64));
                list.push(body(turn as f64));
            }
            assert_eq!((cloud.len(), cloud.bodies().collect::<Vec<_>>()), (list.len(), list.clone()));
            let padding =
                (0..cloud.blocks().len() * BLOCK).map(|i| cloud.blocks()[i / BLOCK].body(i % BLOCK));
            assert!(padding.skip(list.len()).all(|b| b == ABSENT), "{turn}");
        }
    }
}
