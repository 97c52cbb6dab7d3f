/** Statistics over the runs of a group, which differ by their seeds. */

/** What the band around the mean of a group shows. */
export type BandKind = "interval" | "deviation" | "extremes";

export const BANDS: [BandKind, string][] = [
  ["interval", "95 % interval of the mean"],
  ["deviation", "± standard deviation"],
  ["extremes", "minimum to maximum"],
];

/** Mean of several values with a band around it. */
export interface MeanBand {
  mean: number;
  low: number;
  high: number;
}

/** 97.5 % quantiles of Student's t distribution with 1 to 30 degrees of freedom. */
const T_QUANTILES = [
  12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.16, 2.145, 2.131,
  2.12, 2.11, 2.101, 2.093, 2.086, 2.08, 2.074, 2.069, 2.064, 2.06, 2.056, 2.052, 2.048, 2.045, 2.042,
];

/** Returns the 97.5 % quantile of Student's t distribution. */
export function tQuantile(degrees: number): number {
  const z = 1.959964;
  // Beyond the table: the first terms of the expansion around the normal distribution.
  return T_QUANTILES[degrees - 1] ?? z + (z ** 3 + z) / (4 * degrees);
}

/** Number of values below which there is no interval of the mean: the one of two values is wider than any axis. */
export const MIN_INTERVAL = 3;

/** Lowest and highest possible value of a quantity. */
export interface Bounds {
  min?: number;
  max?: number;
}

/**
 * Returns the mean of the values with its band within the bounds; undefined without values. A single value has no width.
 * Two values have no interval of the mean: the band is from one to the other.
 */
export function meanBand(values: number[], kind: BandKind, bounds: Bounds = {}): MeanBand | undefined {
  const n = values.length;
  if (n === 0) return undefined;
  const mean = values.reduce((sum, value) => sum + value, 0) / n;
  if (n === 1) return { mean, low: mean, high: mean };
  if (kind === "extremes" || (kind === "interval" && n < MIN_INTERVAL))
    return { mean, low: Math.min(...values), high: Math.max(...values) };
  const deviation = Math.sqrt(values.reduce((sum, value) => sum + (value - mean) ** 2, 0) / (n - 1));
  const half = kind === "deviation" ? deviation : (tQuantile(n - 1) * deviation) / Math.sqrt(n);
  const { min = -Infinity, max = Infinity } = bounds;
  return { mean, low: Math.max(min, mean - half), high: Math.min(max, mean + half) };
}
