/**
 * Comparison of screenshots that does not depend on how a machine draws letters. A screenshot is reduced to the mean colours of its
 * blocks: the edges of letters and lines average out, while a missing line, letter or colour changes the mean.
 */
import pixelmatch from "pixelmatch";
import { PNG } from "pngjs";

/** Width and height of a block, in pixels of the screenshot. */
const BLOCK = 5;
/** Distance of colours (OKLab, 0 to 1) up to which two blocks are equal. */
const COLOUR_TOLERANCE = 0.08;
/**
 * Width and height of the window that moves over the blocks, and the number of different blocks in it that is accepted. Texts of charts in
 * another font make up to 10 blocks differ; a single curve, a legend or a column of a table that vanishes makes 20 to 30 differ.
 */
const WINDOW = { size: 16, different: 16 };

/** Reduces a screenshot, as a PNG file, to the mean colours of its blocks. Parts of blocks at the edges are left out. */
export function reduceToBlocks(screenshot: Buffer): PNG {
  const source = PNG.sync.read(screenshot);
  const [width, height] = [Math.floor(source.width / BLOCK), Math.floor(source.height / BLOCK)];
  const reduced = new PNG({ width, height });
  for (let y = 0; y < height; y += 1)
    for (let x = 0; x < width; x += 1) {
      const sums = [0, 0, 0];
      for (let i = 0; i < BLOCK * BLOCK; i += 1) {
        const [column, row] = [x * BLOCK + (i % BLOCK), y * BLOCK + Math.floor(i / BLOCK)];
        const at = 4 * (row * source.width + column);
        for (let channel = 0; channel < 3; channel += 1)
          sums[channel] = (sums[channel] ?? 0) + (source.data[at + channel] ?? 0);
      }
      const mean = sums.map((sum) => Math.round(sum / (BLOCK * BLOCK)));
      reduced.data.set([...mean, 255], 4 * (y * width + x));
    }
  return reduced;
}

/** Returns how two reduced screenshots differ in a sentence; empty if the difference is within the tolerance. */
export function describeDifference(actual: PNG, expected: PNG): string {
  const size = ({ width, height }: PNG) => `${String(BLOCK * width)} × ${String(BLOCK * height)} px`;
  if (actual.width !== expected.width || actual.height !== expected.height)
    return `the size is ${size(actual)} instead of ${size(expected)}`;
  const { width, height } = expected;
  const different = pixelmatch(actual.data, expected.data, null, width, height, {
    threshold: COLOUR_TOLERANCE,
    includeAA: true, // pixels are blocks: none of them is an edge of a letter
    windowSize: WINDOW.size,
  });
  if (different <= WINDOW.different) return "";
  const window = `${String(BLOCK * WINDOW.size)} px`;
  return `${String(different)} blocks differ within ${window}, and ${String(WINDOW.different)} are accepted`;
}
