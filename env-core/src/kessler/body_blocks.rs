//! Bodies in blocks of a fixed size, column by column, one block after the other in memory. A block
//! holds a whole number of the machine's vectors, so a pass over all bodies reads one stream and
//! has no remainder.

use super::kernel::Body;

/// Bodies per block. The widest vectors of today hold eight f64.
pub(super) const BLOCK_LEN: usize = 8;
/// Coordinate of empty places, LU: far from everything and still finite.
pub(super) const ABSENT_COORDINATE: f64 = 1e12;
/// Body in an empty place.
pub(super) const ABSENT_BODY: Body = Body { x: ABSENT_COORDINATE, y: ABSENT_COORDINATE, vx: 0.0, vy: 0.0 };

/// [`BLOCK_LEN`] bodies, column by column.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct BodyBlock {
    pub x: [f64; BLOCK_LEN],
    pub y: [f64; BLOCK_LEN],
    pub vx: [f64; BLOCK_LEN],
    pub vy: [f64; BLOCK_LEN],
}

impl BodyBlock {
    /// Block without any body.
    pub(super) const EMPTY: Self = Self {
        x: [ABSENT_COORDINATE; BLOCK_LEN],
        y: [ABSENT_COORDINATE; BLOCK_LEN],
        vx: [0.0; BLOCK_LEN],
        vy: [0.0; BLOCK_LEN],
    };

    /// Column `C`: 0 is x, 1 is y, 2 is vx, 3 is vy.
    #[inline(always)]
    pub(super) const fn column<const C: usize>(&self) -> &[f64; BLOCK_LEN] {
        match C {
            0 => &self.x,
            1 => &self.y,
            2 => &self.vx,
            _ => &self.vy,
        }
    }

    /// Returns the body at a place below [`BLOCK_LEN`].
    pub(super) const fn body(&self, i: usize) -> Body {
        Body { x: self.x[i], y: self.y[i], vx: self.vx[i], vy: self.vy[i] }
    }

    /// Stores a body at a place below [`BLOCK_LEN`].
    pub(super) const fn set(&mut self, i: usize, body: Body) {
        self.x[i] = body.x;
        self.y[i] = body.y;
        self.vx[i] = body.vx;
        self.vy[i] = body.vy;
    }
}

/// Ordered list of bodies, stored in blocks.
#[derive(Debug, Clone, Default)]
pub(super) struct BodyBlocks {
    blocks: Vec<BodyBlock>,
    len: usize,
}

impl BodyBlocks {
    /// Number of bodies in the list.
    pub(super) const fn len(&self) -> usize {
        self.len
    }

    /// Number of bodies that fit without an allocation.
    pub(super) fn capacity(&self) -> usize {
        self.blocks.capacity() * BLOCK_LEN
    }

    /// Memory of the blocks, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<BodyBlock>()
    }

    /// Returns the body at an index below `len`.
    pub(super) fn body(&self, i: usize) -> Body {
        self.blocks[i / BLOCK_LEN].body(i % BLOCK_LEN)
    }

    /// Iterates over all bodies in order.
    pub(super) fn bodies(&self) -> impl Iterator<Item = Body> {
        (0..self.len).map(|i| self.body(i))
    }

    /// Replaces the body at an index below `len`.
    pub(super) fn set(&mut self, i: usize, body: Body) {
        self.blocks[i / BLOCK_LEN].set(i % BLOCK_LEN, body);
    }

    /// All blocks. Places from `len` on hold [`ABSENT_BODY`].
    pub(super) fn blocks(&self) -> &[BodyBlock] {
        &self.blocks
    }

    /// Mutable blocks, to move the bodies in them.
    pub(super) fn blocks_mut(&mut self) -> &mut [BodyBlock] {
        &mut self.blocks
    }

    /// Removes all bodies and reserves memory for `capacity` of them.
    pub(super) fn clear(&mut self, capacity: usize) {
        self.blocks.clear();
        self.blocks.reserve(capacity.div_ceil(BLOCK_LEN));
        self.len = 0;
    }

    /// Appends a block whose first `count` places hold bodies. All earlier blocks must be full.
    pub(super) fn push_block(&mut self, mut block: BodyBlock, count: usize) {
        for i in count..BLOCK_LEN {
            block.set(i, ABSENT_BODY);
        }
        self.blocks.push(block);
        self.len += count;
    }

    /// Appends one body to the list.
    pub(super) fn push(&mut self, body: Body) {
        if self.len == self.blocks.len() * BLOCK_LEN {
            self.blocks.push(BodyBlock::EMPTY);
        }
        self.len += 1;
        self.set(self.len - 1, body);
    }

    /// Removes the body at an index below `len` and moves those after it up by one.
    pub(super) fn remove(&mut self, i: usize) {
        for next in i + 1..self.len {
            self.set(next - 1, self.body(next));
        }
        self.len -= 1;
        self.set(self.len, ABSENT_BODY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn body_blocks_behave_like_a_vec() {
        let body = |n: f64| Body { x: n, y: n + 0.25, vx: n + 0.5, vy: n + 0.75 };
        let (mut blocks, mut list) = (BodyBlocks::default(), Vec::new());
        for round in 0..200usize {
            if round % 3 == 2 {
                let at = round * 7 % list.len();
                blocks.remove(at);
                list.remove(at);
            } else {
                blocks.push(body(round as f64));
                list.push(body(round as f64));
            }
            assert_eq!((blocks.len(), blocks.bodies().collect::<Vec<_>>()), (list.len(), list.clone()));
            let padding = (0..blocks.blocks().len() * BLOCK_LEN)
                .map(|i| blocks.blocks()[i / BLOCK_LEN].body(i % BLOCK_LEN));
            assert!(padding.skip(list.len()).all(|b| b == ABSENT_BODY), "{round}");
        }
    }
}
