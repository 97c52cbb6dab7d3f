/** Ranges of the axes of charts, which the numbers of the axis can divide: finite, and wide enough for the precision of doubles. */

/** Smallest width of a range, as a share of its largest absolute value; a narrower one counts as constant. */
export const MIN_RELATIVE_WIDTH = 1e-9;
/** Largest absolute value that is drawn: the width of a range of larger values can overflow. */
const MAX_DRAWN = 1e300;
/** Smallest margin: a share of a smaller value can be 0. */
const MIN_MARGIN = 1e-305;
const MARGIN = 0.05;

/** Returns the values to draw: null, a gap, for those that are too large or not finite. */
export function drawnValues(values: (number | null)[]): (number | null)[] {
  return values.map((value) => (value !== null && Math.abs(value) <= MAX_DRAWN ? value : null));
}

/**
 * Returns the range of a value axis: the values from `low` to `high` with a margin of 5 % of their width, or of their size if
 * they are constant. Bounds are kept; null and undefined stand for no value and no bound.
 */
export function valueRange(
  low: number | null,
  high: number | null,
  bounds: { min?: number | undefined; max?: number | undefined } = {},
): [number, number] {
  const from = bounds.min ?? low ?? 0;
  const to = bounds.max ?? high ?? 1;
  const size = Math.max(Math.abs(from), Math.abs(to));
  const isConstant = to - from <= MIN_RELATIVE_WIDTH * size;
  const margin = size === 0 ? 1 : Math.max(MARGIN * (isConstant ? size : to - from), MIN_MARGIN);
  return [bounds.min ?? from - margin, bounds.max ?? to + margin];
}
