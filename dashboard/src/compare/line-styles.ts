/** Colours and dashes of curves: eight colours that are distinguishable with colour blindness, then the same ones dashed. */
import "./line-styles.css";

/** Look of a curve. */
export interface LineStyle {
  /** CSS custom property of the colour, --r0 to --r7. */
  colour: string;
  /** Lengths of dashes and gaps in pixels; undefined for a solid line. */
  dash: number[] | undefined;
}

/** Number of colours. */
const COLOURS = 8;
const DASHES = [undefined, [8, 4], [2, 3], [10, 3, 2, 3]];

/** Returns the style of the curve with this index. Styles repeat after 32 curves. */
export function lineStyle(index: number): LineStyle {
  return {
    colour: `--r${String(index % COLOURS)}`,
    dash: DASHES[Math.floor(index / COLOURS) % DASHES.length],
  };
}
