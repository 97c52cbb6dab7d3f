//! Writes bodies as observation columns in single precision, in the machine's vector width.

use pulp::{Simd, WithSimd};

use super::body_blocks::{BLOCK_LEN, BodyBlock};

/// Writes the first `slots` bodies as five columns of `slots` values each: x, y, vx, vy rounded to f32, then
/// 1 where there is a body. All columns are zero from the `count`-th place on.
pub(super) struct ColumnWriter<'a> {
    pub blocks: &'a [BodyBlock],
    pub out: &'a mut [f32],
    pub slots: usize,
    pub count: usize,
}

impl WithSimd for ColumnWriter<'_> {
    type Output = ();

    /// Plain loops over blocks of a fixed size: the compiler vectorises them once they are inlined where the
    /// machine's vectors are known. Columns are written one after the other, so memory is written as one
    /// stream.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let ColumnWriter { blocks, out, slots, count } = self;
        write_column::<0>(blocks, out, slots, count);
        write_column::<1>(blocks, &mut out[slots..], slots, count);
        write_column::<2>(blocks, &mut out[2 * slots..], slots, count);
        write_column::<3>(blocks, &mut out[3 * slots..], slots, count);
        for (i, cell) in out[4 * slots..].iter_mut().enumerate() {
            *cell = if i < count { 1.0 } else { 0.0 };
        }
    }
}

/// Writes column `C` to the front of `out`. May overwrite cells after it, since columns are written in order.
#[inline(always)]
fn write_column<const C: usize>(blocks: &[BodyBlock], out: &mut [f32], slots: usize, count: usize) {
    let full = count / BLOCK_LEN;
    let (chunks, _) = out[..slots].as_chunks_mut::<BLOCK_LEN>();
    for (chunk, block) in chunks.iter_mut().zip(&blocks[..full]) {
        *chunk = to_f32(block.column::<C>());
    }
    for from in (full * BLOCK_LEN..slots).step_by(BLOCK_LEN) {
        let mut cells =
            blocks.get(from / BLOCK_LEN).map_or([0.0; BLOCK_LEN], |block| to_f32(block.column::<C>()));
        for (i, cell) in cells.iter_mut().enumerate() {
            *cell = if from + i < count { *cell } else { 0.0 };
        }
        if let Some(chunk) = out[from..].first_chunk_mut() {
            *chunk = cells;
        } else {
            out[from..].iter_mut().zip(cells).for_each(|(to, cell)| *to = cell);
        }
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
fn to_f32(from: &[f64; BLOCK_LEN]) -> [f32; BLOCK_LEN] {
    let mut to = [0.0; BLOCK_LEN];
    for i in 0..BLOCK_LEN {
        to[i] = from[i] as f32;
    }
    to
}
