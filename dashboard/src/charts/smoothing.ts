/** Smoothing of curves. */
import type { Interval } from "./shown-range.svelte";

/** Weight of earlier values in charts whose user has chosen none. */
export const DEFAULT_SMOOTHING = 0.5;

/**
 * Returns the exponential moving average of the values, without the bias of its start (as Adam: Kingma and Ba 2015).
 * `weight` is that of the earlier values, from 0 to below 1. Unknown values stay unknown and change nothing. A value outside of
 * `kept`, an outlier, changes nothing either: the average stays as it was before the value.
 */
export function smooth(values: (number | null)[], weight: number, kept?: Interval | null): (number | null)[] {
  let [sum, total] = [0, 0];
  return values.map((value) => {
    if (value === null || !Number.isFinite(value)) return value;
    if (!kept || (value >= kept.from && value <= kept.to)) {
      sum = weight * sum + (1 - weight) * value;
      total = weight * total + (1 - weight);
    }
    return total > 0 ? sum / total : null;
  });
}
