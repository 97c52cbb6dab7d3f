/** Rows of a long list that are drawn: those in the window, and some before and after it. */

export interface RowWindow {
  first: number;
  /** Row after the last one. */
  end: number;
}

/**
 * Returns the rows to draw of a list of `count` rows of `height` pixels each. The list begins `top` pixels below the upper edge of the
 * window (negative if it is above), which is `windowHeight` pixels high.
 */
export function rowWindow(
  count: number,
  height: number,
  top: number,
  windowHeight: number,
  margin = 8,
): RowWindow {
  if (height <= 0) return { first: 0, end: Math.min(count, 1) };
  const clamp = (row: number) => Math.max(0, Math.min(count, row));
  return {
    first: clamp(Math.floor(-top / height) - margin),
    end: clamp(Math.ceil((windowHeight - top) / height) + margin),
  };
}
